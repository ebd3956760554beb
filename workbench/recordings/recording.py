"""A recording: a time base and named signals in SI, with what was done to them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from workbench.arrays import Matrix, Vector, runs
from workbench.display import Drawn, Rows, aligned_table
from workbench.errors import WorkbenchError, check_choice
from workbench.model.units import from_si, in_time, same_dimension
from workbench.recordings.quantity_kinds import kind_of

Role = Literal["command", "reference", "measurement"]
Scalar = str | int | float | bool

_EVEN = 0.02
"""Part of a step by which a rounded clock may miss a sample of an even time base."""


def _frozen(values: npt.ArrayLike, what: str) -> Vector:
    array = np.array(values, dtype=float)
    if array.ndim != 1:
        raise WorkbenchError(f"{what} has the shape {array.shape}; it must be one column")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Signal:
    """A named column of a recording, in SI.

    Args:
        values: Samples, shape (n,), in ``unit``; NaN where nothing was measured.
        unit: SI unit; ``""`` if the file did not state one.
        kind: What it measures; by default from the unit. Pressures say ``gauge pressure``,
            ``absolute pressure`` or, if nothing was stated, ``pressure``.
        display_unit: Unit in which people read it; by default from the unit.
    """

    name: str
    values: Vector
    unit: str = ""
    kind: str = ""
    role: Role = "measurement"
    display_unit: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _frozen(self.values, f"signal {self.name!r}"))
        check_choice(f"role of {self.name!r}", self.role, ("command", "reference", "measurement"))
        kind = kind_of(self.unit)
        if not self.kind:
            object.__setattr__(self, "kind", kind.name)
        if not self.display_unit or not same_dimension(self.display_unit, self.unit):
            object.__setattr__(self, "display_unit", kind.display_unit)

    @property
    def zero_order_hold(self) -> bool:
        """Whether the signal keeps its value until the next sample."""
        return self.role in ("command", "reference")

    def displayed(self, values: npt.ArrayLike | None = None) -> Vector:
        """Return the samples, or other SI values of this signal, in the display unit.

        Args:
            values: Values in ``unit``, any shape; the samples if not given.
        """
        array = self.values if values is None else np.asarray(values, dtype=float)
        return from_si(array, self.display_unit) if self.display_unit else array


@dataclass(frozen=True)
class Span:
    """A stretch, ``start`` to ``stop`` in s, in which a signal was not measured.

    Args:
        start: First instant concerned, in s.
        stop: Last instant concerned, in s.
    """

    signal: str
    start: float
    stop: float
    reason: str


@dataclass(frozen=True)
class MappedColumn:
    """One line of the printed mapping.

    Args:
        signal: Name of the signal; ``time`` for the time base.
        unit: Unit of the column; ``""`` if it was taken as SI because none was stated.
        how: ``mapping file``, ``name``, ``unit``, ``sample time`` ...
        sign: Factor 1 or -1.
        factor: Gain, in ``unit`` per unit of the column.
        offset: In ``unit``.
    """

    column: str
    signal: str
    unit: str
    si_unit: str
    how: str
    sign: float = 1.0
    factor: float = 1.0
    offset: float = 0.0
    note: str = ""

    @property
    def stated(self) -> bool:
        """Whether somebody said what the column is: a mapping file, a model or a unit."""
        return bool(self.unit) or self.how != "header"


@dataclass(frozen=True)
class ColumnMapping:
    """How the columns of a file became the signals of a recording.

    Args:
        unused: Headers of columns that were left out, with the reason.
    """

    rows: tuple[MappedColumn, ...]
    unused: tuple[tuple[str, str], ...] = ()

    def __iter__(self) -> Iterator[MappedColumn]:
        return iter(self.rows)

    def __str__(self) -> str:
        def formula(r: MappedColumn) -> str:
            gain = r.sign * r.factor
            text = "" if gain == 1 else ("-" if gain == -1 else f"{gain:g} ")
            return f"{text}column" + (f" {r.offset:+g}" if r.offset else "")

        body = [
            (
                r.column,
                r.signal,
                r.unit or "not stated",
                r.si_unit or "taken as SI",
                formula(r),
                r.how,
                r.note,
            )
            for r in self.rows
        ]
        body += [(column, "-", "", "", "", "left out", why) for column, why in self.unused]
        titles = ("column", "signal", "unit", "SI unit", "value", "by", "note")
        return aligned_table(titles, body)


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Drawn):
    """Signals over time, in SI.

    The time base may be anything a file can hold; `workbench.recordings.check_recording` makes it
    increasing and uniform. What is done to a recording is written into its notes.

    Args:
        time: Instants, shape (n,), in s.
        notes: What was corrected or assumed, in order.
        metadata: Settings of the experiment, such as ``load_kg``.
        excluded: Stretches in which a signal was not measured and must not be judged.
        resampled: Whether it has another pace than it was taken at: neighbours share their noise.

    Example:
        >>> time = np.arange(4) * 0.1
        >>> recording = Recording("trial", time, (Signal("angle", np.ones(4), "rad"),))
        >>> recording["angle"].sum()
        np.float64(4.0)
        >>> print(recording)
        trial: 4 samples, 300 ms, 10 Hz
        signal  kind   role         unit  minimum  maximum  missing
        angle   angle  measurement  deg   57.2958  57.2958  0
    """

    name: str
    time: Vector
    signals: tuple[Signal, ...]
    source: str = ""
    notes: tuple[str, ...] = ()
    metadata: Mapping[str, Scalar] = field(default_factory=dict)
    excluded: tuple[Span, ...] = ()
    mapping: ColumnMapping | None = None
    resampled: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", _frozen(self.time, "time"))
        for name in ("signals", "notes", "excluded"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not np.all(np.isfinite(self.time)):
            raise WorkbenchError(
                f"recording {self.name!r} has instants that are not finite; remove those rows"
            )
        for signal in self.signals:
            if not isinstance(signal, Signal):
                raise WorkbenchError(
                    f"a signal of recording {self.name!r} is a {type(signal).__name__}; give each"
                    " as Signal(name, values, unit)"
                )
            if len(signal.values) != len(self.time):
                raise WorkbenchError(
                    f"signal {signal.name!r} has {len(signal.values)} samples but the time has "
                    f"{len(self.time)}; they must be equal"
                )
        double = sorted({n for n in self.names if self.names.count(n) > 1})
        if double:
            raise WorkbenchError(
                f"recording {self.name!r} has two signals {double[0]!r}; rename one"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals, in order."""
        return tuple(s.name for s in self.signals)

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the commands."""
        return tuple(s.name for s in self.signals if s.role == "command")

    @property
    def measurements(self) -> tuple[str, ...]:
        """Names of the measured signals."""
        return tuple(s.name for s in self.signals if s.role == "measurement")

    def moving(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of some signals whose samples differ."""
        return tuple(name for name in names if np.ptp(self[name]) > 0)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, in s."""
        return float(self.time[-1] - self.time[0]) if len(self.time) else 0.0

    @property
    def sample_time(self) -> float:
        """Median step of the time base, in s; NaN with fewer than two samples.

        Of even steps, missing rows aside, it is their mean, which a rounded clock leaves right.
        """
        if len(self.time) < 2:
            return float("nan")
        steps = np.diff(self.time)
        usual = float(np.median(steps))
        if not usual > 0.0:
            return usual
        whole = np.round(steps / usual)
        even = bool(np.all(np.abs(steps - whole * usual) < _EVEN * usual) and np.all(whole >= 1.0))
        return self.duration / float(whole.sum()) if even else usual

    @property
    def increasing(self) -> bool:
        """Whether every instant lies after the one before."""
        return bool(np.all(np.diff(self.time) > 0))

    def __len__(self) -> int:
        return len(self.time)

    def signal(self, name: str) -> Signal:
        """Return a signal by name."""
        check_choice(f"signal of recording {self.name!r}", name, self.names)
        return next(s for s in self.signals if s.name == name)

    @overload
    def __getitem__(self, key: str) -> Vector: ...
    @overload
    def __getitem__(self, key: slice) -> Recording: ...
    def __getitem__(self, key: str | slice) -> Vector | Recording:
        """Return the samples of a signal in SI, or a slice of the recording."""
        return self.take(key) if isinstance(key, slice) else self.signal(key).values

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def matrix(self, names: Iterable[str]) -> Matrix:
        """Return signals side by side, shape (n, number of names), in SI."""
        columns = [self[name] for name in names]
        return np.column_stack(columns) if columns else np.zeros((len(self.time), 0))

    def valid(self, name: str) -> npt.NDArray[np.bool_]:
        """Return where a signal was really measured, shape (n,)."""
        spans = [(s.start, s.stop) for s in self.excluded if s.signal == name]
        starts, stops = np.sort(np.reshape(spans, (-1, 2)), axis=0).T
        begun = np.searchsorted(starts, self.time, side="right")
        over = np.searchsorted(stops, self.time, side="left")
        good: npt.NDArray[np.bool_] = np.isfinite(self[name]) & (begun == over)
        return good

    def at_times(self, time: npt.ArrayLike) -> Recording:
        """Return the same samples at other instants, shape (n,), in s; what is excluded goes along.

        Example:
            >>> span = Span("x", 1.0, 1.0, "row missing")
            >>> made = Recording("a", np.arange(3.0), (Signal("x", np.zeros(3)),), excluded=(span,))
            >>> made.at_times([0.1, 1.1, 2.1]).valid("x").tolist()
            [True, False, True]
        """
        new = np.asarray(time, dtype=float)
        spans = (
            replace(s, start=float(a), stop=float(b))
            for s in self.excluded
            for a, b in [np.interp([s.start, s.stop], self.time, new)]
        )
        return replace(self, time=new, excluded=tuple(spans))

    def take(self, rows: slice | npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> Recording:
        """Return the recording at some of its rows."""
        return replace(
            self,
            time=self.time[rows],
            signals=tuple(replace(s, values=s.values[rows]) for s in self.signals),
        )

    def between(self, start: float, stop: float) -> Recording:
        """Return the samples with ``start <= time <= stop``, in s."""
        rows = (self.time >= start) & (self.time <= stop)
        if np.count_nonzero(rows) < 2:
            raise WorkbenchError(
                f"recording {self.name!r} has no samples from {start:g} to {stop:g} s; it runs "
                f"from {self.time.min():g} to {self.time.max():g} s"
            )
        return self.take(rows)

    def select(self, names: Iterable[str]) -> Recording:
        """Return the recording with these signals only, in this order."""
        return replace(self, signals=tuple(self.signal(name) for name in names))

    def with_signal(self, signal: Signal) -> Recording:
        """Return the recording with a signal replaced or added."""
        signals = {s.name: s for s in self.signals} | {signal.name: signal}
        return replace(self, signals=tuple(signals.values()))

    def with_roles(self, roles: Mapping[str, Role]) -> Recording:
        """Return the recording with other roles of its signals."""
        changed = self
        for name, role in roles.items():
            changed = changed.with_signal(replace(self.signal(name), role=role))
        return changed

    def excluding(self, name: str, bad: npt.NDArray[np.bool_], reason: str) -> Recording:
        """Return the recording with samples of a signal, shape (n,), excluded from judgement."""
        spans = [Span(name, float(self.time[a]), float(self.time[b]), reason) for a, b in runs(bad)]
        return replace(self, excluded=(*self.excluded, *spans))

    def noted(self, *notes: str) -> Recording:
        """Return the recording with notes added."""
        return replace(self, notes=(*self.notes, *notes))

    def tables(self) -> tuple[Rows, ...]:
        """Return the range of every signal in the unit in which it is shown."""
        rows = []
        for s in self.as_data()["signals"]:
            low, high = (
                "" if s[end] is None else f"{s[end]:.6g}" for end in ("minimum", "maximum")
            )
            missing = str(s["missing"])
            rows.append((s["name"], s["kind"], s["role"], s["unit"] or "?", low, high, missing))
        titles = ("signal", "kind", "role", "unit", "minimum", "maximum", "missing")
        return (Rows("signals", titles, rows),)

    def as_data(self) -> dict[str, list[dict[str, Any]]]:
        """Return the signals, with their ranges as they are shown, and how columns were read."""
        signals: list[dict[str, Any]] = []
        for s in self.signals:
            shown = s.displayed()
            finite = shown[np.isfinite(shown)]
            low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
            signals.append(
                {"name": s.name, "kind": s.kind, "role": s.role, "unit": s.display_unit}
                | {"minimum": low, "maximum": high}
                | {"missing": int(np.count_nonzero(~self.valid(s.name)))}
            )
        rows = () if self.mapping is None else self.mapping.rows
        return {"signals": signals, "columns": [asdict(row) for row in rows]}

    def columns(self) -> dict[str, Vector]:
        """Return time and signals over time, in SI."""
        return {"time": self.time, **{s.name: s.values for s in self.signals}}

    def __str__(self) -> str:
        step = self.sample_time
        pace = f"{1 / step:g} Hz" if 0 < step <= 1 else f"one every {in_time(step, 6)}"
        head = f"{self.name}: {len(self)} samples, {in_time(self.duration, 6)}, {pace}"
        (table,) = self.tables()
        notes = [f"note: {note}" for note in self.notes]
        return "\n".join([head, aligned_table(table.headings, table.rows), *notes])
