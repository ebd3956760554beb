"""Places: ports of a model with their role, and the speed, coordinate or level found there.

What a port is good for follows from what its author declared, else from its unit, else from the
structure of the equations: a force drives the state whose integral is a state too, a flow drives a
level. No name of a state or signal is needed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, permutations

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.errors import check_choice
from workbench.model import Model, Output, Parameter, Port, State
from workbench.model.expressions import cofactor, weight
from workbench.model.quantities import Quantity
from workbench.model.regularisation import Expression
from workbench.model.units import powers, same_dimension

EFFORTS = ("force", "acceleration", "circuit")
"""Roles of ports that drive a speed: of a body, or the current of a circuit."""

RESISTED = (*EFFORTS, "shared command")
"""Roles of places where something may resist a motion: also a command that sets several bodies in
motion at once, such as the force on the trolley of a crane. What rubs there acts on all of them."""

DRIVES = ("command", "voltage", "circuit", "current")
"""Roles of signals that a drive or amplifier gives."""

FLOWS = ("flow", "heat", "current")
"""Roles of ports that fill a store: with matter, heat or charge."""

COORDINATES = {"N m": "rad", "N": "m", "V": "A s", "m/s2": "m", "rad/s2": "rad"}
"""Unit of what an effort moves, where the model does not tell."""

_STEADY = 0.2
"""Part of its middle by which a push on a body may change with where the plant is, to be one."""

_VISIBLE = 0.02
"""Part of a port's scale that a parameter must bring in to be offered a change with time."""

_DAMPINGS, _SPEEDS = ("N s/m", "N m s/rad"), ("m/s", "rad/s")

_RESISTANCES = ("ohm", "S", *_DAMPINGS, "Pa s/m3", "m3/(s Pa)")
"""Units of parameters that make heat of what they multiply, or divide."""

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


def argument_of(parameter: str) -> str:
    """Return the name under which the range of what a parameter multiplies is kept."""
    return f"argument of {parameter}"


def term_of(port: str, number: int) -> str:
    """Return the name under which the range of one term of a port's signal is kept."""
    return f"term {number} of {port}"


def end_of(port: str) -> str:
    """Return the name under which the end is kept at which a sensor was seen to stand."""
    return f"end of {port}"


def per(unit: str, divisor: str, power: float = 1) -> str:
    """Return the unit of a quantity per power of another one.

    Example:
        >>> per("N", "m", 3), per("N m", "rad/s"), per("m/s2", "m/s", 2), per("V/s", "V")
        ('N/m3', 'N m s/rad', '1/m', '1/s')
        >>> per("m3/s", "Pa", 0.5)
        'm3/(s Pa^0.5)'
    """
    total: dict[str, float] = {}
    for text, sign in ((unit, 1), (divisor, -power)):
        for symbol, exponent in powers(text):
            if symbol not in ("1", "-"):
                total[symbol] = total.get(symbol, 0) + sign * exponent

    def raised(name: str, power: float) -> str:
        whole = power == round(power)
        return name if power == 1 else f"{name}{power:.0f}" if whole else f"{name}^{power:g}"

    over, under = (
        [raised(n, abs(e)) for n, e in total.items() if sign * e > 0] for sign in (1, -1)
    )
    divided = f"({' '.join(under)})" if len(under) > 1 else "".join(under)
    return (" ".join(over) or "1") + (f"/{divided}" if divided else "")


Points = list[tuple[Vector, Vector, Vector]]
"""States, inputs and parameters at which expressions are compared."""


@dataclass(frozen=True)
class Local:
    """A signal that a law sees at a place.

    Args:
        source: Name of the port's local signal, or of the state or input that it is.
        scale: Typical size, in ``unit``.
        lower: Lower end of its range, in ``unit``; minus infinity if it is not known.
        upper: Upper end of its range, in ``unit``.
        start: Usual value at the start of a run, in ``unit``.
        seen: Smallest and largest value along the recordings, in ``unit``; None if not known.
        minus: Name of a state that is subtracted: the place or speed of one body over another.
        ratio: Factor of the source before that, in ``unit`` per unit of the source: of a gear,
            lever or drum.
        sign: 1, or -1 where the signal of the port counts the other way, dimensionless.
        multiplied: Whether it is what the parameter that changes multiplies, of which there is no
            other name.
    """

    source: str
    unit: str
    scale: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf
    start: float = 0.0
    seen: tuple[float, float] | None = None
    minus: str = ""
    ratio: float = 1.0
    sign: float = 1.0
    multiplied: bool = False

    @property
    def largest(self) -> float:
        """Largest magnitude that was seen, in ``unit``; the typical size if none was."""
        return _largest(self.seen) or self.scale

    @property
    def apart(self) -> str:
        """Name under which the range of a difference of two states is kept."""
        return f"{self.ratio:.9g} {self.source} - {self.minus}"

    def geared(self, ratio: float, unit: str) -> Local:
        """Return the signal times a positive ratio, in another unit."""
        seen = self.seen and (ratio * self.seen[0], ratio * self.seen[1])
        return replace(
            self, unit=unit, scale=ratio * self.scale, lower=ratio * self.lower,
            upper=ratio * self.upper, start=ratio * self.start, seen=seen, ratio=ratio,
        )  # fmt: skip

    def turned(self, sign: float) -> Local:
        """Return the signal as it is counted the other way, if the sign (a factor) is negative."""
        if sign >= 0.0:
            return self
        seen = self.seen and (-self.seen[1], -self.seen[0])
        return replace(
            self, sign=-self.sign, lower=-self.upper, upper=-self.lower, start=-self.start,
            seen=seen,
        )  # fmt: skip

    def value(self, own: Mapping[str, Expression], known: Mapping[str, Expression]) -> Expression:
        """Return the signal, in ``unit``.

        Args:
            own: Local signals of the port, by name, in SI.
            known: States and inputs of the model, by name, in SI.
        """
        value = own[self.source] if self.source in own else known[self.source]
        if self.ratio != 1.0:
            value = self.ratio * value
        if self.minus:
            value = value - known[self.minus]
        return value if self.sign == 1.0 else self.sign * value


def _coordinate_unit(effort: str) -> str:
    return next((c for u, c in COORDINATES.items() if same_dimension(u, effort)), "1")


def _largest(seen: tuple[float, float] | None) -> float:
    """Return the largest magnitude that was seen; 0 if none was."""
    return max(abs(seen[0]), abs(seen[1])) if seen else 0.0


