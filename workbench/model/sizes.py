"""Typical sizes where a plant declares none, from its equations and the ranges of its inputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.model.quantities import Input, Output, Quantity, State
from workbench.model.trace import Trace

Named = TypeVar("Named", State, Input, Output)

BEYOND = 1e50
"""Slope, in SI, that no machine has: there the equations have left their range, as an Arrhenius law
below zero absolute, and tell nothing of steps or sizes."""

_ROUNDS = 6
"""Times that the motion is followed to where the sizes of the last round lead: a bearing that
sticks at the start slides there."""

_TURNS = np.array([0.25, 0.05, 0.45])
"""Angles of ``s`` over pi; the further ones where an unstable oscillation is close to the first."""

_INTEGRATES = 1e-9
"""Size of an eigenvalue, as a share of the largest, below which its mode has no pace."""

_WARMER = 0.03
"""Change of a temperature, as a share of its distance from absolute zero: some 10 K."""

_AS_INTEGRATORS = 1e-6
"""The same, below which a mode takes longer than anybody waits."""


def sizes(
    traced: Trace,
    states: Sequence[State],
    inputs: Sequence[Input],
    x: Vector,
    u: Vector,
    p: Vector,
) -> tuple[Vector, Vector, Vector, dict[str, float]]:
    """Find how far inputs within their range move a plant at its own pace.

    The response of the linear model ``|(s I - A)^-1 B| size(u)`` is taken on ``s = w exp(j pi/4)``,
    half-way between a growth and an oscillation, so that no resonance and no instability counts, at
    every pace ``w`` of the plant: the magnitudes of its eigenvalues. Where an unstable oscillation
    is there, it is taken beside it.

    Args:
        x: States at the start, shape (n_states,), in SI.
        u: Inputs at rest, shape (n_inputs,), in SI.
        p: Parameters, shape (n_parameters,), in SI.

    Returns:
        Sizes of states, inputs and outputs, and those of ports by name, in SI; declared sizes as
        they are, and zero where neither equations nor ranges tell.
    """
    declared = np.array([q.scale for q in states])
    known = np.array([q.scale or _reach(q, 0.0) for q in states])
    ends = np.array([(q.lower, q.upper) for q in states]).reshape(-1, 2)
    limits = np.array([(q.lower, q.upper) for q in inputs]).reshape(-1, 2)
    named = [port.name for port in traced.ports]
    rows = [traced.signal_names.index(name) for name in named]
    both = ca.vertcat(traced.x, traced.u)
    slopes = traced.function(
        "slopes",
        *(ca.densify(ca.jacobian(e, both)) for e in (traced.rates, traced.outputs)),
        ca.densify(ca.jacobian(traced.signals[rows], both)),
        ca.densify(ca.vertcat(traced.rates, traced.outputs)),
    )
    n_x = len(states)

    def answered(by: float, k: int) -> tuple[Vector, Vector]:
        found = slopes(x, u + by * np.eye(len(u))[k], p)
        rates, outputs, _, values = (np.asarray(part) for part in found)
        return values[:, 0], np.append(rates[:, n_x + k], outputs[:, n_x + k])

    def clipped(k: int) -> float:
        """Return how far equations let an input go whose author does not say it; 0 if anywhere."""
        ends = [abs(input_end(partial(answered, k=k), sign)) for sign in (1.0, -1.0)]
        return max([end for end in ends if np.isfinite(end)], default=0.0)

    def seen(slope: Vector, moved: Vector) -> Vector:
        """Return what outputs show of each state and input alone; by slopes where they end."""
        start = np.append(x, u)
        each = [start, *(start + np.diag(moved))]
        values = np.hstack([slopes(z[:n_x], z[n_x:], p)[3][n_x:] for z in each])
        steps = np.abs(values[:, 1:] - values[:, :1])
        shown = np.where(np.isfinite(steps), steps, np.abs(slope * moved))
        return np.asarray(shown.sum(axis=1))

    reaches = [q.scale or _reach(q, _usual(q)) for q in inputs]
    of_u = np.array([reach or clipped(k) for k, reach in enumerate(reaches)])
    of_x = declared.copy()
    at_rest: list[Vector] = []
    found: list[list[Vector]] = []
    growth = 0.0
    for _ in range(_ROUNDS):
        responses, measured, passed, answering = [], [], [], np.zeros(len(u), dtype=bool)
        for sign in (0.0, 1.0, -1.0):
            at = np.clip(x + sign * of_x, *ends.T)
            driven = np.clip(u + sign * 0.5 * of_u, *limits.T)
            rates, outputs, ports, _ = (np.asarray(part) for part in slopes(at, driven, p))
            answers = np.vstack([rates, outputs])[:, n_x:].any(axis=0)
            # Beyond the end of an input nothing is told of it.
            if not np.all(np.abs(rates) < BEYOND) or np.any(answering & ~answers):
                continue
            answering = answering | answers
            if not found and not sign:
                growth = float(poles_of(rates[:, :n_x]).real.max(initial=0.0))
            responses.append(response(rates[:, :n_x], rates[:, n_x:], of_u, known, growth))
            moved = np.concatenate([np.where(declared > 0.0, declared, responses[-1]), of_u])
            measured.append(seen(outputs, sign * moved) if sign else np.abs(outputs) @ moved)
            passed.append(np.abs(ports) @ moved)
        if not responses:
            break
        at_rest = at_rest or [responses[0], measured[0], passed[0]]
        found.append([np.median(part, axis=0) for part in (responses, measured, passed)])
        reached = np.where(declared > 0.0, declared, found[-1][0])
        if np.allclose(reached, of_x, rtol=0.01, atol=0.0):
            at_rest, found = found[-1], found[-1:]
            break
        of_x = reached
    if not found:
        return declared, of_u, np.zeros(traced.outputs.numel()), {}
    # Sizes that lead ever further, or back and forth, are told by none of the rounds alone: the
    # plant has left where it works.
    of_x, of_y, of_port = (
        np.where(first > 0.0, np.fmin(first, _middle(part)), _middle(part))
        for first, part in zip(at_rest, zip(*found, strict=True), strict=True)
    )
    of_x = np.where(declared > 0.0, declared, of_x)
    return of_x, of_u, of_y, dict(zip(named, of_port.tolist(), strict=True))


def _middle(sizes: Sequence[Vector]) -> Vector:
    """Return the geometric mean of the middle two of some sizes; the middle one, if there is."""
    ordered = np.sort(sizes, axis=0)
    count = len(ordered)
    return np.asarray(np.sqrt(ordered[(count - 1) // 2] * ordered[count // 2]))


def horizon(
    poles: npt.NDArray[np.complex128], alone: float = 1.0, slowest: float = _AS_INTEGRATORS
) -> float:
    """Return two periods of the slowest oscillation, or three of the slowest lag, in s.

    Args:
        poles: Eigenvalues, shape (n,), in 1/s.
        alone: That of integrators alone, which have no time of their own, in s.
        slowest: Speed over that of the fastest up to which what is slower integrates, a ratio.
    """
    sizes = np.abs(poles)
    own = poles[sizes > slowest * sizes.max(initial=0.0)]
    oscillations = np.abs(own[np.iscomplex(own)])
    if oscillations.size:
        return float(4.0 * np.pi / oscillations.min())
    return 3.0 / float(np.abs(own).min(initial=np.inf)) if own.size else alone


def poles_of(a: Vector) -> npt.NDArray[np.complex128]:
    """Return eigenvalues, shape (n,), in 1/s, those of integrators as zero exactly.

    Rounding makes +-sqrt(eps) of two integrators behind each other, a pole that grows of them. What
    A does not move (its null space) is taken out until all else moves.

    Source: Golub and Wilkinson, Ill-conditioned eigensystems and the computation of the Jordan
    canonical form, SIAM Review 18, 1976, section 7.

    Example:
        >>> poles_of(np.array([[0.0, 1.0], [0.0, 0.0]]))
        array([0.+0.j, 0.+0.j])
    """
    poles = np.linalg.eigvals(a).astype(np.complex128)
    if not np.isfinite(a).all():
        return poles
    left, none = _balanced(a), 0
    while len(left):
        _, values, right = np.linalg.svd(left)
        still = int(np.sum(values <= _NULL * values.max()))
        if not still:
            break
        moving, none = right[: len(left) - still], none + still
        left = moving @ left @ moving.T
    poles[np.argsort(np.abs(poles))[:none]] = 0.0
    return poles


def _balanced(a: Vector) -> Vector:
    """Return a matrix in units of its states in which rows and columns are equally large.

    Source: Osborne, On pre-conditioning of matrices, J. ACM 7, 1960.
    """
    a = a.copy()
    for _ in range(5):
        for i in range(len(a)):
            beside = np.arange(len(a)) != i
            row, column = np.linalg.norm(a[i, beside]), np.linalg.norm(a[beside, i])
            if row and column:
                a[i] *= np.sqrt(column / row)
                a[:, i] *= np.sqrt(row / column)
    return a


_NULL = 1e-13
"""Singular value, as a share of the largest, that rounding leaves of zero."""


def response(a: Vector, b: Vector, of_u: Vector, known: Vector, growth: float = 0.0) -> Vector:
    """Return the largest response over the paces of a linear model, shape (n_states,), in SI.

    Integrators alone have the pace at which inputs move them as far as is known of one of them, in
    SI, 0 of those of which nothing is; 1 rad/s if of none.

    Args:
        growth: Rate, in 1/s, at which the plant grows where it starts: by what grows more slowly
            where it would get to, nobody waits for it.
    """
    poles = poles_of(a)
    paces = np.where(poles.real > 0.0, np.maximum(np.abs(poles), growth), np.abs(poles))

    def at(pace: float) -> Vector:
        shown = np.linalg.solve(_beside(pace, poles) * np.eye(len(a)) - a, b)
        return np.asarray(np.abs(shown) @ of_u)

    own = paces[paces > _INTEGRATES * paces.max(initial=0.0)]
    if own.size:
        return np.asarray(np.max([at(pace) for pace in own], axis=0))
    one, fast = at(1.0), at(2.0)
    told = (known > 0.0) & (one > 0.0)
    # What n integrators show goes with the pace to the power of -n.
    order = np.log2(one[told] / fast[told])
    return at(float(np.max((one[told] / known[told]) ** (1.0 / order), initial=0.0)) or 1.0)


def _beside(pace: float, poles: npt.NDArray[np.complex128]) -> complex:
    points = pace * np.exp(1j * np.pi * _TURNS)
    room = np.abs(points[:, None] - poles).min(axis=1, initial=np.inf)
    return complex(points[0 if room[0] > 0.3 * pace else int(room.argmax())])


def _usual(q: Input) -> float:
    """Return how far an input without a range is moved; temperatures stay far from zero."""
    return _WARMER * q.nominal if q.unit == "K" else q.nominal


def _reach(q: State | Input | Output, usual: float) -> float:
    """Return the largest magnitude that a quantity declares; 0 if it declares none."""
    ends = [abs(end) for end in (q.lower, q.upper) if np.isfinite(end)]
    return max(ends, default=0.0) or abs(usual)


def silent(q: Input) -> bool:
    """Tell whether an input declares neither a range nor a value at rest."""
    return _reach(q, q.nominal) == 0.0


def sized(quantities: Sequence[Named], found: Vector, usual: Vector) -> tuple[Named, ...]:
    """Return quantities with sizes where they declare none.

    Args:
        found: Sizes that the equations show, shape (n,), in SI; zero or infinite where none.
        usual: Values at the start or at rest, shape (n,), in SI.
    """

    def one(q: Named, size: float, value: float) -> Named:
        if q.scale > 0.0:
            return q
        known = _reach(q, 0.0)
        size = size if np.isfinite(size) and size > 0.0 else known or abs(value)
        size = min(size, known) if known else size
        return replace(q, scale=size if np.isfinite(size) and size > 0.0 else 1.0, sized=False)

    return tuple(map(one, quantities, found.tolist(), usual.tolist()))


def missing(groups: Sequence[Sequence[Quantity]], traced: Trace, known: Collection[str]) -> bool:
    """Tell whether a quantity has no size yet, or a port that is not known by name."""
    return any(q.scale == 0.0 for group in groups for q in group) or any(
        not port.sized and port.name not in known for port in traced.ports
    )


_LITTLE = 0.05
"""Part of the steepest slope, and of all of an answer, that is left where it has ended: tanh ends
at 2.2, what a clip bounds at the clip, and a root or a logarithm nowhere."""

_FAR = 30
"""Octaves of an input's size beyond rest within which its end is looked for."""


