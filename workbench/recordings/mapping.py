"""Which column becomes which signal: by a small TOML file, or by name and unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from workbench.checked_json import read_toml
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.model.units import parse_unit
from workbench.recordings.recording import Role


@dataclass(frozen=True)
class ColumnRule:
    """What a mapping file says about one signal: value = sign * factor * column + offset.

    Args:
        column: Header of the column, as in the file or without its unit.
        unit: Unit of ``sign * factor * column + offset``; by default the header's.
        sign: Factor 1, or -1 to turn the signal round.
        factor: Gain, in ``unit`` per unit of the column: a sensor's voltage becomes a pressure.
        offset: Added after sign and factor, in ``unit``.
        role: ``command``, ``reference`` or ``measurement``; by default from the name.
        reference: ``gauge`` or ``absolute`` (pressures); absolute becomes gauge.
    """

    signal: str
    column: str
    unit: str = ""
    sign: float = 1.0
    factor: float = 1.0
    offset: float = 0.0
    role: Role | str = ""
    reference: str = ""

    def __post_init__(self) -> None:
        """Check every entry, naming the signal."""
        where = f"of signal {self.signal!r} in the mapping"
        for key in ("column", "unit"):
            if not isinstance(getattr(self, key), str):
                raise WorkbenchError(f"{key} {where} is {getattr(self, key)!r}; write a text")
        if not self.column:
            raise WorkbenchError(f"the mapping names no column for signal {self.signal!r}")
        parse_unit(self.unit)
        for key in ("sign", "factor", "offset"):
            check_range(f"{key} {where}", getattr(self, key), -1e12, 1e12)
        if float(self.sign) not in (1.0, -1.0):
            raise WorkbenchError(f"sign {where} is {self.sign!r}; it must be 1 or -1")
        if float(self.factor) == 0.0:
            raise WorkbenchError(f"factor {where} is 0; it must not be")
        if self.role:
            check_choice(f"role {where}", self.role, ("command", "reference", "measurement"))
        if self.reference:
            check_choice(f"reference {where}", self.reference, ("gauge", "absolute"))


@dataclass(frozen=True)
class MappingRules:
    """The content of a mapping file.

    Args:
        signals: Rules by signal, in order; empty to map by name and unit.
        time: Rule of the time column; None to find it by name.
        columns: Names of the columns, for a file without a header.
        sample_time_s: Step in s, for a file without a time column.
        metadata: Settings to add to the recording, in units of their names.
        format: Name of the format, or ``module:object`` of the user's own; ``""`` to recognise it.
        rows: First row taken and first row left out after it, counted from 0; None for all.
        times_s: First and last instant taken, in s; None for all.
        units: Units of the file's own: how many of which known unit one of them is, by name.
    """

    signals: tuple[ColumnRule, ...] = ()
    time: ColumnRule | None = None
    columns: tuple[str, ...] = ()
    sample_time_s: float | None = None
    metadata: Mapping[str, str | int | float | bool] = field(default_factory=dict)
    format: str = ""
    rows: tuple[int, int] | None = None
    times_s: tuple[float, float] | None = None
    units: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    folder: Path | None = None


def _units(given: object, path: str) -> dict[str, tuple[float, str]]:
    """Read units of a file's own, such as ``tick = "0.0015 rad"``."""
    if not isinstance(given, Mapping):
        raise WorkbenchError(f'units of {path} must be a table: [units] tick = "0.0015 rad"')
    found = {}
    for name, text in given.items():
        size, _, unit = str(text).partition(" ")
        try:
            factor = float(size)
        except ValueError:
            factor = 0.0
        if not factor or not unit.strip():
            raise WorkbenchError(
                f"unit {name!r} of {path} is {text!r}; write a number and a known unit, such as"
                ' "0.0015 rad"'
            )
        parse_unit(unit.strip())
        found[str(name)] = (factor, unit.strip())
    return found


