"""A menu of experiments that a machine can run: inputs within what recordings show is admissible.

Some inputs are played as they are, others come from a loop that follows a reference. Each can be
repeated at another value of a parameter that the machine lets its user set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Input, Model, Output
from workbench.model.units import from_si, in_range, in_time, shown_unit, with_unit
from workbench.simulation import simulate
from workbench.simulation.stepper import Stepper

LONGEST = 10_000
"""Samples of an experiment, or those of the longest recording; twice those at the most."""

_TOLERANCE = 1e-6
_OUTSIDE = 0.05
"""Part of the recorded range by which a prediction may leave it: recordings end by chance."""

_PULSE_SHARE = 0.7


@dataclass(frozen=True)
class Experiment:
    """An input to play on a machine.

    Args:
        sample_time: Time between samples, in s.
        inputs: Inputs held from each sample to the next, shape (n, n_inputs), in SI.
        settings: Parameters that are set to another value for it, in SI, by name.
        planned: The model that planned it and what that would read, shape (n, n_outputs), in SI.
    """

    text: str
    sample_time: float
    inputs: Vector
    settings: Mapping[str, float] = field(default_factory=dict)
    planned: tuple[Model, Vector] | None = field(default=None, repr=False, compare=False)

    def measurements(self, model: Model, start: npt.ArrayLike) -> Vector | None:
        """Simulate what the sensors of a model would read, shape (n, n_outputs), without noise.

        It is None if the integrator gives up. Measurements and the states at the start, shape
        (n_states,), are in SI.
        """
        if self.planned is not None and self.planned[0] is model:
            return self.planned[1]
        try:
            return simulate(
                self.on(model),
                self.inputs,
                sample_time=self.sample_time,
                start=start,
                tolerance=_TOLERANCE,
                check=False,
            ).outputs
        except NumericalError:
            return None

    def on(self, model: Model) -> Model:
        """Return a model as it is set for the experiment."""
        return model.with_parameters(self.settings) if self.settings else model


def menu(model: Model, recordings: Sequence[Observed]) -> tuple[Experiment, ...]:
    """Return experiments that stay within what the recordings show.

    Amplitudes are half, once and twice those of the recorded inputs. Measurements stay within the
    validity of the state that they show or the range of their sensor; where neither is known,
    within the recorded range and a twentieth of it on either side. References use 80 % of that.

    Args:
        recordings: Recordings as `observe` returns them; their sample time is that of the menu.
    """
    if not recordings:
        raise WorkbenchError("experiments are planned from recordings, and there are none")
    longest = max(len(r.inputs) for r in recordings)
    n = min(2 * longest, max(LONGEST, longest))
    plan = _Plan(model, recordings, n)
    candidates = (*plan.open_loop(), *plan.closed_loop())
    return tuple(kept for e in candidates if (kept := plan.kept(e)) is not None)


def other_settings(
    model: Model, free: Sequence[str] = ()
) -> tuple[tuple[str, dict[str, float]], ...]:
    """Return changed settings of a model, in SI by name, with words; none that is being fitted."""
    found = []
    for q in model.parameters:
        if not q.setting or q.name in free:
            continue
        unit = shown_unit(q.unit)
        for value in (q.value - q.setting, q.value + q.setting):
            if q.lower <= value <= q.upper:
                words = with_unit(f"{from_si(value, unit):.3g}", unit)
                found.append((f"at {words} {q.name.replace('_', ' ')}", {q.name: value}))
    return tuple(found)


def with_setting(experiment: Experiment, words: str, values: Mapping[str, float]) -> Experiment:
    """Return an experiment at another setting: changed parameters, in SI, by name."""
    return replace(
        experiment, text=f"{experiment.text}, {words}", settings=dict(values), planned=None
    )


_RARELY = 0.05
"""Part of the samples beyond which an input must lie on both sides of its rest to move about it."""


class _Plan:
    """What the recordings admit, and inputs within it."""

    def __init__(self, model: Model, recordings: Sequence[Observed], n: int) -> None:
        first = recordings[0]
        self.model, self.n, self.sample_time = model, n, first.sample_time
        self.duration = n * first.sample_time
        self.share = np.arange(n) / n
        self.start = first.start
        inputs = np.concatenate([r.inputs for r in recordings])
        # What was hardly ever at rest, as a flow that must go on, moves about a middle.
        rarely = np.quantile(inputs, [_RARELY, 1.0 - _RARELY], axis=0)
        near = (rarely[0] <= model.nominal_input) & (model.nominal_input <= rarely[1])
        self.rest = np.where(near, model.nominal_input, np.median(inputs, axis=0))
        # A recording may hold a single spike; what is admissible is what was held for some time.
        low, high = np.quantile(inputs, [0.01, 0.99], axis=0)
        self.reach = np.maximum(np.minimum(high - self.rest, self.rest - low), 0.0)
        wide = np.maximum(high - self.rest, self.rest - low)
        one_sided = self.reach <= 0.2 * wide
        self.reach = np.where(one_sided, wide, self.reach)
        self.reach *= [q.commanded for q in model.inputs]
        self.sign = np.where(high - self.rest >= 0.2 * wide, 1.0, -1.0)
        # What goes to one side of its rest only, as the pressure of a brake, stays there.
        self.ends = np.where(
            one_sided, np.sort([0.0 * self.sign, self.sign], axis=0), [[-1.0], [1.0]]
        )
        self.rows = first.rows(model)
        outputs = np.concatenate([r.outputs for r in recordings])
        self.low, self.high = self._limits(outputs)
        self.limits = [q.lower for q in model.inputs], [q.upper for q in model.inputs]

    def _limits(self, outputs: Vector) -> tuple[Vector, Vector]:
        """Return where the measurements may be."""
        ends = np.array([np.nanmin(outputs, axis=0), np.nanmax(outputs, axis=0)])
        ends += _OUTSIDE * np.array([[-1.0], [1.0]]) * (ends[1] - ends[0])
        states = {q.name: (q, x) for q, x in zip(self.model.states, self.start, strict=True)}
        read = self.model.read(self.start, self.rest)
        for i, row in enumerate(self.rows):
            q = self.model.outputs[row]
            shown, value = states.get(q.name, (None, math.nan))
            for known in (q, shown if math.isclose(value, read[row], rel_tol=1e-9) else None):
                if known is not None and math.isfinite(known.lower) and math.isfinite(known.upper):
                    ends[:, i] = known.lower, known.upper
        return ends[0], ends[1]

    def kept(self, experiment: Experiment) -> Experiment | None:
        """Return an experiment with its prediction if every measurement stays near the recorded."""
        read = experiment.measurements(self.model, self.start)
        if read is None:
            return None
        seen = read[:, self.rows]
        inside = (seen >= self.low) & (seen <= self.high)
        return replace(experiment, planned=(self.model, read)) if inside.all() else None

    def open_loop(self) -> list[Experiment]:
        """Return inputs played as they are, one input after the other."""
        made = []
        for channel, reach in enumerate(self.reach):
            if reach <= 0:
                continue
            q = self.model.inputs[channel]
            for part in (1.0, 0.5, 2.0):
                size = part * reach
                low, high = self.rest[channel] + size * self.ends[:, channel]
                if low < q.lower or high > q.upper:
                    continue
                for words, shape in self._shapes():
                    inputs = np.tile(self.rest, (self.n, 1))
                    inputs[:, channel] = low + 0.5 * (high - low) * (1.0 + shape)
                    text = f"{words} of {self._between(q, low, high)}"
                    made.append(Experiment(text, self.sample_time, inputs))
        rest = np.tile(self.rest, (self.n, 1))
        return [*made, Experiment(self._resting(), self.sample_time, rest)]

    def _between(self, q: Input | Output, low: float, high: float) -> str:
        """Say what moves between which ends, and how long."""
        ends = in_range([from_si(x, q.display_unit) for x in (low, high)])
        between = f"between {ends[0]} and {with_unit(ends[1], q.display_unit)}"
        return f"{q.name} {between}, for {in_time(self.duration)}"

    def _resting(self) -> str:
        """Say what stays as it is."""
        lasting = in_time(self.duration)
        commands = [
            (q, x) for q, x in zip(self.model.inputs, self.rest, strict=True) if q.commanded
        ]
        if all(x == q.nominal for q, x in commands):
            return f"rest for {lasting}" if commands else f"a run left to itself for {lasting}"
        held = [
            f"{q.name} at {with_unit(f'{from_si(x, q.display_unit):.3g}', q.display_unit)}"
            for q, x in commands
        ]
        return f"{' and '.join(held)} for {lasting}"

    def _shapes(self) -> list[tuple[str, Vector]]:
        """Return signals between -1 and 1 over the duration."""
        t, base = self.share, 1.0 / self.duration
        pulses = _pulses(self.n, self.n // 36, np.random.default_rng(0))
        shapes = [
            ("random pulses", pulses),
            (f"a pulse train of {_pace(5 * base)}", np.where((5 * t) % 1 < 0.5, 1.0, -1.0)),
            (f"a slow triangle of {_pace(base)}", _triangle(t)),
            (f"a triangle of {_pace(4 * base)}", _triangle(4 * t)),
        ]
        return shapes + [
            (f"a sine of {_pace(cycles * base)}", np.sin(2 * np.pi * cycles * t))
            for cycles in (4, 20, 80)
        ]

    def closed_loop(self) -> list[Experiment]:
        """Return inputs with which a loop lets the first output follow a reference."""
        low, high = self.low[0], self.high[0]
        middle, half = 0.5 * (low + high), 0.4 * (high - low)
        channel = int(np.argmax(self.reach))
        if not (half > 0 and self.reach[channel] > 0):
            return []
        loop = _Loop(self, channel)
        if loop.gain == 0.0:
            return []
        q = self.model.outputs[self.rows[0]]
        t, base = self.share, 1.0 / self.duration
        rng = np.random.default_rng(1)
        stairs = np.array([0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5])
        shapes = [
            ("holds at several values", stairs[np.minimum((8 * t).astype(int), 7)]),
            (f"a slow triangle of {_pace(base)}", _triangle(t)),
            (f"a triangle of {_pace(4 * base)}", _triangle(4 * t)),
            (f"a sine of {_pace(4 * base)}", np.sin(2 * np.pi * 4 * t)),
            (f"a small sine of {_pace(8 * base)}", 0.2 * np.sin(2 * np.pi * 8 * t)),
            ("random steps", _pulses(self.n, self.n // 12, rng)),
        ]
        made = []
        for words, shape in shapes:
            inputs = loop.follow(middle + half * shape)
            if inputs is None:
                continue
            # A recorded input may have left the bounds of the model.
            unread = Experiment("", self.sample_time, np.clip(inputs, *self.limits))
            read = unread.measurements(self.model, self.start)
            if read is None:
                continue
            # What the loop reaches, which is less than what it is asked for.
            moved = read[:, self.rows[0]]
            between = self._between(q, float(np.min(moved)), float(np.max(moved)))
            text = f"in closed loop, {words} of {between}"
            made.append(replace(unread, text=text, planned=(self.model, read)))
        return made


class _Loop:
    """A cautious loop from the first output to one input, tuned on a step of the model."""

    def __init__(self, plan: _Plan, channel: int) -> None:
        self.plan, self.channel = plan, channel
        self.row = plan.rows[0]
        # The loop acts some times per window, the window is a small share of the experiment.
        self.every = max(1, plan.n // 2000)
        self.window = max(2 * self.every, plan.n // 40)
        self.stepper = Stepper(plan.model, plan.sample_time, _TOLERANCE)
        self.gain = self._tuned()

    def _tuned(self) -> float:
        """Return the input per output that a step shows; 0 if the input does not move it."""
        plan = self.plan
        rest = np.tile(plan.rest, (self.window, 1))
        pushed = rest.copy()
        step = 0.5 * plan.sign[self.channel] * plan.reach[self.channel]
        pushed[:, self.channel] += step
        reads = [
            Experiment("step", plan.sample_time, u).measurements(plan.model, plan.start)
            for u in (rest, pushed)
        ]
        if reads[0] is None or reads[1] is None:
            return 0.0
        moved = float(reads[1][-1, self.row] - reads[0][-1, self.row])
        reach = 1e-3 * float(plan.high[0] - plan.low[0])
        return float(step / moved) if abs(moved) > reach else 0.0

    def follow(self, reference: Vector) -> Vector | None:
        """Return the inputs with which the output follows a reference; None if it does not."""
        plan, every = self.plan, self.every
        x = plan.start.copy()
        limit = 2 * plan.reach[self.channel]
        inputs = np.tile(plan.rest, (plan.n, 1))
        output = np.empty(plan.n)
        before = slope = 0.0
        ahead = self.window / every
        try:
            for k in range(0, plan.n, every):
                u = inputs[k : k + every]
                now = float(self.stepper.read(x, u[0])[self.row])
                slope = 0.5 * slope + 0.5 * (now - before if k else 0.0)
                before = now
                push = self.gain * (reference[k] - now - ahead * slope)
                u[:, self.channel] += np.clip(push, -limit, limit)
                output[k : k + every] = now
                x = self.stepper.run(x, u)[-1]
        except NumericalError:
            return None
        settled = slice(4 * self.window, None)
        with np.errstate(over="ignore"):  # What ran away is infinitely far off.
            error = np.sqrt(np.mean((output - reference)[settled] ** 2))
        return inputs if error < 0.5 * float(plan.high[0] - plan.low[0]) else None


def _pace(frequency: float) -> str:
    """Write a frequency, in Hz, as people say it: slow ones by their period."""
    return f"{frequency:.3g} Hz" if frequency >= 0.1 else f"period {in_time(1.0 / frequency)}"


def _triangle(turns: Vector) -> Vector:
    """Return a triangle between -1 and 1 that begins at 0, by turns."""
    return np.asarray(2 * np.abs(2 * ((turns + 0.75) % 1) - 1) - 1)


def _pulses(n: int, hold: int, rng: np.random.Generator) -> Vector:
    """Return levels between -1 and 1, a third of them 0, each held for some ``hold`` samples."""
    signal = np.zeros(n)
    k = 0
    while k < n:
        held = int(rng.integers(max(1, hold // 2), max(2, 2 * hold)))
        if rng.random() < _PULSE_SHARE:
            signal[k : k + held] = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.0)
        k += held
    return signal
