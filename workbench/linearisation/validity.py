"""How far a linear model holds: steps and sines on the full plant against the linear response.

Both runs get the same inputs, held between the same samples, so that holding itself is no
difference. Where the operating point drifts, the plant is compared with the rates of the point
taken off: the drift is known, and a linear model is not to be blamed for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.errors import NumericalError, check_choice, check_range
from workbench.linearisation.linear_model import LinearModel
from workbench.model import Model, Output, Parameter, Scope
from workbench.model.trace import Equations
from workbench.model.units import from_si
from workbench.operating_point import OperatingPoint
from workbench.simulation.stepper import Stepper

Vector = npt.NDArray[np.float64]

SAMPLE_TIME = 0.002
"""Time between samples of the comparison, s."""

_BLOCK = 250
_GRID = 13
_BISECTIONS = 4
_HIGHEST_HZ = 1.0 / (20 * SAMPLE_TIME)


@dataclass(frozen=True)
class AmplitudeValidity:
    """Steps of an input for which the linear response holds.

    Args:
        input: Name of the input.
        output: Output that was compared.
        within: Largest deviation allowed, as a fraction of the largest linear response.
        horizon: Length of the comparison after the step, in s.
        lower: Smallest step that holds, in SI of the linear model's input; NaN if none does.
        upper: Largest step that holds, in SI of the linear model's input; NaN if none does.
        amplitudes: Steps that were tried, in both directions, shape (n,), in SI.
        errors: Deviation of the worse direction, as a fraction, shape (n,), dimensionless.
        moves: Largest linear response to each step, shape (n,), in SI of the output.
        unit: Unit in which the output is shown.

    Example:
        >>> a = np.array([0.1, 1.0])
        >>> holds = AmplitudeValidity("u", "y", 0.1, 1.0, 0.1, 0.5, a, 0.2 * a, a, "1")
        >>> holds.best
        0.1
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

    @property
    def best(self) -> float:
        """Step with the smallest deviation, in SI of the linear model's input."""
        return float(self.amplitudes[int(np.argmin(self.errors))])

    def __str__(self) -> str:
        """Return one line: the steps that hold, or how close the best one comes."""
        i = int(np.argmin(self.errors))
        moved = from_si(float(self.moves[i]), self.unit)
        closest = (
            f"closest at {self.amplitudes[i]:.3g} with {100 * self.errors[i]:.0f} %, where"
            f" {self.output} moves {moved:.3g} {self.unit}"
        )
        head = f"steps of {self.input} over {self.horizon:.3g} s"
        if math.isnan(self.upper):
            return f"{head}: none holds within {100 * self.within:.0f} %; {closest}"
        top = from_si(float(np.interp(self.upper, self.amplitudes, self.moves)), self.unit)
        return (
            f"{head}: hold within {100 * self.within:.0f} % from {self.lower:.3g} to"
            f" {self.upper:.3g} ({self.output} moves up to {top:.3g} {self.unit}); {closest}"
        )


@dataclass(frozen=True)
class FrequencyValidity:
    """Frequencies at which a sine on the full plant agrees with the linear model.

    Args:
        input: Name of the input.
        output: Output that was compared.
        gain_within: Largest gain error allowed, as a fraction.
        phase_within: Largest phase error allowed, in rad.
        lower: Lowest frequency of the band that agrees, in Hz; NaN if none does.
        upper: Highest frequency of the band that agrees, in Hz; NaN if none does.
        frequencies_hz: Frequencies that were tried, shape (n,), in Hz.
        amplitudes: Amplitude of the input at each, shape (n,), in SI of the linear model's input.
        gain_ratios: Gain of the plant over that of the linear model, shape (n,), dimensionless.
        phase_errors: Phase of the plant less that of the linear model, shape (n,), in rad.

    Example:
        >>> one = np.ones(2)
        >>> print(FrequencyValidity("u", "y", 0.1, 0.17, 1.0, 2.0, one, one, one, 0 * one))
        sines of u: y agrees within 10 % and 10 deg from 1 to 2 Hz
    """

    input: str
    output: str
    gain_within: float
    phase_within: float
    lower: float
    upper: float
    frequencies_hz: Vector
    amplitudes: Vector
    gain_ratios: Vector
    phase_errors: Vector

    @property
    def agrees(self) -> npt.NDArray[np.bool_]:
        """Whether gain and phase agree at each frequency, shape (n,)."""
        return (np.abs(self.gain_ratios - 1.0) <= self.gain_within) & (
            np.abs(self.phase_errors) <= self.phase_within
        )

    def __str__(self) -> str:
        """Return one line: the band that agrees."""
        limits = (
            f"within {100 * self.gain_within:.0f} % and {math.degrees(self.phase_within):.0f} deg"
        )
        if math.isnan(self.upper):
            return f"sines of {self.input}: {self.output} agrees at no frequency {limits}"
        return (
            f"sines of {self.input}: {self.output} agrees {limits} from {self.lower:.3g} to"
            f" {self.upper:.3g} Hz"
        )


