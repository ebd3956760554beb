"""What the equations of a model see while they are written down: names, ports and signals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import casadi as ca

from workbench.errors import WorkbenchError, check_choice
from workbench.model.regularisation import Expression, Form
from workbench.model.units import in_si, parse_unit


class Names(Mapping[str, Expression]):
    """Read-only access to named values, as items or as attributes.

    Args:
        kind: What the names are, for messages: ``"state"``, ``"parameter"``, ...
        values: The values by name, in SI; symbols, numbers or arrays.
    """

    def __init__(self, kind: str, values: Mapping[str, Expression]) -> None:
        self._kind = kind
        self._values = dict(values)

    def __getitem__(self, name: str) -> Expression:
        if name not in self._values:
            check_choice(self._kind, name, self._values)
        return self._values[name]

    def __getattr__(self, name: str) -> Expression:
        if name.startswith("_"):
            raise AttributeError(name)
        return self[name]

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)


@dataclass(frozen=True)
class Port:
    """A named place in the equations where an effect may act.

    Args:
        name: Name of the port, ``where.what``: ``joint.torque``.
        scale: Typical size of the signal, in ``unit``.
        signals: Names of the local signals that an effect may use there.
        disturbance: Root mean square of what the model's author expects the equations to leave out
            here, in ``unit``; 0 where the signal is trusted.
        relative_disturbance: The same, as a fraction of the signal's magnitude, dimensionless.
        role: What the signal does, such as ``"force"``, ``"flow"`` or ``"command"``: effects are
            offered by it. Where it is not declared, the unit and the structure of the equations
            tell.
        origins: For each of ``signals``, the state, input, port or published signal that it is, or
            nothing.
        stated: Unit that the author of the equations wrote, where it is not ``unit``.
    """

    name: str
    unit: str
    scale: float
    description: str
    signals: tuple[str, ...]
    disturbance: float = 0.0
    relative_disturbance: float = 0.0
    role: str = ""
    origins: tuple[str, ...] = ()
    sized: bool = True
    stated: str = ""

    @property
    def group(self) -> str:
        """Part of the name before the dot: the component that the port belongs to."""
        return self.name.split(".")[0]


@dataclass(frozen=True)
class ValidRange:
    """The range of a signal within which the laws of a model hold.

    Args:
        lower: Smallest valid value, in ``unit``.
        upper: Largest valid value, in ``unit``.
    """

    signal: str
    unit: str
    lower: float
    upper: float


@dataclass(frozen=True)
class PortView:
    """What an effect sees at one of its ports.

    Args:
        index: Position of the port in the effect's list of ports, from 0.
        value: The signal before this effect, in the port's unit.
        signals: Local signals of the port, by name, in SI.
        p: The effect's own parameters, by their short names, in SI.
        x: The effect's own states, by their short names, in SI.
        scale: Typical size of the signal, in the port's unit.
        known: States and inputs of the model, by name, in SI.
        parameters: Parameters of the model, by name, in SI.
        subject: The parameter of the model that the effect changes, in SI.
        plain: The signal before any effect, in the port's unit.
    """

    port: str
    index: int
    value: Expression
    signals: Names
    p: Names
    x: Names
    form: Form
    scale: float = 1.0
    known: Names = field(default_factory=lambda: Names("state or input", {}))
    parameters: Names = field(default_factory=lambda: Names("parameter", {}))
    subject: Expression = None
    plain: Expression = None

    @property
    def group(self) -> str:
        """Part of the port's name before the dot."""
        return self.port.split(".")[0]


@dataclass(frozen=True)
class EffectView:
    """What an effect sees when the whole model has been written down.

    Args:
        at: What the effect saw at each of its ports, by the port's name.
        values: Final value of every port of the model and of every published signal, by name, in
            SI.
    """

    p: Names
    x: Names
    form: Form
    at: Mapping[str, PortView]
    values: Names

    @property
    def here(self) -> PortView:
        """What the effect saw at its first port."""
        return next(iter(self.at.values()))


Transform = Callable[[Port, Expression, Names], Expression]


