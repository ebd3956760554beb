"""Which column becomes which signal: by a small TOML file, or by name and unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import starmap
from pathlib import Path
from typing import Any

from workbench.checked_json import (
    Place,
    Shape,
    ShapeError,
    TableShape,
    listed,
    named,
    number,
    one_of,
    read_toml,
    scalar,
    text,
    whole,
    within,
)
from workbench.errors import WorkbenchError
from workbench.model.units import is_known, refuse_slips
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
        reference: ``gauge`` or ``absolute`` (pressures); it becomes what the plant counts in.
    """

    signal: str
    column: str
    unit: str = ""
    sign: float = 1.0
    factor: float = 1.0
    offset: float = 0.0
    role: Role | str = ""
    reference: str = ""


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
        words: Numbers that words in a text stand for, dimensionless, such as 1 for ``EIN``.
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
    words: Mapping[str, float] = field(default_factory=dict)
    folder: Path | None = None


def _own_unit(value: Any, place: Place) -> tuple[float, str]:
    """Read a unit of a file's own, such as ``"0.0015 rad"``."""
    size, _, unit = str(value).partition(" ")
    try:
        factor = float(size)
    except ValueError:
        factor = 0.0
    if not factor or not unit.strip() or not is_known(unit):
        raise ShapeError(
            place, f'is {value!r}; write a number and a known unit, such as "0.0015 rad"'
        )
    return factor, unit.strip()


def _ends(item: Shape) -> Shape:
    """Return a shape of two increasing numbers."""

    def check(value: Any, place: Place) -> tuple[Any, Any]:
        first, last = listed(item, length=2)(value, place)
        if not first < last:
            raise ShapeError(place, f"is {value!r}; write first and last, the first smaller")
        return first, last

    return check


_COLUMN = TableShape(
    {},
    {
        **dict.fromkeys(("column", "unit"), text),
        "sign": one_of(1, -1),
        **dict.fromkeys(("factor", "offset"), within(-1e12, 1e12)),
        "role": one_of("command", "reference", "measurement"),
        "reference": one_of("gauge", "absolute"),
    },
    others=False,
)


def _column(value: Any, place: Place) -> Any:
    if isinstance(value, str):
        return {"column": value}
    if not isinstance(value, Mapping):
        raise ShapeError(
            place, f"is {value!r}; write a column name or a table with column, unit, sign, offset"
        )
    return _COLUMN(value, place)


_MAPPING = TableShape(
    {},
    {
        "signals": named(_column),
        "time": _column,
        "columns": listed(text),
        "sample_time_s": within(1e-9, 1e6),
        "metadata": named(scalar),
        "format": text,
        "rows": _ends(within(0, 1e12, whole)),
        "times_s": _ends(number),
        "units": named(_own_unit),
        "words": named(number),
    },
    others=False,
)
"""Shape of a mapping file."""


def _rule(
    units: Mapping[str, tuple[float, str]], signal: str, entry: Mapping[str, Any]
) -> ColumnRule:
    values = {"column": signal, "unit": "", "factor": 1.0, "offset": 0.0, **entry}
    if not values["column"]:
        raise WorkbenchError(f"the mapping names no column for signal {signal!r}")
    if not values["factor"]:
        raise WorkbenchError(f"factor of signal {signal!r} in the mapping is 0; it must not be")
    size, unit = units.get(values["unit"], (1.0, values["unit"]))
    refuse_slips(unit)
    scaled = {key: size * values[key] for key in ("factor", "offset")}
    return ColumnRule(signal, **values | scaled | {"unit": unit})


def rules_from(
    content: Mapping[str, Any], *, path: str = "the mapping", folder: Path | None = None
) -> MappingRules:
    """Build the rules from the content of a mapping file.

    ``{"angle": "q1"}`` is short for ``{"signals": {"angle": {"column": "q1"}}}``.
    """
    if not set(content) & set(_MAPPING.usual) and all(
        isinstance(v, str) or (isinstance(v, Mapping) and "column" in v) for v in content.values()
    ):
        content = {"signals": content}
    try:
        given = _MAPPING(content, ())
    except ShapeError as error:
        raise WorkbenchError(f"{path}: {error}") from None
    units, time = given.get("units", {}), given.get("time")
    if time is not None and "column" not in time:
        raise WorkbenchError(f'[time] of {path} names no column; write column = "..."')
    given["signals"] = tuple(starmap(partial(_rule, units), given.get("signals", {}).items()))
    given["time"] = None if time is None else _rule(units, "time", time)
    given["columns"] = tuple(given.get("columns", ()))
    return MappingRules(**given, folder=folder)


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
