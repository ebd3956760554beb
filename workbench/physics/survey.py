"""A survey of a model: every port as a place, and what decides which laws may act there."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np

from workbench.errors import check_choice
from workbench.model import Model, Parameter, Port
from workbench.model.expressions import reverses_over
from workbench.model.units import per, same_dimension
from workbench.physics.motion import (
    carried_motion,
    directed_motion,
    is_elastic,
    motion_of,
    muscle_signals,
)
from workbench.physics.place import EFFORTS, FLOWS, Local, Place
from workbench.physics.ports import Ports, same
from workbench.physics.recorded_facts import NOTHING, RecordedFacts, end_of, term_of

_ROLES = {
    "force": ("N", "N m"),
    "acceleration": ("m/s2", "rad/s2"),
    "voltage": ("V",),
    "current": ("A",),
    "flow": ("m3/s", "kg/s"),
    "heat": ("W",),
    "temperature": ("K",),
    "pressure": ("Pa",),
    "inertia": ("kg m2", "kg"),
    "volume": ("m3",),
}
_ENDINGS = {".reading": "measurement", ".command": "command", ".outflow": "flow", ".inflow": "flow"}

_PULLS = ("force", "muscle_tension")
"""Roles of ports where pressure and contraction of a muscle may act."""

_VISIBLE = 0.02
"""Part of a port's scale that a parameter must bring in to be offered a change with time."""


