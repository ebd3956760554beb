"""Names and units out of column headers: ``pressure_1_bar``, ``angle [deg]``, ``t / ms``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from workbench.model.units import ends_a_name, in_symbols, is_known
from workbench.recordings.quantity_kinds import kind_of

_REFERENCES = {
    "abs": "absolute", "absolute": "absolute", "a": "absolute",
    "gauge": "gauge", "g": "gauge", "rel": "gauge", "relative": "gauge",
}  # fmt: skip
_BRACKETS = re.compile(r"^(?P<name>.*?)[\s_]*[\[(<{](?P<unit>[^\])>}]*)[\])>}]\s*$")
_NESTED = re.compile(
    r"^(?P<name>[^(\[]*\S)[\s_]*[(\[](?P<unit>[^()\[\]]*\([\w\s/*·^-]+\)[^()\[\]]*)[)\]]\s*$"
)
_SLASH = re.compile(r"^(?P<name>.*\S)\s+/\s*(?P<unit>\S.*)$")
_TIGHT_SLASH = re.compile(r"^(?P<name>[^/]*\w)/(?P<unit>\S+)$")
TOPIC = re.compile(r"^/((?:[^/\[(]*/)*)")
"""What stands before the last word of a topic, ``/drive/state/speed``, as robots log them."""
# Symbols that are as often the name of a chamber, an axis or a constant as a unit.
_AMBIGUOUS = {
    "A", "F", "H", "K", "J", "W", "N", "L", "h", "t", "g", "l", "m", "s", "count", "turn",
}  # fmt: skip
# Words that stand below the line of a unit: "g_l" is in g/l, but "kW_h" in kW h.
_BELOW = ("s", "s2", "min", "h", "l", "m3", "abs", "gauge")
DEGREES = {"C": "degC", "F": "degF"}
"""What coulombs and farads are where a temperature is meant."""
_PRESSURE = re.compile(
    r"(bar|mbar|kPa|MPa|hPa|Pa|psi)[\s_(]*(abs|absolute|gauge|rel|relative|a|g)\)?", re.IGNORECASE
)
"""``bara``, ``barg``, ``bar(g)``, ``bar abs``, ``psig``."""
_ACCELERATION = re.compile(r"(.*[^A-Za-z])?acc(?!u|ep|es)", re.IGNORECASE)
_TEMPERATURE = re.compile(r"[Tt](?![A-Za-z])|.*temp", re.IGNORECASE)
_MEANING = {
    "pressure": "Pa", "angle": "rad", "torque": "N m", "force": "N", "temperature": "K",
    "voltage": "V", "time": "s", "mass": "kg",
}  # fmt: skip


@dataclass(frozen=True)
class Header:
    """A column header taken apart.

    Args:
        unit: The unit; ``""`` if none is stated.
        reference: ``gauge``, ``absolute`` or ``""`` (pressures).
        stated: The unit as it stands there, where it is not known.
    """

    column: str
    name: str
    unit: str = ""
    reference: str = ""
    stated: str = ""

    @property
    def problem(self) -> str:
        """What is wrong with the unit; ``""`` if nothing is."""
        return f"unit {self.stated!r} is not known" if self.stated else ""


def tidy_name(text: str) -> str:
    """Return a name of letters, digits and underscores.

    Example:
        >>> tidy_name("Spool Pos.")
        'Spool_Pos'
    """
    return re.sub(r"\W+", "_", text.strip()).strip("_")


def is_temperature(name: str) -> bool:
    """Tell whether a name is that of a temperature."""
    return _TEMPERATURE.match(name) is not None


def unit_of_time(name: str) -> str:
    """Return the unit that a name is by itself, such as ``ms`` or ``minutes``; else nothing.

    A single letter, as often that of a path or a height, is none.

    Example:
        >>> unit_of_time("Minutes"), unit_of_time("h"), unit_of_time("time")
        ('min', '', '')
    """
    unit = _known(name.lower()) if len(name) > 1 else None
    return unit if unit is not None and kind_of(unit).name == "time" else ""


@lru_cache(maxsize=4096)
def _known(unit: str) -> str | None:
    text = in_symbols(unit.strip())
    return text if is_known(text) else None


def read_unit(text: str) -> tuple[str | None, str]:
    """Return the unit a text states, and the reference of a pressure.

    Args:
        text: Text such as ``sec``, ``barg`` or ``deg/s``.

    Returns:
        The unit as `workbench.model.units` spells it (None if unknown) and ``gauge``,
        ``absolute`` or ``""``.

    Example:
        >>> read_unit("sec"), read_unit("barg"), read_unit("furlong")
        (('s', ''), ('bar', 'gauge'), (None, ''))
    """
    match = _PRESSURE.fullmatch(text.strip())
    known = match and (_known(match[1]) or _known(match[1].lower()))
    return (known, _REFERENCES[match[2].lower()]) if match and known else (_known(text), "")


def _fits(name: str, unit: str) -> bool:
    """Tell whether a trailing symbol is a unit, given what the name says it measures."""
    if unit not in _AMBIGUOUS:
        return True
    for word, expected in _MEANING.items():
        if word in name.lower():
            return kind_of(unit) == kind_of(expected)
    return True


def _suffix(column: str) -> tuple[str, str, str] | None:
    """Split ``name_unit``, the unit being one to three words joined by underscores."""
    words = re.split(r"[_\s]+", column)
    for count in (3, 2, 1):
        if len(words) <= count:
            continue
        name, tail = "_".join(words[:-count]), words[-count:]
        if any(ends_a_name(w) or not re.search("[A-Za-zµΩ°%]", w) for w in tail):
            continue
        spellings = [" ".join(tail)]
        if count > 1:
            spellings = ["/".join(w for w in tail if w != "per"), *spellings, "_".join(tail)]
        below = in_symbols(tail[-1]) in _BELOW and not (
            tail[-1] == "h" and tail[0].endswith(("W", "A"))
        )
        if count > 1 and "per" not in tail and not below:
            spellings = spellings[1:]
            small = tail[0] in _AMBIGUOUS and tail[0].islower()
            if small or len({in_symbols(w) == w for w in tail}) > 1:
                # Nobody multiplies a symbol by a word, or metres by what follows: "U_amp_V" is the
                # voltage of an amplifier, "tau_m_Nm" the torque of a motor.
                continue
        for spelling in spellings:
            unit, reference = read_unit(spelling)
            if unit is not None and tidy_name(name) and _fits(name, unit):
                return name, unit, reference
    return None


def _quotient(column: str) -> tuple[str, str, str] | None:
    """Split ``Time/ms``, ``flow_l/min``; a unit as a whole, such as ``m/s``, names nothing."""
    for sign in " _":
        name, _, last = column.rpartition(sign)
        above = last.partition("/")[0]
        if not name or above == last or not (known := _known(last)):
            continue
        # "P_A/bar" is the pressure of a chamber A, and "p_1/bar" the first one.
        unclear = sign == "_" and (above in _AMBIGUOUS or above == "1")
        if not unclear or kind_of(known).name not in (kind_of(known).unit, "dimensionless"):
            return name, known, ""
    match = _TIGHT_SLASH.match(column)
    if match is None or (_known(column) is not None and match["name"] != "t"):
        return None
    unit, reference = read_unit(match["unit"])
    symbol = len(match["name"]) == 1
    if unit is None or not (symbol or _fits(match["name"], unit)):
        return None
    return match["name"], unit, reference


def read_header(column: str) -> Header:
    """Take a column header apart: name, unit and, for pressures, the reference.

    Example:
        >>> header = read_header("pressure_1_bar")
        >>> header.name, header.unit
        ('pressure_1', 'bar')
        >>> read_header("Supply [barg]").reference
        'gauge'
    """
    text = column.strip().strip('"').strip()
    text = TOPIC.sub(lambda m: m[1].replace("/", "."), text)
    match = _NESTED.match(text) or _BRACKETS.match(text) or _SLASH.match(text)
    if match is not None and match.group("name").strip():
        name, stated = match.group("name"), match.group("unit")
        unit, reference = read_unit(stated)
        if unit is not None:
            # Nobody means coulombs by "T [C]".
            unit = DEGREES.get(unit, unit) if is_temperature(name) else unit
            return _with_reference(column, name, unit, reference)
        if re.fullmatch(r"[\d\s]*", stated) is None:
            return Header(column, tidy_name(name), stated=stated.strip())
    found = _quotient(text) or _suffix(text)
    if found is not None:
        return _with_reference(column, *found)
    return _with_reference(column, text, "", "")


def _with_reference(column: str, name: str, unit: str, reference: str) -> Header:
    # Nobody weighs an acceleration.
    unit = "gn" if unit == "g" and _ACCELERATION.match(name) else unit
    words = tidy_name(name).split("_")
    for word in words[1:]:
        if word.lower() in ("abs", "absolute", "gauge", "rel"):
            rest = "_".join(w for w in words if w != word)
            return Header(column, rest, unit, reference or _REFERENCES[word.lower()])
    return Header(column, tidy_name(name) or "column", unit, reference)
