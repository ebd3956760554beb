"""Metrics of a closed-loop run: numbers with units, or NaN with the reason.

A metric is one object that states everything about itself: how it is measured, its unit, what a run
must have for it, which way is better and what difference counts. Tables, the check of a study file,
the report and the comparison with a baseline follow from it. A metric of one's own is such an
object in a module beside the study, named as ``module:object``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from typing import Any, Literal, NamedTuple

import numpy as np

from workbench.arrays import Vector
from workbench.display import Rows, Shown
from workbench.errors import check_choice
from workbench.model import Model, Output
from workbench.model.units import convert, of_difference, per, time_unit
from workbench.registry import Registry
from workbench.verification import responses
from workbench.verification.closed_loop_run import NoSignalError, Run
from workbench.verification.each_step import each_step
from workbench.verification.responses import Value

_ORDER = count()

_PART = 0.1
"""Part of a run by whose length times measured of it are shown: in s, h or ms."""


class Tolerance(NamedTuple):
    """How a metric is compared with that of a baseline.

    Args:
        better: ``"less"``, ``"more"``, or ``"neither"`` for what only describes.
        absolute: Difference that does not count, in the metric's SI unit.
        typical: The same in typical sizes of the output or command and in samples, as the metric's
            unit asks; it becomes `absolute` where the plant is known.
        relative: Difference that does not count, as a fraction of the baseline.
        gates: Whether a worse value fails a study.
        repeats: Whether another machine gives the same number: times of computation do not.
    """

    better: Literal["less", "more", "neither"] = "less"
    absolute: float = 0.0
    relative: float = 0.05
    gates: bool = True
    repeats: bool = True
    typical: float = 0.0

    def sized(self, size: float) -> Tolerance:
        """Return the tolerance with what is typical, in the metric's SI unit, taken in."""
        return self._replace(absolute=self.absolute + self.typical * size, typical=0.0)


@dataclass(frozen=True)
class Metric:
    """One kind of number that a run can have.

    Args:
        name: Name in studies and results; of several outputs ``output.name``, of several commands
            ``name.command``.
        measure: Called with the run, and with the name of the output or command it is ``of``.
        help: How it is computed, in the words of a table.
        unit: SI unit; ``{unit}`` stands for that of the output or command.
        display_unit: Unit in which people read it; one of an output follows that of the output.
        level: Whether it is a value of a signal, and not a difference: that of a temperature is
            shown from the zero of its scale.
        of: Whether there is one per run, per controlled output or per command.
        needs: What a run must have: a ``"step"`` of the reference, a reference that comes to
            ``"rest"``, a controller that is a ``"solver"`` or has a sliding ``"surface"``, or a
            ``"guard"`` with limits or with something to do.
        fits: Tells from the units of a plant's outputs and signals, by name, whether it has the
            metric.
        zero: Whether a good run has it at zero, so that zero is a limit that can be met.
        invariant: Whether a sliding mode is held to it; when the surface is crossed depends on
            rounding, so its other metrics are shown and do not fail a study.
        table: Where it is a column: the ``"page"``, or the ``"summary"`` and the page.
        title: Name as people read it, if not the name in words.
    """

    name: str
    measure: Callable[..., Value | float]
    help: str = ""
    unit: str = "1"
    display_unit: str = ""
    level: bool = field(default=False, kw_only=True)
    of: Literal["run", "output", "command"] = "run"
    needs: Literal["", "step", "rest", "solver", "surface", "guard"] = ""
    fits: Callable[[Mapping[str, str]], bool] = lambda signals: True
    tolerance: Tolerance = Tolerance()
    zero: bool = False
    invariant: bool = False
    table: Literal["", "page", "summary"] = ""
    title: str = ""
    order: int = field(default_factory=lambda: next(_ORDER), compare=False, repr=False)

    @property
    def words(self) -> str:
        """Name as people read it."""
        return self.title or self.name.replace("_", " ")


