"""A place: a port of a model as a law sees it, with what moves, is filled or is read there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from workbench.model import Output, Parameter, Port
from workbench.model.regularisation import Expression, sqrt
from workbench.model.units import per, same_dimension
from workbench.physics.recorded_facts import NOTHING, RecordedFacts

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
        beside: Names of states of which and the source it is the mean: along a rod, a conductor.
        vector: Whether it is not their mean but the length of the vector that they are.
        ratio: Factor of the source before that, in ``unit`` per unit of the source: of a gear,
            lever or drum.
        sign: 1, or -1 where the signal of the port counts the other way, dimensionless.
        multiplied: Whether it is what the parameter that changes multiplies, of which there is no
            other name.
        read: Unit in which people read it; empty for its own.
        of: Gives it by states and inputs, and by parameters, if it is no signal of the model.
    """

    source: str
    unit: str
    scale: float = 1.0
    lower: float = -math.inf
    upper: float = math.inf
    start: float = 0.0
    seen: tuple[float, float] | None = None
    minus: str = ""
    beside: tuple[str, ...] = ()
    vector: bool = False
    ratio: float = 1.0
    sign: float = 1.0
    multiplied: bool = False
    read: str = ""
    of: Callable[[Mapping[str, Expression], Mapping[str, Expression]], Expression] | None = None

    @property
    def largest(self) -> float:
        """Largest magnitude that was seen, in ``unit``; the typical size if none was."""
        return largest(self.seen) or self.scale

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

    def value(
        self,
        own: Mapping[str, Expression],
        known: Mapping[str, Expression],
        parameters: Mapping[str, Expression],
    ) -> Expression:
        """Return the signal, in ``unit``.

        Args:
            own: Local signals of the port, by name, in SI.
            known: States and inputs of the model, by name, in SI.
            parameters: Parameters of the model, by name, in SI.
        """
        if self.of is not None:
            return self.of(known, parameters)
        value = own[self.source] if self.source in own else known[self.source]
        parts = [value, *(known[name] for name in self.beside)]
        if self.vector:
            # Rounded where it has no direction.
            value = sqrt(sum(part**2 for part in parts) + (1e-6 * self.scale) ** 2)
        elif self.beside:
            value = sum(parts) / len(parts)
        if self.ratio != 1.0:
            value = self.ratio * value
        if self.minus:
            value = value - known[self.minus]
        return value if self.sign == 1.0 else self.sign * value


def coordinate_unit(effort: str) -> str:
    """Return the unit of what an effort moves."""
    return next((c for u, c in COORDINATES.items() if same_dimension(u, effort)), "1")


def largest(seen: tuple[float, float] | None) -> float:
    """Return the largest magnitude that was seen, in the unit of that; 0 if none was."""
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
        dry_declared: Whether dry friction is attached to it that was not missing at first.
        dry: Whether there is dry friction over the speed.
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
        seen: Smallest and largest value along the recordings, in its unit; None if not known.
        stands: Value at which a sensor stands as only one does that goes no further, in its unit;
            None if it does not.
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
    dry_declared: bool = False
    dry: bool = True
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
    recorded: RecordedFacts = NOTHING
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
        own = self.port.scale if self.port.sized else largest(self.seen) or self.port.scale
        return max(own, self.terms)

    @property
    def read(self) -> str:
        """Unit in which people read what a sensor says; empty for its own."""
        return self.output.display_unit if self.output is not None else ""

    @property
    def interval(self) -> float:
        """Sampling interval, in s; fine for the model where it is not known."""
        return self.recorded.sample_time or self.horizon / 500.0

    @property
    def changed(self) -> Parameter:
        """The parameter that changes, of a law of one; a plain number where it is not known."""
        return self.parameters[0] if self.parameters else Parameter("parameter", "1")

    @property
    def over(self) -> Local:
        """What that parameter changes with, or what heats."""
        return self.other("over")

    @property
    def lasting(self) -> float:
        """Length of the recordings, in s; long for the model where it is not known."""
        return self.recorded.duration or 20.0 * self.horizon

    def with_signal(self, name: str, other: Local) -> Place:
        """Return the place with a signal of elsewhere beside its own, by the name of a law."""
        return replace(self, signals={**self.signals, name: other})

    def other(self, name: str) -> Local:
        """Return a signal of elsewhere by the name of a law; dimensionless where there is none."""
        return self.signals.get(name, Local(name, "1"))

    @property
    def speed(self) -> Local:
        """The speed of what moves."""
        return self.signals.get("speed") or Local("speed", per(coordinate_unit(self.unit), "s"))

    @property
    def coordinate(self) -> Local:
        """The position of what moves; none of a shaft whose turns nobody counts.

        Of that its scale is how far it goes while the response of the model shows.
        """
        if "coordinate" in self.signals:
            return self.signals["coordinate"]
        way = self.speed.largest * self.horizon if "speed" in self.signals else 1.0
        return Local("coordinate", coordinate_unit(self.unit), scale=way or 1.0)

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


def unknown_place(name: str) -> Place:
    """Return a place of which nothing but the name is known yet."""
    return Place(Port(name, "1", 1.0, "", ()), "")