def amplitude_validity(
    linear: LinearModel,
    *,
    output: str = "",
    within: float = 0.1,
    horizon: float | None = None,
) -> AmplitudeValidity:
    """Find the steps of the first input for which the linear response holds.

    Steps of growing size, in both directions, from a thousandth of the input's range on, run on
    the exact plant and on the linear model; the ends of the band that holds are bisected.

    Args:
        linear: The linear model.
        output: Output to compare; the first by default.
        within: Deviation allowed, as a fraction of the largest linear response.
        horizon: Length of the comparison, in s; by default two periods of the slowest oscillation,
            or three time constants.

    Returns:
        The band of steps.

    Raises:
        WorkbenchError: If an argument is outside its range.

    Example:
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis().without("coulomb_friction")
        >>> holds = amplitude_validity(linearise(operating_point(axis)))
        >>> round(holds.upper)  # a linear plant: up to the largest force
        350
    """
    check_range("deviation", within, 1e-6, 10.0)
    trial = _Comparison(linear, output)
    length = _horizon(linear) if horizon is None else horizon
    check_range("horizon", length, SAMPLE_TIME, 60.0, "s")
    blocks = max(1, math.ceil(length / (SAMPLE_TIME * _BLOCK)))
    counted = min(blocks * _BLOCK, max(2, round(length / SAMPLE_TIME)))

    def error(step: float) -> tuple[float, float]:
        worst, move = 0.0, 0.0
        for sign in (1.0, -1.0):
            held = np.full(blocks * _BLOCK, sign * step)
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
        for _ in range(_BISECTIONS):
            middle = math.sqrt(inside * outside)
            tried[middle] = error(middle)
            if tried[middle][0] <= within:
                inside = middle
            else:
                outside = middle
        return inside

    band = _band_around_best(np.array([tried[float(s)][0] for s in steps]), within)
    lower = upper = math.nan
    if band is not None:
        first, last = band
        lower, upper = float(steps[first]), float(steps[last])
        if first > 0:
            lower = end(lower, float(steps[first - 1]))
        if last < len(steps) - 1:
            upper = end(upper, float(steps[last + 1]))
    amplitudes = np.array(sorted(tried))
    return AmplitudeValidity(
        input=linear.input_names[0],
        output=trial.quantity.name,
        within=within,
        horizon=counted * SAMPLE_TIME,
        lower=lower,
        upper=upper,
        amplitudes=amplitudes,
        errors=np.array([tried[a][0] for a in amplitudes]),
        moves=np.array([tried[a][1] for a in amplitudes]),
        unit=trial.quantity.display_unit,
    )


def frequency_validity(
    linear: LinearModel,
    *,
    output: str = "",
    swing: float | None = None,
    gain_within: float = 0.1,
    phase_within: float = math.radians(10.0),
    points: int = 10,
) -> FrequencyValidity:
    """Find the frequencies at which a sine on the full plant agrees with the linear model.

    At each frequency the input's amplitude is chosen so that the linear model predicts the same
    swing of the output, as far as the input's range allows. After the transient, gain and phase of
    the fundamental are fitted to both runs alike.

    Args:
        linear: The linear model.
        output: Output to compare; the first by default.
        swing: Amplitude of the output, in SI; 5 % of its scale by default.
        gain_within: Gain error allowed, as a fraction.
        phase_within: Phase error allowed, in rad.
        points: Number of frequencies.

    Returns:
        The band that agrees.

    Raises:
        WorkbenchError: If an argument is outside its range.

    Source:
        Describing functions by simulation.

    Example:
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis().without("coulomb_friction")
        >>> agree = frequency_validity(linearise(operating_point(axis)), points=3)
        >>> bool(agree.agrees.all())
        True
    """
    check_range("number of frequencies", points, 2, 200)
    check_range("gain error", gain_within, 1e-6, 10.0)
    check_range("phase error", phase_within, 1e-6, math.pi, "rad")
    trial = _Comparison(linear, output)
    wanted = 0.05 * trial.quantity.scale if swing is None else swing
    check_range("swing", wanted, 1e-12, 1e12, trial.quantity.unit)
    corner = 2.0 / _horizon(linear)
    frequencies = np.logspace(
        math.log10(0.1 * corner), math.log10(min(10.0 * corner, _HIGHEST_HZ)), points
    )
    swinging = [-m.pole.real for m in linear.modes if m.damping < 1.0 and m.pole.real < 0.0]
    settle = min(4.0 / min(swinging), 8.0) if swinging else 0.0
    amplitudes, ratios = [], []
    for frequency in frequencies:
        gain = abs(trial.gain(2j * math.pi * frequency))
        amplitude = min(wanted / gain if gain else math.inf, 0.9 * trial.largest)
        amplitudes.append(amplitude)
        ratios.append(_sine_ratio(trial, float(frequency), amplitude, settle))
    table = np.array(ratios)
    found = FrequencyValidity(
        input=linear.input_names[0],
        output=trial.quantity.name,
        gain_within=gain_within,
        phase_within=phase_within,
        lower=math.nan,
        upper=math.nan,
        frequencies_hz=frequencies,
        amplitudes=np.array(amplitudes),
        gain_ratios=np.abs(table),
        phase_errors=np.angle(table),
    )
    band = _longest_run(found.agrees)
    if band is None:
        return found
    return replace(found, lower=float(frequencies[band[0]]), upper=float(frequencies[band[1]]))