METRICS: Registry[Metric] = Registry(
    "metric", Metric, package="workbench.verification", group="workbench.metrics"
)
"""Every metric, by name."""


@dataclass(frozen=True)
class MetricValue:
    """One number of a run.

    Args:
        value: The number in ``unit``, NaN if there is none.
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
        value, unit = self.shown()
        text = f"{self.name:<24} {value:>10.4g} {'' if unit == '1' else unit}".rstrip()
        return f"{text}  ({self.reason})" if self.reason else text


@dataclass(frozen=True, repr=False)
class Metrics(Shown, Mapping[str, MetricValue]):
    """All metrics of a run, by name."""

    controller: str
    plant: str
    scenario: str
    values: tuple[MetricValue, ...]  # type: ignore[assignment]

    def __getitem__(self, name: str) -> MetricValue:
        check_choice("metric", name, [m.name for m in self.values])
        return next(m for m in self.values if m.name == name)

    def __iter__(self) -> Iterator[str]:
        return iter(m.name for m in self.values)

    def __len__(self) -> int:
        return len(self.values)

    def __contains__(self, name: object) -> bool:
        return any(m.name == name for m in self.values)

    def tables(self) -> tuple[Rows, ...]:
        """Return every metric in the unit in which it is shown."""
        rows = [(m.name, *m.shown(), m.reason) for m in self.values]
        return (Rows("metrics", ("metric", "value", "unit", "why there is none"), rows),)

    def __str__(self) -> str:
        head = f"{self.controller} on {self.plant}, {self.scenario}"
        return "\n".join([head, *(f"  {metric}" for metric in self.values)])


def known_metrics(own: Iterable[Metric] = ()) -> tuple[Metric, ...]:
    """Return all metrics in the order of tables, a user's own last."""
    return (*sorted(METRICS.members().values(), key=lambda m: m.order), *own)


def columns(table: Literal["page", "summary"]) -> tuple[str, ...]:
    """Return the names of the metrics that are columns of a table."""
    return tuple(m.name for m in known_metrics() if m.table in ("summary", table) and m.table)


def labels_of(names: Iterable[str], labels: Iterable[str]) -> tuple[str, ...]:
    """Return the labels of metrics: their names, or those of each of several outputs or commands.

    Example:
        >>> labels_of(("rmse", "chatter"), ("level.rmse", "warmth.rmse", "chatter"))
        ('level.rmse', 'warmth.rmse', 'chatter')
    """
    known = tuple(dict.fromkeys(labels))
    return tuple(
        label
        for name in names
        for label in known
        if label == name or label.endswith(f".{name}") or label.startswith(f"{name}.")
    )


def metric_of(label: str, own: Iterable[Metric] = ()) -> Metric | None:
    """Return the metric that a label such as ``angle.rmse`` or ``chatter.valve`` names, or None."""
    known = {m.name: m for m in known_metrics(own)}
    return next((known[part] for part in (label, *label.split(".")) if part in known), None)


def tolerance_of(label: str, own: Iterable[Metric] = ()) -> Tolerance:
    """Return how a metric is compared unless a study says otherwise; 5 % if it is not known."""
    found = metric_of(label, own)
    return found.tolerance if found else Tolerance()


