"""How far a linear model holds: its kinks, its describing functions, and what simulation says."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector, runs
from workbench.errors import NumericalError, WorkbenchError, check_range
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.time_scales import horizon_of, step_time
from workbench.linearisation.transfer import transfer_function
from workbench.model import Model, Output, Parameter, Quantity, Scope
from workbench.model.units import from_si, in_time, of_difference, per, with_unit
from workbench.operating_point import Derivatives, OperatingPoint
from workbench.simulation.integrators import Method
from workbench.simulation.stepper import Stepper

_AT_ONCE = 1e-7
_REACH = 0.05
_JUMP = 0.05
_BEND = 0.1
_BISECTIONS = 16
_MINOR = 0.2
"""Share of the largest slope of a row below which a slope is too small to matter."""


@dataclass(frozen=True)
class Kink:
    """A place where the slopes of a plant jump, and the linear models on both sides.

    Args:
        name: State or input across which the slopes jump.
        distance: Where the kink is, from the operating point, in ``unit``; 0 for on the kink.
        of: Rate or measurement whose slope jumps most.
        slope_below: Its slope below the kink, in SI.
        slope_above: Its slope above the kink, in SI.
        slope_read: Unit in which people read the slopes, and its size from SI.
        read: Unit in which people read the distance, and its size from SI.
    """

    name: str
    unit: str
    distance: float
    below: LinearModel
    above: LinearModel
    of: str
    slope_below: float
    slope_above: float
    slope_read: tuple[str, float]
    read: tuple[str, float]

    @property
    def factor(self) -> float:
        """Larger over smaller of the two slopes, dimensionless."""
        small, large = sorted((abs(self.slope_below), abs(self.slope_above)))
        return large / small if small else float("inf")

    def __str__(self) -> str:
        unit, factor = self.slope_read
        below, above = (factor * slope for slope in (self.slope_below, self.slope_above))
        away = f"{self.distance * self.read[1]:+.3g}"
        where = f"{with_unit(away, self.read[0])} away" if self.distance else "at the point"
        return (
            f"kink in {self.name}, {where}: slope of {self.of}"
            f" {with_unit(f'{below:.4g}', unit)} below,"
            f" {above:.4g} above (factor {self.factor:.3g})"
        )


def slope_read(
    model: Model, row: str, row_unit: str, by: Quantity, slope: float
) -> tuple[str, float]:
    """Return the unit in which people read a slope, and its factor from SI.

    Args:
        row: Output, or ``"rate of"`` a state.
        row_unit: Its SI unit.
        slope: How steep it is, in SI.
    """
    top, rise = model.reading(row_unit, row, size=slope * by.scale)
    bottom, run = model.reading(by.unit, by.name, size=by.scale)
    return f"{top} per {bottom}", rise / run


def find_kinks(
    at: Derivatives,
    point: OperatingPoint,
    build: Callable[[Vector], LinearModel],
    matrix: Vector,
    jacobian: Vector,
) -> tuple[Kink, ...]:
    """Find kinks across each state and input, at the point or up to 5 % of a scale away.

    Args:
        build: Makes a linear model of derivatives, shape (n_x + n_y, n_x + n_u), in SI.
        matrix: Derivatives that the linear model uses, shape (n_x + n_y, n_x + n_u), in SI.
        jacobian: Derivatives at the point, same shape, in SI.

    Returns:
        The kinks, those at the point first, then by the size of the jump.
    """
    model = point.model
    quantities = [*model.states, *model.inputs]
    rows = [f"d {q.name}/dt" for q in model.states] + [q.name for q in model.outputs]
    names = [f"rate of {q.name}" for q in model.states] + [q.name for q in model.outputs]
    units = [per(q.unit, "s") for q in model.states] + [q.unit for q in model.outputs]
    columns = np.array([q.scale for q in quantities])
    sizes = np.array([q.scale for q in (*model.states, *model.outputs)])
    norm = columns / sizes[:, None]
    z = np.concatenate([point.x, point.u])
    p = model.values
    n = len(point.x)

    def slopes(index: int, by: float) -> Vector:
        moved = z.copy()
        moved[index] += by * columns[index]
        return at(moved[:n], moved[n:], p)[1]

    around = np.array(
        [[slopes(i, by) for by in (-_REACH, -_AT_ONCE, _AT_ONCE, _REACH)] for i in range(len(z))]
    )
    bends = _bends(around[:, :-1], around[:, 1:], norm)

    # What an oscillation has replaced stays replaced on both sides.
    swung = matrix != jacobian
    found = []
    for i, quantity in enumerate(quantities):
        if bends[i, 1] > _JUMP:
            jumps = [(0.0, around[i, 1], around[i, 2])]
        else:
            # A slope that was taken over an oscillation has crossed what is near.
            near = () if swung[:, i].any() else (-1, 1)
            jumps = [
                jump
                for side in near
                if bends[i, 1 + side] > _BEND
                and (jump := _nearest(slopes, i, side, around[i], bends[i, 1 + side], norm))
            ]
        for distance, below, above in jumps:
            change = np.abs(_relative(below, above, norm))
            # Of equal jumps the first is named: pressures stand before temperatures.
            first = int(np.argmax(change.ravel() > 0.9 * change.max()))
            row, column = np.unravel_index(first, change.shape)
            sided = [build(np.where(swung, matrix, side)) for side in (below, above)]
            found.append(
                Kink(
                    quantity.name,
                    quantity.unit,
                    distance * quantity.scale,
                    sided[0],
                    sided[1],
                    f"{rows[row]} by {quantities[column].name}",
                    float(below[row, column]),
                    float(above[row, column]),
                    slope_read(
                        model, names[row], units[row], quantities[column], above[row, column]
                    ),
                    model.reading(quantity.unit, quantity.name, size=distance * quantity.scale),
                )
            )
    return tuple(sorted(found, key=lambda kink: (kink.distance != 0.0, -kink.factor)))


def _nearest(
    slopes: Callable[[int, float], Vector],
    i: int,
    side: int,
    around: Vector,
    total: float,
    norm: Vector,
) -> tuple[float, Vector, Vector] | None:
    """Bisect towards a jump on one side; return distance, slopes below and slopes above."""
    here, there = (around[2], around[3]) if side > 0 else (around[1], around[0])
    near, beyond, before = _AT_ONCE, _REACH, here
    for _ in range(_BISECTIONS):
        middle = 0.5 * (near + beyond)
        slope = slopes(i, side * middle)
        if _bends(here, slope, norm) > 0.5 * total:
            beyond, there = middle, slope
        else:
            near, before = middle, slope
    # A bend that is spread out, as that of a rounded kink, is none.
    if _bends(before, there, norm) <= _JUMP:
        return None
    return side * beyond, *((before, there) if side > 0 else (there, before))


def _bends(a: Vector, b: Vector, norm: Vector) -> Vector:
    """Return the largest relative change of a slope, over the last two axes."""
    return np.asarray(np.abs(_relative(a, b, norm)).max(axis=(-2, -1)))


def _relative(a: Vector, b: Vector, norm: Vector) -> Vector:
    """Return the change of each slope relative to itself, minor slopes relative to their row."""
    scaled_a, scaled_b = a * norm, b * norm
    size = np.maximum(np.abs(scaled_a), np.abs(scaled_b))
    row = size.max(axis=-1, keepdims=True)
    return np.asarray((scaled_b - scaled_a) / (size + _MINOR * row + 1e-12))


BLOCK = 250
"""Samples that are run at once; comparisons last whole blocks."""


class Comparison:
    """The first output of the exact plant and of a linear model, at changes of the first input.

    ``sample_time`` is the time between its samples, in s.
    """

    def __init__(self, linear: LinearModel) -> None:
        op = linear.operating_point
        self.model = linear
        self.sample_time = step_time(linear) / 1000
        outputs = [q.name for q in op.model.outputs]
        self.plant_index = outputs.index(linear.output_names[0])
        self.quantity: Output = op.model.outputs[self.plant_index]
        self.largest = self._largest()
        self.held_plant = _without_drift(op)
        self.steppers: dict[str, Stepper] = {}

    def _largest(self) -> float:
        u0 = float(self.model.u0[0])
        if self.model.inverse is not None:
            return 1.0 - abs(u0)
        op = self.model.operating_point
        quantity = next(q for q in op.model.inputs if q.name == self.model.input_names[0])
        room = min(quantity.upper - u0, u0 - quantity.lower)
        if room <= 0.0:
            unit = quantity.display_unit
            rest = with_unit(f"{from_si(u0, unit):g}", unit)
            raise WorkbenchError(
                f"{quantity.name} rests at an end of its range, {rest}; how far the"
                " linear model holds is tried in both directions: rest the plant elsewhere, with"
                " another output or input (--at NAME=VALUE)"
            )
        return room if math.isfinite(room) else 10.0 * quantity.scale

    def gain(self, s: complex) -> complex:
        """Compute the linear model's transfer function at a complex frequency, in rad/s."""
        m = self.model
        return complex(transfer_function(m.A, m.B, m.C, m.D, s)[0, 0])

    def linear(self, change: Vector) -> Vector:
        """Compute how the output of the linear model changes, shape (n,), in SI.

        Args:
            change: Change of the first input, shape (n,), in SI.
        """
        held = np.tile(self.model.u0, (len(change), 1))
        held[:, 0] += change
        response = self.model.response(held, self.sample_time)
        return np.asarray(response[:, 0] - self.model.y0[0])

    def plant(self, change: Vector) -> Vector:
        """Compute how the exact plant's output changes, shape (n,), with its first input, in SI.

        Raises:
            NumericalError: If the integrator gives up.
        """
        op = self.model.operating_point
        held = np.tile(op.u, (len(change), 1))
        names = [q.name for q in op.model.inputs]
        i = names.index(self.model.input_names[0]) if self.model.inverse is None else 0
        held[:, i] = self.model.to_plant(self.model.u0[0] + change)
        try:
            return self._run("erk", held)
        except NumericalError:
            return self._run("rosenbrock", held)

    def _run(self, method: Method, held: Vector) -> Vector:
        op = self.model.operating_point
        if method not in self.steppers:
            self.steppers[method] = Stepper(self.held_plant, self.sample_time, 1e-7, method)
        stepper = self.steppers[method]
        x, read = op.x, []
        for start in range(0, len(held), BLOCK):
            block = held[start : start + BLOCK]
            after = stepper.run(x, block)
            for state, u in zip(np.vstack([x, after[:-1]]), block, strict=True):
                read.append(stepper.read(state, u)[self.plant_index])
            x = after[-1]
        return np.asarray(read, dtype=float) - float(op.y[self.plant_index])


