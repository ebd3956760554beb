"""How large a step may be: steps on the full plant against the linear response."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.arrays import Vector
from workbench.errors import NumericalError, check_range
from workbench.linearisation.comparison import BLOCK, Comparison
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.pace import horizon_of
from workbench.model.units import from_si, in_time, of_difference, with_unit

_GRID = 13
_BISECTIONS = 4
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

    @property
    def best(self) -> float:
        """Step with the smallest deviation, in SI of the linear model's input."""
        return float(self.amplitudes[int(np.argmin(self.errors))])

    def __str__(self) -> str:
        """Return one line: the steps that hold, or how close the best one comes."""
        i = int(np.argmin(self.errors))
        unit = self.input_unit or "1"
        tried, lower = (
            f"{from_si(float(size), unit):.3g}" for size in (self.amplitudes[i], self.lower)
        )
        upper = with_unit(f"{from_si(self.upper, unit):.3g}", unit)
        moved = from_si(float(self.moves[i]), self.unit)
        closest = (
            f"closest at {with_unit(tried, unit)} with {100 * self.errors[i]:.0f} %, where"
            f" {self.output} moves {moved:.3g} {self.unit}"
        )
        head = f"steps of {self.input} over {in_time(self.horizon)}"
        if math.isnan(self.upper):
            return f"{head}: none holds within {100 * self.within:.0f} %; {closest}"
        top = from_si(float(np.interp(self.upper, self.amplitudes, self.moves)), self.unit)
        return (
            f"{head}: hold within {100 * self.within:.0f} % from {lower} to"
            f" {upper} ({self.output} moves up to {top:.3g} {self.unit}); {closest}"
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
    length = horizon_of(linear)
    if growing * length > _GROWN:
        length = _GROWN / growing
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
