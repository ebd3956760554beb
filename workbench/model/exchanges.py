"""Exchanges: what one store or body gives and another takes, found in equations without ports.

The spring between two masses, the heat between a room and its walls, a reaction that turns one
substance into another: a term that enters the rates of several states of one kind in a fixed ratio,
with opposite signs. What acts there, such as the backlash of a coupling, acts on all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.model.quantities import Quantity
from workbench.model.units import SPEEDS, same_dimension

_LOOKS = 12
"""Random points at which terms are compared; those without a value do not count."""

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


def exchanges(
    rates: Mapping[str, ca.SX],
    states: Sequence[Quantity],
    x: Mapping[str, ca.SX],
    u: Mapping[str, ca.SX],
    p: Mapping[str, ca.SX],
) -> list[Exchange]:
    """Find the terms that rates share, by the parameters in them.

    A parameter k of a term ``k^n g(x)`` tells its direction, the ratios of ``df/dk``, and its
    value, ``k df/dk / n``; n and the ratios must be the same whatever the states are.

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
    units = {q.name: q.unit for q in states}
    found: list[tuple[Vector, Exchange]] = []
    taken: list[tuple[Vector, ca.SX]] = []
    for symbol in p.values():
        slope = ca.jacobian(f, symbol)
        moved = [i for i in range(len(names)) if not slope[i].is_zero()]
        if len(moved) < 2 or not _of_one_kind([units[names[i]] for i in moved]):
            continue
        bent = symbol * ca.jacobian(slope[moved[0]], symbol)
        see = ca.Function("see", [both, own], [slope[moved], bent])
        seen = np.vstack([np.asarray(v, dtype=float) for v in see(looks.T, usual)]).T
        known = np.flatnonzero(np.isfinite(seen).all(axis=1) & seen[:, :-1].any(axis=1))
        if len(known) < 2 or not seen[known, :-1].all():
            continue
        slopes = seen[known, :-1]
        ratios, powers = slopes / slopes[:, :1], 1.0 + seen[known, -1:] / slopes[:, :1]
        if not (_same(ratios) and _same(powers)) or ratios.min() > 0.0 or powers[0, 0] == 0.0:
            continue
        shares = ca.substitute(slope[moved] / slope[moved[0]], both, ca.DM(looks[known[0]]))
        value = symbol * slope[moved[0]] / round(float(powers[0, 0]), 6)
        direction = np.zeros(len(names))
        direction[moved] = ratios[0]
        if any(_near(d, direction) and not ca.jacobian(v, symbol).is_zero() for d, v in taken):
            continue  # A second factor of a term that is there already.
        taken.append((direction, value))
        same = next((k for k, (d, _) in enumerate(found) if _near(d, direction)), None)
        if same is None:
            own_shares = tuple(shares[k] for k in range(len(moved)))
            found.append((direction, Exchange(tuple(names[i] for i in moved), value, own_shares)))
        else:
            _, first = found[same]
            found[same] = direction, Exchange(first.names, first.value + value, first.shares)
    return [exchange for _, exchange in found]


def _same(rows: Vector) -> bool:
    return bool(np.all(np.abs(rows - rows[0]) <= _ALIKE * np.abs(rows[0]).max()))


def _near(a: Vector, b: Vector) -> bool:
    return bool(np.all(np.abs(a - b) <= _ALIKE * np.abs(b).max()))


def _of_one_kind(units: Sequence[str]) -> bool:
    """Whether states may give each other something: a drum may turn what a rope pulls."""
    return all(same_dimension(unit, units[0]) for unit in units) or all(
        same_dimension(unit, *SPEEDS) for unit in units
    )
