"""Metrics of a study: those of every run, and the bounds and invariants that a study adds.

A sliding mode is judged by invariants: its course depends on when the surface is crossed, but how
far it strays from the surface does not.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from workbench.model import Model
from workbench.verification import Metric, Metrics, Run, metrics

SOLVER = ("solve_time_median", "solve_time_p99", "fallbacks", "deadline_misses")
SURFACE = ("surface_rms", "surface_peak", "outside_layer")
STEP_ONLY = ("settling_time", "rise_time", "overshoot")
AT_REST = ("steady_error", "oscillation")
MAY_BE_ZERO = (
    "stop_impacts",
    "stop_peak_torque",
    "fallbacks",
    "deadline_misses",
    "overshoot",
    "outside_layer",
)
"""Metrics that a good run has at zero, so that zero is a limit that can be met."""


class Rule(NamedTuple):
    """How a metric is compared with that of a baseline.

    Args:
        better: ``"less"``, ``"more"``, or ``"neither"`` for what only describes.
        absolute: Difference that does not count, in the metric's SI unit.
        relative: Difference that does not count, as a fraction of the baseline.
        gates: Whether a worse value fails the study.
        repeats: Whether another machine gives the same number: times of computation do not.
    """

    better: str = "less"
    absolute: float = 0.0
    relative: float = 0.05
    gates: bool = True
    repeats: bool = True


RULES: dict[str, Rule] = {
    # Two samples of 2 ms: entry into a band is counted in whole samples.
    "settling_time": Rule(absolute=0.004, relative=0.02),
    "rise_time": Rule(absolute=0.004, relative=0.02),
    "overshoot": Rule(absolute=0.002, relative=0.05),
    # 0.01 deg: some steps of the encoder and of the pressure sensors' noise.
    "steady_error": Rule(absolute=1.7e-4, relative=0.1),
    "oscillation": Rule(absolute=1.7e-4, relative=0.1),
    "rmse": Rule(absolute=1e-5, relative=0.02),
    "iae": Rule(absolute=1e-5, relative=0.02),
    "chatter": Rule(absolute=0.1, relative=0.05),
    "air": Rule(absolute=1e-6, relative=0.05),
    "mean_pressure_lowest": Rule("neither", 1e3, 0.02),
    "mean_pressure_highest": Rule("neither", 1e3, 0.02),
    "stiffness_lowest": Rule("neither", 0.1, 0.02),
    "stiffness_highest": Rule("neither", 0.1, 0.02),
    "stop_impacts": Rule(relative=0.0),
    "stop_peak_torque": Rule(absolute=0.05, relative=0.05),
    "solve_time_median": Rule(gates=False, repeats=False),
    "solve_time_p99": Rule(gates=False, repeats=False),
    "deadline_misses": Rule(gates=False, repeats=False),
    "fallbacks": Rule(relative=0.0),
    "surface_rms": Rule(relative=0.05),
    "surface_peak": Rule(relative=0.1),
    "outside_layer": Rule(absolute=0.005, relative=0.1),
    "lowest": Rule("neither", 1e-3, 0.02),
    "highest": Rule("neither", 1e-3, 0.02),
    "command_lowest": Rule("neither", 0.05, 0.05),
    "command_highest": Rule("neither", 0.05, 0.05),
}
"""How each metric is compared; a study may state other tolerances."""

INVARIANTS = (*SURFACE, "stop_impacts", "stop_peak_torque")
"""What a sliding mode is compared by; its other metrics are shown but do not fail a study."""


def rule(name: str) -> Rule:
    """Return how a metric is compared with that of a baseline.

    Args:
        name: Name of the metric, with or without the output or command it is of.

    Returns:
        The rule; 5 % for metrics that have none of their own.

    Example:
        >>> rule("angle.settling_time").absolute
        0.004
    """
    if name in RULES:
        return RULES[name]
    parts = name.split(".")
    return next((RULES[part] for part in parts if part in RULES), Rule())


def study_metrics(run: Run, controller: Any) -> Metrics:
    """Compute every metric of a run, with its bounds and the invariants of a sliding mode.

    Args:
        run: The run.
        controller: The controller that ran; its ``layer``, if it has one, bounds the surface.

    Returns:
        The metrics of `workbench.verification.metrics`, and ``lowest``, ``highest`` of each
        followed output, ``command_lowest``, ``command_highest``, and for a sliding mode
        ``surface_rms`` and ``surface_peak`` (of s over its boundary layer, a ratio) and
        ``outside_layer`` (share of the samples at which s is outside).

    Example:
        >>> study_metrics.__name__
        'study_metrics'
    """
    found = metrics(run)
    extra: list[Metric] = []
    for name in run.follows:
        quantity = next(q for q in run.output_quantities if q.name == name)
        prefix = f"{name}." if len(run.follows) > 1 else ""
        for word, value in (("lowest", run[name].min()), ("highest", run[name].max())):
            extra.append(
                Metric(f"{prefix}{word}", float(value), quantity.unit, "", quantity.display_unit)
            )
    for command, column in zip(run.input_quantities, run.inputs.T, strict=True):
        suffix = f".{command.name}" if len(run.input_quantities) > 1 else ""
        extra.append(Metric(f"command_lowest{suffix}", float(column.min()), command.unit))
        extra.append(Metric(f"command_highest{suffix}", float(column.max()), command.unit))
    if run.infos and "surface" in run.infos[0]:
        layer = float(getattr(controller, "layer", 1.0))
        surface = np.abs(run.info("surface")) / layer
        extra += [
            Metric("surface_rms", float(np.sqrt(np.mean(surface**2))), "1"),
            Metric("surface_peak", float(surface.max()), "1"),
            Metric("outside_layer", float(np.mean(surface > 1.0)), "1", display_unit="%"),
        ]
    return Metrics(found.controller, found.plant, found.scenario, (*found.values, *extra))


def metric_units(plant: Model, follows: tuple[str, ...]) -> dict[str, str]:
    """Return the metrics that a run on a plant can have, with their SI units.

    Args:
        plant: The plant.
        follows: Names of the followed outputs.

    Returns:
        SI unit by name.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> metric_units(servo_axis(), ("position",))["rmse"]
        'm'
    """
    outputs = {q.name: q.unit for q in plant.outputs}
    found: dict[str, str] = {}
    for name in follows:
        unit, prefix = outputs[name], f"{name}." if len(follows) > 1 else ""
        found |= {f"{prefix}{m}": "s" for m in ("settling_time", "rise_time")}
        found[f"{prefix}overshoot"] = "1"
        words = ("steady_error", "oscillation", "rmse", "lowest", "highest")
        found |= {f"{prefix}{m}": unit for m in words}
        found[f"{prefix}iae"] = "s" if unit == "1" else f"{unit} s"
    for q in plant.inputs:
        suffix = f".{q.name}" if len(plant.inputs) > 1 else ""
        found[f"chatter{suffix}"] = "1/s" if q.unit == "1" else f"{q.unit}/s"
        found |= {f"command_{m}{suffix}": q.unit for m in ("lowest", "highest")}
    ports = [port.name for port in plant.ports]
    if "supply.flow" in plant.exact.signal_names:
        found["air"] = "kg"
    if {"pressure_1", "pressure_2"} <= set(outputs):
        found |= {f"mean_pressure_{m}": "Pa" for m in ("lowest", "highest")}
    if "joint.torque" in ports:
        found |= {f"stiffness_{m}": "N m/rad" for m in ("lowest", "highest")}
    if any(name.endswith("_stop.torque") for name in ports):
        found |= {"stop_impacts": "1", "stop_peak_torque": "N m"}
    found |= {"solve_time_median": "s", "solve_time_p99": "s"}
    return found | dict.fromkeys(("fallbacks", "deadline_misses", *SURFACE), "1")
