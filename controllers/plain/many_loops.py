"""Loops of many laws at once: closed, their responses, and the sensitivity peaks that they reach.

A delay turns the gain of a loop at each frequency: of all up to the largest, the worst is the one
that turns it to -1, or is nearest to that. Of several outputs, |S| is the largest singular value of
the sensitivity, opened at all outputs or at all commands, each in the unit that makes it least:
what the loop bears of changes of all channels at once, whatever their units; where more is measured
than followed, it is opened at the commands, and with five times the limits at each measurement.

Units: SI.

Source: Safonov, Stability margins of diagonally perturbed multivariable feedback systems, IEE
Proc. D 129, 1982 (units).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from controllers.linear_law import LinearLaw, reached
from controllers.sensitivity import least_gain
from workbench.arrays import Complex, Matrix, Vector

P = TypeVar("P", bound=tuple[Any, ...])
Turned = tuple[Vector, Vector, Vector, npt.NDArray[np.bool_]]
Peaks = tuple[Vector, Vector, Vector, Vector, npt.NDArray[np.bool_]]


def stacked(laws: Sequence[Any]) -> LinearLaw:
    """Return laws around rest one behind the other, each matrix of shape (n_laws, ...)."""
    each = [law.around_rest() for law in laws]
    n, (m, k), count = max(len(law.F) for law in each), each[0].J.shape, len(each)
    shapes = (count, n, n), (count, n, k), (count, m, n), (count, m, k)
    whole = LinearLaw(*(np.zeros(shape) for shape in shapes))
    for i, law in enumerate(each):
        for part, own in zip(whole, law, strict=True):
            part[i, : own.shape[0], : own.shape[1]] = own
    return whole


def chosen(parts: P, which: Any) -> P:
    """Return some of laws, or of what is known of each, a named tuple of arrays."""
    return cast(P, cast(Any, type(parts))(*(part[which] for part in parts)))


def response(laws: LinearLaw, z: Complex, inputs: int = 1) -> Complex:
    """Return transfer functions by the first inputs, shape (n_laws, n_z, n_commands, n_inputs)."""
    from scipy.linalg.lapack import dgebal, zgees

    entry = laws.G[:, :, :inputs]
    live = reached(np.any(entry != 0.0, axis=(0, 2)), np.any(laws.F != 0.0, axis=0))
    F = laws.F[:, live][:, :, live]
    T, b, c = (part.astype(complex) for part in (F, entry[:, live], laws.H[:, :, live]))
    n = len(live)
    origin, behind = _repeating(F, entry[:, live])
    if 2 * np.count_nonzero(behind) > n:
        x = _repeated(F, b, z, origin, behind)
        return np.asarray(np.einsum("lmn,lnzk->lzmk", c, x) + laws.J[:, None, :, :inputs])
    for k in np.flatnonzero(np.any(np.tril(F, -1), axis=(1, 2))):
        even, _, _, size, _ = dgebal(F[k], scale=1, permute=0)
        T[k], _, _, Z, *_ = zgees(lambda _: True, even, lwork=8 * n)
        b[k], c[k] = Z.conj().T @ (b[k] / size[:, None]), (c[k] * size) @ Z
    x = np.zeros((len(T), n, len(z), inputs), dtype=complex)
    for i in reversed(range(n)):
        right = np.einsum("lj,ljzk->lzk", T[:, i, i + 1 :], x[:, i + 1 :])
        x[:, i] = (b[:, i, None] + right) / (z - T[:, i, i, None])[..., None]
    return np.asarray(np.einsum("lmn,lnzk->lzmk", c, x) + laws.J[:, None, :, :inputs])


def _repeating(F: Matrix, entry: Matrix) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return what each state repeats, and how many samples later: none are those that do not."""
    own = np.arange(F.shape[1])
    reads = np.any(F != 0.0, axis=0)
    alone = (reads.sum(axis=1) == 1) & ~np.any(entry != 0.0, axis=(0, 2))
    before = np.where(alone, reads.argmax(axis=1), own)
    before = np.where(np.all(F[:, own, before] == 1.0, axis=0), before, own)
    origin, behind = before, (before != own).astype(int)
    # Twice as far each time; what goes round repeats itself, and is no delay.
    for _ in range(len(own).bit_length()):
        origin, behind = origin[origin], behind + behind[origin]
    circling = before[origin] != origin
    return np.where(circling, own, origin), np.where(circling, 0, behind)


