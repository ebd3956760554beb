"""The signals somebody wants from a file, and which column each of them is."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from workbench.errors import WorkbenchError
from workbench.model import Input, Output
from workbench.model.units import is_known, parse_unit, same_dimension
from workbench.recordings.headers import DEGREES, TOPIC, Header, is_temperature, read_header
from workbench.recordings.recording import Role

_SYNONYMS = {
    word: words[0]
    for words in (
        ("angle", "theta", "phi", "jointangle", "winkel", "q", "alpha"),
        ("position", "x", "y", "displacement", "pos", "stroke", "weg", "qm"),
        ("speed", "velocity", "omega", "v", "angularspeed", "geschwindigkeit", "drehzahl"),
        ("valve", "u", "command", "valvecommand", "valvevoltage", "input", "ventil", "control"),
        ("pressure", "p", "druck"),
        (
            "time", "t", "timestamp", "zeit", "elapsed", "elapsedtime", "tiempo", "temps", "date",
            "datum", "datetime", "clock", "uhrzeit", "tout", "stamp", "epoch",
        ),
    )
    for word in words
}  # fmt: skip
"""What a name stands for, by the name without underscores."""

_COMMANDS = {
    "command", "cmd", "valve", "u", "control", "vir", "pump", "pwm", "duty", "ventil", "pulses",
}  # fmt: skip
_ALONE = {"command": {"u", "input"}, "measurement": {"y", "output"}}
"""What the only command and the only measurement of a plant are called whatever they are."""

_LETTERS = (
    ("K", "T"), ("Pa", "pP"), ("V", "UV"), ("A", "I"), ("N", "F"), ("m3/s", "Q"), ("kg/s", "m"),
    ("W", "P"), ("N m", "MT"), ("rad/s", "nw"),
)  # fmt: skip
"""Letters that stand for what is measured in a unit."""

_REFERENCES = {
    "reference", "ref", "setpoint", "goal", "target", "desired", "demand", "soll", "qg", "sp",
}  # fmt: skip


@dataclass(frozen=True)
class Requested:
    """A signal that a model or a caller asks for.

    Args:
        unit: Unit of the same dimension as the column must have; ``""`` for any.
        role: Role the signal gets; ``""`` to guess it from the name.
        display_unit: Unit in which people read it; ``""`` for the column's.
        stated: Unit in which numbers count that state none; ``""`` for that of the SI.
        begins: What it is where the plant begins, in SI; NaN if nobody knows.
        reference: From where the plant counts a pressure, ``gauge`` or ``absolute``; ``""`` if it
            does not show.
    """

    name: str
    unit: str = ""
    role: Role | str = ""
    display_unit: str = ""
    optional: bool = False
    stated: str = ""
    begins: float = math.nan
    reference: str = ""


def _requested(
    q: Input | Output, role: Role, begins: Mapping[str, float], reference: str
) -> Requested:
    shown = "" if q.display_unit == q.unit else q.display_unit
    first = begins.get(q.name, math.nan)
    counts = _reference(q, first) or reference if same_dimension(q.unit, "Pa") else ""
    return Requested(q.name, q.unit, role, shown, stated=q.stated, begins=first, reference=counts)


AMBIENT_PA = 101325.0
_ABOUT_PA = 0.05 * AMBIENT_PA
"""Distance from the ambient pressure of what somebody writes for it, such as 1 bar."""


def _reference(q: Input | Output, begins: float) -> str:
    """Return from where a plant counts a pressure, by its range and by where it begins."""
    if abs(begins - AMBIENT_PA) < _ABOUT_PA or q.lower > 0.5 * AMBIENT_PA:
        return "absolute"
    return "gauge" if -math.inf < q.lower < 0.0 else ""


def _at_first(model: Any) -> dict[str, float]:
    """Return temperatures and pressures with which a model begins, by name, in SI."""
    at = [
        q.name
        for q in (*model.inputs, *model.outputs)
        if same_dimension(q.unit, "K") or same_dimension(q.unit, "Pa")
    ]
    if not (at and hasattr(model, "initial_state")):
        return {}
    u = model.nominal_input
    try:
        values = (*u, *model.read(model.initial_state(), u))
    except WorkbenchError:
        # It begins nowhere.
        return {}
    each = zip((*model.inputs, *model.outputs), values, strict=True)
    return {q.name: float(value) for q, value in each if q.name in at}


def requested_signals(signals: Any) -> tuple[Requested, ...]:
    """Return what is asked for, from names, from names with units, or from a model.

    Args:
        signals: None, names, a mapping from name to unit, or an object with ``inputs`` and
            ``outputs`` (such as a `workbench.model.model.Model`), whose inputs are commands.
    """
    if signals is None:
        return ()
    if isinstance(signals, tuple) and all(isinstance(s, Requested) for s in signals):
        return signals
    if hasattr(signals, "inputs") and hasattr(signals, "outputs"):
        check_own_columns(signals)
        begins = _at_first(signals)
        roles: list[tuple[Any, Role]] = [(q, "command") for q in signals.inputs]
        roles += [(q, "measurement") for q in signals.outputs]
        told = {_reference(q, begins[q.name]) for q, _ in roles if q.name in begins}
        # What tells nothing by itself, such as a supply, is counted as the others are.
        usual = "absolute" if "absolute" in told and "gauge" not in told else ""
        return tuple(_requested(q, role, begins, usual) for q, role in roles)
    if isinstance(signals, Mapping):
        for unit in signals.values():
            parse_unit(unit)
        return tuple(Requested(str(name), unit) for name, unit in signals.items())
    if isinstance(signals, str) or not isinstance(signals, Iterable):
        raise WorkbenchError(
            f"signals is {signals!r}; give a list of names, a mapping from name to unit, or a model"
        )
    return tuple(Requested(str(name)) for name in signals)


def check_own_columns(model: Any) -> None:
    """Check that what shares a name, of which a recording has one column, is one signal.

    Raises:
        WorkbenchError: If an output has the name of an input that it does not read.
    """
    for name in getattr(model, "shadowed", ()):
        raise WorkbenchError(
            f"{name!r} is an input of {model.name!r} and an output that does not read it, and a"
            f" recording has one column of a name; rename one of them, as to {name}_command"
        )


def driven_by(model: Any) -> tuple[Requested, ...]:
    """Return what a recording of a model holds: all its inputs, and measured outputs."""
    return tuple(replace(w, optional=w.role == "measurement") for w in requested_signals(model))


def guess_role(name: str) -> Role:
    """Guess from its name whether a signal is a command, a reference or a measurement.

    Example:
        >>> guess_role("valve"), guess_role("goal_position"), guess_role("angle")
        ('command', 'reference', 'measurement')
    """
    words = set(re.split(r"[_\s.]+", name.lower()))
    if words & _REFERENCES:
        return "reference"
    # "input" alone is a command; "input_volts" is as often a measurement of the supply.
    return "command" if words & _COMMANDS or words == {"input"} else "measurement"


def _plain(text: str) -> str:
    return re.sub(r"[\W_]+", "", text).lower()


def is_time(header: Header) -> bool:
    """Tell whether a column is the time by its name."""
    right_unit = not header.unit or same_dimension(header.unit, "s")
    return right_unit and _SYNONYMS.get(_plain(header.name)) == "time"


def _meaning(name: str) -> tuple[str, str]:
    """Return what a name stands for, and its number: ``p_1``, ``pa`` and ``pressure1`` agree."""
    plain = _plain(name)
    ends = re.fullmatch(r"(.+?)(\d+|[ab])", plain)
    parts = [
        (plain, ""),
        *([(ends[1], {"a": "1", "b": "2"}.get(ends[2], ends[2]))] if ends else []),
    ]
    return next(((_SYNONYMS[s], number) for s, number in parts if s in _SYNONYMS), (plain, ""))


def _same(requested: Requested, header: Header) -> int:
    """Return how well a name fits: 0 not at all, 1 a synonym, 2 the name itself."""
    if _plain(requested.name) in (_plain(header.name), _plain(header.column)):
        return 2
    # Of a signal in a group, as "drive.speed" or "/drive/speed", the last word is its name.
    inside = read_header(TOPIC.sub("", header.column).rsplit(".", 1)[-1]).name
    return int(_meaning(requested.name) in (_meaning(header.name), _meaning(inside)))


def _words(name: str) -> set[str]:
    return {w for w in re.split(r"[\W_]+", name.lower()) if w}


def _parts(name: str) -> set[str]:
    """Return the words and numbers of a name: ``heat1`` has two, as ``heater 1`` has."""
    return set(re.findall(r"[^\W\d_]+|\d+", name.lower()))


def _partly(requested: Requested, header: Header) -> bool:
    """Tell whether a header says a name among other words.

    Or begins to: ``rotor speed`` is ``n_rotor``, in which a letter says what is measured, and
    ``generator speed`` is ``n_gen``. One or two letters must be a word as they are.
    """
    words = _parts(header.name)
    first, *rest = re.split(r"[\W_]+", requested.name)
    own = _parts("_".join(rest) if rest and first in _letters(requested.unit) else requested.name)
    begun = all(w in words or (len(w) > 2 and any(v.startswith(w) for v in words)) for w in own)
    return (
        (begun if len("".join(own)) > 2 else _as_word(requested, header))
        and not words & _REFERENCES
        and bool(header.unit or requested.unit == "1")
        and _units_agree(requested, header)
    )


def _as_word(requested: Requested, header: Header) -> bool:
    """Tell whether a name is a word of a header, which is no letter for what it measures.

    As ``Qt`` is of ``Q_turb Qt``, and ``Q`` is not.
    """
    first, *rest = re.split(r"[\W_]+", header.name.lower())
    told = first in {letter.lower() for letter in _letters(header.unit)} and bool(rest)
    return _words(requested.name) <= {*rest, *([] if told else [first])}


def _shortened(requested: Requested, header: Header) -> bool:
    """Tell whether a header says part of a name, as ``flow`` does of ``outflow``."""
    plain = _plain(header.name)
    return len(plain) > 3 and plain in _plain(requested.name)


def _told(requested: Requested, header: Header) -> bool:
    """Tell whether something beside its unit speaks for a header.

    It is part of the name, or a word of it, as ``v`` is of ``v_car``, the name or a synonym is one
    of its words, as of ``travel s`` or ``shaft velocity``, or it begins with the letter of what it
    measures, as ``T_stack`` and ``n`` do.
    """
    first, *rest = re.split(r"[\W_]+", header.name)
    if requested.name in rest or _shortened(requested, header):
        return True
    words = _words(header.name)
    if words <= _words(requested.name) or _meaning(requested.name) in map(_meaning, words):
        return True
    return first in _letters(header.unit) and not words & _REFERENCES


def _letters(unit: str) -> set[str]:
    """Return the letters that stand for what is measured in a unit."""
    return set(next((s for other, s in _LETTERS if unit and same_dimension(other, unit)), ""))


def _alike(unit: str, other: str) -> bool:
    """Tell whether both units are stated and measure the same."""
    return bool(unit and other) and same_dimension(unit, other)


def _units_agree(requested: Requested, header: Header) -> bool:
    return not requested.unit or not header.unit or same_dimension(requested.unit, header.unit)


def in_units_asked(headers: Sequence[Header], requested: Sequence[Requested]) -> list[Header]:
    """Read units that mean something only beside what is asked for: degrees, turns, nm."""
    for read in (_in_degrees, _in_turns, _in_small_units):
        headers = [read(header, headers, requested) for header in headers]
    return list(headers)


def _in_degrees(
    header: Header, headers: Sequence[Header], requested: Sequence[Requested]
) -> Header:
    """Read ``oven_C`` and ``oven (F)`` in degrees where that temperature is asked for.

    ``T_C`` beside ``T_B`` stays the name that it is, and what is asked for by that name as well.
    """
    asked = {_plain(w.name) for w in requested}
    kelvins = {_plain(w.name) for w in requested if _alike(w.unit, "K")}
    if header.unit in DEGREES and _plain(header.name) in kelvins:
        return replace(header, unit=DEGREES[header.unit])
    found = re.fullmatch(r"(.+?)_(?:deg_?)?([CcF])", header.name)
    if found is None or header.unit or not kelvins or _plain(header.name) in asked:
        return header
    stem = _plain(found[1])
    beside = any(o is not header and _plain(o.name)[:-1] == stem for o in headers)
    if beside or not (stem in kelvins or is_temperature(found[1])):
        return header
    return replace(header, name=found[1], unit=DEGREES[found[2].upper()])


def _in_turns(header: Header, _: Sequence[Header], requested: Sequence[Requested]) -> Header:
    """Read ``n [1/min]`` and ``n [Hz]`` in turns, and ``w [1/s]`` in rad/s, where those are asked.

    Where something is asked for in 1/s too, such as a rate of growth, they stay what they say.
    """
    asked = [w.unit for w in requested if w.unit]
    turning = same_dimension("rad/s", *asked) and not same_dimension("1/s", *asked)
    if not turning or not _alike(header.unit, "1/s"):
        return header
    told = f"{'turn' if 'Hz' in header.unit else 'rad'} {header.unit}".replace(" 1/", "/")
    return replace(header, unit="rpm" if "min" in header.unit else told)


def _in_small_units(header: Header, _: Sequence[Header], requested: Sequence[Requested]) -> Header:
    """Read ``torque_nm`` in N m where a torque is asked for, ``z_nm`` in nm where a length is.

    So ``drive_nN``, ``leak_pA``, ``tip_pm``: what is a unit of that which is asked for by the name
    before it is no part of a name, as of a pressure ``load_pA`` it is.
    """
    found = re.fullmatch(r"(.+?)_([np][A-Za-zΩ])", header.name, re.IGNORECASE)
    if found is None or header.unit:
        return header
    stem = Header(header.column, found[1])
    named = [w for w in requested if _same(w, header) or _same(w, stem)]
    if found[2].lower() == "nm":
        units = {"N m": "N m", "m": "nm"}
        meant = {u for w in named or requested for of, u in units.items() if _alike(w.unit, of)}
    else:
        meant = {found[2] for w in named if is_known(found[2]) and _alike(w.unit, found[2])}
    if len(meant) != 1:
        return header
    name = header.name if any(_same(w, header) == 2 for w in named) else stem.name
    return replace(header, name=name, unit=meant.pop())


def _check_twice(requested: Sequence[Requested], headers: Sequence[Header]) -> None:
    """Refuse two columns of one name where a signal is meant: nobody knows which."""
    columns = [h.column.strip() for h in headers]
    for column in sorted({c for c in columns if columns.count(c) > 1}):
        for signal in requested:
            if _same(signal, read_header(column)):
                raise WorkbenchError(
                    f"{columns.count(column)} columns are called {column!r}, and {signal.name} may"
                    " be any of them; give them different names"
                )


def match_requested(
    requested: Sequence[Requested], headers: Sequence[Header], taken: Iterable[int]
) -> dict[str, tuple[int, str]]:
    """Find the column of every requested signal: by its name, a synonym, or as the only one left.

    Returns:
        Column index and ``name``, ``synonym``, ``part of its name`` or ``unit``, by signal.

    Example:
        >>> columns = [Header("q1_deg", "q1", "deg"), Header("u_V", "u", "V")]
        >>> match_requested([Requested("angle", "rad"), Requested("valve", "V")], columns, ())
        {'valve': (1, 'synonym'), 'angle': (0, 'unit')}
    """
    used = set(taken)
    _check_twice(requested, headers)
    found: dict[str, tuple[int, str]] = {}
    for quality, how in ((2, "name"), (1, "synonym")):
        for signal in requested:
            if signal.name in found:
                continue
            named = [
                i for i, h in enumerate(headers) if i not in used and _same(signal, h) == quality
            ]
            fitting = [i for i in named if _units_agree(signal, headers[i])]
            if not fitting and quality == 2 and signal.unit and same_dimension(signal.unit, "1"):
                # Its author may have left the unit out.
                fitting = named
            if named and not fitting and quality == 2:
                bad = headers[named[0]]
                raise WorkbenchError(
                    f"column {bad.column!r} is in {bad.unit!r} but {signal.name} is measured in "
                    f"{signal.unit!r}; correct the header or give the unit in a mapping file"
                )
            if len(fitting) == 1 or (fitting and quality == 2):
                found[signal.name] = (fitting[0], how)
                used.add(fitting[0])
    for role, letters in _ALONE.items():
        asked = [w for w in requested if w.role == role]
        named = [i for i, h in enumerate(headers) if i not in used and h.name.lower() in letters]
        if len(asked) == len(named) == 1 and asked[0].name not in found:
            (signal,), (index,) = asked, named
            if _units_agree(signal, headers[index]):
                found[signal.name] = (index, "synonym")
                used.add(index)
    open_ = [w for w in requested if w.name not in found and w.unit]
    parts = {
        w.name: [i for i, h in enumerate(headers) if i not in used and _partly(w, h)] for w in open_
    }
    while parts:
        # What only one signal can be is taken from those that can be another column.
        only = [columns[0] for columns in parts.values() if len(columns) == 1]
        alone = {n: c[0] for n, c in parts.items() if len(c) == 1 and only.count(c[0]) == 1}
        found |= {name: (i, "part of its name") for name, i in alone.items()}
        used |= set(alone.values())
        parts = {n: [i for i in c if i not in used] for n, c in parts.items() if n not in alone}
        if not alone:
            break
    for signal in requested:
        if signal.name in found or not signal.unit:
            continue
        rivals = [w for w in requested if w.name not in found and _alike(w.unit, signal.unit)]
        left = [i for i, h in enumerate(headers) if i not in used and _alike(h.unit, signal.unit)]
        # Where other sensors are found, a unit alone is no reason to take one more for this one.
        beside = signal.optional and any(w.optional and w.name in found for w in requested)
        sure = len(left) == len(rivals) == 1
        if sure and (not beside or _told(signal, headers[left[0]])):
            found[signal.name] = (left[0], "unit")
            used.add(left[0])
    for signal in requested:
        if signal.name not in found and not signal.optional:
            has = ", ".join(h.column for h in headers) or "none"
            unit = f" ({signal.unit})" if signal.unit not in ("", "1") else ""
            raise WorkbenchError(
                f"no column for signal {signal.name!r}{unit}; the file has: {has[:400]}; give "
                f'the column that name, or name it in a mapping file: signals.{signal.name} = "..."'
            )
    return found


def without_column(
    requested: Sequence[Requested], found: Iterable[str], headers: Sequence[Header]
) -> tuple[str, ...]:
    """Say which measurements found no column, where columns of their unit are left over."""
    have, notes = set(found), []
    for signal in requested:
        left = [h.column for h in headers if _alike(h.unit, signal.unit)]
        if signal.optional and signal.name not in have and left:
            named = [h.column for h in headers if h.column in left and _as_word(signal, h)]
            right = (named or left)[0] if named or len(left) == 1 else "..."
            notes.append(
                f"no column is called {signal.name}; of its unit "
                f"{'is' if len(left) == 1 else 'are'} {', '.join(map(repr, left))}: name the right"
                f' one in a mapping file, signals.{signal.name} = "{right}", or'
                f" {signal.name} is not compared"
            )
    return tuple(notes)