def metrics(run: Run, own: Iterable[Metric] = ()) -> Metrics:
    """Compute every metric of a run, and those of a user's own.

    Of several steps the worst counts. Metrics of an output use the plant's output without noise.
    A metric of an installed package is left out where the plant has no signal that it asks for.
    """
    own = tuple(own)
    found: list[MetricValue] = []
    told = run.infos[0] if run.infos else {}
    has = {
        "solver": "solve_time" in told,
        "surface": "surface" in told,
        "guard": run.guarded or any("guard" in info for info in run.infos),
    }
    signals = _signals(run.output_quantities, run.model)
    # While one of several outputs steps, those that rest have no response of their own.
    stepped = [name for name in run.controlled if run.scenario.references[name].changes]
    stepped = stepped or list(run.controlled)
    outputs = {q.name: (q.unit, q.display_unit) for q in run.output_quantities}
    commands = {q.name: (q.unit, q.display_unit) for q in run.input_quantities if q.commanded}
    # What is measured of a run, such as a settling time, is a part of it.
    pace = time_unit(_PART * float(run.time[-1] - run.time[0]))[0]
    paced = {"s": pace, "{unit} s": f"{{unit}} {pace}"}
    for metric in known_metrics(own):
        if not has.get(metric.needs, True) or not metric.fits(signals):
            continue
        for label, name in _labels(metric, run.controlled, tuple(commands)):
            if metric.needs == "step" and name not in stepped:
                continue
            unit, shown = (outputs if metric.of == "output" else commands).get(name, ("1", ""))
            follows = paced.get(metric.unit, metric.unit if "{unit}" in metric.unit else "")
            shown = shown if metric.level else of_difference(shown)
            try:
                value = metric.measure(run, name) if name else metric.measure(run)
            except NoSignalError:
                if metric in own:
                    raise
                continue
            value = value if isinstance(value, Value) else Value(float(value))
            found.append(
                MetricValue(
                    label,
                    value.value,
                    _unit(metric.unit, unit),
                    value.reason,
                    _unit(metric.display_unit or follows, shown or unit),
                )
            )
    return Metrics(run.controller, run.plant, run.scenario.name, tuple(found))


def metric_units(
    plant: Model, controlled: tuple[str, ...], own: Iterable[Metric] = ()
) -> dict[str, str]:
    """Return the SI unit of every metric that a run on a plant can have, by its label."""
    units = {q.name: q.unit for q in (*plant.outputs, *plant.inputs)}
    return {
        label: _unit(metric.unit, units.get(name, "1"))
        for metric, label, name in _of_plant(plant, controlled, own)
    }


def metric_sizes(
    plant: Model, controlled: tuple[str, ...], sample_time: float, own: Iterable[Metric] = ()
) -> dict[str, float]:
    """Return what is typical of a metric on a plant, in its SI unit, by its label.

    A signal counts in its scale, a time in samples, every `sample_time` s.
    """
    scales = {q.name: q.scale for q in (*plant.outputs, *plant.inputs)}
    times = {"s": sample_time, "{unit} s": sample_time, "{unit}/s": 1.0 / sample_time}
    return {
        label: times.get(metric.unit, 1.0) * (scales[name] if "{unit}" in metric.unit else 1.0)
        for metric, label, name in _of_plant(plant, controlled, own)
    }


def _of_plant(
    plant: Model, controlled: tuple[str, ...], own: Iterable[Metric]
) -> Iterator[tuple[Metric, str, str]]:
    """Yield the metrics of a plant with their labels, and the output or command each is of."""
    signals = _signals(plant.outputs, plant)
    for metric in known_metrics(own):
        if metric.fits(signals):
            for label, name in _labels(metric, controlled, tuple(q.name for q in plant.commands)):
                yield metric, label, name


def _signals(outputs: Iterable[Output], plant: Model | None) -> dict[str, str]:
    """Return the units of outputs and signals, by name."""
    traced = plant.exact if plant else None
    named = zip(traced.signal_names, traced.signal_units, strict=True) if traced else ()
    return dict(named) | {q.name: q.unit for q in outputs}


def _labels(
    metric: Metric, controlled: tuple[str, ...], commands: tuple[str, ...]
) -> list[tuple[str, str]]:
    """Return the labels of a metric with the output or command that each is of."""
    if metric.of == "output":
        several = len(controlled) > 1
        return [(f"{n}.{metric.name}" if several else metric.name, n) for n in controlled]
    if metric.of == "command":
        several = len(commands) > 1
        return [(f"{metric.name}.{n}" if several else metric.name, n) for n in commands]
    return [(metric.name, "")]


