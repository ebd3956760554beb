"""Equations that count in units of their own, such as mg/dl and minutes, or bar and litres."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from workbench.errors import WorkbenchError
from workbench.model.quantities import Quantity
from workbench.model.regularisation import EXACT
from workbench.model.scope import Names, Scope, node
from workbench.model.units import in_symbols, parse_unit, powers, same_dimension

_SAME = 1e-9
"""Relative difference that rounding leaves."""

_POINTS = 3
"""Points at which equations in SI and in their own units are compared."""

Sizes = Mapping[str, tuple[float, float]]
"""Of each quantity the size of its unit and the zero of that, in SI, by name."""

_SI = (1.0, 0.0)


@dataclass(frozen=True)
class InSI:
    """Equations in SI, made of those that count in units of their own.

    Args:
        equations: What counts in units of its own.
        time: Its unit of time, in s.
        plainly: Whether it holds in SI as it stands, because no number in it has a unit.
    """

    equations: Callable[[Scope], Any]
    time: float
    states: Sizes
    inputs: Sizes
    outputs: Sizes
    parameters: Sizes
    plainly: bool = False

    def __call__(self, scope: Scope) -> Any:
        """Write the equations down with the names of a scope."""
        if self.plainly:
            return self.equations(replace(scope, in_si=True))
        x, u, p = (
            Names(kind, {n: (v - of[n][1]) / of[n][0] if n in of else v for n, v in own.items()})
            for kind, own, of in (
                ("state", scope.x, self.states),
                ("input", scope.u, self.inputs),
                ("parameter", scope.p, self.parameters),
            )
        )
        own = {
            node(named[n]): whole[n]
            for named, whole in ((x, scope.x), (u, scope.u), (p, scope.p))
            for n in named
        }
        found = self.equations(replace(scope, x=x, u=u, p=p, own=own))
        if isinstance(found, Mapping):
            return self._paced(found)
        if not _are_two(found):
            return found
        rates, outputs = found
        # What is read as it is, in the same unit, stays recognisable.
        read = {
            (node(named[n]), of.get(n, _SI)): whole[n]
            for named, whole, of in ((u, scope.u, self.inputs), (x, scope.x, self.states))
            for n in named
        }
        return (
            self._paced(rates),
            {
                n: read.get((node(v), (size, zero)), v * size + zero)
                for n, v in outputs.items()
                for size, zero in (self.outputs.get(n, _SI),)
            },
        )

    def _paced(self, rates: Mapping[str, Any]) -> dict[str, Any]:
        return {n: v * (self.states.get(n, _SI)[0] / self.time) for n, v in rates.items()}


def _are_two(found: object) -> bool:
    return isinstance(found, tuple) and [isinstance(v, Mapping) for v in found] == [True, True]


def in_si_equations(
    equations: Callable[[Scope], Any], groups: Mapping[str, Sequence[Quantity]], time: str = ""
) -> Callable[[Scope], Any]:
    """Return equations in SI: those given, where all quantities are declared in its units.

    Others hold in SI too where no number in them has a unit. Else they count in the units that are
    declared, which then must belong together as those of the SI do, litres with decimetres, or
    their author says which unit of time is theirs, and that they hold what factors there are.

    Args:
        groups: ``states``, ``inputs``, ``outputs`` and ``parameters``.
        time: Unit of time of the equations, where the author says it.

    Raises:
        WorkbenchError: If the units do not belong together.
    """
    declared = [q for group in groups.values() for q in group]
    if isinstance(equations, InSI) or not (time or any(q.stated for q in declared)):
        return equations
    units = {
        kind: {q.name: parse_unit(q.stated) for q in group if q.stated}
        for kind, group in groups.items()
    }
    states, inputs, outputs, parameters = (
        {name: (unit.factor, unit.offset) for name, unit in units[kind].items()}
        for kind in ("states", "inputs", "outputs", "parameters")
    )
    if time and not same_dimension(time, "s"):
        raise WorkbenchError(f"time is {time!r}; give a unit of time, such as 'min'")
    # Beside states that are plain numbers the unit of an output says nothing of the equations.
    plain = all(q.unit == "1" and not q.stated for q in groups["states"])
    joined = [
        q for kind, group in groups.items() if not (plain and kind == "outputs") for q in group
    ]
    texts = dict.fromkeys(q.stated or q.unit for q in joined)
    # What goes in is given in any unit: a flow in l/min is no sign of equations that count minutes.
    own = [q.stated or q.unit for kind in ("states", "parameters") for q in groups[kind]]
    for size in (parse_unit(time).factor,) if time else _times(own):
        found = InSI(equations, size, states, inputs, outputs, parameters)
        plainly = replace(found, plainly=True)
        if _alike(found, plainly, groups):
            return plainly
        if time or _belong_together(texts, size):
            return found
    for unit in _units_of_time(q.stated for q in groups["inputs"]):
        if _belong_together(texts, parse_unit(unit).factor):
            raise WorkbenchError(
                f"the equations' unit of time is not told: inputs alone are declared per {unit!r};"
                f" give Model(..., time={unit!r}) if the equations count in {unit!r}, with which"
                " all units belong together, or time='s' if they hold the factor"
            )
    # A zero of its own is no factor: only where nothing else is declared are there two of them.
    sized = [q for q in declared if q.stated and parse_unit(q.stated).factor != 1.0]
    named = sized or [q for q in declared if q.stated]
    said = ", ".join(f"{q.name} is in {q.stated!r}" for q in named)
    one = named[0]
    unit = "N m" if one.unit == "J" and "N" in one.stated else one.unit
    told = f"{type(one).__name__}({one.name!r}, {unit!r}, display_unit={one.stated!r})"
    raise WorkbenchError(
        f"the units do not belong together: {said}, others in units of the SI or of another size,"
        " so that the equations would hold factors between them; declare all of a kind in the same"
        " unit, such as minutes, or in the SI, and what a recording or a reader counts in as"
        f" display_unit, as in {told}; or, of equations"
        " that hold these factors, say in which time they count, Model(..., time='s') or time='min'"
    )


def _times(units: Iterable[str]) -> list[float]:
    """Return sizes of the units of time that units are made of, in s, then those that usual are."""
    named = [parse_unit(symbol).factor for symbol in _units_of_time(units)]
    return list(dict.fromkeys([*named, 1.0, 3600.0]))


def _units_of_time(units: Iterable[str]) -> list[str]:
    """Return the units of time that units are made of."""
    symbols = [s for unit in units for s, _ in powers(in_symbols(unit)) if s != "1"]
    return [s for s in dict.fromkeys(symbols) if same_dimension(s, "s")]


def _belong_together(units: Iterable[str], time: float) -> bool:
    """Tell whether units are products of powers of one size each of length, mass and so on.

    Args:
        time: That of time, in s.
    """
    every = [*map(parse_unit, units)]
    # What is read in per cent is a size of its own, of which a gain in W/% is one too.
    own = {unit.text for unit in every if unit.factor != 1.0 and not unit.dimensions}
    own = {text for text in own if powers(text) == [(text, 1)]}
    parsed = [unit for unit in every if unit.dimensions or unit.text in own]
    # A temperature is told from absolute zero, or from another, throughout.
    scales = {unit.offset for unit in parsed if unit.dimensions == (("K", 1),)}
    powers_of = [
        {**dict(unit.dimensions), **{k: n for k, n in powers(in_symbols(unit.text)) if k in own}}
        for unit in parsed
    ]
    bases = sorted({base for each in powers_of for base in each} - {"rad", "s"})
    matrix = np.array([[each.get(base, 0.0) for base in bases] for each in powers_of])
    wanted = np.array(
        [
            math.log(unit.factor) - each.get("s", 0.0) * math.log(time)
            for unit, each in zip(parsed, powers_of, strict=True)
        ]
    )
    found = np.linalg.lstsq(matrix, wanted, rcond=None)[0] if bases else np.zeros(0)
    return len(scales) < 2 and bool(np.abs(matrix @ found - wanted).max(initial=0.0) < _SAME)


def _alike(
    first: Callable[[Scope], Any],
    second: Callable[[Scope], Any],
    groups: Mapping[str, Sequence[Quantity]],
) -> bool:
    """Tell whether two equations are the same, at some points about those that are declared."""
    symbols = {k: {q.name: ca.SX.sym(q.name) for q in group} for k, group in groups.items()}
    given = [symbols[k] for k in ("states", "inputs", "parameters")]
    each = []
    for equations in (first, second):
        x, u, p = map(Names, ("state", "input", "parameter"), given)
        found = equations(Scope(x, u, p, form=EXACT))
        if isinstance(found, Mapping):
            found = (found,)
        elif not _are_two(found):
            return True
        each.append(ca.vcat([ca.SX(v) for part in found for v in part.values()]))
    vectors = [ca.vcat(list(v.values())) if v else ca.SX(0, 1) for v in given]
    both = ca.Function("both", vectors, each)
    random = np.random.default_rng(0)
    for _ in range(_POINTS):
        at = [
            [_value(q) * random.uniform(0.8, 1.2) for q in groups[k]]
            for k in ("states", "inputs", "parameters")
        ]
        own, plain = (np.asarray(v, dtype=float).ravel() for v in both.call(at))
        if not np.allclose(own, plain, rtol=_SAME, atol=0.0, equal_nan=True):
            return False
    return True


def _value(q: Quantity) -> float:
    """Return a value, in SI, that a quantity may have; one of its unit where it says none."""
    unit = parse_unit(q.stated or q.unit)
    said = (getattr(q, name, 0.0) for name in ("value", "initial", "nominal"))
    return next((v for v in said if v), unit.factor + unit.offset)