def _rule(
    signal: str, entry: object, path: str, units: Mapping[str, tuple[float, str]]
) -> ColumnRule:
    if isinstance(entry, str):
        return ColumnRule(signal, entry)
    if not isinstance(entry, Mapping):
        raise WorkbenchError(
            f"signal {signal!r} in {path} is {entry!r}; write a column name or a table with column,"
            " unit, sign, offset"
        )
    known = [f.name for f in fields(ColumnRule) if f.name != "signal"]
    for key in entry:
        check_choice(f"key of signal {signal!r} in {path}", str(key), known)
    values = {"column": signal, **entry}
    unit = values.get("unit")
    if isinstance(unit, str) and unit in units:
        size, values["unit"] = units[unit]
        for key, usual in (("factor", 1.0), ("offset", 0.0)):
            what = f"{key} of signal {signal!r} in {path}"
            values[key] = size * check_range(what, values.get(key, usual), -1e12, 1e12)
    return ColumnRule(signal, **values)


def _range(content: Mapping[str, Any], key: str, path: str) -> tuple[float, float] | None:
    """Return two increasing numbers of a mapping file."""
    value = content.get(key)
    if value is None:
        return None
    if (
        not isinstance(value, Sequence)
        or isinstance(value, str)
        or len(value) != 2
        or any(isinstance(v, bool) or not isinstance(v, (int, float)) for v in value)
        or not value[0] < value[1]
    ):
        raise WorkbenchError(
            f"{key} of {path} is {value!r}; write first and last, the first smaller: {key} = [0, 5]"
        )
    return value[0], value[1]


def rules_from(
    content: Mapping[str, Any], *, path: str = "the mapping", folder: Path | None = None
) -> MappingRules:
    """Build the rules from the content of a mapping file.

    ``{"angle": "q1"}`` is short for ``{"signals": {"angle": {"column": "q1"}}}``.
    """
    known = tuple(f.name for f in fields(MappingRules) if f.name != "folder")
    if (
        content
        and not set(content) & set(known)
        and all(
            isinstance(v, str) or (isinstance(v, Mapping) and "column" in v)
            for v in content.values()
        )
    ):
        content = {"signals": content}
    for key in content:
        check_choice(f"key of {path}", str(key), known)
    signals = content.get("signals", {})
    columns = content.get("columns", ())
    metadata = content.get("metadata", {})
    if not isinstance(signals, Mapping) or not isinstance(metadata, Mapping):
        raise WorkbenchError(f"signals and metadata of {path} must be tables, such as [signals]")
    if (
        isinstance(columns, str)
        or not isinstance(columns, Sequence)
        or not all(isinstance(c, str) for c in columns)
    ):
        raise WorkbenchError(f"columns of {path} is {columns!r}; write a list of names")
    time = content.get("time")
    if isinstance(time, Mapping) and "column" not in time:
        raise WorkbenchError(f'[time] of {path} names no column; write column = "..."')
    step = content.get("sample_time_s")
    if step is not None:
        step = check_range(f"sample_time_s of {path}", step, 1e-9, 1e6, "s")
    bad = [k for k, v in metadata.items() if not isinstance(v, (str, int, float, bool))]
    if bad:
        raise WorkbenchError(f"metadata {bad[0]!r} of {path} must be a text or a number")
    units = _units(content.get("units", {}), path)
    rows = _range(content, "rows", path)
    if rows is not None and (rows[0] < 0 or any(int(r) != r for r in rows)):
        raise WorkbenchError(f"rows of {path} is {list(rows)}; write whole numbers from 0 on")
    format_ = content.get("format", "")
    if not isinstance(format_, str):
        raise WorkbenchError(f"format of {path} is {format_!r}; write its name")
    return MappingRules(
        tuple(_rule(str(name), entry, path, units) for name, entry in signals.items()),
        None if time is None else _rule("time", time, path, units),
        tuple(columns),
        step,
        dict(metadata),
        format_,
        None if rows is None else (int(rows[0]), int(rows[1])),
        _range(content, "times_s", path),
        units,
        folder,
    )


def read_mapping(path: str | Path) -> MappingRules:
    r"""Read a mapping file.

    .. code-block:: toml

        columns = ["time_ms", "laser_V", "laser_mm", "pressure_bar"]  # file without header
        rows = [0, 5000]       # the first 5000 rows, or: times_s = [1.0, 20.0]

        [time]
        column = "time_ms"

        [signals.position]
        column = "laser_mm"
        unit = "mm"
        sign = -1
        offset = 25.0
    """
    file = Path(path)
    content = read_toml(file, "mapping file")
    return rules_from(content, path=file.name, folder=file.parent)