@dataclass(frozen=True)
class Place:
    """A port as a law sees it.

    Args:
        signals: The signals that a law may use, by the name that laws give them: the port's own,
            ``speed`` and ``coordinate`` of what an effort drives, positive where more of the
            signal raises the speed, ``level`` of what a flow fills, ``head`` of what it empties,
            ``back`` of what it fills from there, ``bearing_load_1``... of what loads a contact,
            ``contraction`` and ``gauge_pressure`` of a muscle, ``measured`` of what a sensor reads.
        driven: Whether an input of the model reaches the signal at once.
        commanded: Whether it follows from inputs alone.
        shared: Whether it is a command that sets several bodies in motion at once.
        rubbed: Whether dry friction is attached to it that was not missing at first.
        empty: Whether nothing passes there unless an effect adds it.
        whole: Whether the rate of what it drives or fills is proportional to the signal.
        elastic: Whether the signal is a straight line over the coordinate.
        between: Whether it acts between bodies: more of it drives one on and another one back.
        store: The store whose level the signal changes, and nothing else; empty if there is none.
        fills: 1 if more of it fills that store, -1 if it empties it; dimensionless.
        directed: Whether it is known which way the signal counts beside the speed.
        shaped: Whether contraction and pressure of a muscle enter the signal as they stand.
        parameters: Refitted parameters that enter the equations through this port alone, and are
            more than a gain of what is driven.
        gains: Those that are such a gain.
        others: The further ports on which the same effect acts.
        horizon: Time in which the response of the model shows, in s.
        duration: Length of the recordings, in s; 0 if it is not known.
        sample_time: Sampling interval of the recordings, in s; 0 if it is not known.
        seen: Smallest and largest value along the recordings, in its unit; None if not known.
        stands: Value at which a sensor stands as only one does that goes no further, in its unit;
            None if it does not.
        period: Period with which something repeats that nobody read, in s; 0 if nothing does.
        episode: From when to when most of what nobody read acts, in s; None if it always may.
        stride: How much of the signal passes, in its unit times s, or how far goes what it moves,
            until something repeats that goes with it; 0 if nothing does.
        terms: How far the terms that add up to the signal, and may balance, go along recordings:
            half of the range of the largest one, in its unit; 0 if a size is declared.
        usual: States and inputs at the start, by name, in SI, where they change what the signal is
            divided by as a whole, such as an inertia that depends on where a machine is.
        carried: ``speed`` and ``coordinate`` over what carries a body, where an input moves that;
            ``speed`` alone over an input that takes part of what passes, where the rest fills.
    """

    port: Port
    role: str
    signals: Mapping[str, Local] = field(default_factory=dict)
    driven: bool = False
    commanded: bool = False
    shared: bool = False
    rubbed: bool = False
    empty: bool = False
    whole: bool = False
    elastic: bool = False
    between: bool = False
    store: str = ""
    fills: float = 1.0
    directed: bool = True
    shaped: bool = False
    parameters: tuple[Parameter, ...] = ()
    gains: tuple[Parameter, ...] = ()
    output: Output | None = None
    others: tuple[Place, ...] = ()
    horizon: float = 1.0
    duration: float = 0.0
    sample_time: float = 0.0
    period: float = 0.0
    episode: tuple[float, float] | None = None
    stride: float = 0.0
    seen: tuple[float, float] | None = None
    stands: float | None = None
    terms: float = 0.0
    usual: Mapping[str, float] = field(default_factory=dict)
    carried: Mapping[str, Local] = field(default_factory=dict)

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
        """Typical size of the signal, in its unit; what was seen of it if none is declared."""
        if self.output is not None:
            return self.output.scale
        own = self.port.scale if self.port.sized else _largest(self.seen) or self.port.scale
        return max(own, self.terms)

    @property
    def interval(self) -> float:
        """Sampling interval, in s; fine for the model where it is not known."""
        return self.sample_time or self.horizon / 500.0

    @property
    def lasting(self) -> float:
        """Length of the recordings, in s; long for the model where it is not known."""
        return self.duration or 20.0 * self.horizon

    def with_signal(self, name: str, other: Local) -> Place:
        """Return the place with a signal of elsewhere beside its own, by the name of a law."""
        return replace(self, signals={**self.signals, name: other})

    def other(self, name: str) -> Local:
        """Return a signal of elsewhere by the name of a law; dimensionless where there is none."""
        return self.signals.get(name, Local(name, "1"))

    @property
    def speed(self) -> Local:
        """The speed of what moves."""
        return self.signals.get("speed") or Local("speed", f"{_coordinate_unit(self.unit)}/s")

    @property
    def coordinate(self) -> Local:
        """The position of what moves."""
        return self.signals.get("coordinate") or Local("coordinate", _coordinate_unit(self.unit))

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