@dataclass(frozen=True)
class _Held:
    """Equations with constant rates taken off."""

    equations: Callable[..., Any]
    names: tuple[str, ...]

    def __call__(self, m: Scope) -> Any:
        found = self.equations(m)
        rates, *outputs = (found,) if isinstance(found, Mapping) else found
        held = {**rates, **{n: rates[n] - m.p[f"held_rate.{n}"] for n in self.names}}
        return (held, *outputs) if outputs else held


def _without_drift(op: OperatingPoint) -> Model:
    if not op.drift:
        return op.model
    # Parameters instead of numbers: the compiled plant then serves every operating point.
    extra = tuple(
        Parameter(f"held_rate.{q.name}", f"{q.unit}/s", value=op.drift[q.name])
        for q in op.model.states
        if q.name in op.drift
    )
    return replace(
        op.model,
        equations=_Held(op.model.equations, tuple(n for n in op.drift if "." not in n)),
        parameters=(*op.model.parameters, *extra),
    )


_POINTS = 10
_LONGEST = 10
"""Horizons for which a transient is waited out at the most."""

GAIN_WITHIN, PHASE_WITHIN = 0.1, math.radians(10.0)
"""Largest errors of gain, as a fraction, and phase, in rad, at which a frequency agrees."""


@dataclass(frozen=True)
class FrequencyValidity:
    """Frequencies at which a sine on the full plant agrees with the linear model.

    Args:
        lower: Lowest frequency of the band that agrees, in Hz; NaN if none does.
        upper: Highest frequency of the band that agrees, in Hz; NaN if none does.
        frequencies_hz: Frequencies that were tried, shape (n,), in Hz.
        amplitudes: Amplitude of the input at each, shape (n,), in SI of the linear model's input.
        gain_ratios: Gain of the plant over that of the linear model, shape (n,), dimensionless.
        phase_errors: Phase of the plant less that of the linear model, shape (n,), in rad.
    """

    input: str
    output: str
    lower: float
    upper: float
    frequencies_hz: Vector
    amplitudes: Vector
    gain_ratios: Vector
    phase_errors: Vector

    @property
    def agrees(self) -> npt.NDArray[np.bool_]:
        """Whether gain and phase agree at each frequency, shape (n,)."""
        phase = np.abs(self.phase_errors) <= PHASE_WITHIN
        return np.asarray((np.abs(self.gain_ratios - 1.0) <= GAIN_WITHIN) & phase)

    def __str__(self) -> str:
        limits = f"within {100 * GAIN_WITHIN:.0f} % and {math.degrees(PHASE_WITHIN):.0f} deg"
        if np.isnan(self.gain_ratios).all():
            return f"sines of {self.input}: none can be tried, as the plant grows"
        if math.isnan(self.upper):
            return f"sines of {self.input}: {self.output} agrees at no frequency {limits}"
        low, high = f"{self.lower:.3g}", f"{self.upper:.3g}"
        band = f"at {low} Hz alone" if low == high else f"from {low} to {high} Hz"
        return f"sines of {self.input}: {self.output} agrees {limits} {band}"


