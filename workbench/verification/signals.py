"""Reference signals over time: steps, a sine, ramps; frozen data that a study file can hold.

Units: s, and SI for values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_finite, check_range
from workbench.model.units import refuse_slips, same_dimension, to_si
from workbench.registry import Registry, user_code

FREQUENCIES_HZ = (1.0 / TIMES_S[1], 1.0 / TIMES_S[0])
"""Lowest and highest frequency of a sine, in Hz."""

BEGINS_S = (0.0, TIMES_S[1])
"""Earliest and latest begin of a sine, in s."""


class Signal(Protocol):
    """A reference over time."""

    def sample(self, time: npt.ArrayLike) -> Vector:
        """Return the signal at some times, shape (n,), in s; values in SI."""

    @property
    def changes(self) -> tuple[tuple[float, float, float], ...]:
        """Time in s, value before and value after of every step; none unless it has steps."""
        return ()


@dataclass(frozen=True)
class _Points(Signal):
    """Values at increasing times."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        word = type(self).__name__.lower()
        times = check_finite(f"times of the {word} reference", self.times)
        check_finite(f"values of the {word} reference", self.values)
        if len(times) != len(self.values) or not len(times) or np.any(np.diff(times) <= 0):
            raise WorkbenchError(
                f"the {word} reference has {len(self.values)} values at the times"
                f" {list(self.times)[:8]} s; give one value per time, and times must increase"
            )

    def sample(self, time: npt.ArrayLike) -> Vector:
        # A time computed as k h may fall short of its decimal value by one rounding.
        instants = np.asarray(time, dtype=float) * (1.0 + 1e-10)
        index = np.searchsorted(self.times, instants, side="right") - 1
        return np.asarray(self.values, dtype=float)[np.maximum(index, 0)]


@dataclass(frozen=True)
class Steps(_Points):
    """A staircase: each value holds from its time to the next.

    Args:
        times: Increasing times, in s; the first is 0.
        values: Values in SI, as many as ``times``.
    """

    def __post_init__(self) -> None:
        if self.times and self.times[0] != 0.0:
            raise WorkbenchError(f"steps have the times {list(self.times)}; start at 0 s")
        super().__post_init__()

    @property
    def changes(self) -> tuple[tuple[float, float, float], ...]:
        v = self.values
        return tuple((t, v[i], v[i + 1]) for i, t in enumerate(self.times[1:]) if v[i] != v[i + 1])


@dataclass(frozen=True)
class Sine(Signal):
    """A sine that starts at its mean.

    Args:
        begin: Time until which the mean is held, in s.
    """

    mean: float
    amplitude: float
    frequency_Hz: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        check_finite("mean and amplitude of the sine", (self.mean, self.amplitude))
        check_range("frequency of the sine", self.frequency_Hz, *FREQUENCIES_HZ, "Hz")
        check_range("begin of the sine", self.begin, *BEGINS_S, "s")

    def sample(self, time: npt.ArrayLike) -> Vector:
        elapsed = np.maximum(np.asarray(time, dtype=float) - self.begin, 0.0)
        wave = np.sin(2.0 * math.pi * self.frequency_Hz * elapsed)
        return np.asarray(self.mean + self.amplitude * wave, dtype=float)


@dataclass(frozen=True)
class Ramps(_Points):
    """Straight lines between points, constant before the first and after the last."""

    def sample(self, time: npt.ArrayLike) -> Vector:
        instants = np.asarray(time, dtype=float)
        return np.asarray(np.interp(instants, self.times, self.values), dtype=float)


