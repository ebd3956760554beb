"""Exchanges: what one store or body gives and another takes, found in equations without ports.

The spring between two masses, the heat between a room and its walls, a reaction that turns one
substance into another: a term that enters the rates of several states in a fixed ratio, of one kind
with opposite signs. What acts there, such as the backlash of a coupling, acts on all of them.
States of several kinds, as a pressure and the volume that it fills, share what one parameter is in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.model.quantities import State
from workbench.model.units import SPEEDS, same_dimension

_LOOKS = 12
"""Random points at which terms are compared, half of them as large as states usually are; those
without a value do not count."""

_ALIKE = 1e-7
"""Relative difference of numbers that are the same but for rounding."""


@dataclass(frozen=True)
class Exchange:
    """A term that several rates share.

    Args:
        names: The states, the one that stands first being that whose rate the value is.
        value: The term in the rate of the first, in SI per second.
        shares: The term in each rate as a multiple of that, in SI.
    """

    names: tuple[str, ...]
    value: ca.SX
    shares: tuple[ca.SX, ...]


class _Shared(NamedTuple):
    """What several rates share, and the terms by parameter that add up to it."""

    direction: Vector
    names: tuple[str, ...]
    shares: tuple[ca.SX, ...]
    values: list[ca.SX]


def exchanges(
    rates: Mapping[str, ca.SX],
    states: Sequence[State],
    x: Mapping[str, ca.SX],
    u: Mapping[str, ca.SX],
    p: Mapping[str, ca.SX],
) -> list[Exchange]:
    """Find the terms that rates share, by the parameters in them.

    A parameter k of a term ``k^n g(x)`` tells its direction, the ratios of ``df/dk``, and its
    value, ``k df/dk / n``; n and the ratios must be the same whatever the states are. Where one
    parameter is in several such terms, as a conductivity is all along a rod, they show as they are
    written.

    Args:
        rates: Rates in the symbols ``x``, ``u`` and ``p``, by the state's name, in SI per second.
        states: The plant's own, without those of effects.
        x: Symbols of the states, by name, in SI.
        u: Symbols of the inputs, by name, in SI.
        p: Symbols of the parameters, by name, in SI.
    """
    names = [q.name for q in states if q.name in rates]
    f = ca.vcat([rates[n] for n in names])
    both, own = ca.vcat([*x.values(), *u.values()]), ca.vcat(list(p.values()))
    rng = np.random.default_rng(2)
    # What is found must not turn on the values that parameters have.
    usual = rng.uniform(0.5, 1.5, own.numel())
    looks = rng.uniform(0.2, 1.0, (_LOOKS, both.numel()))
    # A reaction has no rate at 1 K.
    looks[::2, : len(x)] *= [max(abs(q.initial), q.scale) for q in states]
    units = {q.name: q.unit for q in states}
    shared: list[_Shared] = []
    for symbol in p.values():
        slope = ca.jacobian(f, symbol)
        moved = [i for i in range(len(names)) if not slope[i].is_zero()]
        if len(moved) < 2:
            continue
        alike = _of_one_kind([units[names[i]] for i in moved])
        if not alike:
            if not ca.depends_on(slope[moved], ca.vcat(list(x.values()))):
                continue  # What an input alone gives acts there.
            # What is nearly all of a rate is best read in its unit.
            moved.sort(key=lambda i: len(_added_up(f[i])))
        bent = symbol * ca.jacobian(slope[moved[0]], symbol)
        see = ca.Function("see", [both, own], [slope[moved], bent])
        seen = np.vstack([np.asarray(v, dtype=float) for v in see(looks.T, usual)]).T
        known = np.flatnonzero(np.isfinite(seen).all(axis=1) & seen[:, :-1].any(axis=1))
        if len(known) < 2 or not seen[known, :-1].all():
            continue
        slopes = seen[known, :-1]
        ratios, powers = slopes / slopes[:, :1], 1.0 + seen[known, -1:] / slopes[:, :1]
        if not (_same(ratios) and _same(powers)) or powers[0, 0] == 0.0:
            continue
        if alike and ratios.min() > 0.0:
            continue  # It fills both, or drives them.
        shares = ca.substitute(slope[moved] / slope[moved[0]], both, ca.DM(looks[known[0]]))
        value = symbol * slope[moved[0]] / round(float(powers[0, 0]), 6)
        direction = np.zeros(len(names))
        direction[moved] = ratios[0]
        same = next((one for one in shared if _equal(one.direction, direction)), None)
        if same is None:
            moving = tuple(names[i] for i in moved)
            shared.append(_Shared(direction, moving, tuple(shares.elements()), [value]))
            continue
        factored = [v for v in same.values if ca.depends_on(v, symbol)]
        if factored:
            # A second factor of a term that is there already, unless that is a part of this one.
            part = ca.sum1(ca.vcat(factored))
            scaled = symbol * ca.jacobian(part, symbol) / round(float(powers[0, 0]), 6)
            at = ca.Function("at", [both, own], [part, scaled, value])
            there, by_it, whole = np.array(at(looks[known].T, usual), dtype=float)[:, 0]
            if not _equal(there, by_it) or _equal(there, whole):
                continue
        kept = [v for v in same.values if not ca.depends_on(v, symbol)]
        same.values[:] = [*kept, value]
    found = [Exchange(one.names, ca.sum1(ca.vcat(one.values)), one.shares) for one in shared]
    for direction, exchange in _written(f, names, both, own, looks, usual):
        kinds = [units[n] for n in exchange.names]
        if _of_one_kind(kinds) and not any(_equal(one.direction, direction) for one in shared):
            found.append(exchange)
    return found


def _written(
    f: ca.SX, names: Sequence[str], both: ca.SX, own: ca.SX, looks: Vector, usual: Vector
) -> list[tuple[Vector, Exchange]]:
    """Find the terms of rates that are multiples of one another, not all of one sign."""
    terms = [(i, term) for i in range(f.numel()) for term in _added_up(f[i])]
    terms = [(i, term) for i, term in terms if ca.depends_on(term, both)]
    if not terms:
        return []
    see = ca.Function("see", [both, own], [ca.vcat([term for _, term in terms])])
    seen = np.asarray(see(looks.T, usual), dtype=float)
    known = np.isfinite(seen).all(axis=0)
    found: dict[tuple[float, ...], tuple[Vector, Exchange]] = {}
    left = [k for k in range(len(terms)) if known.sum() > 1 and seen[k, known].all()]
    while left:
        ratios = {k: seen[k, known] / seen[left[0], known] for k in left}
        alike = [k for k, ratio in ratios.items() if _same(ratio[:, None])]
        left = [k for k in left if k not in alike]
        moved = [terms[k][0] for k in alike]
        if len({*moved}) < len(moved) or min(ratios[k][0] for k in alike) > 0.0:
            continue
        direction = np.zeros(len(names))
        direction[moved] = [ratios[k][0] for k in alike]
        first = terms[alike[0]][1]
        shares = (terms[k][1] / first for k in alike)
        at = ca.DM(looks[np.flatnonzero(known)[0]])
        exchange = Exchange(
            tuple(names[i] for i in moved),
            first,
            tuple(ca.substitute(share, both, at) for share in shares),
        )
        same = tuple(np.round(direction, 9))
        if same in found:
            before = found[same][1]
            exchange = Exchange(before.names, before.value + first, before.shares)
        found[same] = direction, exchange
    return list(found.values())


def _added_up(e: ca.SX) -> list[ca.SX]:
    """Return the terms that add up to a rate; what is made of bare signals alone is one term."""
    op = e.op() if e.n_dep() else None
    parts = [e.dep(i) for i in range(e.n_dep())]
    if op == ca.OP_NEG:
        return [-term for term in _added_up(parts[0])]
    if op in (ca.OP_ADD, ca.OP_SUB) and not all(map(_is_bare, parts)):
        sign = -1.0 if op == ca.OP_SUB else 1.0
        return [*_added_up(parts[0]), *(sign * term for term in _added_up(parts[1]))]
    if op == ca.OP_DIV:
        return [term / parts[1] for term in _added_up(parts[0])]
    if op == ca.OP_MUL:
        (a, b), (left, right) = parts, map(_added_up, parts)
        if len(left) == 1 or len(right) == 1:
            return [x * y for x in left for y in right] if len(left) + len(right) > 2 else [a * b]
    return [e]


def _is_bare(e: ca.SX) -> bool:
    """Whether an expression is a signal, a number, or made of such by sums and numbers."""
    if e.is_constant() or e.is_symbolic():
        return True
    parts = [e.dep(i) for i in range(e.n_dep())]
    if e.op() in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG):
        return all(map(_is_bare, parts))
    return e.op() == ca.OP_MUL and any(q.is_constant() for q in parts) and all(map(_is_bare, parts))


def _same(rows: Vector) -> bool:
    return _equal(rows, rows[0])


def _equal(a: Vector, b: Vector) -> bool:
    return bool(np.all(np.abs(a - b) <= _ALIKE * np.abs(b).max()))


def _of_one_kind(units: Sequence[str]) -> bool:
    """Whether states may give each other something: a drum may turn what a rope pulls."""
    return all(same_dimension(unit, units[0]) for unit in units) or all(
        same_dimension(unit, *SPEEDS) for unit in units
    )
