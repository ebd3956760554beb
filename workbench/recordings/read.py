"""Read a recording from any supported file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.display import aligned_table
from workbench.errors import WorkbenchError, check_range
from workbench.recordings.column_assignment import assign, find_time, header_list
from workbench.recordings.column_matching import Requested, requested_signals
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import FORMATS, MAX_ROWS, ReadOptions, format_of
from workbench.recordings.mapping import MappingRules, read_mapping, rules_from
from workbench.recordings.recording import Recording, Signal
from workbench.recordings.saving import restore_recording
from workbench.registry import user_code

MappingLike = str | Path | Mapping[str, Any] | MappingRules | None


@dataclass(frozen=True, eq=False)
class Table:
    """Columns in SI without a time, such as a map of static forces."""

    name: str
    signals: tuple[Signal, ...]
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Vector:
        for signal in self.signals:
            if signal.name == name:
                return signal.values
        raise WorkbenchError(
            f"table {self.name!r} has no column {name!r}; it has "
            f"{', '.join(s.name for s in self.signals)}"
        )

    def __str__(self) -> str:
        ends = [(np.nanmin(s.values), np.nanmax(s.values)) for s in self.signals]
        rows = [
            (s.name, s.kind, s.unit or "?", f"{low:.6g}", f"{high:.6g}")
            for s, (low, high) in zip(self.signals, ends, strict=True)
        ]
        n = len(self.signals[0].values) if self.signals else 0
        head = f"{self.name}: {n} rows"
        body = aligned_table(("column", "kind", "unit", "minimum", "maximum"), rows)
        return "\n".join([head, body, *(f"note: {note}" for note in self.notes)])


def rules_of(mapping: MappingLike) -> MappingRules:
    """Return the rules of a mapping in any of its forms."""
    if mapping is None:
        return MappingRules()
    if isinstance(mapping, MappingRules):
        return mapping
    return rules_from(mapping) if isinstance(mapping, Mapping) else read_mapping(mapping)


def _require_file(path: Path) -> None:
    if path.is_dir():
        raise WorkbenchError(f"{path} is a folder; give one of its files")
    if path.is_file():
        return
    folder = path.parent
    names = [p.name for p in folder.iterdir()] if folder.is_dir() else []
    near = difflib.get_close_matches(path.name, names, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise WorkbenchError(f"there is no file {path}{hint}")


def _columns(file: Path, rules: MappingRules, *, max_rows: int = MAX_ROWS) -> Columns:
    """Read a file as columns, in the format that the rules name or its ending tells."""
    _require_file(file)
    try:
        kind = FORMATS.get(rules.format, folder=rules.folder) if rules.format else format_of(file)
    except OSError as error:
        raise WorkbenchError(f"{file} cannot be read: {error.strerror or error}") from None
    options = ReadOptions(
        rules.columns, max_rows, lambda *titles: find_time(header_list(*titles), rules), rules.words
    )
    with user_code(f"reading {file.name} as {kind.name}"):
        found = kind.columns(file, options)
    if not isinstance(found, Columns):
        raise WorkbenchError(
            f"recording format {kind.name!r} returned a {type(found).__name__}; it must be Columns"
        )
    return found


def mapping_beside(path: str | Path) -> Path | None:
    """Return the mapping of one file, such as ``trial.mapping.toml`` beside ``trial.csv``."""
    file = Path(path)
    own = file.parent / f"{_title(file)}.mapping.toml"
    return own if own.is_file() else None


def _title(file: Path) -> str:
    return file.name.removesuffix(".gz").rsplit(".", 1)[0]


def _within(recording: Recording, rules: MappingRules) -> Recording:
    """Keep the rows and instants that a mapping names."""
    kept = recording
    if rules.rows is not None:
        first, stop = rules.rows
        if first + 2 > len(kept):
            raise WorkbenchError(
                f"rows of the mapping are [{first}, {stop}] but {recording.source} has {len(kept)};"
                " name rows inside"
            )
        kept = kept.take(slice(first, stop))
    if rules.times_s is not None:
        kept = kept.between(*rules.times_s)
    if kept is recording:
        return recording
    return kept.noted(f"{len(kept)} of {len(recording)} rows taken, as the mapping says")


def _named(columns: Columns, path: Path, rules: MappingRules) -> None:
    if not columns.named and not rules.signals:
        count = len(columns.headers)
        raise WorkbenchError(
            f'{path.name} has no header; name its {count} columns: columns = ["time_s", ...] in '
            "a mapping file"
        )


def read_recording(
    path: str | Path,
    *,
    mapping: MappingLike = None,
    signals: Any = None,
    max_rows: int = MAX_ROWS,
    name: str | None = None,
) -> Recording:
    r"""Read a recording: text, or a file of a program in any of the formats that are known.

    Units come from the headers (``pressure_1_bar``, ``angle [deg]``), a row of units or the
    mapping; a column without unit is taken as SI and the mapping says so. Print
    ``recording.mapping`` to see how each column was read. `check_recording` judges and corrects
    what stands in the file.

    Args:
        path: The file; text files may be compressed (``.csv.gz``).
        mapping: TOML file (see `read_mapping`) or its content; None takes `mapping_beside` the
            file, else maps by name and unit.
        signals: Names, a mapping from name to unit, or a model whose inputs and outputs are
            requested. None to take every column of numbers.
        max_rows: Largest number of rows kept; a longer file is averaged in groups, with a note.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "trial.csv"
        >>> _ = file.write_text("time_ms;angle_deg\n0;0,0\n2;90,0\n4;180,0\n")
        >>> recording = read_recording(file)
        >>> recording.time, recording["angle"].round(3)
        (array([0.   , 0.002, 0.004]), array([0.   , 1.571, 3.142]))
        >>> print(recording.mapping)
        column     signal  unit  SI unit  value   by      note
        time_ms    time    ms    s        column  name
        angle_deg  angle   deg   rad      column  header
    """
    file = Path(path)
    if mapping is None:
        mapping = mapping_beside(file)
    rules = rules_of(mapping)
    requested = requested_signals(signals)
    check_range("max_rows", max_rows, 2, 1e9)
    found = _columns(file, rules, max_rows=int(max_rows))
    title = name or _title(file)
    if found.saved is not None and mapping is None:
        return _as_requested(restore_recording(found, found.saved), requested)
    _named(found, file, rules)
    assigned = assign(found, rules, requested)
    if assigned.time is None:
        raise WorkbenchError(
            f"{file.name} has no time column (its columns: {', '.join(found.headers)[:300]}); name "
            'one in a mapping file, time = "...", or give sample_time_s there, or write'
            ' "# sample rate = 100 Hz" above the table'
        )
    if not assigned.signals:
        raise WorkbenchError(f"{file.name} holds a time but no signals")
    rows = np.isfinite(assigned.time)
    if np.count_nonzero(rows) < 2:
        raise WorkbenchError(
            f"{file.name} has {np.count_nonzero(rows)} row(s) with a time; a recording needs two"
        )
    known = vars(assigned) | {"time": np.where(rows, assigned.time, 0.0)}
    recording = Recording(title, source=file.name, **known)
    if not rows.all():
        lost = np.count_nonzero(~rows)
        recording = recording.take(rows).noted(f"{lost} row(s) without a time left out")
    return _within(recording, rules)


def _as_requested(recording: Recording, requested: Sequence[Requested]) -> Recording:
    """Check that a restored recording has what is asked for, and put it first."""
    if not requested:
        return recording
    names = [w.name for w in requested if w.name in recording or not w.optional]
    for name in names:
        recording.signal(name)
    return recording.select([*names, *(n for n in recording.names if n not in names)])


def read_table(path: str | Path, *, mapping: MappingLike = None) -> Table:
    r"""Read every column of numbers, in SI, of a file that is no recording, such as a force map.

    The file may have any format of `read_recording`, and a mapping as it takes it.
    """
    file = Path(path)
    rules = rules_of(mapping)
    found = _columns(file, rules)
    _named(found, file, rules)
    assigned = assign(found, rules, ())
    if not assigned.signals:
        raise WorkbenchError(f"{file.name} holds no columns of numbers")
    signals_ = assigned.signals
    if assigned.time is not None:
        signals_ = (Signal("time", assigned.time, "s"), *signals_)
    return Table(_title(file), signals_, assigned.notes)