class Survey:
    """Everything about a model that decides which laws may act where.

    Args:
        outputs: Names of the outputs that are recorded; all by default.
        duration: Length of the recordings, in s; 0 if it is not known.
        sample_time: Sampling interval of the recordings, in s; 0 if it is not known.
        period: Period with which something repeats that nobody read, in s; 0 if nothing does.
        episode: From when to when most of what nobody read acts, in s; None if it always may.
        held: Whether only a loop can have held the machine, whose commands follow measurements.
        strides: The same by commands: how much of one passes meanwhile, in its unit times s, by
            port; and by what is moved: how far it goes, by state.
        ranges: Smallest and largest value along the recordings of ports and states, by name, and
            of differences of two states, in SI; of a sensor that stands at an end, that value
            twice.
        found: Names of attached effects whose parameters are not offered a change with time.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> place = Survey(servo_axis()).place("axis.force")
        >>> place.role, place.speed.unit, place.coordinate.source
        ('force', 'm/s', 'position')
    """

    def __init__(
        self,
        model: Model,
        outputs: tuple[str, ...] | None = None,
        *,
        duration: float = 0.0,
        sample_time: float = 0.0,
        period: float = 0.0,
        episode: tuple[float, float] | None = None,
        held: bool = False,
        strides: Mapping[str, float] | None = None,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        found: Collection[str] = (),
    ) -> None:
        self.model, self.trace, self._found = model, model.exact, found
        self.ranges, self.period, self.strides = ranges or {}, period, strides or {}
        self.episode, self.held = episode, held
        # A recording that is to be refused later may have no sensible time base.
        self.duration = duration if 0.0 < duration < math.inf else 0.0
        self.sample_time = sample_time if 0.0 < sample_time < math.inf else 0.0
        self._recorded = [q for q in model.outputs if outputs is None or q.name in outputs]
        self._known: dict[str, Quantity] = {
            q.name: q for q in (*model.parameters, *model.inputs, *model.states)
        }
        self._port_index = {q.name: i for i, q in enumerate(self.trace.ports)}
        self._state_index = {q.name: i for i, q in enumerate(model.states)}
        self._parameter_index = {q.name: i for i, q in enumerate(model.parameters)}

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
        shared = "shared command" in roles
        return tuple(
            q
            for q in self.places
            if (q.role in roles or (shared and q.shared)) and set(needs) <= set(q.signals)
        )

    def with_level(self, place: Place) -> Place:
        """Return a place with the level of the store that it alone changes."""
        level = self._of(place.store)
        return place.with_signal("level", level)

    def arriving(self, place: Place) -> tuple[Local, ...]:
        """Return the levels of other stores that enter what fills a store at once."""
        value, own = self._signal(place), place.level.source
        levels = dict.fromkeys(
            q.level.source for q in self.fitting(*FLOWS, needs=("level",)) if q.level.source != own
        )
        return tuple(
            self._of(name)
            for name in levels
            if name in self._state_index
            and ca.depends_on(value, self.trace.x[self._state_index[name]])
        )

    def input(self, name: str) -> Local:
        """Return an input as a law sees it."""
        return self._of(name)

    def beside(self, place: Place) -> tuple[Local, ...]:
        """Return what other sensors read that the one of a place is not meant to read.

        Not the rate of what it reads, nor that of which it reads the rate: those are a delay.
        """
        value, own = self._signal(place), self._symbols
        seen = [n for n in self._state_index if ca.depends_on(value, own[n])]
        near = {*seen, *(self._integral.get(n, n) for n in seen)} | {
            q.name for q in self.model.inputs
        }
        recorded = [self._measured[q.name] for q in self._recorded if q.name in self._measured]
        return tuple(
            self._of(n)
            for n in dict.fromkeys(recorded)
            if n in self._state_index and not near & {n, self._integral.get(n, n)}
        )

    def causes(self, place: Place) -> tuple[Local, ...]:
        """Return the inputs that enter the signal of a place at once."""
        entered = self._entered[self._port_index[place.name]]
        entering = zip(self.model.inputs, entered, strict=True)
        return tuple(self._of(q.name) for q, enters in entering if enters)

    @cached_property
    def inputs_alone(self) -> tuple[Place, ...]:
        """Inputs that enter the equations through one port alone, beside other signals there.

        Each is that port as its cause alone is seen there, with its unit, scale and range.
        """
        t, found = self.trace, []
        for k, q in enumerate(self.model.inputs):
            at = [i for i, entered in enumerate(self._entered) if entered[k]]
            if len(at) != 1 or at[0] in self._commanded:
                continue
            slope = ca.jacobian(self._port_value(at[0]), t.u[k])
            whole = ca.jacobian(ca.vertcat(t.rates, t.outputs), t.u[k])
            if not _same(self._sampled(self._by_port[:, at[0]] * slope), self._sampled(whole)):
                continue
            cause, port = self._of(q.name), t.ports[at[0]]
            found.append(
                Place(
                    replace(port, unit=cause.unit, scale=cause.scale),
                    "command",
                    {"cause": cause},
                    driven=True,
                    horizon=self.model.horizon,
                    duration=self.duration,
                    sample_time=self.sample_time,
                    seen=cause.seen,
                )
            )
        return tuple(found)

    def inputs_alike(self, level: Local) -> tuple[Local, ...]:
        """Return the inputs in the unit of a level."""
        alike = [q.name for q in self.model.inputs if same_dimension(q.unit, level.unit)]
        return tuple(self._of(name) for name in alike)

    @property
    def unused_inputs(self) -> tuple[Local, ...]:
        """Return the inputs that the equations do not use."""
        t, e = self.trace, ca.vertcat(self.trace.rates, self.trace.outputs)
        unused = (k for k in range(t.u.numel()) if not ca.depends_on(e, t.u[k]))
        return tuple(self._of(self.model.inputs[k].name) for k in unused)

    def attached(self, equation: str) -> bool:
        """Tell whether an effect of that equation is part of the model."""
        return any(e.about.equation == equation for e in self.model.effects)

    def place(self, name: str) -> Place:
        """Return a port of the model as a place."""
        check_choice(f"port of {self.model.name}", name, self._port_index)
        index = self._port_index[name]
        port = self.trace.ports[index]
        role = self._role(port, index)
        output = next((q for q in self._recorded if name == f"{q.name}.reading"), None)
        signals = {
            s: self._local(port, s, o) for s, o in zip(port.signals, port.origins, strict=True)
        }
        carried: dict[str, Local] = {}
        directed = elastic = True
        pressed = self._pressed(port, index) if role in ("force", "muscle_tension") else {}
        signals |= pressed
        shared = role == "command" and sum(q.name in self._integral for q in self._moved[index]) > 1
        if role in EFFORTS or shared:
            motion, directed = self._directed(index, self._motion(port, index, signals))
            signals |= motion | _bearing_loads(signals)
            carried = self._carried(index, motion)
            elastic = "coordinate" in motion and self._elastic(index, motion["coordinate"])
        elif role in FLOWS:
            stores = self._filled[index]
            if len(stores) == 1:
                signals["level"] = self._of(stores[0].name)
            if head := self._emptied(index):
                signals["head"] = self._of(head)
                raised = {n for n, i in self._state_index.items() if self._pushed[i, index] > 0.0}
                filled = [q for q in self._moved[index] if q.name in raised]
                if len(filled) == 1 and len(self._moved[index]) == 2:
                    signals["back"] = self._of(filled[0].name)
        if output is not None and output.name in self._measured:
            signals.setdefault("measured", self._of(self._measured[output.name]))
        alone, fills = self._alone(index) if role in FLOWS else ("", 1.0)
        return Place(
            port, role, signals, any(self._entered[index]), store=alone, fills=fills,
            commanded=index in self._commanded, shared=shared, shaped=bool(pressed),
            rubbed=any(
                e.dry and name in e.ports and e.name not in self._found for e in self.model.effects
            ),
            empty=self._port_value(index).is_zero(),
            parameters=tuple(q for q in self._entering[index] if not self._is_gain(q, index)),
            gains=tuple(q for q in self._entering[index] if self._is_gain(q, index)),
            whole=self._whole(index), elastic=(shared or role in EFFORTS) and elastic,
            between=role in EFFORTS and self._between_bodies(index),
            directed=directed, output=output, horizon=self.model.horizon, duration=self.duration,
            sample_time=self.sample_time, period=self.period, episode=self.episode,
            seen=self.ranges.get(name), stands=self.ranges.get(end_of(name), (None,))[0],
            stride=self._stride(name, signals), terms=self._terms(port), carried=carried,
            usual=self._weighing(index) if role in (*EFFORTS, *FLOWS) else {},
        )  # fmt: skip

    def _stride(self, name: str, signals: Mapping[str, Local]) -> float:
        """Return how much of a signal passes, or how far what it moves goes, until it repeats."""
        way = signals.get("coordinate")
        alone = way is not None and not way.minus
        return self.strides.get(way.source if way and alone else name, 0.0)

    def _weighing(self, index: int) -> dict[str, float]:
        """Return the start of what changes the divisor of a port's whole signal."""
        t, m = self.trace, self.model
        found = weight(ca.SX(self._port_value(index)), ca.vertcat(t.x, t.u))
        start = {q.name: q.nominal for q in m.inputs} | {q.name: q.initial for q in m.states}
        if found is None:
            return {}
        first = t.function("weight", found)(m.initial_state(), m.nominal_input, m.values)
        return start if float(first) and math.isfinite(float(first)) else {}

    def _terms(self, port: Port) -> float:
        """Return how far the largest term of a port's signal goes, if its author gives no size."""
        size, number = 0.0, 0
        if port.sized and port.name not in dict(self.model.traits.sizes):
            return size
        while (seen := self.ranges.get(term_of(port.name, number))) is not None:
            size, number = max(size, 0.5 * (seen[1] - seen[0])), number + 1
        return size

    def _role(self, port: Port, index: int) -> str:
        if port.role:
            return port.role
        for ending, role in _ENDINGS.items():
            if port.name.endswith(ending):
                return role
        if "penetration" in port.signals:
            return "stop"
        for role, units in _ROLES.items():
            if same_dimension(port.unit, *units):
                circuit = role == "voltage" and any(map(self._is_current, self._moved[index]))
                return "circuit" if circuit else role
        for state in self._moved[index]:
            if same_dimension(port.unit, per(state.unit, "s")):
                if state.unit == "A":
                    # What changes a current is a voltage over a coil.
                    return "circuit"
                fast = state.name in self._integral or state.unit.endswith("/s")
                return "acceleration" if fast else "flow"
        return "flow" if port.name.endswith(".flow") else ""

    def _motion(self, port: Port, index: int, own: Mapping[str, Local]) -> dict[str, Local]:
        """Find what an effort moves: by the author's names, by what they are, by structure."""
        unit = _coordinate_unit(port.unit)
        origins = dict(zip(port.signals, port.origins, strict=True))
        speeds: list[str] = [s for s in origins if s in ("speed", "velocity")]
        speeds += [s for s, o in origins.items() if o in self._integral and s not in speeds]
        speeds += [s for s in origins if s.endswith(("_speed", "_velocity")) and s not in speeds]
        moved = [
            q
            for q in self._moved[index]
            if q.name in self._integral or same_dimension(q.unit, f"{unit}/s")
        ]
        if unit == "1" and len(self._moved[index]) == 1:
            # The water in a pipe: what accelerates it acts on a flow in m3/s.
            moved = list(self._moved[index])
        # A force moves first what has a speed in m/s, a torque what has one in rad/s.
        moved.sort(
            key=lambda q: (
                not same_dimension(q.unit, f"{unit}/s"),
                q.name != self._collocated.get(index),
            )
        )
        found: dict[str, Local] = {}
        place = ""
        if speeds:
            found["speed"] = self._local(port, speeds[0], origins[speeds[0]], f"{unit}/s")
            place = self._integral.get(origins[speeds[0]], "")
        elif own and (pair := self._own_motion(port, index, own)):
            found |= pair
        elif moved:
            found["speed"] = self._between(index, [q.name for q in moved])
            place = "" if found["speed"].minus else self._integral.get(moved[0].name, "")
        named = [s for s in origins if s in ("coordinate", "angle", "position")]
        named += [s for s, o in origins.items() if place and o == place]
        if named:
            found["coordinate"] = self._local(port, named[0], origins[named[0]], unit)
        elif place:
            found["coordinate"] = self._of(place)
        elif "speed" in found and (where := self._integral_of(index, found["speed"], own)):
            found["coordinate"] = where
        return found

    def _carried(self, index: int, motion: Mapping[str, Local]) -> dict[str, Local]:
        """Return place and speed over what carries a body, where an input moves that.

        So the travel of a seat is its height over the floor.
        """
        value, own = self._port_value(index), self._symbols

        def over(local: Local) -> Local:
            if local.minus or local.source not in self._state_index:
                return local
            slope = self._sampled(ca.jacobian(value, own[local.source]))
            bases = (q.name for q in self.model.inputs if q.unit == local.unit)
            based = (q for q in bases if _same(-self._sampled(ca.jacobian(value, own[q])), slope))
            return next((self._over(local.source, q).turned(local.sign) for q in based), local)

        found = {name: over(local) for name, local in motion.items()}
        carried = {name: q for name, q in found.items() if q is not motion[name]}
        return carried if "coordinate" in carried else self._filling(value, motion)

    def _filling(self, value: ca.SX, motion: Mapping[str, Local]) -> dict[str, Local]:
        """Return speed over an input, where the port sees what the two of them alone fill.

        So the water of a tunnel that no turbine takes rises in a surge shaft, through its throat.
        """
        speed, own, t = motion.get("speed"), self._symbols, self.trace
        if speed is None or speed.minus or speed.source not in self._state_index:
            return {}
        bases = [q.name for q in self.model.inputs if q.unit == speed.unit]
        for i in self._state_index.values() if bases else ():
            slope = self._sampled(ca.jacobian(t.rates[i], own[speed.source]))
            if not ca.depends_on(value, t.x[i]) or not np.any(np.nan_to_num(slope)):
                continue
            for base in bases:
                passed = slope * self._sampled(own[speed.source] - own[base])
                if _same(passed, self._sampled(t.rates[i])):
                    return {"speed": self._over(speed.source, base).turned(speed.sign)}
        return {}

    @cached_property
    def _collocated(self) -> dict[int, str]:
        """Return the speed that each of several commands works on, where all move all bodies.

        Of two forces each raises the speed of the other as much as the other raises its own (E.
        Betti 1872): the inverse of a mass matrix is symmetric.
        """
        names = list(self._state_index)
        speeds = {
            i: [self._state_index[q.name] for q in self._moved[i] if q.name in self._integral]
            for i in self._commanded
        }
        found: dict[int, str] = {}
        for i, j in combinations([i for i, own in speeds.items() if len(own) > 1], 2):
            ways = [
                (a, b)
                for a, b in permutations(sorted({*speeds[i], *speeds[j]}), 2)
                if _same(self._raised(i)[:, b], self._raised(j)[:, a])
            ]
            if len(ways) == 1:
                found |= {i: names[ways[0][0]], j: names[ways[0][1]]}
        return found

    def _between(self, index: int, moved: list[str]) -> Local:
        """Return the speed that an effort raises: of one body, or of one over another."""
        first = self._of(moved[0])
        # What pushes one body off another does so wherever they are, whatever they weigh: a rope
        # that hangs askew passes a pull on to one side or the other.
        anywhere = [(x, u, self.model.values) for x, u, _ in self._points]
        raised = self._sampled(self.trace.rates_by_port[:, index], anywhere)
        for name in moved[1:]:
            columns = raised[:, [self._state_index[moved[0]], self._state_index[name]]]
            pair = np.nanmedian(columns, axis=0)
            steady = np.all(np.nanmax(np.abs(columns - pair), axis=0) < _STEADY * np.abs(pair))
            if not steady or pair[0] * pair[1] >= 0.0:
                continue
            ratio = self._geared(index, moved[0], name)
            if ratio < 1.0:
                return self._over(moved[0], name, ratio)
            if ratio > 1.0:
                return self._over(name, moved[0], 1.0 / ratio)
            if self._known[name].unit == first.unit:
                return self._over(*((name, moved[0]) if pair[0] < 0.0 else (moved[0], name)))
        return first

    def _geared(self, index: int, one: str, other: str) -> float:
        """Return how far one body moves another through a port, in the unit of that; or 1.

        The signal is a function of ``ratio * one - other``: of their places, or of their speeds.
        """
        value, own = self._port_value(index), self._symbols
        for pair in ([self._integral.get(one), self._integral.get(other)], [one, other]):
            slopes = [ca.jacobian(value, own[name]) for name in pair if name]
            if len(slopes) == 2 and not any(slope.is_zero() for slope in slopes):
                ratios = -self._sampled(slopes[0] / slopes[1], self._usual)
                if _same(ratios, np.full_like(ratios, ratios[0])) and ratios[0] > 0.0:
                    return 1.0 if abs(ratios[0, 0] - 1.0) < 1e-9 else float(ratios[0, 0])
        return 1.0

    def _over(self, ahead: str, behind: str, ratio: float = 1.0) -> Local:
        """Return how far one state is from another, in the unit of that."""
        first, second = self._of(ahead), self._of(behind)
        found = Local(ahead, second.unit, minus=behind, ratio=ratio)
        seen = self.ranges.get(found.apart)
        scale = _largest(seen) or max(ratio * first.scale, second.scale)
        return replace(found, scale=scale, seen=seen)

    def _own_motion(
        self, port: Port, index: int, own: Mapping[str, Local]
    ) -> dict[str, Local] | None:
        """Find a coordinate and its rate among a port's signals, or a signal that it drives."""
        for name, local in own.items():
            rate = self._rate(index, local)
            for other, speed in own.items():
                if other != name and _same(rate, self._values(index, speed)):
                    return {"coordinate": local, "speed": speed}
        driven = [q for q in own.values() if np.nanmax(np.abs(self._push_rate(index, q))) > 0.0]
        ends = [q for q in driven if any(self._is_rate(q.unit, u.unit) for u in own.values())]
        ends += [q for q in driven if not port.role and q.unit.endswith("/s")]
        return {"speed": ends[0]} if ends else None

    @staticmethod
    def _is_rate(unit: str, of: str) -> bool:
        return same_dimension(unit, per(of, "s"))

    def _integral_of(self, index: int, speed: Local, own: Mapping[str, Local]) -> Local | None:
        """Find the signal, state or difference of two states whose rate is a speed.

        Or times a speed: of the depth of a cage the angle of its drum.
        """
        moving = self._values(index, speed)
        if not np.any(np.nan_to_num(moving)):
            return None
        states = [q for q in self.model.states if "." not in q.name]
        single = [*own.values(), *(self._of(q.name) for q in states)]
        pairs = [
            self._over(a.name, b.name)
            for i, a in enumerate(states)
            for b in states[i + 1 :]
            if a.unit == b.unit
        ]
        ends = [self._integral.get(name, "") for name in (speed.source, speed.minus)]
        if speed.ratio != 1.0 and all(ends):
            pairs.append(self._over(ends[0], ends[1], speed.ratio))
        for local in (*single, *pairs):
            rate = self._rate(index, local)
            for sign in (1.0, -1.0):
                if _same(sign * rate, moving):
                    return local.turned(sign)
        for state in (self._of(q.name) for q in states) if speed.unit.endswith("/s") else ():
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = float(np.nanmedian(moving / self._rate(index, state)))
            if math.isfinite(ratio) and _same(ratio * self._rate(index, state), moving):
                return state.geared(abs(ratio), speed.unit.removesuffix("/s")).turned(ratio)
        followed = [q for q in single if self._follows(q, speed)]
        sees = (q for q in followed if self._slope(index, q).any())
        return next(sees, next(iter(followed), None))

    def _follows(self, place: Local, speed: Local) -> bool:
        """Tell whether a speed adds to a place, beside what else carries it off.

        So the pitch rate of an aircraft adds to the angle at which the wind meets it, and the rise
        of a boat through the water, beside its pitch, to its depth.
        """
        at, t = self._state_index, self.trace
        if place.source not in at or speed.source not in at or place.minus or speed.minus:
            return False
        own, over = at[place.source], t.x[at[speed.source]]
        slope = self._sampled(ca.jacobian(t.rates[own], over))
        return self._is_rate(speed.unit, place.unit) and _same(slope, np.ones_like(slope))

    def _directed(self, index: int, motion: dict[str, Local]) -> tuple[dict[str, Local], bool]:
        """Turn speed and coordinate so that more of the signal raises them.

        Where the signal drives nothing, as the force that a rig measures, it is taken to resist.
        """
        if not motion:
            return motion, True
        signs: list[float] = []
        if "speed" in motion:
            signs.append(_sign(self._push_rate(index, motion["speed"])))
        if not any(signs):
            signs += [
                -_sign(self._slope(index, motion[q]))
                for q in ("speed", "coordinate")
                if q in motion
            ]
        sign = next((q for q in signs if q), 0.0)
        return {k: q.turned(sign) for k, q in motion.items()}, bool(sign)

    def _pressed(self, port: Port, index: int) -> dict[str, Local]:
        """Find pressure and length of a force whose slope over the one depends on the other."""
        own = {s: self._local(port, s, o) for s, o in zip(port.signals, port.origins, strict=True)}
        known = {k: q for k, q in own.items() if self._symbol(index, q) is not None}
        for pressure in (q for q in known.values() if same_dimension(q.unit, "Pa")):
            for length in (q for q in known.values() if same_dimension(q.unit, "m")):
                value = self._port_value(index)
                slope = ca.jacobian(value, self._symbol(index, pressure))
                if not ca.jacobian(slope, self._symbol(index, length)).is_zero():
                    return {"contraction": length, "gauge_pressure": pressure}
        return {}

    def _elastic(self, index: int, at: Local) -> bool:
        """Tell whether a signal is a straight line over a coordinate, of a fixed slope."""
        place, value = self._expression(index, at), self._port_value(index)
        slopes = [ca.jacobian(value, q) / ca.jacobian(place, q) for q in ca.symvar(place)]
        return (
            bool(slopes)
            and not any(ca.depends_on(q, self.trace.x) for q in slopes)
            and all(
                _same(self._sampled(q, self._usual), self._sampled(slopes[0], self._usual))
                for q in slopes
            )
        )

    def _symbol(self, index: int, local: Local) -> ca.SX | None:
        expression = self._expression(index, local)
        return expression if expression.is_symbolic() else None

    def _port_value(self, index: int) -> ca.SX:
        return self.trace.signals[self.trace.signal_names.index(self.trace.ports[index].name)]

    def _signal(self, place: Place) -> ca.SX:
        return self._port_value(self._port_index[place.name])

    def _own_symbol(self, q: Parameter) -> ca.SX:
        return self.trace.p[self._parameter_index[q.name]]

    @cached_property
    def _commanded(self) -> set[int]:
        """Ports that follow from inputs alone, the first of each input."""
        found: set[int] = set()
        taken: set[int] = set()
        for i in range(len(self.trace.ports)):
            if ca.depends_on(self._port_value(i), self.trace.x):
                continue
            slope = ca.jacobian(self._port_value(i), self.trace.u)
            inputs = {k for k in range(self.trace.u.numel()) if not slope[0, k].is_zero()}
            if inputs - taken:
                found.add(i)
            taken |= inputs
        return found

    @cached_property
    def spread(self) -> tuple[tuple[Parameter, tuple[Place, ...]], ...]:
        """Refitted parameters of the plant that several ports bring into the equations."""
        t, found = self.trace, []
        alone = {q.name for of_port in self._entering for q in of_port}
        for k, q in enumerate(self.model.parameters):
            if not q.fitted or q.name in alone or "." in q.name:
                continue
            slopes = [ca.jacobian(self._port_value(i), t.p[k]) for i in range(len(t.ports))]
            at = [i for i, slope in enumerate(slopes) if not slope.is_zero()]
            through = sum(self._by_port[:, i] * slopes[i] for i in at)
            if len(at) > 1 and _same(self._sampled(through), self._whole_slope(k)):
                found.append((q, tuple(self.place(t.ports[i].name) for i in at)))
        return tuple(found)

    @cached_property
    def _by_port(self) -> ca.SX:
        """Derivatives of rates and measurements by what each port adds, in SI."""
        return ca.vertcat(self.trace.rates_by_port, self.trace.outputs_by_port)

    def _whole_slope(self, k: int) -> Vector:
        """Sample the derivatives of rates and measurements by a parameter."""
        t = self.trace
        return self._sampled(ca.jacobian(ca.vertcat(t.rates, t.outputs), t.p[k]))

    @cached_property
    def joints(self) -> tuple[tuple[Parameter, tuple[Place, ...], Local], ...]:
        """Damping parameters that several ports bring in, with the speed that each resists.

        They are those of joints that no command works on: what rubs there turns all the bodies of a
        machine, each through its inertia, as the damping does. So does what rubs over a speed that
        several signals make, as that of a wheel beside the body that drives it.
        """
        found = []
        commanded = {at.speed.source for at in self.places if at.shared}
        for q, places in self.spread:
            values = [self._signal(at) for at in places]
            over = {str(cofactor(value, self._own_symbol(q))) for value in values}
            speed = next(iter(over))
            if len(over) == 1 and speed in self._integral and speed not in commanded:
                found.append((q, places, self._of(speed)))
            elif same_dimension(q.unit, *_DAMPINGS):
                made, together = self.driving(q, places), self._multiplied(q, values)
                if made and made.unit in _SPEEDS and not _is_difference(ca.SX(together)):
                    found.append((q, places, made))
        return tuple(found)

    def may_bend_over(self, q: Parameter, places: Sequence[Place]) -> tuple[Local, ...]:
        """Return the measured states and inputs over which a parameter at some ports may change.

        A state is measured too where an output reads no other, as that of a capacitor behind a
        resistance does. What is constant, as the heat of a fermentation, may change over the state
        that it feeds. Not states that its term is a function of, and of nothing else: a curve over
        them is a law of its own. Of the inputs those that it is a factor of in what a sensor reads,
        where no other law is a curve over them: a resistance over its current. And those without
        which its term is, of which the equations make nothing or that multiply a state beside it: a
        decay over the light, a heat transfer over the flow that carries the heat.
        """
        t, found = self.trace, []
        values = [self._signal(at) for at in places]
        slopes = [ca.jacobian(value, self._own_symbol(q)) for value in values]
        names = list(self._state_index)
        slopes_of = (ca.jacobian(y, t.x) for y in t.outputs.elements())
        alone = (s.sparsity().get_col() for s in slopes_of if s.nnz() == 1)
        constant = not any(ca.depends_on(s, ca.vertcat(t.x, t.u)) for s in slopes)
        raised = {k for at in places for k in self._rates_of(self._port_index[at.name])}
        for name in dict.fromkeys([*self._measured.values(), *(names[k] for (k,) in alone)]):
            other = [t.x[i] for n, i in self._state_index.items() if n != name]
            rest = ca.vertcat(*other, t.u)
            source = constant and self._state_index.get(name) in raised
            if "." not in name and (source or any(ca.depends_on(s, rest) for s in slopes)):
                found.append(self._of(name))
        # As a slip is; of how far two states are apart other laws are curves.
        over = self.driving(q, places)
        if over and not _is_difference(ca.SX(self._multiplied(q, values))):
            found.append(over)
        read = any(at.output for at in places)
        beside = [t.rates[i] for at in places for i in self._rates_of(self._port_index[at.name])]
        unused = {u.source for u in self.unused_inputs}
        for i, u in enumerate(self.model.inputs):
            if any(ca.depends_on(s, t.u[i]) for s in slopes):
                bends = read
            else:
                carries = (ca.depends_on(ca.jacobian(rate, t.u[i]), t.x) for rate in beside)
                bends = u.name in unused or any(carries)
            if bends:
                found.append(self._of(u.name))
        return tuple(found)

    def _rates_of(self, index: int) -> list[int]:
        """Return the states whose rate a port changes."""
        raised = self.trace.rates_by_port[:, index]
        return [k for k in range(raised.numel()) if not raised[k].is_zero()]

    def dissipating(self, q: Parameter, places: Sequence[Place]) -> Local | None:
        """Return what a parameter at some ports makes heat of: a current, what a resistance passes.

        It is what the parameter multiplies there, or divides.
        """
        own = self._own_symbol(q)
        parts = (cofactor(self._signal(at), own) for at in places)
        found = [part for part in parts if part is not None]
        known = (str(e) for e in found if e.is_symbolic())
        passed = [self._of(name) for name in known if name in self._known]
        # A magnet is weaker the warmer the current makes it, which it turns as well as brakes with.
        if current := next((q for q in passed if same_dimension(q.unit, "A")), None):
            return current
        if (
            len(found) < len(places)
            or not ca.depends_on(found[0], ca.vertcat(self.trace.x, self.trace.u))
            or not all(ca.is_equal(found[0], e, 8) for e in found[1:])
            or not same_dimension(q.unit, *_RESISTANCES)
        ):
            return None
        return passed[0] if passed else self._argument(q, "1")

    def heating(self, place: Place) -> tuple[Local, ...]:
        """Return the currents, and the voltages and shares of one that are set, that may heat."""
        heating = [q for q in self.model.states if same_dimension(q.unit, "A")] + [
            q for q in self.model.inputs if q.commanded and same_dimension(q.unit, "A", "V", "1")
        ]
        return tuple(self._of(q.name) for q in heating)

    def argument(self, q: Parameter, places: Sequence[Place]) -> Local | None:
        """Return what a parameter multiplies at some ports, if that is made of several signals.

        What it divides, as an inertia does, is all that acts there.
        """
        values, own = [self._signal(at) for at in places], self._own_symbol(q)
        first = self._multiplied(q, values)
        if first is None or any(ca.depends_on(ca.jacobian(v, own), own) for v in values):
            return None
        return self._argument(q, self._argument_unit(q, first, values[0], places[0]))

    def driving(self, q: Parameter, places: Sequence[Place]) -> Local | None:
        """Return what a parameter multiplies or divides at some ports, made of several signals."""
        seen = self.ranges.get(argument_of(q.name))
        values = [self._signal(at) for at in places]
        first = self._multiplied(q, values)
        if seen is None or seen[0] == seen[1] or first is None:
            return None
        return self._argument(q, self._argument_unit(q, first, values[0], places[0]))

    def _argument_unit(self, q: Parameter, first: ca.SX, value: ca.SX, at: Place) -> str:
        """Return the unit of what a parameter multiplies in the value of a port.

        What adds up has one unit, that of a bare signal in it; what is all of the port with the
        parameter has the port's over its own.
        """
        units = {self._known[n].unit for n in _added(first) if n in self._known}
        if len(units) == 1 and units != {"1"}:
            return units.pop()
        alone = ca.is_equal(value, first * self._own_symbol(q), 8)
        return per(at.unit, q.unit) if alone else "1"

    def _argument(self, q: Parameter, unit: str) -> Local:
        """Return what a parameter multiplies as a signal of its own."""
        seen = self.ranges.get(argument_of(q.name))
        return Local("argument", unit, _largest(seen) or 1.0, seen=seen, multiplied=True)

    def _multiplied(self, q: Parameter, values: Sequence[ca.SX]) -> ca.SX | None:
        """Return what a parameter multiplies in all values; None unless several signals make it."""
        t, own = self.trace, self._own_symbol(q)
        found = [cofactor(value, own) for value in values]
        # What weighs a body is also in what an exchange with another one does to it.
        given = [i for name, i in self._port_index.items() if name.endswith(".exchange")]
        weighs = any(ca.depends_on(t.rates_by_port[:, i], own) for i in given)
        if not found or weighs or any(e is None for e in found):
            return None
        first = ca.SX(found[0])
        signals = ca.vertcat(t.x, t.u)
        many = sum(ca.depends_on(first, signals[i]) for i in range(signals.numel()))
        alike = all(ca.is_equal(first, ca.SX(e), 8) for e in found[1:])
        return first if alike and many > 1 and ca.depends_on(first, t.x) else None

    @cached_property
    def _entering(self) -> tuple[tuple[Parameter, ...], ...]:
        """Refitted parameters that each port alone brings into the equations."""
        t, found = self.trace, [list[Parameter]() for _ in self.trace.ports]
        for k, q in enumerate(self.model.parameters):
            if not q.fitted or q.name.partition(".")[0] in self._found:
                continue
            whole = self._whole_slope(k)
            for i in range(len(t.ports)):
                slope = ca.jacobian(self._port_value(i), t.p[k])
                if slope.is_zero() or not _same(self._sampled(self._by_port[:, i] * slope), whole):
                    continue
                part = self._sampled(slope * t.p[k])
                if np.nanmax(np.abs(part)) >= _VISIBLE * t.ports[i].scale:
                    found[i].append(q)
                break
        return tuple(tuple(each) for each in found)

    def _is_gain(self, q: Parameter, index: int) -> bool:
        """Tell whether a parameter is a mere gain of what is driven, which has laws of its own."""
        value, own = self._port_value(index), self._own_symbol(q)
        part = self._sampled(ca.jacobian(value, own) * own)
        return any(self._entered[index]) and _same(part, self._sampled(value))

    def _own(self, index: int) -> dict[str, ca.SX]:
        port, values = self.trace.ports[index], self.trace.local_signals[index]
        return {name: values[i] for i, name in enumerate(port.signals)}

    def _expression(self, index: int, local: Local) -> ca.SX:
        return ca.SX(local.value(self._own(index), self._symbols))

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
        t, m = self.trace, self.model
        inputs = {q.name: t.u[i] for i, q in enumerate(m.inputs)}
        return inputs | {q.name: t.x[i] for i, q in enumerate(m.states)}

    def _values(self, index: int, local: Local) -> Vector:
        return self._sampled(self._expression(index, local))

    def _rate(self, index: int, local: Local) -> Vector:
        return self._sampled(
            ca.jtimes(self._expression(index, local), self.trace.x, self.trace.rates)
        )

    def _push_rate(self, index: int, local: Local) -> Vector:
        raised = self.trace.rates_by_port[:, index]
        return self._sampled(ca.jtimes(self._expression(index, local), self.trace.x, raised))

    def _slope(self, index: int, local: Local) -> Vector:
        symbol = self._expression(index, local)
        if not (symbol.is_symbolic() or (-symbol).is_symbolic()):
            return np.zeros(1)
        sign = 1.0 if symbol.is_symbolic() else -1.0
        return sign * self._sampled(ca.jacobian(self._port_value(index), sign * symbol))

    def _raised(self, index: int) -> Vector:
        return self._sampled(self.trace.rates_by_port[:, index])

    def _whole(self, index: int) -> bool:
        """Tell whether the rates that a port drives are proportional to its signal."""
        moved = self._moved[index]
        if len(moved) != 1:
            return False
        i = self._state_index[moved[0].name]
        share = self.trace.rates_by_port[i, index] * self._port_value(index)
        return _same(self._sampled(share), self._sampled(self.trace.rates[i]))

    def _sampled(self, expression: ca.SX, points: Points | None = None) -> Vector:
        """Evaluate an expression at some points, shape (n_points, n)."""
        function = self.trace.function("sampled", ca.SX(expression))
        return np.array([np.asarray(function(*at)).ravel() for at in points or self._points])

    @cached_property
    def _usual(self) -> Points:
        """Those points with the values of what is not fitted, such as the ratio of a gear."""
        fitted = np.array([q.fitted for q in self.model.parameters], dtype=bool)
        return [(x, u, np.where(fitted, p, self.model.values)) for x, u, p in self._points]

    @cached_property
    def _points(self) -> Points:
        """Some states, inputs and parameters about the usual ones, by a fixed rule."""
        m, rng = self.model, np.random.default_rng(1)
        x = np.array([q.initial for q in m.states], dtype=float)

        def around(quantities: Sequence[Quantity], usual: Vector) -> Vector:
            scales = np.array([q.scale for q in quantities], dtype=float)
            return np.asarray(usual + scales * rng.uniform(0.2, 0.8, usual.size))

        return [
            (
                around(m.states, x),
                around(m.inputs, m.nominal_input),
                m.values * rng.uniform(0.9, 1.1, m.values.size),
            )
            for _ in range(3)
        ]

    def _is_current(self, state: State) -> bool:
        # A motor without inductance: its voltage is a torque, which has a port of its own.
        moves = same_dimension(state.unit, *_SPEEDS)
        return not moves and (state.name in self._integral or state.unit == "A")

    def _of(self, name: str) -> Local:
        q = self._known[name]
        lower, upper = getattr(q, "lower", -math.inf), getattr(q, "upper", math.inf)
        start = getattr(q, "initial", getattr(q, "nominal", 0.0))
        seen = self.ranges.get(name)
        scale = q.scale if q.sized else _largest(seen) or q.scale
        return Local(name, q.unit, scale, lower, upper, start, seen)

    def _local(self, port: Port, signal: str, origin: str, unit: str = "") -> Local:
        """Return a local signal with what is known of it; by its unit where it is no state."""
        if origin in self._known:
            of = self._of(origin)
            # A prescribed signal of a test bench has no unit of its own.
            own = of.unit if of.unit != "1" or not unit else unit
            return Local(signal, own, of.scale, of.lower, of.upper, of.start, of.seen)
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
    def _pushed(self) -> Vector:
        """Slopes of the rates by the ports at the start, shape (n_states, n_ports)."""
        matrix = self.trace.function("by_port", self.trace.rates_by_port)
        x, u = self.model.initial_state(), self.model.nominal_input
        return np.asarray(matrix(x, u, self.model.values))

    def _alone(self, index: int) -> tuple[str, float]:
        """Return the only state that a port moves, and whether more of the signal raises it."""
        if len(self._moved[index]) != 1:
            return "", 1.0
        name = self._moved[index][0].name
        slope = self._pushed[self._state_index[name], index]
        return (name, float(np.sign(slope))) if slope else ("", 1.0)

    @cached_property
    def _filled(self) -> tuple[tuple[State, ...], ...]:
        """States that each port fills: those it moves, if more of it raises every one of them."""
        at = self._pushed
        return tuple(
            moved if all(at[self._state_index[q.name], j] > 0 for q in moved) else ()
            for j, moved in enumerate(self._moved)
        )

    def _between_bodies(self, index: int) -> bool:
        """Tell whether a port that no input enters drives one body on and another one back."""
        pushes = self._pushed[[self._state_index[q.name] for q in self._moved[index]], index]
        return not any(self._entered[index]) and bool((pushes > 0).any() and (pushes < 0).any())

    def _emptied(self, index: int) -> str:
        """Return the level that drives a flow and falls with it; empty if there is none."""
        value, raised = self._port_value(index), self._raised(index)
        for i, q in enumerate(self.model.states):
            if "." in q.name or not ca.depends_on(value, self.trace.x[i]):
                continue
            if np.nanmedian(raised[:, i]) < 0.0:
                return q.name
        return ""

    @cached_property
    def _entered(self) -> tuple[tuple[bool, ...], ...]:
        """Whether each input enters the signal of each port at once."""
        ports, inputs = range(len(self.trace.ports)), range(len(self.model.inputs))
        slopes = [ca.jacobian(self._port_value(i), self.trace.u) for i in ports]
        return tuple(tuple(not slope[k].is_zero() for k in inputs) for slope in slopes)


