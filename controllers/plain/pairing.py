"""Interaction between several loops: relative gains, pairing, zeros, and what they forbid.

With the plant's gain G at rest (its limit from above where it integrates), commands times outputs,

    relative gains       RGA = G o (G^-1)^T             the gain of a pair alone, over that with all
                                                        other outputs held
    Niederlinski index   NI = det G / product of g_ii   of the paired gains

A pair with a negative relative gain, or pairs with a negative index of a stable plant, are unstable
with the other loops closed or with one of them open, however slow they are. A change of g_ij by
-1 / RGA_ij of itself makes G singular. A zero z in the right half plane bounds the speed of what
it shows in to about z / 2, if that shall not go far the wrong way, an unstable pole p from below to
about 2 p.

Source: Bristol, On a new measure of interaction for multivariable process control, IEEE Trans.
AC-11, 1966; Niederlinski, A heuristic approach to the design of linear multivariable interacting
control systems, Automatica 7, 1971; Skogestad and Postlethwaite, Multivariable Feedback Control,
2005, sections 3.4, 5.6 to 5.9 and 10.6.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from controllers.plain.loop import Loop, listed
from workbench.arrays import Complex, Matrix
from workbench.errors import WorkbenchError
from workbench.linearisation.exact_delays import channels_of
from workbench.model.linear_system import PADE_ABOVE
from workbench.model.units import in_time

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
    G = _even(G)
    return np.asarray(G * np.linalg.pinv(G).T)


def _even(G: Any) -> Any:
    """Return a gain in units in which its outputs move alike, if one integrates more often too."""
    return np.asarray(G / np.maximum(np.linalg.norm(G, axis=1, keepdims=True), 1e-300))


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


def best_pairings(loop: Loop, speed: float = 0.0) -> list[Pairing]:
    """Return the pairings that can be stable: the best at rest, and at a speed, in rad/s.

    The best is that whose relative gains are nearest to 1. Of more commands than outputs, those act
    that do most: of a command that does nothing, the relative gains of all outputs add up to 0,
    else to 1 at most.

    Raises:
        WorkbenchError: If none can be.
    """
    allowed = [one for one in pairings(loop) if one.allowed]
    if not allowed:
        table = np.round(relative_gains(gain_at_rest(loop)), 3).tolist()
        raise WorkbenchError(
            f"no pairing of {listed(loop.measured)} with {listed(loop.actuators)} is"
            " stable with each loop alone and with all of them: every one has a negative relative"
            f" gain or Niederlinski index (relative gains {table}); take decoupled = true, or a"
            " family that commands all outputs together, such as lqi"
        )
    scale, best = loop.command_scale / loop.output_scale[:, None], []
    for G in (gain_at_rest(loop), *(loop.response([speed]) if speed else ())):
        table = relative_gains(G * scale)
        idle = np.abs(1.0 - table.sum(axis=0))
        away = [
            sum(abs(table[i, k] - 1.0) + 2.0 * idle[k] for i, k in enumerate(one.commands))
            for one in allowed
        ]
        best.append(allowed[int(np.argmin(away))])
    return list(dict.fromkeys(best))


def paired(loop: Loop, pairing: Pairing) -> Matrix:
    """Return what the law of each output adds to the commands, its own alone, shape (m, p), SI."""
    mix = np.zeros(loop.linear.D.T.shape)
    mix[pairing.commands, np.arange(len(pairing.commands))] = 1.0
    return mix


def decoupled(loop: Loop, speed: float) -> Matrix:
    """Return the same mixed so that the law of each moves its own output alone, shape (m, p), SI.

    At rest, or at a speed in rad/s, where a response that turns has no real inverse: of each output
    it is the mix, at whatever phase, that leaves the least of all others.

    Source: Kouvaritakis, Theory and practice of the characteristic locus design method, Proc. IEE
    126, 1979, algorithm ALIGN.
    """
    G = loop.response([speed])[0] if speed else gain_at_rest(loop)
    G = _even(G * loop.command_scale)
    inverse, target = np.linalg.pinv(np.vstack([G.real, G.imag])), np.eye(len(G))
    turned = np.exp(1j * PHASES)[:, None, None] * target
    found = inverse @ np.concatenate([turned.real, turned.imag], axis=1)
    least = np.argmin(np.abs(G @ found - turned).max(axis=1), axis=0)
    mix = found[least, :, np.arange(len(G))].T
    largest = np.argmax(np.abs(mix), axis=0)
    mix = loop.command_scale[:, None] * mix
    return np.asarray(mix / mix[largest, np.arange(len(G))])


PHASES = np.linspace(0.0, np.pi, 90, endpoint=False)
"""Phases at which the answers of all outputs are aligned, in rad."""


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
    found = np.asarray(rate * alpha[finite] / beta[finite])
    delays = channels_of(own.operating_point.model)
    for t in delays.stood_in if delays else ():
        # What stands for a delay has zeros that the plant has not.
        found = found[np.abs(t * (found.real + 1j * np.abs(found.imag)) - PADE_ZERO) > 0.05]
    return found


PADE_ZERO = complex(max(np.roots(PADE_ABOVE), key=np.imag))
"""Zero of the Pade function that stands for a delay, above the real axis, times the delay."""


def interaction(loop: Loop) -> list[str]:
    """Return what several outputs and commands mean to each other, a sentence each."""
    if len(loop.measured) < 2:
        return []
    G = gain_at_rest(loop)
    table = relative_gains(G * loop.command_scale / loop.output_scale[:, None])
    # What rounding leaves is nothing.
    table[np.abs(table) < 1e-9 * np.abs(table).max()] = 0.0
    rows = "; ".join(
        f"{name}: "
        + ", ".join(f"{gain:.3g} {u}" for gain, u in zip(row, loop.actuators, strict=True))
        for name, row in zip(loop.measured, table, strict=True)
    )
    said = [f"relative gains at rest: {rows}"]
    try:
        best = best_pairings(loop)[0]
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
    said += wrong_way(loop)
    poles = loop.linear.poles
    rounded = 1e-9 * np.abs(poles).max(initial=0.0)
    # An integrator is zero but for what rounding leaves of it.
    own = [s for s in poles if s.real > max(1e-6 * abs(s), rounded)]
    growing = {round(float(s.real), 12): s for s in own}
    said += [
        f"the plant is unstable, with a pole at {_rate(pole)}: its loop is faster than about"
        f" {2.0 * abs(pole):.3g} rad/s, or it is not stable"
        for pole in sorted(growing.values(), key=abs)
    ]
    return said


def wrong_way(loop: Loop) -> list[str]:
    """Return what zeros in the right half plane, among the plant's poles, mean, a sentence each."""
    late = {round(float(z.real), 12): z for z in zeros(loop) if z.real > 1e-6 * abs(z)}
    fastest = float(np.abs(loop.linear.poles).max(initial=0.0))
    single = len(loop.measured) == 1
    what = loop.measured[0] if single else "some combination of the outputs"
    return [
        f"a zero in the right half plane at {_rate(z)}: {what} answers the wrong way first,"
        f" whatever the controller{_no_faster(z)}"
        for z in sorted(late.values(), key=abs)
        if not single or abs(z) < _AMONG * fastest
    ]


def _no_faster(z: complex) -> str:
    """Say what a zero, in rad/s, asks of a loop that is fast.

    Source: Middleton, Trade-offs in linear control system design, Automatica 27, 1991: a step that
    settles in T goes by 1 / (exp(z T) - 1) of it the wrong way, or more.
    """
    if z.imag:
        return f"; loops with margins are as a rule no faster than about {abs(z) / 2.0:.3g} rad/s"
    soon = in_time(math.log(2.0) / z.real)
    return f", and by more than its step where that settles within {soon}"


_AMONG = 10.0
"""Rate of a zero over the fastest pole from which on no loop is fast enough to meet it."""


def _rate(s: complex) -> str:
    # Those of a real system come in pairs.
    turn = f" ± {abs(s.imag):.3g}i" if s.imag else ""
    return f"{s.real:.3g}{turn} rad/s"
