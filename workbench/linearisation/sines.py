"""How fast a sine may be: sines on the full plant against the linear response."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import NumericalError
from workbench.linearisation.comparison import BLOCK, Comparison
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.pace import horizon_of

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
        """Return one line: the band that agrees."""
        limits = f"within {100 * GAIN_WITHIN:.0f} % and {math.degrees(PHASE_WITHIN):.0f} deg"
        if math.isnan(self.upper):
            return f"sines of {self.input}: {self.output} agrees at no frequency {limits}"
        low, high = f"{self.lower:.3g}", f"{self.upper:.3g}"
        band = f"at {low} Hz alone" if low == high else f"from {low} to {high} Hz"
        return f"sines of {self.input}: {self.output} agrees {limits} {band}"


def frequency_validity(linear: LinearModel) -> FrequencyValidity:
    """Find the frequencies at which a sine on the full plant agrees with the linear model.

    At each frequency the input's amplitude is chosen so that the linear model predicts an
    oscillation of the output by 5 % of its scale, as far as the input's range allows. After the
    transient, gain and phase of the fundamental are fitted to both runs alike.

    Source:
        Describing functions by simulation.
    """
    trial = Comparison(linear)
    wanted = 0.05 * trial.quantity.scale
    horizon = horizon_of(linear)
    # Twenty samples show a sine.
    highest = min(20.0 / horizon, 1.0 / (20 * trial.sample_time))
    frequencies = np.logspace(math.log10(0.2 / horizon), math.log10(highest), _POINTS)
    swinging = [-m.pole.real for m in linear.modes if m.damping < 1.0 and m.pole.real < 0.0]
    settle = min(4.0 / min(swinging), _LONGEST * horizon) if swinging else 0.0
    amplitudes, ratios = [], []
    for frequency in frequencies:
        gain = abs(trial.gain(2j * math.pi * frequency))
        driven = min(wanted / gain if gain else math.inf, 0.9 * trial.largest)
        amplitudes.append(driven)
        ratios.append(_sine_ratio(trial, float(frequency), driven, settle))
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
    band = _longest_run(found.agrees)
    if band is None:
        return found
    return replace(found, lower=float(frequencies[band[0]]), upper=float(frequencies[band[1]]))


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