def frequency_validity(linear: LinearModel) -> FrequencyValidity:
    """Find the frequencies at which a sine on the full plant agrees with the linear model.

    At each frequency the input's amplitude is chosen so that the linear model predicts an
    oscillation of the output by 5 % of its scale, as far as the input's range allows. After the
    transient, gain and phase of the fundamental are fitted to both runs alike. What grows beyond
    three of its time constants within that is not tried: nothing of a sine is left.

    Source:
        Describing functions by simulation.
    """
    trial = Comparison(linear)
    wanted = 0.05 * trial.quantity.scale
    horizon = horizon_of(linear)
    # Twenty samples show a sine.
    highest = min(20.0 / horizon, 1.0 / (20 * trial.sample_time))
    frequencies = np.logspace(math.log10(0.2 / horizon), math.log10(highest), _POINTS)
    grows = max((m.pole.real for m in linear.modes), default=0.0) * horizon > _GROWN
    swinging = [-m.pole.real for m in linear.modes if m.damping < 1.0 and m.pole.real < 0.0]
    settle = min(4.0 / min(swinging), _LONGEST * horizon) if swinging else 0.0
    amplitudes, ratios = [], []
    for frequency in frequencies.tolist():
        gain = abs(trial.gain(2j * math.pi * frequency))
        driven = min(wanted / gain if gain else math.inf, 0.9 * trial.largest)
        amplitudes.append(driven)
        ratio = complex(math.nan) if grows else _sine_ratio(trial, frequency, driven, settle)
        ratios.append(ratio)
    table = np.array(ratios)
    found = FrequencyValidity(
        input=linear.input_names[0],
        output=trial.quantity.name,
        lower=math.nan,
        upper=math.nan,
        frequencies_hz=frequencies,
        amplitudes=np.array(amplitudes),
        gain_ratios=np.abs(table),
        phase_errors=np.angle(table),
    )
    if not (bands := runs(found.agrees)):
        return found
    first, last = max(bands, key=lambda band: band[1] - band[0])
    return replace(found, lower=float(frequencies[first]), upper=float(frequencies[last]))