class Survey:
    """Everything about a model that decides which laws may act where.

    Args:
        found: Names of attached effects whose parameters are not offered a change with time.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> place = Survey(servo_axis()).place("axis.force")
        >>> place.role, place.speed.unit, place.coordinate.source
        ('force', 'm/s', 'position')
    """

    def __init__(
        self, model: Model, recorded: RecordedFacts = NOTHING, *, found: Collection[str] = ()
    ) -> None:
        self.model, self.trace, self.recorded, self._found = model, model.exact, recorded, found
        self.ports = Ports(model, recorded.ranges)
        read = recorded.outputs
        self._outputs = [q for q in model.outputs if read is None or q.name in read]

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """Every port as a place; sensors of outputs that are not recorded apart."""
        found = (self.place(q.name) for q in self.trace.ports)
        unrecorded = {q.name for q in self.model.outputs} - {q.name for q in self._outputs}
        return tuple(
            q
            for q in found
            if q.role != "measurement" or q.name.removesuffix(".reading") not in unrecorded
        )

    def fitting(self, *roles: str, needs: tuple[str, ...] = ()) -> tuple[Place, ...]:
        """Return the places of some roles at which some signals can be had."""
        shared = "shared command" in roles
        return tuple(
            q
            for q in self.places
            if (q.role in roles or (shared and q.shared)) and set(needs) <= set(q.signals)
        )

    def with_level(self, place: Place) -> Place:
        """Return a place with the level of the store that it alone changes."""
        level = self.ports.of(place.store)
        return place.with_signal("level", level)

    def arriving(self, place: Place) -> tuple[Local, ...]:
        """Return the levels of other stores that enter what fills a store at once."""
        value, own = self.ports.value_at(place), place.level.source
        levels = dict.fromkeys(
            q.level.source for q in self.fitting(*FLOWS, needs=("level",)) if q.level.source != own
        )
        return tuple(
            self.ports.of(name)
            for name in levels
            if name in self.ports.state_index
            and ca.depends_on(value, self.trace.x[self.ports.state_index[name]])
        )

    def beside(self, place: Place) -> tuple[Local, ...]:
        """Return what other sensors read that the one of a place is not meant to read.

        Not the rate of what it reads, nor that of which it reads the rate: those are a delay.
        """
        value, own = self.ports.value_at(place), self.ports.symbols
        seen = [n for n in self.ports.state_index if ca.depends_on(value, own[n])]
        near = {*seen, *(self.ports.integral.get(n, n) for n in seen)} | {
            q.name for q in self.model.inputs
        }
        recorded = [
            self.ports.measured[q.name] for q in self._outputs if q.name in self.ports.measured
        ]
        return tuple(
            self.ports.of(n)
            for n in dict.fromkeys(recorded)
            if n in self.ports.state_index and not near & {n, self.ports.integral.get(n, n)}
        )

    def causes(self, place: Place) -> tuple[Local, ...]:
        """Return the inputs that enter the signal of a place at once."""
        entered = self.ports.entered[self.ports.port_index[place.name]]
        entering = zip(self.model.inputs, entered, strict=True)
        return tuple(self.ports.of(q.name) for q, enters in entering if enters)

    def drives(self, place: Place) -> tuple[Local, ...]:
        """Return the inputs that enter the signal of a place, or states by which they do late.

        Those follow an input, such as the thrust of a rotor, and nothing that moves with the place.
        """
        if causes := self.causes(place):
            return causes
        value, known = self.ports.value_at(place), self.ports.symbols
        near = {own.source for own in place.signals.values()}
        late = [
            name
            for name, i in self.ports.state_index.items()
            if ca.depends_on(value, known[name])
            and ca.depends_on(self.trace.rates[i], self.trace.u)
            and not near
            & {n for n, own in known.items() if ca.depends_on(self.trace.rates[i], own)}
        ]
        return tuple(self.ports.of(name) for name in late)

    def read_too(self, place: Place) -> tuple[Local, ...]:
        """Return the state of which alone a sensor reads a function, if another one reads it."""
        read = [self.ports.measured.get(q.name) for q in self._outputs if q != place.output]
        value, known = self.ports.value_at(place), self.ports.symbols
        seen = [n for n, own in known.items() if ca.depends_on(value, own)]
        return (self.ports.of(seen[0]),) if len(seen) == 1 and seen[0] in read else ()

    @cached_property
    def inputs_alone(self) -> tuple[Place, ...]:
        """Inputs that enter the equations through one port alone, beside other signals there.

        Each is that port as its cause alone is seen there, with its unit, scale and range, and with
        the speed that it raises.
        """
        t, found = self.trace, []
        for k, q in enumerate(self.model.inputs):
            at = [i for i, entered in enumerate(self.ports.entered) if entered[k]]
            if len(at) != 1 or at[0] in self.ports.commanded:
                continue
            slope = ca.jacobian(self.ports.value(at[0]), t.u[k])
            whole = ca.jacobian(ca.vertcat(t.rates, t.outputs), t.u[k])
            if not same(
                self.ports.sampled(self.ports.by_port[:, at[0]] * slope), self.ports.sampled(whole)
            ):
                continue
            cause, port = self.ports.of(q.name), t.ports[at[0]]
            signals, sign = {"cause": cause}, np.nanmedian(self.ports.sampled(slope))
            if speed := self.place(port.name).signals.get("speed"):
                signals["speed"] = speed.turned(float(sign))
            found.append(
                Place(
                    replace(port, unit=cause.unit, scale=cause.scale),
                    "command",
                    signals,
                    driven=True,
                    horizon=self.model.horizon,
                    recorded=self.recorded,
                    seen=cause.seen,
                )
            )
        return tuple(found)

    def inputs_alike(self, level: Local) -> tuple[Local, ...]:
        """Return the inputs in the unit of a level."""
        alike = [q.name for q in self.model.inputs if same_dimension(q.unit, level.unit)]
        return tuple(self.ports.of(name) for name in alike)

    @property
    def unused_inputs(self) -> tuple[Local, ...]:
        """Return the inputs that the equations do not use."""
        t, e = self.trace, ca.vertcat(self.trace.rates, self.trace.outputs)
        unused = (k for k in range(t.u.numel()) if not ca.depends_on(e, t.u[k]))
        return tuple(self.ports.of(self.model.inputs[k].name) for k in unused)

    def attached(self, equation: str) -> bool:
        """Tell whether an effect of that equation is part of the model."""
        return any(e.about.equation == equation for e in self.model.effects)

    def place(self, name: str) -> Place:
        """Return a port of the model as a place."""
        ports, ranges = self.ports, self.recorded.ranges
        check_choice(f"port of {self.model.name}", name, ports.port_index)
        index = ports.port_index[name]
        port, role = self.trace.ports[index], _role_of(ports, index)
        output = next((q for q in self._outputs if name == f"{q.name}.reading"), None)
        signals = {
            s: ports.local(port, s, o) for s, o in zip(port.signals, port.origins, strict=True)
        }
        shaped = muscle_signals(ports, index, signals) if role in _PULLS else {}
        signals |= shaped
        bodies = sum(q.name in ports.integral for q in ports.moved[index])
        shared = role == "command" and bodies > 1
        carried: dict[str, Local] = {}
        directed = elastic = True
        if role in EFFORTS or role == "command":
            moved, directed = directed_motion(ports, index, motion_of(ports, index, signals))
            signals |= moved | _bearing_loads(signals)
            carried = carried_motion(ports, index, moved)
            elastic = "coordinate" in moved and is_elastic(ports, index, moved["coordinate"])
        store, fills = "", 1.0
        if role in FLOWS:
            signals |= self._levels(index)
            store, fills = ports.alone(index)
        if output is not None and output.name in ports.measured:
            measured = ports.measured[output.name]
            signals.setdefault("measured", ports.of(measured))
            if measured in ports.state_index and measured not in ports.moving:
                signals["rate"] = ports.rate_of(measured)
        gains = tuple(q for q in self._entering[index] if _is_gain(ports, q, index))
        return Place(
            port, role, signals, any(ports.entered[index]), store=store, fills=fills,
            commanded=index in ports.commanded, shared=shared, shaped=bool(shaped),
            dry_declared=any(
                e.dry and name in e.ports and e.name not in self._found for e in self.model.effects
            ),
            dry=self._dry(index, signals), empty=ports.value(index).is_zero(), gains=gains,
            parameters=tuple(q for q in self._entering[index] if q not in gains),
            whole=ports.whole(index), elastic=(shared or role in EFFORTS) and elastic,
            between=role in EFFORTS and ports.between_bodies(index),
            directed=directed, output=output, horizon=self.model.horizon, recorded=self.recorded,
            seen=ranges.get(name), stands=ranges.get(end_of(name), (None,))[0],
            stride=self._stride(name, signals), terms=self._terms(port), carried=carried,
            usual=ports.weighing(index) if role in (*EFFORTS, *FLOWS) else {},
        )  # fmt: skip

    def _dry(self, index: int, signals: Mapping[str, Local]) -> bool:
        """Tell whether there is dry friction at a port, the author's or what was attached."""
        name, speed = self.trace.ports[index].name, signals.get("speed")
        if speed is None or any(e.dry and name in e.ports for e in self.model.effects):
            return speed is not None
        known = self.ports.state_index.get(speed.source)
        return known is None or reverses_over(self.ports.value(index), self.trace.x[known])

    def _levels(self, index: int) -> dict[str, Local]:
        """Return what a flow fills, what it empties, and what it fills from there."""
        ports, found = self.ports, {}
        moved, raised = ports.moved[index], ports.pushed[:, index] > 0.0
        if len(ports.filled[index]) == 1:
            found["level"] = ports.of(ports.filled[index][0].name)
        if head := ports.emptied(index):
            found["head"] = ports.of(head)
            filled = [q.name for q in moved if raised[ports.state_index[q.name]]]
            if len(filled) == 1 and len(moved) == 2:
                found["back"] = ports.of(filled[0])
        return found

    def _stride(self, name: str, signals: Mapping[str, Local]) -> float:
        """Return how much of a signal passes, or how far what it moves goes, until it repeats."""
        way = signals.get("coordinate")
        alone = way is not None and not way.minus
        return self.recorded.strides.get(way.source if way and alone else name, 0.0)

    def _terms(self, port: Port) -> float:
        """Return how far the largest term of a port's signal goes, if its author gives no size."""
        size, number = 0.0, 0
        if port.sized and port.name not in dict(self.model.traits.sizes):
            return size
        while (seen := self.recorded.ranges.get(term_of(port.name, number))) is not None:
            size, number = max(size, 0.5 * (seen[1] - seen[0])), number + 1
        return size

    @cached_property
    def _entering(self) -> list[list[Parameter]]:
        """Refitted parameters that each port alone brings into the equations."""
        t, ports = self.trace, self.ports
        found = [list[Parameter]() for _ in t.ports]
        for k, q in enumerate(self.model.parameters):
            if not q.fitted or q.name.partition(".")[0] in self._found:
                continue
            whole = ports.whole_slope(k)
            for i in range(len(t.ports)):
                slope = ca.jacobian(ports.value(i), t.p[k])
                if slope.is_zero() or not same(ports.sampled(ports.by_port[:, i] * slope), whole):
                    continue
                part = ports.sampled(slope * t.p[k])
                if np.nanmax(np.abs(part)) >= _VISIBLE * t.ports[i].scale:
                    found[i].append(q)
                break
        return found

    @cached_property
    def spread(self) -> list[tuple[Parameter, tuple[Place, ...]]]:
        """Refitted parameters of the plant that several ports bring into the equations.

        What one state gives another is part of the rates of both: a growth that a measurement shows
        as well comes in through those rates. What is made of a rate, as the voltage of a second
        winding is of that of the flux, comes in through that.
        """
        return self._through_several(fitted=True)

    @cached_property
    def fixed(self) -> list[tuple[Parameter, tuple[Place, ...]]]:
        """Parameters that are not refitted, as a drum's radius, and that several ports bring in.

        What enters through one port alone changes there as a gain does, or what it multiplies.
        """
        sensors = {f"{q.name}.reading" for q in self.model.outputs}
        found = self._through_several(fitted=False)
        return [(q, at) for q, at in found if not sensors & {place.name for place in at}]

    def _through_several(self, *, fitted: bool) -> list[tuple[Parameter, tuple[Place, ...]]]:
        t, ports, found = self.trace, self.ports, []
        taken = {q.name for of_port in self._entering for q in of_port}
        for k, q in enumerate(self.model.parameters):
            if q.fitted != fitted or q.name in taken or "." in q.name:
                continue
            slopes = [ca.jacobian(ports.value(i), t.p[k]) for i in range(len(t.ports))]
            at = [i for i, slope in enumerate(slopes) if not slope.is_zero()]
            rates = [i for i in at if not t.ports[i].name.endswith(".exchange")]
            own = [i for i in at if all(i == j or not self._reads(i, j) for j in at)]
            for sites in {tuple(some): None for some in (at, rates, own)}:
                if len(sites) > 1 and self._is_all(k, sites):
                    found.append((q, tuple(self.place(t.ports[i].name) for i in sites)))
                    break
        return found

    def passing(self, q: Parameter) -> tuple[Place, ...]:
        """Return what states give one another, where a parameter enters through that alone."""
        k, t = self.ports.parameter_index[q.name], self.trace
        sites = [
            i
            for i, port in enumerate(t.ports)
            if port.name.endswith(".exchange") and ca.depends_on(self.ports.value(i), t.p[k])
        ]
        if not sites or not self._is_all(k, sites):
            return ()
        return tuple(self.place(t.ports[i].name) for i in sites)

    def _is_all(self, k: int, sites: Sequence[int]) -> bool:
        """Tell whether a parameter brings into the equations what it does through some ports."""
        ports, t = self.ports, self.trace
        through = sum(ports.by_port[:, i] * ca.jacobian(ports.value(i), t.p[k]) for i in sites)
        return same(ports.sampled(through), ports.whole_slope(k))

    def _reads(self, index: int, other: int) -> bool:
        """Tell whether the port of a sensor reads what another port adds too."""
        name = self.trace.ports[index].name
        rows = [i for i, q in enumerate(self.model.outputs) if name == f"{q.name}.reading"]
        return any(not self.trace.outputs_by_port[i, other].is_zero() for i in rows)


