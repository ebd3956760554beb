"""Units of measurement: parse, check and convert the unit strings of quantities.

A unit is written as the field writes it: ``"N m s/rad"``, ``"m3/(s Pa)"``, ``"mm^2"``, ``"bar"``.
The plane angle counts as a dimension of its own, so that degrees and radians are never mixed up
with plain numbers.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError

Dimensions = tuple[tuple[str, float], ...]
"""Base units with their exponents, in the order of their names: those of the SI, the radian, and
what another field counts in, by its own name. A valve's m3/(s Pa^0.5) has one that is not whole."""


def _dim(**exponents: float) -> Dimensions:
    return tuple(sorted((base, power) for base, power in exponents.items() if power))


_ONE = _dim()
_S = _dim(s=1)
_N = _dim(m=1, kg=1, s=-2)
_PA = _dim(m=-1, kg=1, s=-2)
_J = _dim(m=2, kg=1, s=-2)
_W = _dim(m=2, kg=1, s=-3)

_PREFIXABLE: dict[str, tuple[float, Dimensions]] = {
    "m": (1.0, _dim(m=1)),
    **dict.fromkeys(("l", "L"), (1e-3, _dim(m=3))),
    "g": (1e-3, _dim(kg=1)),
    "s": (1.0, _S),
    "Hz": (1.0, _dim(s=-1)),
    "K": (1.0, _dim(K=1)),
    "A": (1.0, _dim(A=1)),
    "mol": (1.0, _dim(mol=1)),
    "cd": (1.0, _dim(cd=1)),
    "rad": (1.0, _dim(rad=1)),
    "N": (1.0, _N),
    "Nm": (1.0, _J),
    "Pa": (1.0, _PA),
    "bar": (1e5, _PA),
    "J": (1.0, _J),
    "eV": (1.602176634e-19, _J),
    "cal": (4.184, _J),
    "W": (1.0, _W),
    "Wh": (3600.0, _J),
    "V": (1.0, _dim(m=2, kg=1, s=-3, A=-1)),
    **dict.fromkeys(("Ohm", "ohm", "Ω"), (1.0, _dim(m=2, kg=1, s=-3, A=-2))),
    "S": (1.0, _dim(m=-2, kg=-1, s=3, A=2)),
    "H": (1.0, _dim(m=2, kg=1, s=-2, A=-2)),
    "F": (1.0, _dim(m=-2, kg=-1, s=4, A=2)),
    "C": (1.0, _dim(s=1, A=1)),
    "Ah": (3600.0, _dim(s=1, A=1)),
    "Wb": (1.0, _dim(m=2, kg=1, s=-2, A=-1)),
    "T": (1.0, _dim(kg=1, s=-2, A=-1)),
}
_PREFIXES = {
    "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "h": 1e2,
    "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip

# What a prefix and a unit would give is overruled by what has the name: min, h, cd, kn, ft.
_FAHRENHEIT = "Δ°F"
"""A difference by the scale of Fahrenheit."""

_SYMBOLS: dict[str, tuple[float, Dimensions]] = {
    **{f"{p}{u}": (by * size, d) for p, by in _PREFIXES.items() for u, (size, d) in
       _PREFIXABLE.items()},
    **_PREFIXABLE,
    **dict.fromkeys(("1", "-", "count"), (1.0, _ONE)),
    "%": (0.01, _ONE),
    "‰": (1e-3, _ONE),
    "ppm": (1e-6, _ONE),
    "ppb": (1e-9, _ONE),
    **dict.fromkeys(("%RH", "%rH", "vol%"), (0.01, _ONE)),
    "ppmv": (1e-6, _ONE),
    "t": (1e3, _dim(kg=1)),
    "min": (60.0, _S),
    "h": (3600.0, _S),
    **dict.fromkeys(("d", "day"), (86400.0, _S)),
    "week": (7 * 86400.0, _S),
    # Of the Julian calendar, as astronomers count.
    "month": (365.25 / 12 * 86400.0, _S),
    **dict.fromkeys(("year", "yr"), (365.25 * 86400.0, _S)),
    "bpm": (1.0 / 60.0, _dim(s=-1)),
    **dict.fromkeys(("deg", "°"), (math.pi / 180, _dim(rad=1))),
    "mdeg": (math.pi / 180e3, _dim(rad=1)),
    "arcmin": (math.pi / 10800, _dim(rad=1)),
    "arcsec": (math.pi / 648000, _dim(rad=1)),
    **dict.fromkeys(("turn", "rev"), (2 * math.pi, _dim(rad=1))),
    "gon": (math.pi / 200, _dim(rad=1)),
    "rpm": (2 * math.pi / 60, _dim(s=-1, rad=1)),
    "krpm": (2e3 * math.pi / 60, _dim(s=-1, rad=1)),
    "rps": (2 * math.pi, _dim(s=-1, rad=1)),
    # In a compound unit, a degree of a scale is a difference.
    **dict.fromkeys(("degC", "°C"), (1.0, _dim(K=1))),
    **dict.fromkeys(("degF", "°F", _FAHRENHEIT), (5 / 9, _dim(K=1))),
    "Ncm": (1e-2, _J),
    "Nmm": (1e-3, _J),
    "psi": (6894.757293168361, _PA),
    "atm": (101325.0, _PA),
    "mmHg": (133.322387415, _PA),
    "inHg": (3386.389, _PA),
    "cmH2O": (98.0665, _PA),
    "mmH2O": (9.80665, _PA),
    **dict.fromkeys(("inH2O", "inWC"), (249.08891, _PA)),
    **dict.fromkeys(("Torr", "torr"), (101325.0 / 760.0, _PA)),
    "mTorr": (101.325 / 760.0, _PA),
    # A flow of gas as meters of it count: the volume that it would have at standard conditions.
    "sccm": (1e-6 / 60.0, _dim(m=3, s=-1)),
    **dict.fromkeys(("slm", "slpm"), (1e-3 / 60.0, _dim(m=3, s=-1))),
    "gpm": (3.785411784e-3 / 60.0, _dim(m=3, s=-1)),
    **dict.fromkeys(("cfm", "scfm"), (0.028316846592 / 60.0, _dim(m=3, s=-1))),
    "Nl": (1e-3, _dim(m=3)),
    "gal": (3.785411784e-3, _dim(m=3)),
    "bbl": (0.158987294928, _dim(m=3)),
    **{p + a: (f, _W) for p, f in (("", 1.0), ("k", 1e3), ("M", 1e6)) for a in ("VA", "var")},
    "PS": (735.49875, _W),
    "BTU": (1055.05585262, _J),
    **dict.fromkeys(("G", "gauss"), (1e-4, _dim(kg=1, s=-2, A=-1))),
    "Pas": (1.0, _dim(kg=1, m=-1, s=-1)),
    "mPas": (1e-3, _dim(kg=1, m=-1, s=-1)),
    **dict.fromkeys(("in", "inch"), (0.0254, _dim(m=1))),
    "ft": (0.3048, _dim(m=1)),
    "ha": (1e4, _dim(m=2)),
    "nmi": (1852.0, _dim(m=1)),
    "kn": (1852.0 / 3600.0, _dim(m=1, s=-1)),
    "mph": (0.44704, _dim(m=1, s=-1)),
    "gn": (9.80665, _dim(m=1, s=-2)),
    # The steradian of a lumen is no dimension here.
    "lm": (1.0, _dim(cd=1)),
    "lx": (1.0, _dim(cd=1, m=-2)),
    "cP": (1e-3, _dim(m=-1, kg=1, s=-1)),
    "cSt": (1e-6, _dim(m=2, s=-1)),
    # Amount of substance in a litre.
    **{f"{p}M": (1e3 * _PREFIXES[p], _dim(mol=1, m=-3)) for p in "nuµm"},
    "kgf": (9.80665, _N),
    "lb": (0.45359237, _dim(kg=1)),
    "lbf": (4.4482216152605, _N),
    "hp": (745.6998715822702, _W),
}  # fmt: skip

_NAMES = re.compile(r"in|d|C|T|S|G|MA|PS|atm|cal|var|(?!cm|ha|hr|nF|ns|pF)[cdhnp][A-Za-zΩ]")
"""Symbols that end a name more often than they are its unit."""

_SPELLINGS = {
    **dict.fromkeys(("sec", "Sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("mins", "minute", "minutes"), "min"),
    **dict.fromkeys(("hr", "hrs", "hour", "hours"), "h"),
    "days": "d", "weeks": "week", "months": "month", "years": "year",
    "RPM": "rpm", "kph": "km/h", "kmh": "km/h", "lpm": "l/min", "LPM": "l/min",
    "SCCM": "sccm", "SLM": "slm", "SLPM": "slpm", "GPM": "gpm", "CFM": "cfm", "TORR": "Torr",
    **dict.fromkeys(("Kelvin", "kelvin"), "K"), "Celsius": "degC", "Fahrenheit": "degF",
    **dict.fromkeys(("℃", "DEGC", "degc"), "degC"), **dict.fromkeys(("℉", "DEGF", "degf"), "degF"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("newton", "newtons"), "N"), "pascal": "Pa", "Bar": "bar", "BAR": "bar",
    **dict.fromkeys(("volt", "volts", "Volt", "Volts"), "V"),
    **dict.fromkeys(("amp", "amps", "ampere", "Amp", "Amps"), "A"),
    **dict.fromkeys(("degree", "degrees", "Deg", "DEG", "grad", "Grad"), "deg"),
    **dict.fromkeys(("turns", "revs", "revolution", "revolutions", "Umdr"), "turn"),
    **dict.fromkeys(("radian", "radians", "RAD"), "rad"),
    **dict.fromkeys(("liter", "liters", "litre", "litres"), "l"),
    "Upm": "rpm", "knot": "kn", "knots": "kn", "percent": "%",
}  # fmt: skip
"""How loggers and people spell units."""

_WORD = re.compile(r"[A-Za-zµΩΔ°%‰℃℉]+")
_TOKEN = re.compile(
    r"\s*([()/*·]|\.(?!\d)|\^?[-+−]?\d+(?:\.\d+)?|[²³⁻¹]+|(?:cm|mm|in)H2O|[A-Za-zµΩΔ°%‰]+|-)"
)
_SUPERSCRIPTS = str.maketrans("²³⁻¹−", "23-1-")
_SCALES = {
    **dict.fromkeys(("degC", "°C", "celsius"), (1.0, 273.15)),
    **dict.fromkeys(("degF", "°F", "fahrenheit"), (5 / 9, 459.67 * 5 / 9)),
}
"""Temperature scales: the size of a degree and the zero, in K."""


@dataclass(frozen=True)
class Unit:
    """A unit of measurement: SI value = value * factor + offset.

    Args:
        factor: Size of the unit in SI base units.
        dimensions: Base units with their exponents.
        offset: SI value of zero in this unit; non-zero for temperature scales only.
    """

    text: str
    factor: float
    dimensions: Dimensions
    offset: float = 0.0


def _combine(a: Dimensions, b: Dimensions, power: float) -> Dimensions:
    found = dict(a)
    for base, exponent in b:
        found[base] = found.get(base, 0) + power * exponent
    return _dim(**found)


def _parts(token: str) -> tuple[str, ...]:
    """Split what was written without spaces, such as ``Nms``, into known units."""
    for end in range(1, len(token) + 1):
        if token[:end] in _SYMBOLS and token[:end] != "-":
            rest = _parts(token[end:])
            if rest or end == len(token):
                return (token[:end], *rest)
    return ()


def _unknown(text: str, token: str) -> WorkbenchError:
    return WorkbenchError(
        f"unit {text!r} cannot be read at {token!r}; write symbols, joined by spaces and /, with"
        " their powers behind them, such as 'N m s/rad' or 'mU/(l min^2)'"
    )


def strangers(text: str) -> tuple[str, ...]:
    """Return the words of a unit that are no symbols known here, each with what may be meant.

    Example:
        >>> strangers("mU/l"), strangers("Nms/rad"), strangers("kW")
        (("'mU'",), ("'Nms' (did you mean 'N m s'?)",), ())
    """
    found, symbols = [], in_symbols(text.strip())
    plain = symbols in ("", "-", *_SCALES)
    for token in dict.fromkeys(symbol for symbol, _ in ([] if plain else powers(symbols))):
        if token in _SYMBOLS:
            continue
        typed = difflib.get_close_matches(token, _SYMBOLS, n=1, cutoff=0.85)
        meant = "".join(typed) or " ".join(_parts(token))
        found.append(f"{token!r}" + f" (did you mean {meant!r}?)" * bool(meant))
    return tuple(found)


def refuse_slips(text: str) -> None:
    """Refuse what cannot be read as a unit, or is most likely a slip of the pen.

    Raises:
        WorkbenchError: With what is most likely meant.
    """
    parse_unit(text)
    for word in strangers(text):
        if "did you mean" in word:
            raise WorkbenchError(f"unit {text!r} has the unknown part {word}")


def is_known(text: str) -> bool:
    """Tell whether a text is a unit of which every symbol is known here.

    Example:
        >>> is_known("l/min"), is_known("mU/min"), is_known("(")
        (True, False, False)
    """
    try:
        parse_unit(text)
        return not strangers(text)
    except (WorkbenchError, OverflowError, ZeroDivisionError):
        return False


def _symbol(word: str) -> str:
    """Return the symbol of a word for a unit; what is no short symbol may be in capitals."""
    return _SPELLINGS.get(word) or (len(word) > 3 and _SPELLINGS.get(word.lower())) or word


@lru_cache(maxsize=4096)
def in_symbols(text: str) -> str:
    """Return a unit with words for units replaced by their symbols.

    Example:
        >>> in_symbols("meters/sec"), in_symbols("deg C"), in_symbols("U/min"), in_symbols("Nm3/h")
        ('m/s', 'degC', 'rpm', 'm3/h')
    """
    # A letter alone is as often a name: a voltage, a radius.
    text = re.sub(r"^(U|r|tr)/min$", "rpm", text)
    # A cubic metre at standard conditions, not newtons.
    text = re.sub(r"^Nm(3|³|\^3)(?=/)", "m3", text)
    symbols = _WORD.sub(lambda m: _symbol(m.group()), text)
    return re.sub(r"(deg|°)\s+(deg)?(?=[CF]$)", r"\1", symbols)


def powers(text: str) -> list[tuple[str, float]]:
    """Take a unit apart: its symbols in order, each with its power.

    Example:
        >>> powers("m3/(s Pa)"), powers("-")
        ([('m', 3), ('s', -1), ('Pa', -1)], [])
    """
    found: list[tuple[str, float]] = []
    if text.strip() in ("", "-"):
        return found
    position, sign, group, raised = 0, 1, [1], True
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise _unknown(text, text[position:])
        token, position = match.group(1), match.end()
        if token in "*·.":
            continue
        if token == "/":
            sign = -1
        elif token == "(":
            group.append(group[-1] * sign)
            sign = 1
        elif token == ")":
            if len(group) == 1:
                raise _unknown(text, ")")
            group.pop()
            sign = 1
        elif (token in _SYMBOLS and token != "-") or _WORD.fullmatch(token):
            found.append((token, group[-1] * sign))
            sign, raised = 1, False
        else:
            digits = token.lstrip("^").translate(_SUPERSCRIPTS)
            if raised or not digits.lstrip("+-").replace(".", "", 1).isdigit():
                raise _unknown(text, token)
            symbol, power = found[-1]
            found[-1] = (symbol, power * (float(digits) if "." in digits else int(digits)))
            raised = True
    if len(group) != 1:
        raise _unknown(text, "(")
    return found


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """Return the unit that a text says, with its factor to SI and its dimensions.

    A word that is not known is a base unit by its own name.

    Args:
        text: Unit such as ``"N m s/rad"``; ``""``, ``"1"`` and ``"-"`` mean dimensionless.

    Example:
        >>> unit = parse_unit("mU m/(s Pa)")
        >>> unit.factor, unit.dimensions
        (1.0, (('kg', -1), ('m', 2), ('mU', 1), ('s', 1)))
    """
    # Micro and ohm have two signs each that look alike.
    stripped = in_symbols(text.strip()).replace("\u03bc", "\u00b5").replace("\u2126", "\u03a9")
    if stripped in ("", "1", "-"):
        return Unit(text, 1.0, _ONE)
    if stripped in _SCALES:
        degree, zero = _SCALES[stripped]
        return Unit(text, degree, _dim(K=1), zero)
    factor, dimensions = 1.0, _ONE
    for symbol, power in powers(stripped):
        size, dims = _SYMBOLS.get(symbol) or (1.0, ((symbol, 1),))
        factor, dimensions = factor * size**power, _combine(dimensions, dims, power)
    return Unit(text, factor, dimensions)


_PLAIN = ("V", "Ohm", "W", "J", "N", "Pa", "F", "H")


def in_si(unit: str) -> str:
    """Return the unit of the SI that measures what a unit does.

    Example:
        >>> in_si("mg/dl"), in_si("1/min"), in_si("kW/m2"), in_si("bar"), in_si("%")
        ('kg/m3', '1/s', 'kg/s3', 'Pa', '1')
        >>> in_si("nm/V"), in_si("K/kW"), in_si("mV s"), in_si("Nm/A2")
        ('m/V', 'K/W', 'V s', 'H')
    """
    dimensions = parse_unit(unit).dimensions
    of = {plain: parse_unit(plain).dimensions for plain in _PLAIN}
    if dimensions in of.values():
        return next(plain for plain, own in of.items() if own == dimensions)
    # What is electric or thermal and holds one by its name is shorter than what spells it out.
    named = {base for base, _ in dimensions} & {"A", "K"}
    ways = [
        _combine(_combine(dimensions, own, -power), ((plain, 1),), power)
        for plain, own in (of.items() if named else ())
        for power in (1, -1)
    ]
    ways = [dimensions, *(way for way in ways if not any(base == "kg" for base, _ in way))]
    return _written(min(ways, key=_size))


def _size(dimensions: Dimensions) -> float:
    return sum(abs(power) for _, power in dimensions)


def _written(dimensions: Dimensions) -> str:
    above = [f"{base}{power if power != 1 else ''}" for base, power in dimensions if power > 0]
    below = [f"{base}{-power if power != -1 else ''}" for base, power in dimensions if power < 0]
    text = " ".join(above) or "1"
    if below:
        text += f"/({' '.join(below)})" if len(below) > 1 else f"/{below[0]}"
    return text


Values = TypeVar("Values", float, npt.NDArray[np.float64])


def convert(values: Values, from_unit: str, to_unit: str) -> Values:
    """Convert values to another unit, ``to_unit``, of the same dimension.

    Args:
        values: Number or array, in ``from_unit``.

    Example:
        >>> convert(6.0, "bar", "kPa")
        600.0
        >>> convert(20.0, "degC", "K")
        293.15
    """
    source, target = parse_unit(from_unit), parse_unit(to_unit)
    if source.dimensions != target.dimensions:
        raise WorkbenchError(
            f"{from_unit!r} cannot be converted to {to_unit!r}: they measure different things"
        )
    if source.offset == target.offset:
        return values * (source.factor / target.factor)
    return (values * source.factor + source.offset - target.offset) / target.factor


def to_si(values: Values, unit: str) -> Values:
    """Convert a number or an array from a unit to the SI unit of the same dimension."""
    parsed = parse_unit(unit)
    return values * parsed.factor + parsed.offset


def from_si(values: Values, unit: str) -> Values:
    """Convert a number or an array from SI to a unit of the same dimension."""
    parsed = parse_unit(unit)
    return (values - parsed.offset) / parsed.factor


def same_dimension(unit: str, *others: str) -> bool:
    """Tell whether a unit measures what one of others does, so that it can be converted to that.

    Example:
        >>> same_dimension("N m", "kN mm"), same_dimension("rad", "1", "kg")
        (True, False)
    """
    dimensions = parse_unit(unit).dimensions
    return any(parse_unit(other).dimensions == dimensions for other in others)


def ends_a_name(symbol: str) -> bool:
    """Tell whether a symbol at the end of a name is rather a part of it than its unit.

    Such are an inflow ``T_in``, a desired value ``x_d``, a vessel ``p_C``, a difference ``x_dT``.

    Example:
        >>> [ends_a_name(s) for s in ("in", "nm", "cm", "kn")]
        [True, True, False, False]
    """
    return _NAMES.fullmatch(symbol) is not None


_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")
_EXAMPLES = {"deg": "30", "kg": "3", "bar": "3", "s": "5", "V": "5.5"}


def of_difference(unit: str) -> str:
    """Return the unit of a difference: where a unit has a zero of its own, its degree without it.

    Example:
        >>> of_difference("degC"), of_difference("degF"), of_difference("deg")
        ('K', 'Δ°F', 'deg')
    """
    parsed = parse_unit(unit)
    if not parsed.offset:
        return unit
    return "K" if parsed.factor == 1.0 else _FAHRENHEIT


def quantity(name: str, given: object, unit: str, *, difference: bool = False) -> float:
    """Read a value such as ``30``, ``"30deg"`` or ``"0.5 rad"`` in ``unit``.

    Args:
        name: What the value is, as the user knows it.
        given: Number, or text with or without a unit; without one, ``unit`` is meant.
        difference: Whether it is a difference, of which the zero of a scale is no part.

    Example:
        >>> quantity("mean pressure", "300kPa", "bar"), quantity("load", 3, "kg")
        (3.0, 3.0)
    """
    shown = "" if unit in ("", "1", "-") else unit
    example = "give a number"
    if shown:
        example += f" with or without a unit, such as '{_EXAMPLES.get(unit, '1')}{unit}'"
    number = isinstance(given, (int, float)) and not isinstance(given, bool)
    match = _NUMBER.fullmatch(str(given)) if number or isinstance(given, str) else None
    if match is None:
        finite = str(given).strip().lower().lstrip("+-") not in ("nan", "inf", "infinity")
        what = "is not a number" if finite else "is not a finite number"
        raise WorkbenchError(f"{name} {given!r} {what}; {example}")
    value = float(match[1])
    if not math.isfinite(value):
        raise WorkbenchError(f"{name} {given!r} is not a finite number; {example}")
    if not match[2]:
        return value
    refuse_slips(match[2])
    if not same_dimension(match[2], unit):
        raise WorkbenchError(
            f"{name} {given!r} has the unit {match[2]!r}, which does not measure it; {example}"
        )
    if difference:
        size = value * parse_unit(match[2]).factor / parse_unit(unit).factor
    else:
        size = convert(value, match[2], unit)
    # Through decimal text, so that 300 kPa becomes 3 bar and not 3 bar less a rounding.
    return float(f"{size:.12g}")


def named_value(what: str, text: str) -> tuple[str, str]:
    """Return name and value of what is written as ``NAME=VALUE``.

    Example:
        >>> named_value("parameter", "mass = 3 kg")
        ('mass', '3 kg')
    """
    name, sign, value = (part.strip() for part in text.partition("="))
    if not name or not sign:
        raise WorkbenchError(f"{what} {text!r} has no value; write it as NAME=VALUE")
    return name, value


def written_unit(unit: str) -> str:
    """Return a unit as an engineer writes it in a text; empty for a ratio.

    Example:
        >>> [written_unit(u) for u in ("Pa^-1", "m3/(s Pa)", "cmH2O/s2", "deg", "degC", "1")]
        ['1/Pa', 'm³/(s Pa)', 'cmH2O/s²', '°', '°C', '']
    """
    if unit in ("1", "-"):
        return ""
    inverse = re.fullmatch(r"([A-Za-z]+)\^?-1", unit)
    if inverse is not None:
        return f"1/{inverse[1]}"
    raised = re.sub(r"(?<=[A-Za-z])\^?(-?\d+)(?![.\w])", lambda m: m[1].translate(RAISED), unit)
    return re.sub(r"\bdeg(?=[CF]?\b)", "°", raised)


RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


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


def shown_unit(unit: str) -> str:
    """Return the unit in which people read a quantity that says nothing else."""
    return "bar" if unit == "Pa" else unit


def with_unit(number: str, unit: str) -> str:
    """Write a number with its unit behind it, as an engineer does; alone for a ratio.

    Example:
        >>> with_unit("30", "deg"), with_unit("1.2", "m/s2"), with_unit("0.5", "1")
        ('30°', '1.2 m/s²', '0.5')
    """
    written = written_unit(unit)
    return f"{number}{written}" if written[:1] == "°" else f"{number} {written}".rstrip()


_TIMES = (
    ("d", 86400.0, 2 * 86400.0, 10 * 86400.0),
    ("h", 3600.0, 3600.0, 7200.0),
    ("s", 1.0, 1.0, 0.1),
    ("ms", 1e-3, 1e-3, 1e-4),
    ("µs", 1e-6, 1e-6, 1e-7),
    ("ns", 1e-9, 0.0, 0.0),
)
"""Units of time, their sizes in s, and the least time, in s, that is written in each: alone, and as
the longest of several."""


def in_time(seconds: float, digits: int = 3) -> str:
    """Write a time, in s, in the unit that suits it, from nanoseconds to days.

    Example:
        >>> [in_time(t) for t in (2e-7, 0.0123, 0.9999, 520.0, 7200.0, -4e5, math.inf)]
        ['200 ns', '12.3 ms', '1 s', '520 s', '2 h', '-4.63 d', 'inf s']
    """
    if not seconds or not math.isfinite(seconds):
        return f"{seconds:g} s"
    # Rounded first: 0.9999 s is 1 s rather than 1000 ms.
    seconds = float(f"{seconds:.{digits}g}")
    size = abs(seconds)
    unit, factor = next((unit, s) for unit, s, least, _ in _TIMES if size >= least)
    return f"{float(f'{seconds / factor:.{digits}g}'):.10g} {unit}"


def time_unit(longest: float) -> tuple[str, float]:
    """Return the unit in which people read times up to the longest, in s, and its size in s.

    Example:
        >>> time_unit(0.025), time_unit(520.0), time_unit(5e4), time_unit(6e6)
        (('ms', 0.001), ('s', 1.0), ('h', 3600.0), ('d', 86400.0))
    """
    size = abs(longest) or 1.0
    return next((unit, s) for unit, s, _, least in _TIMES if not size < least)


def in_times(times: Sequence[float], digits: int = 3) -> tuple[list[str], str]:
    """Write times, in s, as numbers of the unit that suits the longest, and return that unit.

    Example:
        >>> in_times([0.0, 6090.0]), in_times([6090.0, 51800.0]), in_times([8e-4, 0.021])
        ((['0', '6090'], 's'), (['1.69', '14.4'], 'h'), (['0.8', '21'], 'ms'))
    """
    unit, size = time_unit(max(map(abs, times), default=0.0))
    return [f"{float(f'{t / size:.{digits}g}'):.10g}" for t in times], unit


def in_range(values: Sequence[float], digits: int = 3) -> list[str]:
    """Write numbers that stand in one range; one so far below the largest that it is none is 0.

    Args:
        values: Numbers in one unit.
        digits: Significant digits of each.

    Example:
        >>> in_range([-1.2e5, -40471.0, 0.0]), in_range([-0.00317, 5.63])
        (['-120000', '-40500', '0'], ['0', '5.63'])
    """
    largest = max(map(abs, values), default=0.0)
    kept, least = 10 if largest < 1e6 else digits, 10.0**-digits * largest
    return ["0" if abs(v) <= least else f"{float(f'{v:.{digits}g}'):.{kept}g}" for v in values]


SPEEDS = ("m/s", "rad/s")
"""Units of how fast a body moves."""

_READABLE: dict[str, tuple[str, float, float]] = {
    "rad": ("°", 180.0 / math.pi, 1e4),
    "rad/s": ("°/s", 180.0 / math.pi, 1e4),
    "rad/s2": ("°/s²", 180.0 / math.pi, 1e4),
    "Pa": ("bar", 1e-5, 1e-3),
    "kg/s": ("g/s", 1e3, 1e3),
    "m3": ("cm³", 1e6, 1e4),
    "Pa/s": ("bar/s", 1e-5, 1e-3),
    "m": ("mm", 1e3, 1e3),
    "m/s": ("mm/s", 1e3, 1e3),
}
"""Unit in which people read one of the SI, its factor, and the number from which on, or up to which
if the unit is larger, nobody does."""


def readable(unit: str, size: float = 0.0) -> tuple[str, float]:
    """Return the unit in which people read a quantity, and the factor from its SI unit to it.

    Args:
        size: How large it is, in SI; not known if 0.

    Example:
        >>> readable("Pa"), readable("N m"), readable("m", 0.02), readable("m", 300.0)
        (('bar', 1e-05), ('N m', 1.0), ('mm', 1000.0), ('m', 1.0))
    """
    plain = written_unit(unit) or unit
    written, factor, end = _READABLE.get(unit, (plain, 1.0, 0.0))
    shown = factor * abs(size)
    far = shown >= end if factor > 1.0 else 0.0 < shown < end
    return (plain, 1.0) if far else (written, factor)


def readably(
    values: Values, unit: str, shown: str = "", size: float | None = None
) -> tuple[Values, str]:
    """Return values, in SI, as people read them, and the unit: ``shown`` if it is declared.

    Args:
        size: How large they are, in SI; the largest of them if None, not known if 0.

    Example:
        >>> readably(4.5e5, "Pa"), readably(0.25, "m3", "l"), readably(293.15, "K", "degC")
        ((4.5, 'bar'), (250.0, 'l'), (20.0, '°C'))
    """
    if shown:
        return from_si(values, shown), written_unit(shown) or "1"
    if size is None:
        size = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
    written, factor = readable(unit, size)
    return factor * values, written


def read_with_deviation(
    value: float, std: float, unit: str, shown: str = "", size: float | None = None
) -> tuple[float, float, str]:
    """Return a value and its standard deviation, in SI, as people read them, and the unit.

    Example:
        >>> read_with_deviation(293.15, 2.0, "K", "degC"), read_with_deviation(4e5, 1e4, "Pa")
        ((20.0, 2.0, '°C'), (4.0, 0.1, 'bar'))
    """
    size = abs(value) if size is None else size
    number, written = readably(value, unit, shown, size)
    return number, readably(std, unit, of_difference(shown), size)[0], written