def node(value: Expression) -> object:
    """Return what an expression is known by: another object of the same node is the same.

    Args:
        value: The expression, in the unit of its author.
    """
    return value.element_hash() if isinstance(value, ca.SX) and value.is_scalar() else object()


@dataclass
class Scope:
    """The names that the equations of a model may use, and the ports that they open.

    Args:
        transform: Applies the attached effects to the signal of a port; none by default.
        values: Final value of every port and published signal so far, by name, in its SI unit.
        units: Those SI units, by name of port or signal.
        scales: Typical sizes of ports that declare none, in SI by name.
        in_si: Whether signals are in SI, in whatever unit the author declares them.
        own: Quantities in SI by what equations in units of their own know them by (`node`): what an
            effect sees at a port, and gives back, is in SI all the same; None of other equations.
    """

    x: Names
    u: Names
    p: Names
    form: Form
    transform: Transform = field(default=lambda port, value, signals: value)
    ports: list[Port] = field(default_factory=list)
    values: dict[str, Expression] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    ranges: list[ValidRange] = field(default_factory=list)
    scales: Mapping[str, float] = field(default_factory=dict)
    in_si: bool = False
    own: Mapping[object, Expression] | None = None

    def port(
        self,
        name: str,
        value: Expression,
        *,
        unit: str,
        scale: float | None = None,
        description: str = "",
        signals: Mapping[str, Expression] | None = None,
        disturbance: float = 0.0,
        relative_disturbance: float = 0.0,
        role: str = "",
    ) -> Expression:
        """Open a port: return the signal, in ``unit``, after the effects attached there have acted.

        Args:
            value: The signal as the model has it, in ``unit``.
            scale: Typical size of the signal, in ``unit``; where none is declared, that which the
                equations show, until a recording shows it.
            signals: Local signals that an effect may use, by name, in SI.
            disturbance: Root mean square of what the equations may leave out here, in ``unit``.
            relative_disturbance: The same, as a fraction of the signal's magnitude, dimensionless.
        """
        counted = parse_unit(unit)
        size = counted.factor if self._sized else 1.0
        stated, unit = unit, self._claim(name, unit)
        local = Names(f"signal at port {name}", self._in_si(signals or {}))
        port = Port(
            name,
            unit,
            (self.scales.get(name) or 1.0) if scale is None else scale * size,
            description,
            tuple(local),
            disturbance * size,
            relative_disturbance,
            role,
            sized=scale is not None,
            stated=stated if stated != unit else "",
        )
        given = value if self.own is None else value * size + counted.offset
        result = self.transform(port, given, local)
        self.ports.append(port)
        self.values[name] = result
        return result if self.own is None else (result - counted.offset) / size

    def _in_si(self, signals: Mapping[str, Expression]) -> Mapping[str, Expression]:
        """Return local signals in SI: of equations in their own units those that are quantities."""
        if self.own is None:
            return signals
        known = {name: self.own.get(node(value)) for name, value in signals.items()}
        return {name: whole for name, whole in known.items() if whole is not None}

    @property
    def _sized(self) -> bool:
        return self.in_si or self.own is not None

    def publish(
        self,
        name: str,
        value: Expression,
        *,
        unit: str,
        lower: float = -math.inf,
        upper: float = math.inf,
    ) -> Expression:
        """Name and return an internal signal, in ``unit``: results show it and effects use it.

        Args:
            value: The signal, in ``unit``.
            lower: Smallest value for which the laws that use it hold, in ``unit``.
            upper: Largest value for which the laws that use it hold, in ``unit``.
        """
        counted = parse_unit(unit)
        size = counted.factor if self._sized else 1.0
        unit = self._claim(name, unit)
        self.values[name] = value if self.own is None else value * size + counted.offset
        if lower > -math.inf or upper < math.inf:
            self.ranges.append(ValidRange(name, unit, lower * size, upper * size))
        return value

    def _claim(self, name: str, unit: str) -> str:
        if name in self.values:
            raise WorkbenchError(
                f"the equations open {name!r} twice; ports and signals need different names"
            )
        known = parse_unit(unit).factor == 1.0 or not self._sized
        self.units[name] = unit if known else in_si(unit)
        return self.units[name]
