"""The paper's open-loop experiment: a pulse train on the valve, the arm runs from stop to stop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError, check_finite, check_range
from workbench.model import Model
from workbench.simulation import Trajectory, simulate

LOW, HIGH = math.radians(3.0), math.radians(57.0)
"""Marks between which a transit is timed, in rad."""

SMOOTHING = 0.03
"""Width of the window over which speeds are taken from angles, in s: a fifteenth of a ripple."""

DIP_DEPTH = 0.05
"""A dip is a minimum this far below the maxima on both sides, as a share of the top speed."""

TOUCH_WINDOW = 0.02
"""Time before the contact with a stop over which the touch speed is taken, in s."""


@dataclass(frozen=True)
class Transit:
    """One run of the arm from one end of its travel to the other.

    Args:
        start: Time at which it passes the first mark, in s.
        duration: Time between the marks, in s.
        direction: 1 for a growing angle, -1 for a falling one.
        dips: Number of times the arm slows down and speeds up again between the marks.
        ripple_frequency: Inverse of the mean time between the speed's maxima, in Hz; NaN if there
            is no dip.
        top_speed: Largest speed between the marks, in rad/s.
        touch_speed: Speed at the first contact with the stop, in rad/s; NaN if it is not reached.
    """

    start: float
    duration: float
    direction: Literal[1, -1]
    dips: int
    ripple_frequency: float
    top_speed: float
    touch_speed: float


@dataclass(frozen=True)
class TransitFigures:
    """What the transits of an experiment have in common: the figures of the paper's Figure 8.

    Args:
        transit_time: Median time between the marks, in s; NaN without a transit.
        ripple_frequency: Median ripple frequency, in Hz; NaN without ripple.
        dips: Median number of dips in a transit; 0 without a transit.
        touch_speed: Largest speed at the contact with a stop, in rad/s; NaN if none is touched.
    """

    transits: tuple[Transit, ...]
    transit_time: float
    ripple_frequency: float
    dips: int
    touch_speed: float
    reason: str = ""

    def __str__(self) -> str:
        """Return a short aligned table."""
        rows = [
            f"transits           {len(self.transits)}",
            f"transit time       {self.transit_time:.2f} s",
            f"ripple frequency   {self.ripple_frequency:.2f} Hz",
            f"dips per transit   {self.dips}",
            f"stop touch speed   {math.degrees(self.touch_speed):.0f} deg/s",
        ]
        return "\n".join(rows + ([f"note               {self.reason}"] if self.reason else []))


def measure_transits(
    time: npt.ArrayLike,
    angle: npt.ArrayLike,
    *,
    stops: tuple[float, float] = (0.0, math.radians(60.0)),
) -> TransitFigures:
    """Measure every full transit of an arm, simulated or recorded.

    A transit begins where the angle leaves one mark for good and ends where it first passes the
    other. Its dips are the minima of the speed between the marks; the ripple's frequency comes
    from the speed's maxima. The touch speed is the slope at the stop of a parabola through the
    last angles before it.

    Args:
        time: Sample times, shape (n,), in s, evenly spaced.
        angle: Angles, shape (n,), in rad.
        stops: Angles of the lower and the upper stop, in rad.

    Source:
        The paper's Figure 8 and its description: full travel, gentle touch, vibration in between.
    """
    t, a = check_finite("time", time).ravel(), check_finite("angle", angle).ravel()
    if t.size != a.size or t.size < 20:
        raise WorkbenchError(
            f"time has {t.size} samples and angle {a.size}; give as many of both, 20 or more"
        )
    step = float(t[-1] - t[0]) / (t.size - 1)
    if step <= 0 or np.max(np.abs(np.diff(t) - step)) > 0.01 * step:
        raise WorkbenchError("the sample times are not evenly spaced; resample the recording first")
    check_range("sample time", step, 1e-5, 0.02, "s", fix="a ripple needs 20 samples or more")
    return _summary(tuple(_measure(t, a, *span, stops, step) for span in _spans(a)))


def _spans(angle: Vector) -> list[tuple[int, int, Literal[1, -1]]]:
    """Return (last sample at one mark, first sample at the other, direction)."""
    zone = np.where(angle <= LOW, -1, np.where(angle >= HIGH, 1, 0))
    return [
        (int(i), int(j), 1 if zone[j] > 0 else -1)
        for i, j in pairwise(np.flatnonzero(zone))
        if zone[i] != zone[j]
    ]


def _measure(
    t: Vector,
    angle: Vector,
    begin: int,
    end: int,
    direction: Literal[1, -1],
    stops: tuple[float, float],
    step: float,
) -> Transit:
    from scipy.signal import find_peaks, savgol_filter

    a = angle if direction > 0 else LOW + HIGH - angle
    first = float(np.interp(LOW, a[begin : begin + 2], t[begin : begin + 2]))
    last = float(np.interp(HIGH, a[end - 1 : end + 1], t[end - 1 : end + 1]))
    window = max(5, 2 * round(0.5 * SMOOTHING / step) + 1)
    cut = slice(max(0, begin - window), min(len(a), end + window + 1))
    if len(a[cut]) > window:
        speed = savgol_filter(a[cut], window, 2, deriv=1, delta=step)
    else:
        speed = np.gradient(a[cut], step)
    inside = speed[begin - cut.start : end - cut.start + 1]
    top = float(inside.max())
    # Ends of the span count as sides of a dip, so only the minima between two maxima are taken.
    peaks, _ = find_peaks(np.concatenate([[0.0], inside, [0.0]]), prominence=DIP_DEPTH * top)
    dips = max(0, len(peaks) - 1)
    frequency = dips / (float(peaks[-1] - peaks[0]) * step) if dips else math.nan
    stop = stops[1] if direction > 0 else LOW + HIGH - stops[0]
    touch = _touch_speed(t, a, end, stop, step)
    return Transit(first, last - first, direction, dips, frequency, top, touch)


def _touch_speed(t: Vector, a: Vector, end: int, stop: float, step: float) -> float:
    ahead = np.flatnonzero(a[end:] >= stop)
    if not ahead.size:
        return math.nan
    contact = end + int(ahead[0])
    # Nothing counts after the arm has turned back: that contact belongs to another swing.
    count = max(5, round(TOUCH_WINDOW / step))
    before = slice(max(0, contact - count), contact)
    # A parabola, because the arm brakes or speeds up even in this short time.
    bend, slope, _ = np.polyfit(t[before] - t[contact - 1], a[before], 2)
    ahead_of_contact = (stop - a[contact - 1]) / slope
    return float(slope + 2 * bend * ahead_of_contact)


def _summary(transits: tuple[Transit, ...]) -> TransitFigures:
    if not transits:
        reason = "the arm never goes from one mark to the other"
        return TransitFigures((), math.nan, math.nan, 0, math.nan, reason)
    ripples = [s.ripple_frequency for s in transits if s.dips]
    touches = [s.touch_speed for s in transits if not math.isnan(s.touch_speed)]
    missing = {"no transit has a dip": ripples, "no stop is touched": touches}
    return TransitFigures(
        transits,
        float(np.median([s.duration for s in transits])),
        float(np.median(ripples)) if ripples else math.nan,
        round(float(np.median([s.dips for s in transits]))),
        max(touches) if touches else math.nan,
        "; ".join(reason for reason, found in missing.items() if not found),
    )


@dataclass(frozen=True)
class OpenLoopExperiment:
    """A simulated open-loop experiment with the figures measured from it."""

    trajectory: Trajectory
    figures: TransitFigures

    def __str__(self) -> str:
        """Return the figures as a short aligned table."""
        return f"{self.trajectory.model.description}\n{self.figures}"


def pulse_train(
    *,
    amplitude_V: float = 0.9,
    period: float = 4.0,
    duration: float = 20.0,
    centre_V: float = 5.0,
    sample_time: float = 0.002,
) -> Vector:
    """Return the samples, in V, of a pulse train about the valve's centre, the first pulse upwards.

    Args:
        period: Period, in s; half of it up, half of it down.
        duration: Length of the train, in s.
        sample_time: Time between samples, in s.

    Source:
        The paper: an impulse train of +-0.9 V about +5 V, over a period of 4 s.
    """
    check_range("pulse amplitude", amplitude_V, 0.0, 5.0, "V")
    check_range("sample time", sample_time, 1e-5, 0.02, "s")
    check_range("period", period, 2 * sample_time, 1e4, "s")
    check_range("duration", duration, 2 * sample_time, 1e5, "s")
    # Counted in samples: rounded times would move an edge by a sample now and then.
    half = round(0.5 * period / sample_time)
    number = np.arange(round(duration / sample_time))
    return np.where((number // half) % 2 == 0, centre_V + amplitude_V, centre_V - amplitude_V)


def open_loop_experiment(model: Model, *, duration: float = 20.0) -> OpenLoopExperiment:
    """Run the open-loop experiment of the paper's Figure 8 on a model of the arm.

    Args:
        model: The arm, with the input ``valve`` and the state ``angle``.
        duration: Length of the experiment, in s.

    Raises:
        NumericalError: If the run cannot be trusted.

    Source:
        The paper's Figure 8: 5 +- 0.9 V, 4 s period, 3 kg, horizontal plane.
    """
    values = {q.name: q.value for q in model.parameters}
    voltage = pulse_train(duration=duration, centre_V=values.get("valve_centre", 5.0))
    run = simulate(model, voltage, sample_time=0.002)
    stops = (values.get("lower_stop", 0.0), values.get("upper_stop", math.radians(60.0)))
    figures = measure_transits(run.time, run["angle"], stops=stops)
    return OpenLoopExperiment(run, figures)
