"""Turn the columns of a file into signals in SI, and say how."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model.units import same_dimension, to_si
from workbench.recordings.column_matching import (
    AMBIENT_PA,
    Requested,
    guess_role,
    in_units_asked,
    is_time,
    match_requested,
    without_column,
)
from workbench.recordings.columns import Columns, without_giants, without_marks
from workbench.recordings.headers import Header, read_header, read_unit, tidy_name, unit_of_time
from workbench.recordings.mapping import ColumnRule, MappingRules
from workbench.recordings.quantity_kinds import kind_of
from workbench.recordings.recording import ColumnMapping, MappedColumn, Role, Scalar, Signal

_EPOCHS = {"ms": 1e11, "us": 1e14, "ns": 1e17}
"""Smallest count since 1970 that is one of milli-, micro- and nanoseconds: seconds do not get there
before the year 5138, and the others have since 1973."""

_RATE_NAMES = ("fs", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency")
_STEP_NAMES = ("ts", "dt", "sampletime", "samplingtime", "sampleperiod", "increment")


@dataclass(frozen=True, eq=False)
class Assigned:
    """What a file tells of a recording.

    Args:
        time: Instants, shape (n,), in s; None if the file has none.
    """

    time: Vector | None
    signals: tuple[Signal, ...]
    mapping: ColumnMapping
    notes: tuple[str, ...]
    metadata: dict[str, Scalar]


def header_list(titles: Sequence[str], units: Sequence[str]) -> list[Header]:
    """Return headers, with a row of units, taken apart; names that occur twice keep their unit."""
    headers = [read_header(text) for text in titles]
    for i, text in enumerate(units):
        unit, reference = read_unit(text) if text else (None, "")
        if unit and headers[i].unit and not same_dimension(unit, headers[i].unit):
            # Below "Channel A" stands that it is in volts.
            headers[i] = Header(headers[i].column, tidy_name(headers[i].column))
        if text and not headers[i].unit:
            headers[i] = replace(
                headers[i],
                unit=unit or "",
                reference=headers[i].reference or reference,
                stated=text if unit is None else "",
            )
    names = [h.name for h in headers]
    headers = [
        replace(h, name=tidy_name(h.column) or h.name) if names.count(h.name) > 1 else h
        for h in headers
    ]
    seen: dict[str, int] = {}
    for i, header in enumerate(headers):
        seen[header.name] = seen.get(header.name, 0) + 1
        if seen[header.name] > 1:
            headers[i] = replace(header, name=f"{header.name}_{seen[header.name]}")
    # A first column that is called "minutes" counts them.
    if headers and not headers[0].unit and (unit := unit_of_time(headers[0].name)):
        headers[0] = replace(headers[0], unit=unit)
    return headers


_SECONDS = re.compile(r"(?P<of>(?:.*[._])?)(?P<small>n|nano)?secs?")


def with_whole_stamps(columns: Columns) -> Columns:
    """Put the seconds and nanoseconds of a stamp together, two columns of a robot's messages.

    Example:
        >>> with_whole_stamps(Columns(("sec", "nanosec"), ("",) * 2, np.array([[1, 5e8]]))).values
        array([[1.5]])
    """
    found = [_SECONDS.fullmatch(h) for h in columns.headers]
    at = {(m["of"], bool(m["small"])): i for i, m in enumerate(found) if m}
    pairs = {i: at[of, True] for (of, small), i in at.items() if not small and (of, True) in at}
    values = columns.values.copy()
    for whole, part in pairs.items():
        values[:, whole] += 1e-9 * values[:, part]
    kept = [i for i in range(len(columns.headers)) if i not in pairs.values()]
    named = {i: m["of"].rstrip("._") or "time" for i, m in enumerate(found) if m and i in pairs}
    return replace(
        columns,
        headers=tuple(named.get(i, columns.headers[i]) for i in kept),
        units=tuple(columns.units[i] for i in kept),
        values=values[:, kept],
    )


def find_column(headers: Sequence[Header], rule: ColumnRule) -> int:
    """Return the index of the column that a rule names."""
    wanted = rule.column.strip()
    for name in (wanted, wanted.rsplit(".", 1)[-1]):
        for key, told in (("column", name), ("name", name), ("name", tidy_name(name))):
            for i, header in enumerate(headers):
                if getattr(header, key).strip() == told:
                    return i
    raise WorkbenchError(
        f"the mapping takes {rule.signal!r} from column {rule.column!r}, which the file does not "
        f"have; it has: {', '.join(h.column for h in headers)[:400]}; correct it, or name all "
        "columns anew in the mapping: columns = [...]"
    )


def find_time(headers: Sequence[Header], rules: MappingRules) -> int | None:
    """Return the index of the time column, None if there is none."""
    if rules.time is not None:
        return find_column(headers, rules.time)
    if rules.sample_time_s is not None:
        return None
    last = [replace(h, name=h.column.rsplit(".", 1)[-1]) for h in headers]
    named = [i for titles in (headers, last) for i, h in enumerate(titles) if is_time(h)]
    if named:
        return named[0]
    first = headers[0] if headers else Header("time", "time")
    # A table of pandas begins with its index, which has no name.
    unnamed = not first.column.strip() and len(headers) > 1
    return 0 if unnamed or (first.unit and same_dimension(first.unit, "s")) else None


def _own_units(
    columns: Columns, headers: list[Header], rules: MappingRules
) -> tuple[Columns, list[Header]]:
    """Turn columns in units that the mapping declares into units that are known."""
    values = columns.values.copy()
    for i, header in enumerate(headers):
        if header.problem and header.stated in rules.units:
            factor, unit = rules.units[header.stated]
            values[:, i] *= factor
            headers[i] = replace(header, unit=unit, stated="")
    return replace(columns, values=values), headers


_GOOD = 192
"""Quality from which on a value is good, as OPC counts it (0 to 255)."""


def _as_judged(columns: Columns, headers: Sequence[Header]) -> tuple[Columns, set[int]]:
    """Take values for missing that a column beside them, ``speed_quality``, calls bad.

    Returns:
        The columns, and the places of those that judge others.
    """
    values, notes, judges = columns.values.copy(), list(columns.notes), set()
    names = [h.name.lower() for h in headers]
    for k, header in enumerate(headers):
        found = re.fullmatch(r"(.+?)[_ .](?:quality|qual|valid)", header.name.lower())
        if found is None or found[1] not in names:
            continue
        told = values[:, k]
        known = told[np.isfinite(told)]
        least = 1.0 if np.isin(known, (0.0, 1.0)).all() else _GOOD
        if not known.size or not np.any(known >= least):
            continue
        judges.add(k)
        index = names.index(found[1])
        bad = (told < least) & np.isfinite(values[:, index])
        if bad.any():
            values[bad, index] = np.nan
            count, column = np.count_nonzero(bad), headers[index].column
            notes.append(f"{count} value(s) of {column!r} are bad by {header.column!r}")
    return replace(columns, values=values, notes=tuple(notes)), judges


def _readable(columns: Columns, index: int, name: str) -> str:
    """Return why a column cannot be a signal, ``""`` if it can."""
    header = columns.headers[index]
    count, example = columns.unreadable.get(header, (0, ""))
    n = len(columns.values)
    if n and count > 0.5 * n:
        return f"holds text in {100 * count / n:.0f} % of its rows (first: {example})"
    if n and not np.isfinite(columns.values[:, index]).any():
        return "is empty"
    return "" if name else "has no name"


def _measures(unit: str, other: str) -> bool:
    try:
        return same_dimension(unit, other)
    except WorkbenchError:
        return False


def _signal(
    columns: Columns, index: int, header: Header, rule: ColumnRule, request: Requested, how: str
) -> tuple[Signal, MappedColumn]:
    problem = _readable(columns, index, rule.signal)
    if problem:
        raise WorkbenchError(
            f"column {header.column!r}, needed for {rule.signal!r}, {problem}; repair the file, map"
            " another column, or say which numbers words stand for ([words] in a mapping file)"
        )
    unit, note = rule.unit or header.unit or ("" if header.stated else request.stated), ""
    plain = bool(request.unit) and same_dimension(request.unit, "1")
    if not unit and header.stated and request.unit and not plain:
        # The plant counts in it too.
        unit = header.stated if _measures(header.stated, request.unit) else ""
    if header.problem and not unit:
        if not plain:
            raise WorkbenchError(
                f"column {header.column!r}: {header.problem}; write a known unit in the header or"
                " give one in a mapping file"
            )
        # What is no unit of the SI, such as NTU or mU/min, is a number for the plant too.
        note = f"in {header.stated}, which is taken as it stands"
    elif plain and unit and not rule.unit and not same_dimension(unit, "1"):
        unit, note = "", f"in {unit}, which is taken as it stands"
    if request.unit and unit and not same_dimension(unit, request.unit):
        raise WorkbenchError(
            f"column {header.column!r} is in {unit!r} but {rule.signal} is measured in "
            f"{request.unit!r}; correct the unit"
        )
    # A factor changes what the column measures, so the header's unit no longer holds.
    if rule.factor != 1.0 and not rule.unit and header.unit:
        raise WorkbenchError(
            f"signal {rule.signal!r} has a factor but no unit; give the unit after the factor"
        )
    values = rule.sign * rule.factor * columns.values[:, index] + rule.offset
    if not unit and not header.stated and (unit := _zero_of(values, request)):
        note = f"in {unit}, the nearer to where the plant begins, as no unit is stated"
    kind = kind_of(unit or request.unit)
    values = to_si(values, unit) if unit else values
    name, reference = kind.name, rule.reference or header.reference
    if kind.name == "pressure" and request.reference == "absolute":
        name = "absolute pressure"
        if reference == "gauge":
            values = values + AMBIENT_PA
            note = f"gauge; {AMBIENT_PA / 1e5:g} bar added, as the plant counts from vacuum"
    elif kind.name == "pressure" and reference == "absolute":
        values, name = values - AMBIENT_PA, "gauge pressure"
        note = f"absolute; {AMBIENT_PA / 1e5:g} bar subtracted"
    elif kind.name == "pressure" and reference == "gauge":
        name = "gauge pressure"
    role = cast("Role", rule.role or request.role or guess_role(rule.signal))
    shown = request.display_unit or unit
    signal = Signal(rule.signal, values, kind.unit, name, role, shown)
    line = rule.sign, rule.factor, rule.offset, note
    return signal, MappedColumn(header.column, rule.signal, unit, kind.unit, how, *line)


def _zero_of(values: Vector, request: Requested) -> str:
    """Return the unit with whose zero temperatures begin nearer to where the plant does.

    They are numbers without a unit; ``""`` if that is the absolute zero, or no temperature is asked
    for.
    """
    if not (request.unit and same_dimension(request.unit, "K") and math.isfinite(request.begins)):
        return ""
    shown = request.display_unit or "degC"
    first = values[np.isfinite(values)][:1]
    away = [np.abs(to_si(first, unit) - request.begins).sum() for unit in ("K", shown)]
    return shown if away[1] < away[0] else ""


def _since_1970(instants: Vector) -> str:
    """Return the unit of instants that are too large for seconds since 1970; else ``""``."""
    least = float(np.nanmin(instants, initial=np.inf, where=np.isfinite(instants)))
    units = [unit for unit, from_ in _EPOCHS.items() if from_ <= least < np.inf]
    return units[-1] if units else ""


_DATES = ((25_569.0, 73_050.0), (719_529.0, 767_010.0))
"""Days of 1970 and of 2100 as spreadsheets count them, and as MATLAB does."""

_TOO_FAST = 1e-5
"""Step in s that nobody takes hours after the zero of a clock: 100 kHz."""


def _as_dates(instants: Vector) -> str:
    """Return the unit of instants that are counted in days, as dates are; else ``""``."""
    known = instants[np.isfinite(instants)]
    step = float(np.median(np.abs(np.diff(known)))) if len(known) > 1 else 0.0
    if not step or not any(first < known.min() and known.max() < last for first, last in _DATES):
        return ""
    # Whole seconds are no round number of days, and what is one of seconds may be any of days.
    seconds, plain = 86_400.0 * step, float(f"{step:.1e}")
    whole = abs(seconds - round(seconds)) < 1e-3 * seconds and abs(step - plain) > 5e-3 * step
    return "d" if step < _TOO_FAST or whole else ""


def _with_unit(value: Scalar, header: Header, alike: str) -> float:
    """Return a setting in SI, stated with a unit or in the header's; 0 if it is none like that."""
    found = re.fullmatch(r"([0-9.eE+-]+)\s*([A-Za-z]*)", str(value).strip())
    unit = header.unit or (found is not None and found[2] and read_unit(found[2])[0]) or alike
    if found is None or not same_dimension(unit, alike):
        return 0.0
    try:
        return max(to_si(float(found[1]), unit), 0.0)
    except ValueError:
        return 0.0


