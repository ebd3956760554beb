"""Dates and times of day in the cells of a table.

Units: all times are in s.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from workbench.arrays import Vector
from workbench.model.units import in_time

_STAMP = re.compile(
    r"(?P<date>(?P<iso_y>\d{4})([-/.])(?P<iso_m>\d\d?)\3(?P<iso_d>\d\d?)"
    r"|(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4}|\d\d)"
    r"|(?P<slashed_m>\d\d?)/(?P<slashed_d>\d\d?)/(?P<slashed_y>\d{4}|\d\d)"
    r"|(?P<named_d>\d\d?)[- ](?P<named_m>[A-Za-z]{3})[- ](?P<named_y>\d{4}|\d\d))?"
    r"(?:(?:(?<=\d)[T ]\s*)?(?P<clock>(?P<h>\d\d?):(?P<min>\d\d)"
    r"(?::(?P<s>\d\d(?:[.,]\d*)?)|(?P<part>[.,]\d+))?(?:\s?(?P<half>[AaPp])[Mm])?)"
    r"\s?(?:Z|(?P<zone>[A-Z]{3,4})|(?P<east>[+-]\d\d):?(?P<more>\d\d))?)?"
)
_EAST = {
    "UTC": 0, "GMT": 0, "WET": 0, "WEST": 1, "BST": 1, "CET": 1, "MEZ": 1, "CEST": 2, "MESZ": 2,
    "EET": 2, "EEST": 3, "JST": 9, "EST": -5, "EDT": -4, "CST": -6, "CDT": -5, "MST": -7,
    "MDT": -6, "PST": -8, "PDT": -7,
}  # fmt: skip
"""Hours by which clocks of a zone are ahead of the universal time."""
Instant = tuple[float | None, float | None]
NEVER: Instant = (None, None)
_MILLENNIUM = date(2000, 1, 1).toordinal()
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_PARTS = [(f"{of}y", f"{of}m", f"{of}d") for of in ("", "slashed_", "named_", "iso_")]


def instant(cell: str, *, day_first: bool = False) -> Instant:
    """Return the date that a cell holds, counted from 2000, and its time of day, both in s.

    Args:
        day_first: Whether 3/4/2024 is a day of April; 13/4/2024 is one anyway.

    Example:
        >>> instant("04.01.2000 06:00"), instant("2000-01-04T00:01:30.5Z"), instant("7:00")
        ((259200.0, 21600.0), (259200.0, 90.5), (None, 25200.0))
        >>> instant("2000-01-04T03:00+02:00"), instant("04:59.5"), instant("1/4/2000 12:00:30 AM")
        ((259200.0, 3600.0), (None, 299.5), (259200.0, 30.0))
        >>> instant("27.10.2024 02:30:00 CEST")[1], instant("27.10.2024 02:30:00 CET")[1]
        (1800.0, 5400.0)
    """
    found = _STAMP.fullmatch(cell)
    if found is None or (found["zone"] or "UTC") not in _EAST:
        return NEVER
    day = clock = None
    if found["date"]:
        try:
            day = _date(found, day_first=day_first)
        except ValueError:
            return NEVER
    if found["clock"]:
        numbers = found.group("h", "min", "s")
        if found["part"]:
            # "04:59.5", as Excel writes what is shorter than an hour.
            numbers = "0", found["h"], found["min"] + found["part"]
        hour, minute, second = (float((n or "0").replace(",", ".")) for n in numbers)
        if found["half"]:
            # A clock of twelve hours begins with its twelfth.
            hour = hour % 12.0 + 12.0 * (found["half"] in "Pp")
        clock = 3600.0 * hour + 60.0 * minute + second
        if found["east"]:
            east = float(found["east"])
            clock -= 3600.0 * east + math.copysign(60.0 * float(found["more"]), east)
        clock -= 3600.0 * _EAST[found["zone"] or "UTC"]
    return day, clock


def _date(found: re.Match[str], *, day_first: bool) -> float:
    """Return a date, counted from 2000, in s; ValueError if there is none of that number."""
    year, month, day = found.group(*next(parts for parts in _PARTS if found[parts[0]]))
    if found["slashed_y"] and (int(month) > 12 or (day_first and int(day) <= 12)):
        month, day = day, month
    number = int(month) if month.isdigit() else 1 + _MONTHS.index(month.lower())
    whole = date(int(year) + 2000 * (len(year) == 2), number, int(day))
    return 86400.0 * (whole.toordinal() - _MILLENNIUM)


def begins_with_day(lines: Sequence[str]) -> bool:
    """Tell whether dates such as 3/4/2024 begin with the day, as they lie closer together then.

    Example:
        >>> begins_with_day(["5/6/2024 23:59:59,1.0", "6/6/2024 00:00:00,1.1"])
        True
    """
    dates = set(re.findall(r"\b\d\d?/\d\d?/\d+", "\n".join(lines)))
    days = [[instant(d, day_first=first)[0] for d in dates] for first in (True, False)]
    own, other = (np.ptp([day for day in each if day is not None] or [0.0]) for each in days)
    return bool(own < other) or any(int(d.partition("/")[0]) > 12 for d in dates)


_HOUR = 3600.0
"""By how much clocks are put forward in spring and back in autumn, in s."""


def start_at_zero(values: Vector, stamps: Sequence[Instant]) -> list[str]:
    """Let instants begin at zero: a date and a time of day beside it are one, in both columns.

    Returns:
        What a reader is told: where a clock was put forward or back by an hour, which is undone.
    """
    dates = [k for k, (day, clock) in enumerate(stamps) if day is not None and clock is None]
    clocks = [k for k, (day, clock) in enumerate(stamps) if day is None and clock is not None]
    if dates and clocks:
        values[:, dates[0]] += values[:, clocks[0]]
        values[:, clocks[0]] = values[:, dates[0]]
    for k in () if dates else clocks:
        midnights = np.diff(values[:, k], prepend=values[0, k]) < -43200.0
        values[:, k] += 86400.0 * np.cumsum(midnights)
    told: dict[str, None] = {}
    for k, stamp in enumerate(stamps):
        if stamp != NEVER:
            values[:, k] -= values[0, k]
            told |= dict.fromkeys(_without_clock_changes(values[:, k]))
    return [*told]


def _without_clock_changes(time: Vector) -> list[str]:
    """Undo where the next row is an hour later or earlier than it would be, but for half a step."""
    steps = np.diff(time)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if not 0.0 < usual < 0.25 * _HOUR:
        return []
    hours = np.sign(steps)
    hours[np.abs(steps - usual - hours * _HOUR) > 0.5 * usual] = 0.0
    time[1:] -= _HOUR * np.cumsum(hours)
    return [
        f"the clock was put {'forward' if hours[i] > 0.0 else 'back'} by an hour after"
        f" {in_time(float(time[i]))}; undone"
        for i in np.flatnonzero(hours)
    ]