def _sine_ratio(trial: Comparison, frequency: float, amplitude: float, settle: float) -> complex:
    """Return the fundamental of the plant's output over that of the linear model's."""
    period = 1.0 / frequency
    start = math.ceil((settle + period) / period) * period
    total = math.ceil((start + 3.0 * period) / (trial.sample_time * BLOCK)) * BLOCK
    time = np.asarray(trial.sample_time * np.arange(total), dtype=float)
    change = amplitude * np.sin(2 * math.pi * frequency * time)
    try:
        actual = trial.plant(change)
    except NumericalError:
        return complex(math.nan)
    seen = (time >= start) & (time < start + 3.0 * period)
    fit = _fundamental(time[seen], frequency)
    return fit(actual[seen]) / fit(trial.linear(change)[seen])


def _fundamental(time: Vector, frequency: float) -> Callable[[Vector], complex]:
    """Return a fit of the fundamental beside a slow drift."""
    phase = 2 * math.pi * frequency * time
    slow = (time - time.mean()) / (np.ptp(time) or 1.0)
    basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(time), slow, slow**2])

    def fit(y: Vector) -> complex:
        found = np.linalg.lstsq(basis, y, rcond=None)[0]
        return complex(found[0], -found[1])

    return fit


_GRID = 13
_HALVINGS = 4
_GROWN = 3.0
"""Time constants of an unstable mode after which nothing is left to compare."""


