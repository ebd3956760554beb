"""What a parameter multiplies, resists or heats at its ports, and over what it may change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import casadi as ca

from workbench.model import Parameter
from workbench.model.expressions import cofactor
from workbench.model.units import SPEEDS, per, same_dimension
from workbench.physics.place import Local, Place, largest
from workbench.physics.recorded_facts import argument_of
from workbench.physics.survey import Survey

_DAMPINGS = ("N s/m", "N m s/rad")

_RESISTANCES = ("ohm", "S", *_DAMPINGS, "Pa s/m3", "m3/(s Pa)")
"""Units of parameters that make heat of what they multiply, or divide."""


def entering(survey: Survey) -> Iterator[tuple[Parameter, tuple[Place, ...]]]:
    """Yield refitted parameters, each with the ports that bring it into the equations."""
    yield from ((q, (at,)) for at in survey.places for q in at.parameters)
    yield from survey.spread


def gained(survey: Survey) -> Iterator[tuple[Parameter, tuple[Place, ...]]]:
    """Yield refitted parameters of the plant, gains of what is driven too, with their ports."""
    found = [*entering(survey), *((q, (at,)) for at in survey.places for q in at.gains)]
    yield from ((q, places) for q, places in found if "." not in q.name)


def joint_dampings(survey: Survey) -> tuple[tuple[Parameter, tuple[Place, ...], Local], ...]:
    """Damping parameters that several ports bring in, with the speed that each resists.

    They are those of joints that no command works on: what rubs there turns all the bodies of a
    machine, each through its inertia, as the damping does. So does what rubs over a speed that
    several signals make, as that of a wheel beside the body that drives it.
    """
    found = []
    commanded = {at.speed.source for at in survey.places if at.shared}
    for q, places in survey.spread:
        values = [survey.ports.value_at(at) for at in places]
        over = {str(cofactor(value, survey.ports.symbol_of(q))) for value in values}
        speed = next(iter(over))
        if len(over) == 1 and speed in survey.ports.integral and speed not in commanded:
            found.append((q, places, survey.ports.of(speed)))
        elif same_dimension(q.unit, *_DAMPINGS):
            made = driving(survey, q, places)
            if made and made.unit in SPEEDS and not _is_difference(survey, q, places):
                found.append((q, places, made))
    return tuple(found)


def may_bend_over(survey: Survey, q: Parameter, places: Sequence[Place]) -> tuple[Local, ...]:
    """Return the measured states and inputs over which a parameter at some ports may change.

    A state is measured too where an output reads no other, as that of a capacitor behind a
    resistance does; what is only read may change over all that the same sensor reads, as the
    voltage of a cell does over its charge. What is constant, as the heat of a fermentation, may
    change over the state that it feeds. Not states that its term is a function of, and of nothing
    else: a curve over them is a law of its own, unless the term is read as well, as the current of
    a flux is. Of the inputs those that it is a factor of in what a sensor reads, where no other law
    is a curve over them: a resistance over its current; or beside a state, as what passes from
    bubbles to a broth for each litre of air. And those without which its term is, of which the
    equations make nothing or that multiply a state beside it: a decay over the light, a heat
    transfer over the flow that carries the heat. And how fast two bodies slip, what rubs between
    them.
    """
    t, found = survey.trace, []
    values = [survey.ports.value_at(at) for at in places]
    slopes = [ca.jacobian(value, survey.ports.symbol_of(q)) for value in values]
    names = list(survey.ports.state_index)
    slopes_of = (ca.jacobian(y, t.x) for y in t.outputs.elements())
    alone = (s.sparsity().get_col() for s in slopes_of if s.nnz() == 1)
    constant = not any(ca.depends_on(s, ca.vertcat(t.x, t.u)) for s in slopes)
    read = any(at.output for at in places)
    only_read = all(at.output for at in places)
    shared = read and not only_read
    raised = {k for at in places for k in survey.ports.rates_of(survey.ports.port_index[at.name])}
    beside = [names[k] for at in places if only_read for k in _entered(survey, at)]
    known = [*survey.ports.measured.values(), *(names[k] for (k,) in alone), *beside]
    for name in dict.fromkeys(known):
        other = [t.x[i] for n, i in survey.ports.state_index.items() if n != name]
        rest = ca.vertcat(*other, t.u)
        source = constant and survey.ports.state_index.get(name) in raised
        more = source or shared or name in beside or any(ca.depends_on(s, rest) for s in slopes)
        if "." not in name and more:
            found.append(survey.ports.of(name))
    # How fast two bodies slip changes what rubs between them beside the force that presses them.
    slips = (at.signals["speed"] for at in places if "speed" in at.signals)
    for slip in dict.fromkeys(local for local in slips if local.minus):
        ends = [survey.ports.state_index[name] for name in (slip.source, slip.minus)]
        rest = ca.vertcat(*(x for i, x in enumerate(ca.vertsplit(t.x)) if i not in ends), t.u)
        if any(ca.depends_on(s, rest) for s in slopes):
            found.append(slip)
    # As a slip is; of how far two states are apart other laws are curves.
    over = driving(survey, q, places)
    if over and not _is_difference(survey, q, places):
        found.append(over)
    driven = [
        t.rates[i] for at in places for i in survey.ports.rates_of(survey.ports.port_index[at.name])
    ]
    unused = {u.source for u in survey.unused_inputs}
    for i, u in enumerate(survey.model.inputs):
        if any(ca.depends_on(s, t.u[i]) for s in slopes):
            bends = read or any(ca.depends_on(ca.jacobian(s, t.u[i]), t.x) for s in slopes)
        else:
            carries = (ca.depends_on(ca.jacobian(rate, t.u[i]), t.x) for rate in driven)
            bends = u.name in unused or any(carries)
        if bends:
            found.append(survey.ports.of(u.name))
    return tuple(found)


_VECTORS = ("A", "V", "Wb", "T", "m/s")
"""Units of what may be a vector whose components are states."""


def _entered(survey: Survey, at: Place) -> list[int]:
    """Return the numbers of the states that enter the signal of a place beside another one."""
    value, x = survey.ports.value_at(at), survey.trace.x
    found = [k for k in range(x.numel()) if ca.depends_on(value, x[k])]
    return found if len(found) > 1 else []


def own_states(survey: Survey, places: Sequence[Place]) -> tuple[Local, ...]:
    """Return the state that each of several ports changes, where all are levels of one kind.

    The air in the oil of a cylinder gives way by the pressure of its own chamber. Of what passes
    between two stores it is the level that drives it, or the mean of both that do: a rod conducts
    by its own temperature. Empty unless every port has another one, all in one unit, and a state
    among them is measured. All have one range: that of all of them together.
    """
    names, ports, found = list(survey.ports.state_index), survey.ports, list[Local]()
    for at in places:
        changed = ports.rates_of(ports.port_index[at.name])
        drives = [k for k in changed if ca.depends_on(ports.value_at(at), survey.trace.x[k])]
        own = [names[k] for k in (changed if len(changed) == 1 else drives)]
        if not 0 < len(own) < 3:
            return ()
        found.append(replace(ports.of(own[0]), beside=tuple(own[1:])))
    ends = dict.fromkeys(end for q in found for end in (q.source, *q.beside))
    levels = [ports.of(name) for name in ends]
    alike = all(same_dimension(q.unit, levels[0].unit) for q in levels)
    if not alike or not ends.keys() & {*ports.measured.values()} or len({*found}) < len(places):
        return ()
    known = [q.seen for q in levels if q.seen]
    seen = (min(low for low, _ in known), max(high for _, high in known)) if known else None
    return tuple(replace(q, seen=seen) for q in found) if len(found) > 1 else ()


def own_vector(own: Sequence[Local]) -> Local | None:
    """Return the length of the vector whose components some states are, if they may be one.

    The iron of a motor saturates with the current of both its axes together.
    """
    if not own or any(q.beside for q in own) or not same_dimension(own[0].unit, *_VECTORS):
        return None
    longest = math.hypot(*(q.largest for q in own))
    more = tuple(q.source for q in own[1:])
    return replace(own[0], beside=more, vector=True, lower=0.0, seen=(0.0, longest))


def dissipating(survey: Survey, q: Parameter, places: Sequence[Place]) -> Local | None:
    """Return what a parameter at some ports makes heat of: a current, what a resistance passes.

    It is what the parameter multiplies there, or divides.
    """
    own = survey.ports.symbol_of(q)
    parts = (cofactor(survey.ports.value_at(at), own) for at in places)
    found = [part for part in parts if part is not None]
    known = (str(e) for e in found if e.is_symbolic())
    passed = [survey.ports.of(name) for name in known if name in survey.ports.known]
    # A magnet is weaker the warmer the current makes it, which it turns as well as brakes with.
    if current := next((q for q in passed if same_dimension(q.unit, "A")), None):
        return current
    if (
        len(found) < len(places)
        or not ca.depends_on(found[0], ca.vertcat(survey.trace.x, survey.trace.u))
        or not all(ca.is_equal(found[0], e, 8) for e in found[1:])
        or not same_dimension(q.unit, *_RESISTANCES)
    ):
        return None
    return passed[0] if passed else _argument(survey, q, "1")


def heating(survey: Survey) -> tuple[Local, ...]:
    """Return the currents, and the voltages and shares of one that are set, that may heat."""
    heating = [q for q in survey.model.states if same_dimension(q.unit, "A")] + [
        q for q in survey.model.inputs if q.commanded and same_dimension(q.unit, "A", "V", "1")
    ]
    return tuple(survey.ports.of(q.name) for q in heating)


def argument(survey: Survey, q: Parameter, places: Sequence[Place]) -> Local | None:
    """Return what a parameter multiplies at some ports, if that is made of several signals.

    What it divides, as an inertia does, is all that acts there.
    """
    own = survey.ports.symbol_of(q)
    slopes = (ca.jacobian(survey.ports.value_at(at), own) for at in places)
    return None if any(ca.depends_on(s, own) for s in slopes) else _made(survey, q, places)


def driving(survey: Survey, q: Parameter, places: Sequence[Place]) -> Local | None:
    """Return what a parameter multiplies or divides at some ports, made of several signals."""
    seen = survey.ports.ranges.get(argument_of(q.name))
    return None if seen is None or seen[0] == seen[1] else _made(survey, q, places)


def _made(survey: Survey, q: Parameter, places: Sequence[Place]) -> Local | None:
    """Return what several signals make of what a parameter multiplies at some ports.

    What adds up has one unit, that of a bare signal in it; what is all of the port with the
    parameter has the port's over its own.
    """
    first = _multiplied(survey, q, places)
    if first is None:
        return None
    units = {survey.ports.known[n].unit for n in _added(first) if n in survey.ports.known}
    if len(units) == 1 and units != {"1"}:
        return _argument(survey, q, units.pop())
    value = survey.ports.value_at(places[0])
    alone = ca.is_equal(value, first * survey.ports.symbol_of(q), 8)
    return _argument(survey, q, per(places[0].unit, q.unit) if alone else "1")


def _argument(survey: Survey, q: Parameter, unit: str) -> Local:
    """Return what a parameter multiplies as a signal of its own."""
    seen = survey.ports.ranges.get(argument_of(q.name))
    return Local("argument", unit, largest(seen) or 1.0, seen=seen, multiplied=True)


def _multiplied(survey: Survey, q: Parameter, places: Sequence[Place]) -> ca.SX | None:
    """Return what a parameter multiplies at all ports; None unless several signals make it."""
    t, own = survey.trace, survey.ports.symbol_of(q)
    found = [cofactor(survey.ports.value_at(at), own) for at in places]
    # What weighs a body is also in what an exchange with another one does to it.
    given = [i for name, i in survey.ports.port_index.items() if name.endswith(".exchange")]
    weighs = any(ca.depends_on(t.rates_by_port[:, i], own) for i in given)
    if not found or weighs or any(e is None for e in found):
        return None
    first = ca.SX(found[0])
    signals = ca.vertcat(t.x, t.u)
    many = sum(ca.depends_on(first, signals[i]) for i in range(signals.numel()))
    alike = all(ca.is_equal(first, ca.SX(e), 8) for e in found[1:])
    return first if alike and many > 1 and ca.depends_on(first, t.x) else None


def _parts(expression: ca.SX) -> list[ca.SX]:
    return [expression.dep(i) for i in range(expression.n_dep())]


def _added(expression: ca.SX) -> list[str]:
    """Return the bare signals that add up, with others, to an expression."""
    if expression.is_symbolic():
        return [str(expression)]
    if expression.op() not in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG):
        return []
    return [name for part in _parts(expression) for name in _added(part)]


def _is_difference(survey: Survey, q: Parameter, places: Sequence[Place]) -> bool:
    """Tell whether what a parameter multiplies at some ports is made of two bare signals."""
    return all(part.is_symbolic() for part in _parts(ca.SX(_multiplied(survey, q, places))))