def _unit(text: str, unit: str) -> str:
    """Put the unit of a signal into that of a metric: a ratio over s is 1/s, times s is s."""
    if unit == "1":
        text = text.removeprefix("{unit} ")
    if text == "{unit}/s":
        return per(unit, "s")
    return text.replace("{unit}", unit)


def _of_steps(
    respond: Callable[[Vector, Vector, float, float], Value],
) -> Callable[[Run, str], Value]:
    """Return the worst of a response over the steps of an output's reference."""

    def measure(run: Run, name: str) -> Value:
        found = []
        for _, initial, final, part in each_step(run.time, run.scenario.references[name].changes):
            value = respond(run.time[part], run[name][part], initial, final)
            ended = _at_limits(run, part) if value.reason and initial != final else ""
            found.append(Value(value.value, f"{value.reason}{ended}"))
        return worst(found) if found else Value(math.nan, "the reference has no step")

    return measure


def _at_limits(run: Run, part: slice) -> str:
    """Say which commands are at an end of their range all through the last tenth of a part."""
    tail = run.inputs[part][-max(1, len(run.inputs[part]) // 10) :]
    names = [
        q.name
        for q, u in zip(run.input_quantities, tail.T, strict=True)
        if q.commanded
        and min(np.abs(u - end).max() for end in (q.lower, q.upper)) <= _END * q.scale
    ]
    verb = "is" if len(names) == 1 else "are"
    cure = "take more time, or a smaller step"
    return f", where {' and '.join(names)} {verb} still at the limit: {cure}" if names else ""


def _at_rest(respond: Callable[[Run, str, slice], Value]) -> Callable[[Run, str], Value]:
    """Return the worst of what an output does where its reference rests."""

    def measure(run: Run, name: str) -> Value:
        asked = run.scenario.references
        parts = [step.part for step in each_step(run.time, asked[name].changes)]
        if not parts and np.ptp(run.references[name]) == 0.0:
            # It is moved where others step.
            steps = {change[0]: change for own in asked.values() for change in own.changes}
            others = each_step(run.time, [steps[time] for time in sorted(steps)])
            parts = [step.part for step in others] or [slice(None)]
        found = [respond(run, name, part) for part in parts]
        return worst(found) if found else Value(math.nan, "the reference never rests")

    return measure


def worst(values: list[Value]) -> Value:
    """Return the largest; a value that is missing is worse than any number."""
    missing = [v for v in values if math.isnan(v.value)]
    return missing[0] if missing else max(values, key=lambda v: v.value)


def _error(run: Run, name: str) -> Vector:
    return np.asarray(run.references[name] - run[name])


def _moved_by_others(run: Run, name: str) -> float:
    changes = {own: run.scenario.references[own].changes for own in run.controlled}
    if changes[name] or not any(changes.values()):
        raise NoSignalError("no other reference steps")
    begin = min(change[0] for own in changes.values() for change in own)
    return float(np.max(np.abs(_error(run, name)[run.time >= begin - 1e-9]), initial=0.0))


def _counted(run: Run) -> slice:
    return slice(int(np.searchsorted(run.time, run.scenario.count_from - 1e-9)), None)


def extremes(
    name: str,
    signal: Callable[..., Vector],
    what: str,
    *,
    unit: str,
    tolerance: Tolerance,
    display_unit: str = "",
    of: Literal["run", "output", "command"] = "run",
    fits: Callable[[Mapping[str, str]], bool] = lambda signals: True,
) -> tuple[Metric, Metric]:
    """Return lowest and highest value of a signal as metrics.

    Args:
        name: What stands before ``lowest`` and ``highest`` in their names.
        signal: Returns the signal over time, called as `Metric.measure` is.
    """
    about: dict[str, Any] = {"unit": unit, "tolerance": tolerance, "display_unit": display_unit}

    def metric(end: str, pick: Callable[[Vector], float]) -> Metric:
        def measure(run: Run, *owner: str) -> float:
            return float(pick(signal(run, *owner)))

        name_, help_ = f"{name}{end}", f"{end} {what}"
        return Metric(name_, measure, help_, of=of, fits=fits, level=True, **about)

    return metric("lowest", np.min), metric("highest", np.max)


# Entry into a band is counted in whole samples.
_TIMES = Tolerance(typical=2.0, relative=0.02)
# 0.01 deg of 1 rad: some steps of an encoder.
_REST = Tolerance(typical=1.7e-4, relative=0.1)
_ERROR = Tolerance(typical=1e-5, relative=0.02)
_NEVER = Tolerance(relative=0.0)
_COMPUTING = Tolerance(gates=False, repeats=False)

_END = 1e-6
"""Distance of a command from an end of its range, over its scale, that rounding leaves."""

_of_step = partial(Metric, of="output", needs="step")
_of_rest = partial(
    Metric, unit="{unit}", of="output", needs="rest", tolerance=_REST, table="summary"
)
_of_error = partial(Metric, of="output", tolerance=_ERROR)
_of_solver = partial(Metric, needs="solver")
_of_surface = partial(Metric, needs="surface", invariant=True)

SETTLING_TIME = _of_step(
    "settling_time",
    _of_steps(lambda t, y, a, b: responses.settling_time(t, y, initial=a, final=b)),
    "time from the step until the output stays within 2 % of the step; worst step",
    unit="s",
    tolerance=_TIMES,
    table="summary",
)
RISE_TIME = _of_step(
    "rise_time",
    _of_steps(lambda t, y, a, b: responses.rise_time(t, y, initial=a, final=b)),
    "time from 10 % to 90 % of the step; worst step",
    unit="s",
    tolerance=_TIMES,
)
OVERSHOOT = _of_step(
    "overshoot",
    _of_steps(lambda t, y, a, b: responses.overshoot(y, initial=a, final=b)),
    "how far the output goes past the reference, as a share of the step; worst step",
    display_unit="%",
    tolerance=Tolerance(absolute=0.002, relative=0.05),
    zero=True,
    table="summary",
)
UNDERSHOOT = _of_step(
    "undershoot",
    _of_steps(lambda t, y, a, b: responses.undershoot(y, initial=a, final=b)),
    "how far the output goes the wrong way from where it was, as a share of the step; worst step",
    display_unit="%",
    tolerance=OVERSHOOT.tolerance,
    zero=True,
)
STEADY_ERROR = _of_rest(
    "steady_error",
    _at_rest(
        lambda run, name, part: responses.steady_error(
            run.time[part], _error(run, name)[part], window=run.scenario.rest_window
        )
    ),
    "mean error at the end of each step, as a magnitude; worst step",
)
INTERACTION = _of_error(
    "interaction",
    _moved_by_others,
    "largest error of an output whose reference rests while those of others step",
    unit="{unit}",
    table="summary",
)
OSCILLATION = _of_rest(
    "oscillation",
    _at_rest(
        lambda run, name, part: responses.oscillation(
            run.time[part], run[name][part], window=run.scenario.rest_window
        )
    ),
    "what still moves: half of highest minus lowest output at the end of each step, its"
    " straight line taken away, the amplitude of a limit cycle; worst step",
)
RMSE = _of_error(
    "rmse",
    lambda run, name: responses.rms(_error(run, name)[_counted(run)]),
    "root mean square of reference minus output over the whole run, or from where the scenario"
    " counts it",
    unit="{unit}",
    table="summary",
)
IAE = _of_error(
    "iae",
    lambda run, name: responses.integral_absolute_error(
        run.time[_counted(run)], _error(run, name)[_counted(run)]
    ),
    "integral of the magnitude of reference minus output",
    unit="{unit} s",
    tolerance=_ERROR._replace(typical=5e-3),
)
LOWEST, HIGHEST = extremes(
    "",
    lambda run, name: run[name],
    "value of the output",
    unit="{unit}",
    of="output",
    tolerance=Tolerance("neither", typical=1e-3, relative=0.02),
)
CHATTER = Metric(
    "chatter",
    lambda run, name: responses.variation_rate(run.time, run[name]),
    "how much the command moves: sum of the magnitudes of all its changes, per second",
    unit="{unit}/s",
    of="command",
    tolerance=Tolerance(typical=4e-5, relative=0.05),
    table="summary",
)
COMMAND_LOWEST, COMMAND_HIGHEST = extremes(
    "command_",
    lambda run, name: run[name],
    "command",
    unit="{unit}",
    of="command",
    tolerance=Tolerance("neither", typical=0.01, relative=0.05),
)
SOLVE_TIME_MEDIAN = _of_solver(
    "solve_time_median",
    lambda run: float(np.nanmedian(run.info("solve_time"))),
    "time of one optimisation on this machine, exceeded by every second sample",
    unit="s",
    display_unit="ms",
    tolerance=_COMPUTING,
    title="solve time, median",
)
SOLVE_TIME_P99 = _of_solver(
    "solve_time_p99",
    lambda run: float(np.nanpercentile(run.info("solve_time"), 99)),
    "time of one optimisation on this machine, exceeded by one sample in a hundred; whatever else"
    " the machine does adds to it",
    unit="s",
    display_unit="ms",
    tolerance=_COMPUTING,
    table="summary",
    title="solve time, 99th percentile",
)
FALLBACKS = _of_solver(
    "fallbacks",
    lambda run: float(np.nansum(run.info("fallback"))),
    "how often the optimisation failed and its named fallback was used",
    tolerance=_NEVER,
    zero=True,
    table="page",
)
DEADLINE_MISSES = _of_solver(
    "deadline_misses",
    lambda run: float(np.sum(run.info("solve_time") > run.scenario.sample_time)),
    "how often the optimisation took longer than a sample on this machine",
    tolerance=_COMPUTING,
    zero=True,
)


def _guard(*actions: str) -> Callable[[Run], float]:
    """Return how often the guard did something; on the way back it does not count."""
    return lambda run: float(sum(info.get("guard_action") in actions for info in run.infos))


GUARD_CLAMPED, GUARD_ESTIMATED, GUARD_HELD, GUARD_INNER, GUARD_SAFE = (
    Metric(name, _guard(action), text, needs="guard", tolerance=_NEVER, zero=True)
    for name, action, text in (
        ("guard_clamped", "clamp", "samples whose reference was out of its range or no number, and"
         " was replaced"),
        ("guard_estimated", "estimate", "samples at which the law was shown an estimate in the"
         " place of a measurement that could not be believed"),
        ("guard_held", "hold", "samples at which the guard held the command, because there was none"
         " that could be given"),
        ("guard_inner", "inner", "samples at which the inner law brought the plant to rest"),
        ("guard_safe", "safe", "samples at which the guard gave the safe command"),
    )
)  # fmt: skip


def _surface(run: Run) -> Vector:
    surface = run.info("surface")
    # Where the guard did not let the law step there is none.
    return np.abs(surface[np.isfinite(surface)]) / run.surface_layer


SURFACE_RMS = _of_surface(
    "surface_rms",
    lambda run: float(np.sqrt(np.mean(_surface(run) ** 2))),
    "rms of the sliding variable s over its boundary layer",
    tolerance=Tolerance(relative=0.05),
    title="surface, rms",
)
SURFACE_PEAK = _of_surface(
    "surface_peak",
    lambda run: float(_surface(run).max()),
    "largest magnitude of s over its boundary layer",
    tolerance=Tolerance(relative=0.1),
    title="surface, peak",
)
OUTSIDE_LAYER = _of_surface(
    "outside_layer",
    lambda run: float(np.mean(_surface(run) > 1.0)),
    "share of the samples at which s is outside its boundary layer",
    display_unit="%",
    tolerance=Tolerance(absolute=0.005, relative=0.1),
    zero=True,
)