def _same(a: Vector, b: Vector) -> bool:
    """Tell whether two samples agree wherever both are numbers, and are not nothing."""
    known = np.isfinite(a) & np.isfinite(b)
    size = np.max(np.abs(b[known]), initial=0.0)
    return bool(known.any() and size > 0.0 and np.all(np.abs(a - b)[known] <= 1e-9 * size))


def _parts(expression: ca.SX) -> list[ca.SX]:
    return [expression.dep(i) for i in range(expression.n_dep())]


def _added(expression: ca.SX) -> list[str]:
    """Return the bare signals that add up, with others, to an expression."""
    if expression.is_symbolic():
        return [str(expression)]
    if expression.op() not in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG):
        return []
    return [name for part in _parts(expression) for name in _added(part)]


def _is_difference(expression: ca.SX) -> bool:
    """Tell whether an expression is made of two bare signals."""
    return all(part.is_symbolic() for part in _parts(expression))


def _sign(values: Vector) -> float:
    """Return the sign that all values have, or 0."""
    signs = set(np.sign(values[np.isfinite(values)]).tolist())
    return float(signs.pop()) if len(signs) == 1 else 0.0


def _bearing_loads(signals: Mapping[str, Local]) -> dict[str, Local]:
    """Find what loads a contact at a port: its forces, torques and pressures, by unit or name."""

    def loads(name: str, unit: str) -> bool:
        if unit != "1":
            return same_dimension(unit, "N", "N m", "Pa")
        return name.rstrip("_0123456789").endswith(("force", "load", "pressure"))

    found = [q for name, q in signals.items() if loads(name, q.unit)]
    return {f"bearing_load_{i + 1}": q for i, q in enumerate(found)}


def unknown_place(name: str) -> Place:
    """Return a place of which nothing but the name is known yet."""
    return Place(Port(name, "1", 1.0, "", ()), "")