def input_end(answer: Callable[[float], tuple[Vector, Vector]], size: float) -> float:
    """Return the change of an input, in SI, from which on nothing answers it; infinite for none.

    Args:
        answer: Returns values and their slopes by the input, each of any shape, after a change of
            it, in SI.
        size: Size of the input, in SI; its sign tells to which side.
    """
    tried = size * np.append(0.0, 2.0 ** np.arange(-_FAR, _FAR + 1))
    values, slopes = (np.stack(part) for part in zip(*map(answer, tried), strict=True))
    steep = np.abs(slopes).max(axis=1, initial=0.0)
    # What is no number is beyond all that has a meaning.
    known = np.logical_and.accumulate(np.isfinite(values).all(axis=1) & np.isfinite(steep))
    values, steep = values[known], steep[known]
    flat = _LITTLE * steep.max(initial=0.0)
    if not flat or steep[-1] > flat:
        return math.inf
    last = int(np.flatnonzero(steep > flat)[-1])
    low, high = tried[last], tried[last + 1]
    for _ in range(50):
        middle = 0.5 * (low + high)
        flat_there = float(np.abs(answer(middle)[1]).max()) <= flat
        low, high = (low, middle) if flat_there else (middle, high)
    left, whole = np.abs(answer(high)[0] - values[-1]), np.abs(values[0] - values[-1])
    if np.any((left > _LITTLE * whole) & np.any(slopes[known] != 0.0, axis=0)):
        return math.inf
    return float(size * round(high / size, 12))
