"""Interaction between several loops: relative gains, pairing, zeros, and what they forbid.

With the plant's gain G at rest (its limit from above where it integrates), commands times outputs,

    relative gains       RGA = G o (G^-1)^T             the gain of a pair alone, over that with all
                                                        other outputs held
    Niederlinski index   NI = det G / product of g_ii   of the paired gains

A pair with a negative relative gain, or pairs with a negative index of a stable plant, are unstable
with the other loops closed or with one of them open, however slow they are. A change of g_ij by
-1 / RGA_ij of itself makes G singular. A zero z in the right half plane bounds the speed of what
it shows in to about z / 2, an unstable pole p from below to about 2 p.

Source: Bristol, On a new measure of interaction for multivariable process control, IEEE Trans.
AC-11, 1966; Niederlinski, A heuristic approach to the design of linear multivariable interacting
control systems, Automatica 7, 1971; Skogestad and Postlethwaite, Multivariable Feedback Control,
2005, sections 3.4, 5.6 to 5.9 and 10.6.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from controllers.plain.loop import Loop, listed
from workbench.arrays import Complex, Matrix
from workbench.errors import WorkbenchError

STRONG = 5.0
"""Relative gain from which on outputs can hardly be told apart by their commands."""


class Pairing(NamedTuple):
    """Which command belongs to which output.

    Args:
        commands: Number of the command of each output.
        relative: Relative gain of each pair, dimensionless.
        niederlinski: Niederlinski index, dimensionless.
        allowed: Whether no pair is unstable with the others closed.
    """

    commands: tuple[int, ...]
    relative: tuple[float, ...]
    niederlinski: float
    allowed: bool


def gain_at_rest(loop: Loop) -> Matrix:
    """Return the gain at rest, shape (p, m), in SI; where it integrates, that shortly before."""
    own = loop.linear
    rates = np.abs(own.poles)
    moving = rates[rates > 1e-9 * rates.max(initial=0.0)]
    s = SHORTLY * float(moving.min(initial=math.inf)) if len(moving) else SHORTLY
    # At a real s of its own the response is real.
    return np.asarray(loop.response(-1j * s).real)


SHORTLY = 1e-6
"""At what s the gain at rest is taken, over the slowest pole."""


def relative_gains(G: Matrix) -> Matrix:
    """Return the relative gain array of a gain of any units, shape (p, m), dimensionless."""
    return np.asarray(G * np.linalg.pinv(G).T)


def pairings(loop: Loop) -> Iterator[Pairing]:
    """Yield every way to give each output a command of its own."""
    G = gain_at_rest(loop) * loop.command_scale / loop.output_scale[:, None]
    p, m = G.shape
    stable = bool(np.all(loop.linear.poles.real <= 0.0))
    for commands in itertools.permutations(range(m), p):
        own = G[:, commands]
        pairs = np.diag(own)
        if np.any(pairs == 0.0) or not np.isfinite(np.linalg.cond(own)):
            continue
        relative = np.diag(relative_gains(own))
        index = float(np.linalg.det(own / pairs[None, :]))
        allowed = bool(np.all(relative > 0.0)) and (index > 0.0 or not stable)
        yield Pairing(commands, tuple(relative.tolist()), index, allowed)


def best_pairing(loop: Loop) -> Pairing:
    """Return the pairing whose relative gains are nearest to 1, of those that can be stable.

    Of more commands than outputs, those act that do most: of a command that does nothing, the
    relative gains of all outputs add up to 0, else to 1 at most.

    Raises:
        WorkbenchError: If none can be.
    """
    found = list(pairings(loop))
    allowed = [one for one in found if one.allowed]
    if not allowed:
        table = np.round(relative_gains(gain_at_rest(loop)), 3).tolist()
        raise WorkbenchError(
            f"no pairing of {listed(loop.measured)} with {listed(loop.actuators)} is"
            " stable with each loop alone and with all of them: every one has a negative relative"
            f" gain or Niederlinski index (relative gains {table}); take decoupled = true, or a"
            " family that commands all outputs together, such as lqi"
        )
    G = gain_at_rest(loop) * loop.command_scale / loop.output_scale[:, None]
    idle = 1.0 - relative_gains(G).sum(axis=0)
    return min(
        allowed,
        key=lambda one: (
            sum(abs(gain - 1.0) for gain in one.relative) + 2.0 * sum(idle[k] for k in one.commands)
        ),
    )


def paired(loop: Loop, *, decoupled: bool = False) -> Matrix:
    """Return what the law of each output adds to the commands, shape (m, p), in SI.

    Raises:
        WorkbenchError: If no pairing can be stable.
    """
    G = gain_at_rest(loop)
    p, m = G.shape
    if not decoupled:
        mix = np.zeros((m, p))
        mix[best_pairing(loop).commands, np.arange(p)] = 1.0
        return mix
    scale = loop.command_scale[:, None]
    inverse = scale * np.linalg.pinv(G * loop.command_scale / loop.output_scale[:, None])
    largest = np.argmax(np.abs(inverse / scale), axis=0)
    return np.asarray(inverse / inverse[largest, np.arange(p)])


def zeros(loop: Loop) -> Complex:
    """Return the finite transmission zeros of a plant with as many commands as outputs, in rad/s.

    Others have none as a rule. Source: Emami-Naeini and Van Dooren, Computation of zeros of linear
    multivariable systems, Automatica 18, 1982.
    """
    from scipy.linalg import eig

    own = loop.linear
    size, (p, m) = own.state_scales, own.D.shape
    if p != m:
        return np.zeros(0, dtype=complex)
    rate = float(np.abs(own.poles).max(initial=0.0)) or 1.0
    A = own.A * size / size[:, None] / rate
    B = own.B * loop.command_scale / size[:, None] / rate
    C = own.C * size / loop.output_scale[:, None]
    B, C = B / np.abs(B).max(axis=0), C / np.abs(C).max(axis=1)[:, None]
    left = np.block([[A, B], [C, np.zeros((p, m))]])
    right = np.zeros_like(left)
    right[: len(A), : len(A)] = np.eye(len(A))
    (alpha, beta), _ = eig(left, right, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-7 * np.abs(alpha)
    return np.asarray(rate * alpha[finite] / beta[finite])


def interaction(loop: Loop) -> list[str]:
    """Return what several outputs and commands mean to each other, a sentence each."""
    if len(loop.measured) < 2:
        return []
    G = gain_at_rest(loop)
    table = relative_gains(G * loop.command_scale / loop.output_scale[:, None])
    rows = "; ".join(
        f"{name}: "
        + ", ".join(f"{gain:.3g} {u}" for gain, u in zip(row, loop.actuators, strict=True))
        for name, row in zip(loop.measured, table, strict=True)
    )
    said = [f"relative gains at rest: {rows}"]
    try:
        best = best_pairing(loop)
    except WorkbenchError as error:
        said.append(str(error))
    else:
        pairs = ", ".join(
            f"{name} by {loop.actuators[k]}"
            for name, k in zip(loop.measured, best.commands, strict=True)
        )
        said.append(f"pairs of single loops: {pairs} (Niederlinski index {best.niederlinski:.3g})")
    row, column = np.unravel_index(int(np.argmax(np.abs(table))), table.shape)
    most = float(table[row, column])
    if abs(most) > STRONG:
        said.append(
            f"the plant is ill conditioned: a change of the gain from {loop.actuators[column]} to"
            f" {loop.measured[row]} by {-100.0 / most:.2g} % ties the outputs together at rest, so"
            " that no controller is better than the gains are known"
        )
    late = {round(float(z.real), 12): z for z in zeros(loop) if z.real > 1e-6 * abs(z)}
    said += [
        f"a zero in the right half plane at {_rate(z)}: some combination of the outputs answers the"
        f" wrong way first, and is no faster than about {abs(z) / 2.0:.3g} rad/s, whatever the"
        " controller"
        for z in sorted(late.values(), key=abs)
    ]
    growing = {round(float(s.real), 12): s for s in loop.linear.poles if s.real > 1e-6 * abs(s)}
    said += [
        f"the plant is unstable, with a pole at {_rate(pole)}: its loop is faster than about"
        f" {2.0 * abs(pole):.3g} rad/s, or it is not stable"
        for pole in sorted(growing.values(), key=abs)
    ]
    return said


def _rate(s: complex) -> str:
    turn = f" {'+' if s.imag > 0.0 else '-'} {abs(s.imag):.3g}i" if s.imag else ""
    return f"{s.real:.3g}{turn} rad/s"