def _repeated(
    F: Matrix, b: Complex, z: Complex, origin: npt.NDArray[np.intp], behind: npt.NDArray[np.intp]
) -> Complex:
    """Return states over inputs, shape (n_laws, n, n_z, n_inputs), of laws that mostly repeat some.

    The equations of the others stand alone, with powers of 1 / z for what is repeated.
    """
    own = np.flatnonzero(behind == 0)
    place = np.searchsorted(own, origin)
    late = z[:, None] ** -behind
    x = np.zeros((*b.shape[:2], len(z), b.shape[2]), dtype=complex)
    for i, (f, entry) in enumerate(zip(F[:, own], b[:, own], strict=True)):
        left = np.zeros((len(z), len(own), len(own)), dtype=complex)
        for k, at in enumerate(place):
            left[:, :, at] -= late[:, k, None] * f[:, k]
        left[:, range(len(own)), range(len(own))] += z[:, None]
        found = np.linalg.solve(left, np.broadcast_to(entry, (len(z), *entry.shape)))
        x[i] = (late[:, :, None] * found[:, place]).swapaxes(0, 1)
    return x


def closed(plant: tuple[Matrix, Matrix, Matrix], laws: LinearLaw) -> tuple[Matrix, Matrix]:
    """Return loops, shape (n_loops, n, n), and what references and loads enter them by."""
    (A, B, C), (F, G, H, J) = plant, laws
    n, count, p = len(A), len(F), len(C)
    over = np.zeros((count, n + F.shape[1], n + F.shape[1]))
    over[:, :n, :n], over[:, :n, n:] = A + B @ J[:, :, :p] @ C, B @ H
    over[:, n:, :n], over[:, n:, n:] = G[:, :, :p] @ C, F
    asked = G.shape[2] - p
    entry = np.zeros((count, n + F.shape[1], asked + B.shape[1]))
    entry[:, :n, :asked], entry[:, n:, :asked] = B @ J[:, :, p:], G[:, :, p:]
    entry[:, :n, asked:] = B
    return over, entry


_SURE, _DOUBLED = 0.01, 40
"""Part of the logarithm of a spectral radius to which it is told, and how often a power of a matrix
is squared at most for it."""


def log_radii(matrices: Matrix) -> Vector:
    """Return the logarithms of spectral radii of matrices, shape (n, k, k), to about a hundredth.

    The radius is what the norm of a power n grows to, to the power 1 / n (Gelfand). A loop whose
    commands are long on their way has hundreds of states, of which no other eigenvalue matters.

    Example:
        >>> late = np.array([[0.0, 0.0, 0.125], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        >>> np.round(np.exp(log_radii(late[None])), 1)
        array([0.5])
    """
    count = len(matrices)
    if not matrices.size:
        return np.full(count, -math.inf)
    power, total = _without_twins(matrices), np.zeros(count)
    found, left = np.full(count, -math.inf), np.arange(count)
    for k in range(_DOUBLED):
        size = np.linalg.norm(power, axis=(1, 2))
        power = power / np.maximum(size, 1e-300)[:, None, None]
        grown = np.log(np.maximum(size, 1e-300))
        total = 2.0 * total + grown
        found[left] = total / 2.0**k
        # What only passes through is gone after as many steps as there are states.
        sure = (np.abs(grown) < 2.0**k * _SURE * np.abs(found[left])) & (2**k > power.shape[1])
        left, power, total = left[~sure], power[~sure], total[~sure]
        if not len(left):
            break
        power = power @ power
    return found


_ALIKE = 1e-12
"""What rows of the same quantity in two units differ by, of their largest number."""


