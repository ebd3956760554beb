"""Places: ports of a model with their role, and the speed, coordinate or level found there.

What a port is good for follows from what its author declared, else from its unit, else from the
structure of the equations: a force drives the state whose integral is a state too, a flow drives a
level. No name of a state or signal is needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from workbench.errors import check_choice
from workbench.model import Model, Output, Port, State
from workbench.model.quantities import Quantity
from workbench.model.units import same_dimension

EFFORTS = ("force", "acceleration", "circuit")
"""Roles of ports that drive a speed: of a body, or the current of a circuit."""

DRIVES = ("command", "voltage", "circuit", "current")
"""Roles of signals that a drive or amplifier gives."""

FLOWS = ("flow", "heat", "current")
"""Roles of ports that fill a store: with matter, heat or charge."""

COORDINATES = {"N m": "rad", "N": "m", "V": "A s", "m/s2": "m", "rad/s2": "rad"}
"""Unit of what an effort moves, where the model does not tell."""

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


def per(unit: str, divisor: str, power: int = 1) -> str:
    """Return the unit of a quantity per power of another one.

    Example:
        >>> per("N", "m", 3), per("N m", "rad/s"), per("N", "m/s", 2), per("V/s", "V")
        ('N/m3', 'N m s/rad', 'N s2/m2', 'V/(s V)')
    """
    top, _, bottom = divisor.partition("/")
    exponent = str(power) if power > 1 else ""
    above, _, below = unit.partition("/")
    if bottom:
        above = f"{above} {bottom}{exponent}" if above != "1" else f"{bottom}{exponent}"
    if top in ("", "1"):
        return f"{above}/{below}" if below else above
    if not below:
        return f"{above}/{top}{exponent}"
    return f"{above}/({below.strip('()')} {top}{exponent})"


@dataclass(frozen=True)
class Local:
    """A signal that a law sees at a place.

    Args:
        source: Name of the port's local signal, or of the state or input that it is.
        unit: SI unit.
        scale: Typical size, in ``unit``.
        lower: Lower end of its range, in ``unit``; minus infinity if it is not known.
        upper: Upper end of its range, in ``unit``.
        start: Usual value at the start of a run, in ``unit``.
    """

    source: str
    unit: str
    scale: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf
    start: float = 0.0


@dataclass(frozen=True)
class Place:
    """A port as a law sees it.

    Args:
        port: The port.
        role: What its signal does.
        signals: The signals that a law may use, by the name that laws give them: the port's own,
            ``speed`` and ``coordinate`` of what an effort drives, ``level`` of what a flow fills,
            ``bearing_load_1``... of what loads a contact, ``measured`` of what a sensor reads.
        driven: Whether an input of the model reaches the signal at once.
        output: The output of a measurement.
        others: The further ports on which the same effect acts.
    """

    port: Port
    role: str
    signals: Mapping[str, Local] = field(default_factory=dict)
    driven: bool = False
    output: Output | None = None
    others: tuple[Place, ...] = ()

    @property
    def name(self) -> str:
        """Name of the port."""
        return self.port.name

    @property
    def unit(self) -> str:
        """Unit of the signal."""
        return self.port.unit

    @property
    def scale(self) -> float:
        """Typical size of the signal, in its unit."""
        return self.output.scale if self.output else self.port.scale

    @property
    def speed(self) -> Local:
        """The speed of what moves."""
        return self.signals.get("speed") or Local("speed", f"{self._coordinate_unit}/s")

    @property
    def coordinate(self) -> Local:
        """The position of what moves."""
        return self.signals.get("coordinate") or Local("coordinate", self._coordinate_unit)

    @property
    def level(self) -> Local:
        """What a store holds."""
        return self.signals.get("level") or Local("level", "1")

    @property
    def travel(self) -> tuple[float, float]:
        """Ends of the travel, in the unit of the coordinate."""
        at = self.coordinate
        lower = at.lower if math.isfinite(at.lower) else -at.scale
        return lower, at.upper if math.isfinite(at.upper) else at.scale

    @property
    def middle(self) -> float:
        """Middle of the travel, in the unit of the coordinate."""
        return 0.5 * sum(self.travel)

    @property
    def _coordinate_unit(self) -> str:
        return next((c for u, c in COORDINATES.items() if same_dimension(u, self.unit)), "1")


class Survey:
    """Everything about a model that decides which laws may act where.

    Args:
        model: The model.
        outputs: Names of the outputs that are recorded; all by default.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> place = Survey(servo_axis()).place("axis.force")
        >>> place.role, place.speed.unit, place.coordinate.source
        ('force', 'm/s', 'position')
    """

    def __init__(self, model: Model, outputs: tuple[str, ...] | None = None) -> None:
        self.model, self.trace = model, model.exact
        self._recorded = [q for q in model.outputs if outputs is None or q.name in outputs]
        self._known: dict[str, Quantity] = {
            q.name: q for q in (*model.parameters, *model.inputs, *model.states)
        }

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """Every port as a place; sensors of outputs that are not recorded apart."""
        found = (self.place(q.name) for q in self.trace.ports)
        unrecorded = {q.name for q in self.model.outputs} - {q.name for q in self._recorded}
        return tuple(
            q
            for q in found
            if q.role != "measurement" or q.name.removesuffix(".reading") not in unrecorded
        )

    def fitting(self, *roles: str, needs: tuple[str, ...] = ()) -> tuple[Place, ...]:
        """Return the places of some roles at which some signals can be had."""
        return tuple(q for q in self.places if q.role in roles and set(needs) <= set(q.signals))

    def attached(self, equation: str) -> bool:
        """Tell whether an effect of that equation is part of the model."""
        return any(e.about.equation == equation for e in self.model.effects)

    def place(self, name: str) -> Place:
        """Return a port of the model as a place.

        Raises:
            WorkbenchError: If there is no such port.
        """
        check_choice(f"port of {self.model.name}", name, [q.name for q in self.trace.ports])
        index = next(i for i, q in enumerate(self.trace.ports) if q.name == name)
        port = self.trace.ports[index]
        role = self._role(port, index)
        output = next((q for q in self._recorded if name == f"{q.name}.reading"), None)
        signals = {
            s: self._local(port, s, o) for s, o in zip(port.signals, port.origins, strict=True)
        }
        if role in EFFORTS:
            signals |= self._motion(port, index, signals) | _bearing_loads(signals)
        elif role in FLOWS:
            stores = self._filled[index]
            if len(stores) == 1:
                signals.setdefault("level", self._of(stores[0].name))
        if output is not None and output.name in self._measured:
            signals.setdefault("measured", self._of(self._measured[output.name]))
        return Place(port, role, signals, self._reached[index], output)

    def _role(self, port: Port, index: int) -> str:
        if port.role:
            return port.role
        for ending, role in _ENDINGS.items():
            if port.name.endswith(ending):
                return role
        if "penetration" in port.signals:
            return "stop"
        for role, units in _ROLES.items():
            if any(same_dimension(port.unit, unit) for unit in units):
                circuit = role == "voltage" and any(map(self._is_current, self._moved[index]))
                return "circuit" if circuit else role
        for state in self._moved[index]:
            if same_dimension(port.unit, per(state.unit, "s")):
                return "acceleration" if state.name in self._integral else "flow"
        return "flow" if port.name.endswith(".flow") else ""

    def _motion(self, port: Port, index: int, own: Mapping[str, Local]) -> dict[str, Local]:
        """Find what an effort moves: by the author's names, by what they are, by structure."""
        unit = next((c for u, c in COORDINATES.items() if same_dimension(u, port.unit)), "1")
        origins = dict(zip(port.signals, port.origins, strict=True))
        speeds: list[str] = [s for s in origins if s in ("speed", "velocity")]
        speeds += [s for s, o in origins.items() if o in self._integral and s not in speeds]
        speeds += [s for s in origins if s.endswith(("_speed", "_velocity")) and s not in speeds]
        moved = [q.name for q in self._moved[index] if self._is_speed(q, unit)]
        found: dict[str, Local] = {}
        place = ""
        if speeds:
            found["speed"] = self._local(port, speeds[0], origins[speeds[0]], f"{unit}/s")
            place = self._integral.get(origins[speeds[0]], "")
        elif moved:
            found["speed"] = self._of(moved[0])
            place = self._integral.get(moved[0], "")
        named = [s for s in origins if s in ("coordinate", "angle", "position")]
        named += [s for s, o in origins.items() if place and o == place]
        if named:
            found["coordinate"] = self._local(port, named[0], origins[named[0]], unit)
        elif place:
            found["coordinate"] = self._of(place)
        return found

    def _is_current(self, state: State) -> bool:
        # A motor without inductance: its voltage is a torque, which has a port of its own.
        mechanical = any(same_dimension(state.unit, u) for u in ("m/s", "rad/s"))
        return not mechanical and (state.name in self._integral or state.unit == "A")

    def _is_speed(self, state: State, unit: str) -> bool:
        return state.name in self._integral or same_dimension(state.unit, f"{unit}/s")

    def _of(self, name: str) -> Local:
        q = self._known[name]
        lower, upper = getattr(q, "lower", -math.inf), getattr(q, "upper", math.inf)
        start = getattr(q, "initial", getattr(q, "nominal", 0.0))
        return Local(name, q.unit, q.scale, lower, upper, start)

    def _local(self, port: Port, signal: str, origin: str, unit: str = "") -> Local:
        """Return a local signal with what is known of it; by its unit where it is no state."""
        if origin in self._known:
            of = self._of(origin)
            # A prescribed signal of a test bench has no unit of its own.
            own = of.unit if of.unit != "1" or not unit else unit
            return Local(signal, own, of.scale, of.lower, of.upper, of.start)
        own = self.trace.signal_units[self.trace.signal_names.index(origin)] if origin else unit
        alike = next((q for q in self.model.states if own and q.unit == own), None)
        if alike is None:
            return Local(signal, own or "1")
        return Local(signal, own, alike.scale, alike.lower, alike.upper, alike.initial)

    @cached_property
    def _integral(self) -> dict[str, str]:
        """Name of the state whose rate is a state, by the name of that."""
        names = [q.name for q in self.model.states]
        found: dict[str, str] = {}
        for i, name in enumerate(names):
            for j, speed in enumerate(names):
                if ca.is_equal(self.trace.rates[i], self.trace.x[j], 3) and "." not in name:
                    found.setdefault(speed, name)
        return found

    @cached_property
    def _measured(self) -> dict[str, str]:
        """Name of the state that each output measures, by the output's name."""
        found: dict[str, str] = {}
        for i, output in enumerate(self.model.outputs):
            for j, state in enumerate(self.model.states):
                if ca.is_equal(self.trace.outputs[i], self.trace.x[j], 3):
                    found[output.name] = state.name
        return {q.name: q.name for q in self.model.outputs if q.name in self._known} | found

    @cached_property
    def _moved(self) -> tuple[tuple[State, ...], ...]:
        """States of the plant whose rates the signal of each port enters at once."""
        matrix = self.trace.rates_by_port
        own = [(i, q) for i, q in enumerate(self.model.states) if "." not in q.name]
        return tuple(
            tuple(q for i, q in own if not matrix[i, j].is_zero())
            for j in range(len(self.trace.ports))
        )

    @cached_property
    def _filled(self) -> tuple[tuple[State, ...], ...]:
        """States that each port fills: those it moves, if more of it raises every one of them."""
        matrix = self.trace.function("by_port", self.trace.rates_by_port)
        x, u = self.model.initial_state(), self.model.nominal_input
        at = np.asarray(matrix(x, u, self.model.values))
        names = [q.name for q in self.model.states]
        return tuple(
            moved if all(at[names.index(q.name), j] > 0 for q in moved) else ()
            for j, moved in enumerate(self._moved)
        )

    @cached_property
    def _reached(self) -> tuple[bool, ...]:
        """Whether an input enters the signal of each port at once."""
        index = [self.trace.signal_names.index(q.name) for q in self.trace.ports]
        if not index:
            return ()
        slope = ca.jacobian(self.trace.signals[index], self.trace.u)
        return tuple(not slope[i, :].is_zero() for i in range(len(index)))


def _bearing_loads(signals: Mapping[str, Local]) -> dict[str, Local]:
    """Find what loads a contact at a port: its forces, torques and pressures, by unit or name."""

    def loads(name: str, unit: str) -> bool:
        if unit != "1":
            return any(same_dimension(unit, u) for u in ("N", "N m", "Pa"))
        return name.rstrip("_0123456789").endswith(("force", "load", "pressure"))

    found = [q for name, q in signals.items() if loads(name, q.unit)]
    return {f"bearing_load_{i + 1}": q for i, q in enumerate(found)}


def unknown_place(name: str) -> Place:
    """Return a place of which nothing but the name is known yet."""
    return Place(Port(name, "1", 1.0, "", ()), "")


def numbered(places: tuple[Place, ...]) -> Iterator[tuple[str, Place]]:
    """Yield places with the number that their group's name ends on."""
    for place in places:
        yield place.port.group.rpartition("_")[2], place
