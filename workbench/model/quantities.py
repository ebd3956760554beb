"""Named quantities of a model: states, inputs, outputs and parameters, all in SI."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

from workbench.errors import WorkbenchError
from workbench.model.units import (
    convert,
    in_si,
    in_symbols,
    of_difference,
    parse_unit,
    per,
    same_dimension,
    shown_unit,
)

_REFUSED: ContextVar[list[str] | None] = ContextVar("refused", default=None)
"""Why units were refused, while they are collected."""


@contextmanager
def units_together() -> Iterator[None]:
    """Refuse the units of all quantities that are declared inside at once.

    Raises:
        WorkbenchError: With a reason for each quantity, instead of for the first one.

    Example:
        >>> with units_together():
        ...     State("level", "metre/(min"), Input("heat", "kW s^^2")
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: level: unit 'm/(min' ...; heat: unit 'kW s^^2' ...
    """
    refused: list[str] = []
    token = _REFUSED.set(refused)
    try:
        yield
    except Exception:
        # What a placeholder for a unit leads to tells nothing.
        if not refused:
            raise
    finally:
        _REFUSED.reset(token)
    if refused:
        raise WorkbenchError("; ".join(dict.fromkeys(refused)))


_AT = ("initial", "nominal", "value", "lower", "upper")
_SIZES = (
    "scale",
    "start_rms",
    "resolution",
    "slew",
    "noise_rms",
    "correlated_noise_rms",
    "setting",
)
"""What a quantity says in its unit: values, and sizes, of which the zero of a scale is no part."""


@dataclass(frozen=True)
class Quantity:
    """A named number with a unit and a scale.

    What is declared in another unit than that of the SI is converted: ``unit`` and all numbers are
    then those of the SI, and ``stated`` tells in which the equations count.

    Args:
        name: Name by which it is found; letters, digits, underscores and dots.
        unit: Unit, ``"1"`` of a plain number.
        scale: Typical size, in ``unit``; sets tolerances and conditioning. Where it is left out, 0,
            the model finds it in its equations (`workbench.model.sizes`).
        sized: Whether the author declared the scale.
        display_unit: Unit in which people read it.
        stated: Unit in which the author declared it, where that is not of the SI.

    Example:
        >>> sugar = State("sugar", "mg/dl", initial=120.0)
        >>> round(sugar.initial, 6), sugar.unit, sugar.display_unit
        (1.2, 'kg/m3', 'mg/dl')
    """

    name: str
    unit: str = "1"
    scale: float = 0.0
    description: str = ""
    sized: bool = field(default=True, kw_only=True)
    display_unit: str = field(default="", kw_only=True)
    stated: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        if not self.name.replace(".", "_").replace("_", "a").isalnum():
            raise WorkbenchError(
                f"quantity name {self.name!r} may hold letters, digits, underscores and dots only"
            )
        for name in (f.name for f in fields(self) if f.name in (*_AT, *_SIZES)):
            # Whole numbers would stand in memory otherwise than C code reads them.
            if isinstance(value := getattr(self, name), numbers.Integral):
                object.__setattr__(self, name, float(value))
        low, high = getattr(self, "lower", -math.inf), getattr(self, "upper", math.inf)
        if low > high:
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise WorkbenchError(
                f"the range of {self.name} is {low:g} to {high:g}{unit}, from above its upper end;"
                " swap lower and upper"
            )
        try:
            self._check_units()
        except WorkbenchError as error:
            refused = _REFUSED.get()
            if refused is None:
                raise
            refused.append(str(error))
            for name in ("unit", "display_unit"):
                object.__setattr__(self, name, "1")
        if not (math.isfinite(self.scale) and self.scale >= 0):
            raise WorkbenchError(
                f"scale of {self.name} is {self.scale!r}; give a positive typical size"
            )

    def _check_units(self) -> None:
        try:
            unit = parse_unit(self.unit)
            like = not self.display_unit or same_dimension(self.display_unit, self.unit)
        except WorkbenchError as error:
            raise WorkbenchError(f"{self.name}: {error}") from None
        if not like:
            gravity = self.display_unit == "g" and same_dimension(self.unit, "gn")
            raise WorkbenchError(
                f"display_unit {self.display_unit!r} of {self.name} does not measure what"
                f" {self.unit!r} does; give a unit of the same kind"
                f"{', 9.80665 m/s2 being gn' * gravity}"
            )
        stated = in_symbols(self.unit)
        object.__setattr__(self, "unit", stated)
        if math.isclose(unit.factor, 1.0) and not unit.offset:
            return
        found: dict[str, object] = {"unit": in_si(stated), "stated": stated}
        found["display_unit"] = self.display_unit or stated
        for name, value in ((f.name, getattr(self, f.name)) for f in fields(self)):
            if name in _AT:
                found[name] = value * unit.factor + unit.offset
            elif name in _SIZES:
                found[name] = value * unit.factor
        for name, value in found.items():
            object.__setattr__(self, name, value)


Q = TypeVar("Q", bound=Quantity)


def of_names(quantities: Iterable[Q], names: Iterable[str]) -> tuple[Q, ...]:
    """Return the quantities of some names, in the order of these."""
    known = {q.name: q for q in quantities}
    return tuple(known[name] for name in names)


@dataclass(frozen=True)
class State(Quantity):
    """A quantity with a rate of change.

    Args:
        initial: Value at the start of a run unless another is given, in ``unit``.
        lower: Smallest value inside the validity of the model's laws, in ``unit``.
        upper: Largest value inside the validity of the model's laws, in ``unit``.
        start_rms: How far a recording may start from ``initial``, root mean square, in ``unit``;
            0, the default, stands for the scale.
        start_in: Names of recordings that begin otherwise, each with the value there, in ``unit``.
    """

    initial: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    start_rms: float = 0.0
    start_in: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)


@dataclass(frozen=True)
class Channel(Quantity):
    """What goes into a machine or is read from it; people read it in its unit by default."""

    def _check_units(self) -> None:
        """Check units; the SI unit is the default for display."""
        super()._check_units()
        if not self.display_unit:
            object.__setattr__(self, "display_unit", self.unit)


@dataclass(frozen=True)
class Input(Channel):
    """A command or disturbance that drives the model, held between samples.

    Args:
        nominal: Value at rest, in ``unit``; by default 0, or what is in the middle of a range
            without it, as of a valve from 4 to 20 mA.
        lower: Saturation, in ``unit``.
        upper: Saturation, in ``unit``.
        resolution: Step of the converter that writes it, in ``unit``; 0 for none.
        slew: Fastest change under a controller, in ``unit`` per s, such as that of a valve which
            moves 10 % in a second; none by default. An input that is given over time is as given.
        commanded: Whether the user of the machine sets it; a wind or the temperature of a room is
            only measured: it rests at its nominal value, and no controller, experiment or limit
            takes it for a command.
    """

    nominal: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    resolution: float = 0.0
    slew: float = field(default=math.inf, kw_only=True)
    commanded: bool = field(default=True, kw_only=True)

    def __post_init__(self) -> None:
        if not self.nominal:
            object.__setattr__(self, "nominal", self.unsaid)
        super().__post_init__()
        if not self.slew > 0.0:
            raise WorkbenchError(
                f"slew of {self.name} is {self.slew!r}; give its fastest change in {self.unit} per"
                " s, or leave it out"
            )

    @property
    def unsaid(self) -> float:
        """Value at rest where nobody says it, in ``unit``."""
        if self.lower <= 0.0 <= self.upper:
            return 0.0
        ends = [end for end in (self.lower, self.upper) if math.isfinite(end)]
        return sum(ends) / max(len(ends), 1)


@dataclass(frozen=True)
class Output(Channel):
    """What a sensor reads.

    Args:
        resolution: Step of the converter that reads it, in ``unit``; 0 for none.
        noise_rms: Root mean square of the white noise before conversion, in ``unit``.
        correlated_noise_rms: Root mean square of noise beside it that one sample shares with the
            next, in ``unit``: a first-order Gauss-Markov process.
        noise_correlation_time: Time over which that noise is correlated, in s.
        relative_noise_rms: Root mean square of white noise that grows with the reading, as a
            fraction of it, dimensionless.
        lower: Lower end of the sensor's range, in ``unit``.
        upper: Upper end of the sensor's range, in ``unit``.
    """

    resolution: float = 0.0
    noise_rms: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    correlated_noise_rms: float = field(default=0.0, kw_only=True)
    noise_correlation_time: float = field(default=0.0, kw_only=True)
    relative_noise_rms: float = field(default=0.0, kw_only=True)


def shown_in(quantity: Quantity) -> str:
    """Return the unit in which people read a quantity: what it says, if it does.

    Example:
        >>> shown_in(State("pressure", "Pa")), shown_in(Input("rudder", "rad", display_unit="deg"))
        ('bar', 'deg')
    """
    if isinstance(quantity, Output):
        return quantity.display_unit
    return shown_unit(quantity.display_unit or quantity.unit)


def told_units(quantities: Iterable[Output | Input]) -> dict[str, str]:
    """Return the units of signals by name, with what people read them in.

    Example:
        >>> told_units([Output("position", "m", display_unit="mm"), Input("valve", "1")])
        {'position': 'm: 1 mm is 0.001', 'valve': 'a plain number'}
    """
    told = {}
    for q in quantities:
        own = "a plain number" if q.unit == "1" else q.unit
        one = f"{convert(1.0, q.display_unit, q.unit):g}"
        read = q.display_unit or q.unit
        told[q.name] = own if read == q.unit else f"{own}: 1 {read} is {one}"
    return told


def declared_unit(
    name: str, unit: str, quantities: Iterable[Quantity], *, difference: bool = False
) -> str:
    """Return the unit declared for reading what is named after a quantity; empty if none.

    The rate of a quantity follows the unit of that. What no quantity has given its name is read as
    all quantities of its SI unit are that say it, or as the rates of all whose rate it is, if they
    agree, and their unit has no zero of its own. Plain numbers, which count all sorts of things,
    and their rates are not.

    Args:
        name: Name of the quantity, of a port of its own, or of its rate.
        unit: SI unit of what is named: the quantity's, or that of its rate.
        quantities: Outputs, inputs and states, those first that say it.
        difference: Whether it is a difference, of which the zero of a scale is no part.

    Example:
        >>> of = [Output("oven", "K", display_unit="degF"), Input("heat", "W", display_unit="kW")]
        >>> declared_unit("oven", "K", of), declared_unit("heat.command", "W", of)
        ('degF', 'kW')
        >>> declared_unit("oven.reading", "K", of, difference=True), declared_unit("pump", "W", of)
        ('Δ°F', 'kW')
        >>> declared_unit("rate of oven", "K/s", of), declared_unit("oven_wall.exchange", "K/s", of)
        ('Δ°F/s', 'Δ°F/s')
        >>> blade = [State("pitch", "rad"), Output("rotor", "rad/s", display_unit="rpm")]
        >>> declared_unit("pitch.rate", "rad/s", blade), declared_unit("gear", "rad/s", blade)
        ('', 'rpm')
        >>> declared_unit("leak.conductance", "1/s", [Input("valve", "1", display_unit="%")])
        ''
    """
    own = name.removeprefix("rate of ").partition(".")[0]
    known = [q for q in quantities if isinstance(q, (Channel, State))]
    read = [q for q in known if q.display_unit and q.unit != "1"]
    for q in known:
        said = q.display_unit if q.display_unit != q.unit else ""
        if q.name == own and said and same_dimension(unit, q.unit):
            return of_difference(said) if difference else said
        if q.name == own and same_dimension(unit, per(q.unit, "s")):
            alike = {said} if said else {r.display_unit for r in read if r.unit == q.unit}
            agreed = alike.pop() if len(alike) == 1 else q.unit
            return per(of_difference(agreed), "s") if agreed != q.unit else ""
    alike = {q.display_unit for q in read if q.unit == unit} or {
        per(of_difference(q.display_unit), "s")
        for q in read
        if q.display_unit != q.unit and same_dimension(unit, per(q.unit, "s"))
    }
    agreed = alike.pop() if len(alike) == 1 else unit
    return agreed if agreed not in (unit, "1") and of_difference(agreed) == agreed else ""


_POWERS = (0.5, 1, 1.5, 2, 3, -1)
"""Powers of a quantity that laws divide a signal by."""


def combined_unit(unit: str, signal: str, read: str, quantities: Iterable[Quantity]) -> str:
    """Return the unit for reading what a signal is over a power of a quantity; empty if unclear.

    Args:
        unit: SI unit of that, as `per` writes it.
        signal: SI unit of the signal.
        read: Unit in which the signal is read; empty if it is none of its own.
        quantities: Outputs, inputs and states, of which those of one SI unit agree how to read it.

    Example:
        >>> of = [Output("line", "Pa", display_unit="bar"), State("level", "m")]
        >>> [combined_unit(per("m3/s", "Pa", n), "m3/s", "L/min", of) for n in (1, 0.5)]
        ['L/(min bar)', 'L/(min bar^0.5)']
        >>> combined_unit("m2/s", "m3/s", "L/min", of), combined_unit("kg/Pa", "m3/s", "L/min", of)
        ('L/(min m)', '')
        >>> combined_unit("1/s", "kg/s", "g/min", [State("store", "kg", display_unit="mg")])
        ''
    """
    # A time remains one, whatever was divided.
    if not read or {base for base, _ in parse_unit(unit).dimensions} <= {"s"}:
        return ""
    known = list(quantities)
    measured = dict.fromkeys(q.unit for q in known if q.unit != "1")
    found = {
        per(read, declared_unit("", by, known) or by, power)
        for by in dict.fromkeys([*measured, *(per(u, "s") for u in measured)])
        for power in _POWERS
        if per(signal, by, power) == unit
    }
    return found.pop() if len(found) == 1 else ""


@dataclass(frozen=True)
class Parameter(Quantity):
    """A constant of the model, with bounds and where the number comes from.

    Args:
        scale: Typical size, in ``unit``; by default the magnitude of the value.
        value: Nominal value, in ``unit``.
        lower: Smallest plausible value, in ``unit``.
        upper: Largest plausible value, in ``unit``.
        source: Where the number comes from: a document, a measurement, an estimate.
        fixed: Whether refitting leaves it although it is not known, because it scales with others
            or shows in a few moments only: its bounds then widen the intervals of what is refitted.
        setting: Step by which the user of the machine can set it to another value, in ``unit``; 0
            where that is not possible.
        refined: Whether it is refitted although it is not ``fitted``, as soon as the effect that
            it belongs to was found: a detail of its shape.
        strict: Whether beyond its bounds the equations mean something else: no fit widens them.
    """

    value: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    source: str = ""
    fitted: bool = False
    fixed: bool = False
    setting: float = 0.0
    refined: bool = False
    strict: bool = False

    def __post_init__(self) -> None:
        try:
            finite = math.isfinite(self.value)
        except TypeError:
            finite = False
        if not finite:
            raise WorkbenchError(f"value of {self.name} is {self.value!r}; give a finite number")
        if self.scale == 0.0:
            object.__setattr__(self, "scale", abs(self.value) or 1.0)
        super().__post_init__()
        if not self.lower <= self.value <= self.upper:
            suffix = "" if self.unit == "1" else f" {self.unit}"
            raise WorkbenchError(
                f"{self.name} is {self.value:g}{suffix}; the valid range is {self.lower:g} to"
                f" {self.upper:g}{suffix}"
            )

    def with_value(self, value: float) -> Parameter:
        """Return the same parameter, bounds and source kept, with another value, in its unit."""
        return replace(self, value=float(value))