@dataclass(frozen=True)
class Recorded(_Points):
    """A reference as it was recorded: each sample holds until the next, the last one for ever.

    Unlike `Steps` it has no steps whose responses are measured: quantised, held and noisy
    references are played as they are.
    """

    @classmethod
    def read(cls, path: str | Path, column: str = "", *, unit: str = "1") -> Recorded:
        """Read a reference from a CSV file: header, and times in its first column.

        A header may state a unit, ``time [ms]``; without one times are in s, the reference in
        ``unit``.

        Args:
            column: Name of its column; by default the only one behind the times.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
            rows = [line.split(",") for line in text.splitlines() if line.strip()]
            names, units = zip(*map(_name_and_unit, rows[0]), strict=True)
            if not column and len(names) > 2:
                raise WorkbenchError(
                    f"reference file {path} has the columns {', '.join(names[1:])}; say which it"
                    " is (column)"
                )
            column = column or names[1]
            check_choice(f"column of {path}", column, names[1:])
            k = names.index(column)
            table = np.array(rows[1:], dtype=float)
            times, values = to_si(table[:, 0], units[0] or "s"), table[:, k]
        except (OSError, IndexError, ValueError) as error:
            raise WorkbenchError(
                f"reference file {path} cannot be read ({error}); give a CSV file with a header,"
                " the times in s in its first column, and one number per cell"
            ) from None
        if units[k] and unit != "1" and not same_dimension(units[k], unit):
            raise WorkbenchError(
                f"column {column} of {path} is in {units[k]!r}; give it in a unit like {unit!r}"
            )
        found = np.asarray(to_si(values, units[k] or unit))
        return cls(tuple(np.asarray(times).tolist()), tuple(found.tolist()))


def _name_and_unit(header: str) -> tuple[str, str]:
    """Return a column's name, and the unit in brackets behind it, if any."""
    found = re.fullmatch(r"\s*(.*?)\s*(?:\[(.*)\])?\s*", header)
    return (found[1], found[2] or "") if found else (header, "")


@dataclass(frozen=True)
class SignalKind:
    """A kind of reference that a study file can hold.

    Args:
        valued: Keys in the unit of the signal; they are converted to SI.
        others: Keys in SI.
    """

    name: str
    build: Callable[..., Signal]
    valued: tuple[str, ...]
    others: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()


STEPS = SignalKind("steps", Steps, ("values",), ("times",))
SINE = SignalKind("sine", Sine, ("mean", "amplitude"), ("frequency_Hz", "begin"), ("begin",))
RAMPS = SignalKind("ramps", Ramps, ("values",), ("times",))
RECORDED = SignalKind("recorded", Recorded, ("values",), ("times",))

SIGNALS: Registry[SignalKind] = Registry(
    "kind of reference", SignalKind, package="workbench.verification", group="workbench.signals"
)
"""Every kind of reference, by name."""


def rests(signal: Signal) -> bool:
    """Tell whether a signal comes to rest."""
    return bool(signal.changes) or isinstance(signal, Steps)


def signal_from_table(table: Mapping[str, Any], *, folder: Path | None = None) -> Signal:
    """Build a signal from a table of a study file.

    Args:
        table: ``kind``, a member of `SIGNALS`; ``unit`` of its values; and the keys of that kind.
            A recorded one may have ``file``, and ``column``, in the place of numbers.
        folder: Where a kind of one's own is found as ``module:object``.
    """
    entries = dict(table)
    kind = SIGNALS.get(str(entries.pop("kind", "steps")), folder=folder)
    unit = str(entries.pop("unit", "1"))
    refuse_slips(unit)
    if kind.name == "recorded" and {"file"} <= set(entries) <= {"file", "column"}:
        path = (folder or Path()) / str(entries["file"])
        return Recorded.read(path, str(entries.get("column", "")), unit=unit)
    for key in entries:
        check_choice(
            f"key of the {kind.name} reference", key, ("kind", "unit", *kind.valued, *kind.others)
        )
    for key in (*kind.valued, *kind.others):
        if key not in entries and key not in kind.optional:
            raise WorkbenchError(f"the {kind.name} reference has no {key!r}; add it")
    arguments: dict[str, Any] = {}
    for key, value in entries.items():
        if any(isinstance(v, bool) for v in (value if isinstance(value, list) else [value])):
            raise WorkbenchError(f"{key} of the {kind.name} reference is {value!r}; give numbers")
        numbers = check_finite(f"{key} of the {kind.name} reference", value)
        given = np.asarray(to_si(numbers, unit) if key in kind.valued else numbers)
        arguments[key] = tuple(np.ravel(given).tolist()) if given.ndim else float(given)
    with user_code(f"reference of kind {kind.name!r}"):
        return kind.build(**arguments)