def _is_gain(ports: Ports, q: Parameter, index: int) -> bool:
    """Tell whether a parameter is a mere gain of what is driven, which has laws of its own."""
    value, own = ports.value(index), ports.symbol_of(q)
    part = ports.sampled(ca.jacobian(value, own) * own)
    return any(ports.entered[index]) and same(part, ports.sampled(value))


def _bearing_loads(signals: Mapping[str, Local]) -> dict[str, Local]:
    """Find what loads a contact at a port: its forces, torques and pressures, by unit or name."""

    def loads(name: str, unit: str) -> bool:
        if unit != "1":
            return same_dimension(unit, "N", "N m", "Pa")
        return name.rstrip("_0123456789").endswith(("force", "load", "pressure"))

    found = [q for name, q in signals.items() if loads(name, q.unit)]
    return {f"bearing_load_{i + 1}": q for i, q in enumerate(found)}


def _role_of(ports: Ports, index: int) -> str:
    """Return the role of a port: as its author declared, else by name, unit or structure.

    A force drives the state whose integral is a state too, a flow drives a level. What drives a
    flow is the force on what flows: a pressure, or a head.
    """
    port = ports.trace.ports[index]
    if port.role:
        return port.role
    for ending, role in _ENDINGS.items():
        if port.name.endswith(ending):
            return role
    if "penetration" in port.signals:
        return "stop"
    if same_dimension(port.unit, "Pa", "m") and any(
        same_dimension(q.unit, *_ROLES["flow"]) for q in ports.moved[index]
    ):
        return "force"
    for role, units in _ROLES.items():
        if same_dimension(port.unit, *units):
            circuit = role == "voltage" and any(map(ports.is_current, ports.moved[index]))
            return "circuit" if circuit else role
    for state in ports.moved[index]:
        if same_dimension(port.unit, per(state.unit, "s")):
            if state.unit == "A":
                # What changes a current is a voltage over a coil.
                return "circuit"
            fast = state.name in ports.integral or state.unit.endswith("/s")
            return "acceleration" if fast else "flow"
    if port.name.endswith(".flow"):
        return "flow"
    # A drive of a model per unit has none that says what it is.
    return "command" if index in ports.commanded else ""