@dataclass(frozen=True)
class AmplitudeValidity:
    """Steps of an input for which the linear response holds.

    Args:
        within: Largest deviation allowed, as a fraction of the largest linear response.
        horizon: Length of the comparison after the step, in s.
        lower: Smallest step that holds, in SI of the linear model's input; NaN if none does.
        upper: Largest step that holds, in SI of the linear model's input; NaN if none does.
        amplitudes: Steps that were tried, in both directions, shape (n,), in SI.
        errors: Deviation of the worse direction, as a fraction, shape (n,), dimensionless.
        moves: Largest linear response to each step, shape (n,), in SI of the output.
        input_unit: Unit in which the steps are written; empty where it is not known.
    """

    input: str
    output: str
    within: float
    horizon: float
    lower: float
    upper: float
    amplitudes: Vector
    errors: Vector
    moves: Vector
    unit: str
    input_unit: str = ""

    def __str__(self) -> str:
        i = int(np.argmin(self.errors))
        unit = self.input_unit or "1"
        tried, lower = (
            f"{from_si(float(size), unit):.3g}" for size in (self.amplitudes[i], self.lower)
        )
        upper = with_unit(f"{from_si(self.upper, unit):.3g}", unit)
        moved = from_si(float(self.moves[i]), self.unit)
        closest = (
            f"closest at {with_unit(tried, unit)} with {100 * self.errors[i]:.0f} %, where"
            f" {self.output} moves {with_unit(f'{moved:.3g}', self.unit)}"
        )
        head = f"steps of {self.input} over {in_time(self.horizon)}"
        if math.isnan(self.upper):
            return f"{head}: none holds within {100 * self.within:.0f} %; {closest}"
        top = from_si(float(np.interp(self.upper, self.amplitudes, self.moves)), self.unit)
        return (
            f"{head}: hold within {100 * self.within:.0f} % from {lower} to"
            f" {upper} ({self.output} moves up to {with_unit(f'{top:.3g}', self.unit)}); {closest}"
        )


