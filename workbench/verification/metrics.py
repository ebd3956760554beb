"""Metrics of a closed-loop run: numbers with units, or NaN with the reason."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.errors import check_choice
from workbench.model.units import convert
from workbench.verification import responses
from workbench.verification.each_step import each_step
from workbench.verification.responses import Figure
from workbench.verification.run import Run

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Metric:
    """One number of a run.

    Args:
        name: Name of the metric.
        value: The number in ``unit``, NaN if there is none.
        unit: SI unit.
        reason: Why there is no number; empty if there is one.
        display_unit: Unit in which people read it.

    Example:
        >>> print(Metric("settling_time", 0.45, "s"))
        settling_time                  0.45 s
    """

    name: str
    value: float
    unit: str
    reason: str = ""
    display_unit: str = ""

    def shown(self) -> tuple[float, str]:
        """Return the value and the unit in which people read it."""
        unit = self.display_unit or self.unit
        return (float(convert(self.value, self.unit, unit)), unit)

    def __str__(self) -> str:
        """Return one line."""
        value, unit = self.shown()
        text = f"{self.name:<24} {value:>10.4g} {'' if unit == '1' else unit}".rstrip()
        return f"{text}  ({self.reason})" if self.reason else text


@dataclass(frozen=True)
class Metrics(Mapping[str, Metric]):
    """All metrics of a run, by name.

    Args:
        controller: Name of the controller.
        plant: Name of the plant.
        scenario: Name of the scenario.
        values: The metrics.

    Example:
        >>> print(Metrics("pid", "arm", "step", (Metric("settling_time", 0.45, "s"),)))
        pid on arm, step
          settling_time                  0.45 s
    """

    controller: str
    plant: str
    scenario: str
    values: tuple[Metric, ...]  # type: ignore[assignment]

    def __getitem__(self, name: str) -> Metric:
        """Return a metric by name."""
        check_choice("metric", name, [m.name for m in self.values])
        return next(m for m in self.values if m.name == name)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(m.name for m in self.values)

    def __len__(self) -> int:
        """Return the number of metrics."""
        return len(self.values)

    def __contains__(self, name: object) -> bool:
        """Tell whether there is a metric of a name."""
        return any(m.name == name for m in self.values)

    def __str__(self) -> str:
        """Return a short aligned table."""
        head = f"{self.controller} on {self.plant}, {self.scenario}"
        return "\n".join([head, *(f"  {metric}" for metric in self.values)])


def metrics(run: Run) -> Metrics:
    """Compute every metric of a run.

    Of several steps the worst counts. Figures of the output use the plant's output without noise.

    Args:
        run: The run.

    Returns:
        ``settling_time``, ``rise_time``, ``overshoot``, ``steady_error``, ``oscillation`` (what
        still moves when the reference has been constant: a limit cycle), ``rmse``, ``iae`` per
        followed output; ``chatter`` per command; ``air``, pressures, stiffness, stop impacts where
        the plant has them; ``solve_time_p99``, ``fallbacks`` and ``deadline_misses`` where the
        controller solves problems.

    Example:
        >>> from controllers.open_loop import HeldCommand
        >>> from workbench.plants.servo_axis import servo_axis
        >>> from workbench.verification.loop import verify
        >>> from workbench.verification.scenario import Scenario
        >>> from workbench.verification.signals import Steps
        >>> scenario = Scenario("rest", {"position": Steps((0.0,), (0.0,))}, 0.1, settle=0.0)
        >>> held = HeldCommand((0.0,), actuators=("force",), follows=("position",))
        >>> metrics(verify(held, servo_axis(), scenario))["rmse"].value
        0.0
    """
    found: list[Metric] = []
    for name in run.follows:
        quantity = next(q for q in run.output_quantities if q.name == name)
        prefix = f"{name}." if len(run.follows) > 1 else ""
        found += _following(run, name, prefix, quantity.unit, quantity.display_unit)
    several = len(run.input_quantities) > 1
    for command, column in zip(run.input_quantities, run.inputs.T, strict=True):
        label = f"chatter.{command.name}" if several else "chatter"
        unit = "1/s" if command.unit == "1" else f"{command.unit}/s"
        found.append(_metric(label, responses.variation_rate(run.time, column), unit))
    found += _pneumatics(run)
    found += _stops(run)
    found += _solving(run)
    return Metrics(run.controller, run.plant, run.scenario.name, tuple(found))


def _metric(name: str, figure: Figure, unit: str, display_unit: str = "") -> Metric:
    return Metric(name, figure.value, unit, figure.reason, display_unit)


def _following(run: Run, name: str, prefix: str, unit: str, display: str) -> list[Metric]:
    time, course, reference = run.time, run[name], run.references[name]
    signal = run.scenario.references[name]
    error = reference - course
    settle, rise, over, steady, moving = [], [], [], [], []
    changes = each_step(time, signal.changes)
    for _, initial, final, part in changes:
        t, y = time[part], course[part]
        settle.append(responses.settling_time(t, y, initial=initial, final=final))
        rise.append(responses.rise_time(t, y, initial=initial, final=final))
        over.append(responses.overshoot(y, initial=initial, final=final))
        steady.append(responses.steady_error(t, error[part]))
        moving.append(responses.oscillation(t, y))
    if not changes:
        none = "the reference has no step"
        settle, rise, over = ([Figure(math.nan, none)] for _ in range(3))
        if np.ptp(reference) == 0.0:
            steady, moving = (
                [responses.steady_error(time, error)],
                [responses.oscillation(time, course)],
            )
        else:
            none = "the reference never rests"
            steady, moving = [Figure(math.nan, none)], [Figure(math.nan, none)]
    product = "s" if unit == "1" else f"{unit} s"
    shown_product = "s" if display == "1" else f"{display} s"
    return [
        _metric(f"{prefix}settling_time", _worst(settle), "s"),
        _metric(f"{prefix}rise_time", _worst(rise), "s"),
        _metric(f"{prefix}overshoot", _worst(over), "1", "%"),
        _metric(f"{prefix}steady_error", _worst(steady), unit, display),
        _metric(f"{prefix}oscillation", _worst(moving), unit, display),
        _metric(f"{prefix}rmse", responses.rms(error), unit, display),
        _metric(
            f"{prefix}iae",
            responses.integral_absolute_error(time, error),
            product,
            shown_product,
        ),
    ]


def _worst(figures: list[Figure]) -> Figure:
    """Return the largest; a figure that is missing is worse than any number."""
    missing = [f for f in figures if math.isnan(f.value)]
    return missing[0] if missing else max(figures, key=lambda f: f.value)


def _pneumatics(run: Run) -> list[Metric]:
    found = []
    if run.model is None:
        found.append(Metric("air", math.nan, "kg", "a linear model has no air", "g"))
    elif "supply.flow" in run.signal_names:
        flow = run["supply.flow"]
        h = run.scenario.sample_time
        found.append(Metric("air", float(np.sum(flow) * h), "kg", display_unit="g"))
    names = [q.name for q in run.output_quantities]
    if "pressure_1" in names and "pressure_2" in names:
        mean = 0.5 * (run["pressure_1"] + run["pressure_2"])
        found += [
            Metric("mean_pressure_lowest", float(mean.min()), "Pa", display_unit="bar"),
            Metric("mean_pressure_highest", float(mean.max()), "Pa", display_unit="bar"),
        ]
    if run.model is not None and "joint.torque" in run.signal_names:
        stiffness = joint_stiffness(run)
        found += [
            Metric("stiffness_lowest", float(stiffness.min()), "N m/rad"),
            Metric("stiffness_highest", float(stiffness.max()), "N m/rad"),
        ]
    return found


def joint_stiffness(run: Run) -> Vector:
    """Compute the joint's stiffness at constant pressures, ``-d torque / d angle``.

    Args:
        run: A run on a full plant with the port ``joint.torque`` and the state ``angle``.

    Returns:
        Stiffness, shape (n,), in N m/rad.

    Raises:
        WorkbenchError: If the plant has no such port or state.

    Example:
        >>> joint_stiffness.__name__
        'joint_stiffness'
    """
    check_choice("signal", "joint.torque", run.signal_names)
    check_choice("state", "angle", run.state_names)
    assert run.model is not None
    traced = run.model.exact
    torque = traced.signals[traced.signal_names.index("joint.torque")]
    slope = ca.jacobian(torque, traced.x[run.state_names.index("angle")])
    function = traced.function("stiffness", -slope).map(len(run.time))
    values = function(run.states.T, run.inputs.T, run.parameters.T)
    return np.asarray(values, dtype=float).ravel()


def _stops(run: Run) -> list[Metric]:
    stops = [name for name in run.signal_names if name.endswith("_stop.torque")]
    if not stops:
        return []
    impacts, peak = 0, 0.0
    for name in stops:
        torque = run[name]
        touching = torque > 0.0
        impacts += int(np.sum(touching[1:] & ~touching[:-1])) + int(touching[0])
        peak = max(peak, float(torque.max()))
    return [
        Metric("stop_impacts", float(impacts), "1"),
        Metric("stop_peak_torque", peak, "N m"),
    ]


def _solving(run: Run) -> list[Metric]:
    if not run.infos or "solve_time" not in run.infos[0]:
        return []
    seconds = run.info("solve_time")
    return [
        Metric("solve_time_median", float(np.median(seconds)), "s", display_unit="ms"),
        Metric("solve_time_p99", float(np.percentile(seconds, 99)), "s", display_unit="ms"),
        Metric("fallbacks", float(np.nansum(run.info("fallback"))), "1"),
        Metric("deadline_misses", float(np.sum(seconds > run.scenario.sample_time)), "1"),
    ]