def _without_twins(matrices: Matrix) -> Matrix:
    """Take states that are in proportion from the next sample on for one: spectral radii stay.

    So it is with commands on their way, of which plant and law have a record each.
    """
    k = matrices.shape[1]
    # What is in proportion is found in the first, and holds in all or is not used.
    own, whole, left = matrices[0], np.eye(k), np.arange(k)
    weight = np.random.default_rng(0).uniform(1.0, 2.0, size=(k,))
    while True:
        size = np.maximum(np.abs(own).max(axis=1), 1e-300)
        rows = own / size[:, None]
        sums = rows @ weight[: len(own)]
        order = np.argsort(np.abs(sums))
        near = np.flatnonzero(np.diff(np.abs(sums[order])) <= _ALIKE * k)
        merged = np.eye(len(own))
        for one, other in zip(order[near], order[near + 1], strict=True):
            sign = np.sign(sums[one] * sums[other])
            # A third one of a kind finds the first in the next round.
            if merged[one, one] and np.abs(rows[one] - sign * rows[other]).max() <= _ALIKE:
                merged[other] = 0.0
                merged[other, one] = sign * size[other] / size[one]
        kept = np.flatnonzero(np.diagonal(merged))
        if len(kept) == len(own):
            break
        own, whole, left = (own @ merged[:, kept])[kept], whole @ merged[:, kept], left[kept]
    if len(left) == k:
        return matrices
    told = matrices @ whole
    found = told[:, left]
    away = np.abs(told - whole @ found).max(axis=2)
    alike = np.all(away <= 10.0 * k * _ALIKE * np.abs(told).max(axis=2))
    return found if alike else matrices


AT_A_TIME = 64
"""Loops whose responses are computed together: as many as stay in the processor's cache."""


def peaks(
    plants: Sequence[Complex],
    laws: LinearLaw,
    angle: Vector,
    late: Matrix,
    noise: Matrix,
    weight: Matrix,
    followed: int,
) -> Peaks:
    """Return what loops reach with the worst of plants if they are stable without a delay.

    The first inputs of the laws are the measurements.

    Args:
        plants: Responses at frequencies, in rad per sample, each of shape (n_z, p, m).
        late: Largest angles by which delays turn each loop, in rad, shape (n_z, p, m).
        noise: Noise of the measurements over half of the commands' range, shape (m, p).
        weight: What squares of moves of the commands count, shape (n_z, m), ratios.
        followed: Number of outputs that are followed, the first of those that are measured.

    Returns:
        Ms, Mt, |T| w in rad per sample, noise of the commands as a share of half their range, and
        whether no delay turns a crossover to -1.
    """
    z, count = np.exp(1j * angle), len(laws.F)
    _, sensors, commands = plants[0].shape
    more = sensors > followed
    single = commands == 1 and (more or sensors == 1)
    turned = _turned if single else partial(_turned_together, at_outputs=not more)
    late = late.max(axis=(1, 2)) if single else late
    ms, mt, beyond, stirred = np.zeros((4, count))
    stable = np.ones(count, dtype=bool)
    for first in range(0, count, AT_A_TIME):
        part = slice(first, first + AT_A_TIME)
        K = -response(chosen(laws, part), z, sensors)
        for P in plants:
            s, t, moved, crossed = turned(P, K, late, noise)
            stable[part] &= ~crossed
            noisy = np.trapezoid(moved * weight, angle, axis=1) / np.pi
            for most, own in (
                (ms, s.max(axis=1)),
                (mt, t.max(axis=1)),
                (beyond, (t * angle).max(axis=1)),
                (stirred, np.sqrt(noisy.max(axis=1))),
            ):
                np.maximum(most[part], own, out=most[part])
    return ms, mt, beyond, stirred, stable


AT_A_SENSOR = 5.0
"""What a loop opened at one of more measurements than are followed may peak to, over its limits:
what one sensor tells wrongly, alone, is its gain, and by less than a tenth of it."""

NEAR = 20.0
"""Sensitivity of a loop, a ratio, that a delay or a frequency between two may make unstable."""


