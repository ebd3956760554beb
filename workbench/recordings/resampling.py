"""Other time bases: commands are held, measurements are low-passed and interpolated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import TIMES_S, WorkbenchError, check_finite, check_range
from workbench.recordings.recording import Recording, Signal


def _require_increasing(recording: Recording, what: str) -> None:
    if len(recording) < 2:
        raise WorkbenchError(
            f"recording {recording.name!r} has {len(recording)} sample(s); {what} needs two or more"
        )
    if not recording.increasing:
        raise WorkbenchError(
            f"the time of recording {recording.name!r} does not increase everywhere, so {what} is "
            "not defined; check_recording(...).recording gives a corrected one"
        )


def low_pass(values: Vector, fraction: float, *, half_width: int = 8) -> Vector:
    """Remove what lies above a fraction of the sampling rate, without shifting in time.

    A windowed sinc of odd length (linear phase, delay removed); the ends are continued by their
    reflection through the end point, which keeps the slope there.

    Args:
        values: Uniformly sampled values, shape (n,).
        fraction: Edge of the pass band as a fraction of the sampling rate, below 0.5.
        half_width: Zero crossings of the sinc on each side.
    """
    if len(values) < 3:
        return values
    reach = min(int(np.ceil(half_width / (2 * fraction))), len(values) - 1)
    steps = np.arange(-reach, reach + 1)
    kernel = np.sinc(2 * fraction * steps) * np.hamming(2 * reach + 1)
    kernel /= kernel.sum()
    before = 2 * values[0] - values[reach:0:-1]
    after = 2 * values[-1] - values[-2 : -reach - 2 : -1]
    extended = np.concatenate([before, values, after])
    from scipy.signal import fftconvolve

    filtered: Vector = fftconvolve(extended, kernel, mode="valid")
    return filtered


def _interpolated(signal: Signal, time: Vector, times: Vector) -> Vector:
    good = np.isfinite(signal.values)
    if not good.any():
        return np.full(len(times), np.nan)
    if signal.zero_order_hold:
        # The small allowance keeps a sample that rounding moved just behind its own instant.
        slack = 1e-9 * float(np.max(np.abs(time)))
        index = np.searchsorted(time[good], times + slack, side="right") - 1
        held: Vector = signal.values[good][np.clip(index, 0, None)]
        return held
    values: Vector = np.interp(times, time[good], signal.values[good])
    return values


def resample(
    recording: Recording, *, rate_Hz: float | None = None, times: npt.ArrayLike | None = None
) -> Recording:
    """Return a recording on another time base.

    Commands and references keep their value until the next sample (zero-order hold). Measurements
    are interpolated by straight lines; if the new step is more than 1.2 times the old one they are
    low-passed at 0.4 of the new rate before, so that nothing folds down.

    Args:
        rate_Hz: Rate of a uniform time base that starts at the first sample.
        times: Instants, shape (m,), in s, inside the recording; instead of ``rate_Hz``.

    Raises:
        WorkbenchError: If the time does not increase, or the instants lie outside the recording.

    Example:
        >>> time = np.arange(5) * 1.0
        >>> r = Recording("r", time, (Signal("angle", 2 * time, "rad"),))
        >>> resample(r, rate_Hz=2.0)["angle"][:4]
        array([0., 1., 2., 3.])
    """
    _require_increasing(recording, "resampling")
    if (rate_Hz is None) == (times is None):
        raise WorkbenchError("give either rate_Hz or times to resample a recording, not both")
    old = recording.sample_time
    first, last = float(recording.time[0]), float(recording.time[-1])
    if rate_Hz is not None:
        check_range(
            "rate_Hz", rate_Hz, 1 / max(recording.duration, TIMES_S[0]), 1 / TIMES_S[0], "Hz"
        )
        n = int(np.floor(recording.duration * rate_Hz * (1 + 1e-9))) + 1
        instants = first + np.arange(n) / rate_Hz
        new = 1 / rate_Hz
    else:
        instants = check_finite("times", times if times is not None else [])
        if instants.ndim != 1 or len(instants) < 2 or np.any(np.diff(instants) <= 0):
            raise WorkbenchError("times must be two or more increasing instants")
        if instants[0] < first - 1e-9 or instants[-1] > last + old:
            raise WorkbenchError(
                f"times run from {instants[0]:g} to {instants[-1]:g} s but the recording from "
                f"{first:g} to {last:g} s; choose instants inside"
            )
        new = float(np.median(np.diff(instants)))
    signals = []
    for signal in recording.signals:
        source, time = signal, recording.time
        if not signal.zero_order_hold and new > 1.2 * old and np.isfinite(signal.values).any():
            # The filter needs a uniform base; on it the old samples are met closely enough.
            n_old = round(recording.duration / old) + 1
            time = np.linspace(first, last, n_old)
            uniform = _interpolated(signal, recording.time, time)
            source = replace(signal, values=low_pass(uniform, 0.4 * old / new))
        signals.append(replace(signal, values=_interpolated(source, time, instants)))
    note = f"resampled from {1 / old:.6g} Hz to {1 / new:.6g} Hz"
    return replace(recording, time=instants, signals=tuple(signals)).noted(note)
