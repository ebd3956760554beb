"""What is new in a signal: the part that the past does not predict."""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.recordings.recording import Recording

MEMORY = 12
"""Samples of the past used for prediction."""
MAX_SAMPLES = 50_000
"""Longer recordings are judged on their beginning."""


def innovations(target: Vector, past: Sequence[Vector], *, memory: int = MEMORY) -> Vector:
    """Return what the past of some signals does not predict of a signal, limited to 4 sigma.

    Least squares on the last ``memory`` samples of every signal in ``past``; the limit keeps a few
    steps or impacts from deciding alone.

    Args:
        target: Signal to predict, shape (n,).
        past: Signals whose past may be used, each of shape (n,).

    Returns:
        Prediction errors, shape (n - memory,), zero mean.
    """
    n = len(target)
    scale = float(np.std(target)) or 1.0
    columns = [
        (signal[memory - k : n - k] - signal.mean()) / (float(np.std(signal)) or 1.0)
        for signal in past
        for k in range(1, memory + 1)
    ]
    regressors = np.column_stack([*columns, np.ones(n - memory)])
    wanted = (target[memory:] - target.mean()) / scale
    solution, *_ = np.linalg.lstsq(regressors, wanted, rcond=1e-10)
    error = wanted - regressors @ solution
    limit = 4 * float(np.std(error))
    error = np.clip(error, -limit, limit)
    return np.asarray(scale * (error - error.mean()))


_known: WeakKeyDictionary[Recording, dict[tuple[str, ...], Vector]] = WeakKeyDictionary()


def surprises(
    recording: Recording, name: str, *, given: tuple[str, ...] = (), now: tuple[str, ...] = ()
) -> Vector:
    """Return what is new in a signal, in its unit, given its own past and that of others.

    Several checks need the same, so it is kept as long as the recording is.

    Args:
        now: Names of other signals whose past and present sample may be used.
    """
    kept = _known.setdefault(recording, {})
    key = (name, *given, "now", *now)
    if key not in kept:
        past = [recording[n][:MAX_SAMPLES] for n in (name, *given)]
        # Shifted by one sample, the present stands where the past is looked for.
        present = [
            np.append(recording[n][1:MAX_SAMPLES], recording[n][:MAX_SAMPLES][-1]) for n in now
        ]
        kept[key] = innovations(past[0], [*past, *present])
    return kept[key]


def correlation(first: Vector, second: Vector, lags: npt.NDArray[np.int_]) -> Vector:
    """Return the correlation of ``second`` some samples after ``first``, of zero mean, in sigmas.

    For independent white signals it is normal with unit variance at every lag. Lags, shape
    (n_lags,), are whole numbers of samples, negative where ``second`` comes before.
    """
    n = min(len(first), len(second))
    size = float(np.std(first) * np.std(second)) * np.sqrt(n)
    spectrum = np.conj(np.fft.rfft(first[:n], 2 * n)) * np.fft.rfft(second[:n], 2 * n)
    return np.fft.irfft(spectrum, 2 * n)[lags] / size if size else np.zeros(len(lags))