def _time(
    columns: Columns, headers: Sequence[Header], rules: MappingRules
) -> tuple[Vector | None, MappedColumn | None, int | None]:
    index = find_time(headers, rules)
    if index is not None and not headers[index].column.strip():
        rows = columns.values[:, index]
        # Numbers of rows are no instants.
        index = None if np.array_equal(rows, rows[:1] + np.arange(len(rows))) else index
    if index is not None:
        header = headers[index]
        rule = rules.time or ColumnRule("time", header.column)
        unit = rule.unit or header.unit
        problem = _readable(columns, index, "time")
        if problem:
            raise WorkbenchError(
                f"the time column {header.column!r} {problem}; write the time in seconds, or as"
                " 2024-03-04 06:00:10"
            )
        if unit and not same_dimension(unit, "s"):
            raise WorkbenchError(f"the time column {header.column!r} is in {unit!r}; give s or ms")
        raw = rule.sign * rule.factor * columns.values[:, index] + rule.offset
        unit = unit or _since_1970(raw) or _as_dates(raw)
        how = "mapping file" if rules.time is not None else "name"
        line = rule.sign, rule.factor, rule.offset
        row = MappedColumn(header.column, "time", unit, "s", how, *line)
        return (to_si(raw, unit) if unit else raw), row, index
    step = rules.sample_time_s
    source = "sample_time_s"
    if step is None:
        for key, value in columns.metadata.items():
            header = read_header(key)
            plain = re.sub(r"[\W_]+", "", header.name).lower()
            if plain in _STEP_NAMES and (number := _with_unit(value, header, "s")):
                step, source = number, key
            elif plain in _RATE_NAMES and (number := _with_unit(value, header, "Hz")):
                step, source = 1.0 / number, key
    if step is None:
        return None, None, None
    note = f"every {step:g} s"
    row = MappedColumn(source, "time", "s", "s", "sample time", note=note)
    return np.arange(len(columns.values), dtype=float) * float(step), row, None