class _Comparison:
    """The exact plant and the linear model behind the same held inputs."""

    def __init__(self, linear: LinearModel, output: str) -> None:
        op = linear.operating_point
        name = output or linear.output_names[0]
        check_choice("output", name, linear.output_names)
        self.model = linear
        self.index = linear.output_names.index(name)
        outputs = [q.name for q in op.model.outputs]
        self.plant_index = outputs.index(name)
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
        return room if math.isfinite(room) else 10.0 * quantity.scale

    def gain(self, s: complex) -> complex:
        m = self.model
        inner = np.linalg.solve(s * np.eye(len(m.A)) - m.A, m.B[:, 0])
        return complex(m.C[self.index] @ inner + m.D[self.index, 0])

    def linear(self, change: Vector) -> Vector:
        """Return the change of the output for a change of the first input, shape (n,)."""
        held = np.tile(self.model.u0, (len(change), 1))
        held[:, 0] += change
        response = self.model.response(held, SAMPLE_TIME)
        return np.asarray(response[:, self.index] - self.model.y0[self.index])

    def plant(self, change: Vector) -> Vector:
        """Return the output of the exact plant for a change of the first input, shape (n,)."""
        op = self.model.operating_point
        held = np.tile(op.u, (len(change), 1))
        i = 0
        if self.model.inverse is None:
            names = [q.name for q in op.model.inputs]
            i = names.index(self.model.input_names[0])
        held[:, i] = self.model.to_plant(self.model.u0[0] + change)
        try:
            return self._run("erk", held)
        except NumericalError:
            return self._run("rosenbrock", held)

    def _run(self, method: str, held: Vector) -> Vector:
        op = self.model.operating_point
        if method not in self.steppers:
            self.steppers[method] = Stepper(
                self.held_plant, SAMPLE_TIME, 1e-7, "erk" if method == "erk" else "rosenbrock"
            )
        stepper = self.steppers[method]
        x, read = op.x, []
        for start in range(0, len(held), _BLOCK):
            block = held[start : start + _BLOCK]
            after = stepper.run(x, block)
            for state, u in zip(np.vstack([x, after[:-1]]), block, strict=True):
                read.append(stepper.read(state, u)[self.plant_index])
            x = after[-1]
        return np.asarray(read, dtype=float) - float(op.y[self.plant_index])


@dataclass(frozen=True)
class _Held:
    """Equations with constant rates taken off."""

    equations: Callable[..., Equations]
    names: tuple[str, ...]

    def __call__(self, m: Scope) -> Equations:
        rates, outputs = self.equations(m)
        taken = {name: rates[name] - m.p[f"held_rate.{name}"] for name in self.names}
        return {**rates, **taken}, outputs


def _without_drift(op: OperatingPoint) -> Model:
    if not op.drift:
        return op.model
    # Parameters instead of numbers: the compiled plant then serves every operating point.
    units = {q.name: q.unit for q in op.model.states}
    extra = tuple(
        Parameter(f"held_rate.{name}", f"{units[name]}/s", value=rate)
        for name, rate in op.drift.items()
    )
    return replace(
        op.model,
        equations=_Held(op.model.equations, tuple(op.drift)),
        parameters=(*op.model.parameters, *extra),
    )


def _sine_ratio(trial: _Comparison, frequency: float, amplitude: float, settle: float) -> complex:
    """Return the fundamental of the plant's output over that of the linear model's."""
    period = 1.0 / frequency
    start = math.ceil((settle + period) / period) * period
    total = math.ceil((start + 3.0 * period) / (SAMPLE_TIME * _BLOCK)) * _BLOCK
    time = np.asarray(SAMPLE_TIME * np.arange(total), dtype=float)
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


def _horizon(linear: LinearModel) -> float:
    """Return two periods of the slowest oscillation, or three of the slowest time constants."""
    swinging = [m.frequency_hz for m in linear.modes if m.damping < 1.0 and m.frequency_hz < 20.0]
    if swinging:
        return float(np.clip(2.0 / min(swinging), 0.05, 10.0))
    sizes = [abs(m.pole) for m in linear.modes if abs(m.pole) > 0.1]
    return float(np.clip(3.0 / min(sizes, default=1.0), 0.05, 10.0))


def _band_around_best(errors: Vector, within: float) -> tuple[int, int] | None:
    best = int(np.argmin(errors))
    if not errors[best] <= within:
        return None
    first = last = best
    while first > 0 and errors[first - 1] <= within:
        first -= 1
    while last < len(errors) - 1 and errors[last + 1] <= within:
        last += 1
    return first, last


def _longest_run(flags: npt.NDArray[np.bool_]) -> tuple[int, int] | None:
    best: tuple[int, int] | None = None
    start = None
    for i, flag in enumerate([*flags.tolist(), False]):
        if flag and start is None:
            start = i
        elif not flag and start is not None:
            if best is None or i - start > best[1] - best[0] + 1:
                best = (start, i - 1)
            start = None
    return best
