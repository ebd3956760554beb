"""How large is the noise of every signal, apart from the steps of its converter?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import comb, sqrt
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.quantisation import recorded_quantum
from workbench.recordings.checks.time_base import jitter
from workbench.recordings.recording import Recording, Signal

BLOCK = 100
"""Samples of a block whose noise is estimated."""

_SMALL, _MANY, _FREE = 24, 20, 8
_ORDER = 4


@dataclass(frozen=True)
class NoiseFloor:
    """The noise of a signal, in SI.

    Args:
        total_rms: Root mean square of what successive samples do not share, noise and converter,
            in the unit of the signal.
        step: Step of the converter, in the unit of the signal; 0 if none shows.
        noise_rms: Noise without the converter, in the unit of the signal; NaN if the converter
            hides it.
        upper_bound: Whether the signal moves too fast between samples to tell motion from noise,
            so that ``total_rms`` is too large.
    """

    signal: str
    total_rms: float
    step: float
    noise_rms: float
    upper_bound: bool

    @property
    def floor(self) -> float:
        """Smallest residual that a perfect model can leave: rms of noise and rounding, in SI."""
        return max(self.total_rms, self.step / sqrt(12))


def _difference_rms(blocks: Vector, order: int) -> Vector:
    """Return the rms of white noise that explains the differences of each block."""
    differences = np.diff(blocks, order, axis=1)
    return np.asarray(np.sqrt(np.mean(differences**2, axis=1) / comb(2 * order, order)))


def white_rms(values: npt.ArrayLike, *, order: int = _ORDER, quantile: float = 0.5) -> float:
    """Return the rms, in the unit of ``values``, of the white noise in a smooth signal.

    A difference of order k leaves nothing of a polynomial below degree k and multiplies the
    variance of white noise by the sum of squared binomials, (2k choose k). Blocks of 100 samples
    are taken apart, and the median of the moving ones counts, so that impacts do not.

    Args:
        values: Uniformly sampled values, shape (n,), any unit.
        quantile: Which of the moving blocks counts, as a fraction; a low one leaves fast motion
            out.

    Example:
        >>> time = np.arange(5000) * 1e-3
        >>> noise = np.random.default_rng(1).normal(0.0, 0.01, 5000)
        >>> round(white_rms(np.sin(time) + noise), 4)
        0.01
    """
    array = np.asarray(values, dtype=float)
    size = min(BLOCK, len(array))
    if size < 3 * order:
        return float("nan")
    blocks = array[: len(array) // size * size].reshape(-1, size)
    rms = _difference_rms(blocks, order)
    moving = rms[rms > 0]
    if not moving.size:
        return 0.0
    # Of white noise alone the blocks differ too: a low quantile of them is below its rms.
    alike = [comb(2 * order, order + k) / comb(2 * order, order) for k in range(1, order + 1)]
    spread = sqrt((0.5 + sum(a**2 for a in alike)) / (size - order))
    usual = 1.0 + spread * NormalDist().inv_cdf(quantile)
    return float(np.quantile(moving, quantile)) / usual


def all_white_rms(values: npt.ArrayLike) -> float:
    """Return the rms of all that successive samples do not share, in the unit of ``values``.

    Noise that grows with the signal, or comes in bursts, counts with all its power; so does motion
    that is not smooth.

    Args:
        values: Uniformly sampled values, shape (n,), any unit.
    """
    array = np.asarray(values, dtype=float)
    if len(array) <= _ORDER:
        return float("nan")
    return float(_difference_rms(array[None, :], _ORDER)[0])


def growing_rms(parts: Sequence[npt.ArrayLike]) -> tuple[float, float]:
    """Return the rms of noise that is always there, and of noise that grows with the signal.

    ``variance = rest^2 + (growing y)^2``, by likelihood over blocks of 24 samples, each of which
    gives a variance by the median of its differences.

    Args:
        parts: Uniformly sampled values, shape (n,) each, any unit.

    Returns:
        The rest, in the unit of ``parts``, and the growing part as a fraction of the signal;
        (NaN, 0) where the noise does not clearly grow with the signal.
    """
    arrays = [np.asarray(values, dtype=float) for values in parts]
    blocks = np.concatenate([a[: len(a) // _SMALL * _SMALL].reshape(-1, _SMALL) for a in arrays])
    v = np.array([usual_rms(block) ** 2 for block in blocks])
    m = np.mean(blocks**2, axis=1)
    told = np.isfinite(v) & (v > 0.0) & np.isfinite(m) & (m > 0.0)
    blocks, v, m = blocks[told], v[told], m[told]
    if len(v) < _MANY or np.quantile(m, 0.9) < 10.0 * np.quantile(m, 0.1):
        return math.nan, 0.0
    from scipy.optimize import minimize

    def cost(s: Vector) -> float:
        return float(np.sum(0.5 * _FREE * (np.log(s) + v / s)))

    level = float(np.mean(v))
    found = minimize(
        lambda q: cost(np.exp(2.0 * q[0]) + np.exp(2.0 * q[1]) * m),
        [0.5 * math.log(0.1 * np.quantile(v, 0.1)), 0.5 * math.log(np.median(v / m))],
        method="Nelder-Mead",
    )
    rest, growing = (math.exp(float(q)) for q in found.x)
    # A variance of many freedoms: of another shape than this it is not the noise of a reading.
    alike = float(np.median(np.abs(np.log(v / (rest**2 + growing**2 * m)))))
    if cost(np.full(len(v), level)) - found.fun < _FREE * math.log(len(v)) or alike > 0.7:
        return math.nan, 0.0
    # The variance of a few samples is uncertain; of all of them, each over its own, it is not.
    pooled = np.diff(blocks, _ORDER, axis=1) / np.sqrt(rest**2 + growing**2 * m)[:, None]
    size = _of_median(float(np.median(np.abs(pooled))))
    return rest * size, growing * size


def _of_median(middle: float) -> float:
    return middle / (0.6745 * sqrt(comb(2 * _ORDER, _ORDER)))


def usual_rms(values: npt.ArrayLike) -> float:
    """Return the rms, in the unit of ``values``, of the noise from the median of the differences.

    What happens at less than half of the differences does not count: steps of an input that reach
    the signal at once, at most one in twice the order of samples. NaN where most differences are
    zero, as between the steps of a converter; of few such steps the median lies between two.

    Args:
        values: Uniformly sampled values, shape (n,), any unit.

    Source:
        F. R. Hampel, J. Amer. Statist. Assoc. 69 (1974): the median is 0.6745 of the deviation;
        Y. Ma, M. G. Genton and E. Parzen, Ann. Inst. Stat. Math. 63 (2011): that of discrete
        values, between the middles of their shares.
    """
    differences = np.abs(np.diff(np.asarray(values, dtype=float), _ORDER))
    differences = np.sort(differences[np.isfinite(differences)])
    if not differences.size or not np.median(differences) > 0.0:
        return float("nan")
    # What a step of the converter parts differs by more than the last digits do.
    first = np.flatnonzero(np.diff(differences, prepend=-1.0) > 1e-9 * differences[-1])
    counts = np.diff(first, append=len(differences))
    share = (first + 0.5 * counts) / len(differences)
    if differences[0] <= 1e-9 * differences[-1]:
        share[0] = 0.0  # A difference of nothing has both signs.
    return _of_median(float(np.interp(0.5, share, differences[first])))


def noise_of(recording: Recording, name: str) -> NoiseFloor:
    """Estimate the noise of a signal and take its converter apart.

    Rounding to steps of q adds q^2/12 to the variance as long as the noise is not much smaller
    than a step (Widrow: above a third of it); below that the converter hides the noise.

    Args:
        recording: Recording as it was sampled; interpolation would smooth the noise.
    """
    values = recording[name]
    step = recorded_quantum(recording, name)
    total = white_rms(values)
    higher = white_rms(values, order=_ORDER + 2)
    # White noise gives the same at every order; motion shrinks from one order to the next.
    # With uneven steps a motion looks like noise.
    bound = bool(higher < 0.8 * total or jitter(recording.time) > 0.02)
    variance = total**2 - step**2 / 12
    noise = sqrt(variance) if variance > (step / 3) ** 2 else float("nan")
    return NoiseFloor(name, total, step, noise, bound)


def _shown(signal: Signal, difference: float) -> str:
    number = f"{float(signal.displayed(difference) - signal.displayed(0.0)):.3g}"
    return f"{number} {signal.display_unit}".rstrip()


def _phrase(signal: Signal, floor: NoiseFloor) -> str:
    shown = partial(_shown, signal)
    text = f"{signal.name} {'below ' if floor.upper_bound else ''}{shown(floor.floor)} rms"
    if floor.step and np.isnan(floor.noise_rms):
        text += f" (the converter's steps of {shown(floor.step)} hide the noise)"
    elif floor.step:
        text += f" (noise {shown(floor.noise_rms)}, steps of {shown(floor.step)})"
    return text


@check(
    "noise floor",
    90,
    fix="check shielding and supply of the sensor, or move further, and record again",
)
def check_noise(recording: Recording, expected: Expected) -> Finding:
    """Estimate the noise floor of every measured signal.

    One that stands still beside others that move is a measurement too.
    """
    floors: dict[str, NoiseFloor] = {}
    problems = []
    for name in recording.measurements:
        signal = recording.signal(name)
        floors[name] = noise_of(recording, name)
        low, high = np.quantile(signal.values, [0.01, 0.99])
        told = name in expected.required and not floors[name].upper_bound
        if told and 0 < high - low < 6 * floors[name].floor:
            problems.append(
                f"{name} moves by {_shown(signal, high - low)}, no more than its noise of"
                f" {_shown(signal, floors[name].floor)} rms"
            )
    if problems:
        alone = len(problems) == len(set(recording.measurements) & set(expected.required))
        note, values = "; ".join(problems), {"floors": floors}
        return Finding("unfit" if alone else "pass", note, values, doubt=not alone)
    note = "; ".join(_phrase(recording.signal(n), f) for n, f in floors.items())
    return Finding("pass", note or "nothing was measured", {"floors": floors})