def amplitude_validity(linear: LinearModel, *, within: float = 0.1) -> AmplitudeValidity:
    """Find the steps of the first input for which the linear response holds.

    Steps of growing size, in both directions, from a thousandth of the input's range on, run on
    the exact plant and on the linear model, for two periods of the slowest oscillation or three
    time constants, and no longer than three time constants of an unstable mode; the ends of the
    band that holds are bisected.

    Args:
        within: Deviation allowed, as a fraction of the largest linear response.
    """
    check_range("deviation", within, 1e-6, 10.0)
    trial = Comparison(linear)
    growing = max((m.pole.real for m in linear.modes), default=0.0)
    length = min(horizon_of(linear), _GROWN / growing if growing > 0.0 else math.inf)
    blocks = max(1, math.ceil(length / (trial.sample_time * BLOCK)))
    counted = min(blocks * BLOCK, max(2, round(length / trial.sample_time)))

    def error(step: float) -> tuple[float, float]:
        worst, move = 0.0, 0.0
        for sign in (1.0, -1.0):
            held = np.full(blocks * BLOCK, sign * step)
            predicted = trial.linear(held)[:counted]
            move = float(np.max(np.abs(predicted)))
            try:
                actual = trial.plant(held)[:counted]
            except NumericalError:
                return math.inf, move
            worst = max(worst, float(np.max(np.abs(actual - predicted))) / (move or 1.0))
        return worst, move

    steps = trial.largest * np.logspace(-3.0, 0.0, _GRID)
    tried = {float(step): error(float(step)) for step in steps}

    def end(inside: float, outside: float) -> float:
        for _ in range(_HALVINGS):
            middle = math.sqrt(inside * outside)
            tried[middle] = error(middle)
            if tried[middle][0] <= within:
                inside = middle
            else:
                outside = middle
        return inside

    errors = np.array([tried[float(s)][0] for s in steps])
    best = int(np.argmin(errors))
    band = next((own for own in runs(errors <= within) if own[0] <= best <= own[1]), None)
    lower = upper = math.nan
    if band is not None:
        first, last = band
        lower, upper = float(steps[first]), float(steps[last])
        if first > 0:
            lower = end(lower, float(steps[first - 1]))
        if last < len(steps) - 1:
            upper = end(upper, float(steps[last + 1]))
    amplitudes = np.array(sorted(tried))
    inputs = linear.operating_point.model.inputs
    units = {q.name: of_difference(q.display_unit) for q in inputs}
    return AmplitudeValidity(
        input=linear.input_names[0],
        output=trial.quantity.name,
        within=within,
        horizon=counted * trial.sample_time,
        lower=lower,
        upper=upper,
        amplitudes=amplitudes,
        errors=np.array([tried[a][0] for a in amplitudes]),
        moves=np.array([tried[a][1] for a in amplitudes]),
        unit=of_difference(trial.quantity.display_unit),
        input_unit=units.get(linear.input_names[0], "") if linear.inverse is None else "",
    )


@dataclass(frozen=True)
class DescribingFunction:
    """A slope that was taken over an oscillation of a state because it is another at the point.

    Args:
        amplitude: Amplitude of the oscillation, in SI.
        of: State whose rate has the slope.
        at_rest: Slope at the point, in SI.
        over_oscillation: Slope over the oscillation, in SI, which the matrices hold.
        read: Unit in which people read the amplitude, and its size from SI.
        slope_read: Unit in which people read the slopes, and its size from SI.
    """

    name: str
    amplitude: float
    of: str
    at_rest: float
    over_oscillation: float
    read: tuple[str, float]
    slope_read: tuple[str, float]

    def __str__(self) -> str:
        unit, factor = self.slope_read
        amplitude = with_unit(f"{self.amplitude * self.read[1]:.4g}", self.read[0])
        return (
            f"slope of d {self.of}/dt by {self.name}:"
            f" {with_unit(f'{factor * self.over_oscillation:.4g}', unit)} over an oscillation of"
            f" {amplitude}, {factor * self.at_rest:.4g} at the point"
        )


@dataclass(frozen=True)
class Validity:
    """How far a linear model may be trusted."""

    linear: LinearModel
    kinks: tuple[Kink, ...]
    describing_functions: tuple[DescribingFunction, ...]

    @cached_property
    def amplitude(self) -> AmplitudeValidity:
        """Steps of the input for which the linear response holds within 10 %; simulated once."""
        return amplitude_validity(self.linear)

    @cached_property
    def frequency(self) -> FrequencyValidity:
        """Frequencies up to which a sine on the full plant agrees; simulated once.

        The output oscillates by 5 % of its scale.
        """
        return frequency_validity(self.linear)

    def summary(self) -> list[str]:
        """Return the lines that need no simulation: kinks and describing functions."""
        told = [str(item) for item in (*self.kinks, *self.describing_functions)]
        return told or ["no kink next to the point"]

    def __str__(self) -> str:
        return "\n".join([*self.summary(), str(self.amplitude), str(self.frequency)])