def assign(columns: Columns, rules: MappingRules, requested: Sequence[Requested]) -> Assigned:
    """Turn columns into signals.

    With rules for signals only those are taken; otherwise the requested ones are found by name and
    unit, and every other column of numbers keeps its own name. Pressures stated as absolute become
    gauge pressures, but for a plant that counts from vacuum: there stated gauge pressures become
    absolute.

    Example:
        >>> file = Columns(("time_ms", "angle_deg"), ("", ""), np.array([[0.0, 0.0], [2.0, 180.0]]))
        >>> found = assign(file, MappingRules(), ())
        >>> found.time, found.signals[0].values
        (array([0.   , 0.002]), array([0.        , 3.14159265]))
    """
    columns = with_whole_stamps(without_marks(without_giants(columns)))
    columns, headers = _own_units(columns, header_list(columns.headers, columns.units), rules)
    columns, judges = _as_judged(columns, headers)
    metadata: dict[str, Scalar] = {**columns.metadata, **rules.metadata}
    headers = in_units_asked(headers, requested)
    time, time_row, time_index = _time(columns, headers, rules)
    by_name = {w.name: w for w in requested}
    signals: list[Signal] = []
    rows = [] if time_row is None else [time_row]
    unused: list[tuple[str, str]] = []
    taken = set() if time_index is None else {time_index}

    def take(index: int, rule: ColumnRule, how: str) -> None:
        request = by_name.get(rule.signal, Requested(rule.signal))
        signal, row = _signal(columns, index, headers[index], rule, request, how)
        signals.append(signal)
        rows.append(row)
        taken.add(index)

    for rule in rules.signals:
        take(find_column(headers, rule), rule, "mapping file")
    missing = [w for w in requested if w.name not in {s.name for s in signals}]
    for name, (index, how) in match_requested(missing, headers, taken).items():
        take(index, ColumnRule(name, headers[index].column), how)
    left = [h for i, h in enumerate(headers) if i not in taken]
    notes = [*columns.notes, *without_column(missing, (s.name for s in signals), left)]
    order = {w.name: i for i, w in enumerate(requested)}
    signals.sort(key=lambda s: order.get(s.name, len(order)))
    for index, header in enumerate(headers):
        if index in taken:
            continue
        why = _readable(columns, index, header.column.strip()) or header.problem
        if index in judges:
            why = "judges another column"
        elif rules.signals:
            why = why or "not in the mapping"
        elif header.name in {s.name for s in signals}:
            why = why or "another column has its name"
        if why:
            unused.append((header.column, why))
            continue
        take(index, ColumnRule(header.name, header.column), "header")
    for index in sorted(
        taken | {i for i, h in enumerate(headers) if h.column in {r.column for r in rows}}
    ):
        count, example = columns.unreadable.get(columns.headers[index], (0, ""))
        if count:
            notes.append(
                f"{count} cell(s) of column {columns.headers[index]!r} hold no number (first: "
                f"{example}); they count as missing"
            )
    return Assigned(
        time, tuple(signals), ColumnMapping(tuple(rows), tuple(unused)), tuple(notes), metadata
    )