def _turned(P: Complex, K: Complex, late: Vector, noise: Matrix) -> Turned:
    """Return what single loops reach at each frequency, turned by the worst angle up to `late`.

    Of several measurements, the loop is opened at the command, and at each of them with all others
    closed, there turned by nothing and by `late`.

    Returns:
        |S| and |T|, shape (n_laws, n_z); squares of what noise moves the commands by, over half of
        their range, shape (n_laws, n_z, m); and whether a crossover is turned to -1, (n_laws,).
    """
    each = P[:, :, 0] * K[:, :, 0]
    L = each[..., 0] if each.shape[2] == 1 else each.sum(axis=2)
    gain, near, crossed = np.abs(L), np.abs(1.0 + L), np.zeros(len(L), dtype=bool)
    if late.any():
        margin = np.mod(np.angle(L) + np.pi, 2.0 * np.pi)
        reached = margin <= late
        crossed = np.any(np.diff(gain < 1.0, append=True) & reached, axis=1)
        turned = np.where(reached, 0.0, np.minimum(margin - late, 2.0 * np.pi - margin))
        # |1 + L| with -L = gain exp(j turned), without the difference of near numbers.
        near = np.hypot(gain - 1.0, 2.0 * np.sqrt(gain) * np.sin(0.5 * turned))
    s = 1.0 / np.maximum(near, 1e-300)
    t, stirred = gain * s, np.sum((np.abs(K) * s[..., None, None] * noise) ** 2, axis=3)
    for turn in (1.0, np.exp(-1j * late)) if each.shape[2] > 1 else ():
        share = each * (turn / (1.0 + L * turn))[..., None]
        s = np.maximum(s, np.abs(1.0 - share).max(axis=2) / AT_A_SENSOR)
        t = np.maximum(t, np.abs(share).max(axis=2) / AT_A_SENSOR)
    # One that is crossed between two frequencies comes near to it at both.
    return s, t, stirred, crossed | (s.max(axis=1) > NEAR)


TURN, HARDLY = 0.4, 0.02
"""Largest step between angles by which a loop of several outputs is turned, and largest angle that
is none, in rad."""


def _turned_together(
    P: Complex, K: Complex, late: Matrix, noise: Matrix, *, at_outputs: bool
) -> Turned:
    """Return the same of loops of several outputs or commands, all turned together.

    They are opened at all commands, and at all outputs too or at each of them by itself.
    """
    one, two = (np.eye(k) for k in P.shape[1:])
    late = np.minimum(late, 2.0 * np.pi)
    shares = np.linspace(0.0, 1.0, 1 + math.ceil(float(late.max()) / TURN))
    # Between the ends of what is turned, only where that is something.
    tried = (late.max(axis=(1, 2))[:, None] > HARDLY) | (shares == 0.0) | (shares == 1.0)
    z, own = np.nonzero(tried)
    if len(shares) > 1:
        P, K = np.exp(-1j * late[z] * shares[own][:, None, None]) * P[z], K[:, z]
    S = _inverse(one + P @ K)
    KS = K @ S
    T = KS @ P
    s, t = least_gain(two - T), least_gain(T)
    if at_outputs:
        s, t = np.maximum(least_gain(S), s), np.maximum(least_gain(one - S), t)
    else:
        alone = np.diagonal(S, axis1=-2, axis2=-1)
        s = np.maximum(s, np.abs(alone).max(axis=-1) / AT_A_SENSOR)
        t = np.maximum(t, np.abs(1.0 - alone).max(axis=-1) / AT_A_SENSOR)
    moved = np.sum((np.abs(KS) * noise) ** 2, axis=3)
    if len(shares) > 1:
        first = np.searchsorted(z, np.arange(len(late)))
        s, t, moved = (np.maximum.reduceat(part, first, axis=1) for part in (s, t, moved))
    # A loop that some angle makes unstable comes near to it on the way.
    return s, t, moved, s.max(axis=1, initial=0.0) > NEAR


def _inverse(M: Complex) -> Complex:
    """Return the inverses of matrices, shape (..., k, k); of those of two rows by Cramer's rule."""
    if M.shape[-1] != 2:
        return np.asarray(np.linalg.inv(M))
    (a, b), (c, d) = np.moveaxis(M, (-2, -1), (0, 1))
    found = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return np.moveaxis(found, (0, 1), (-2, -1))
