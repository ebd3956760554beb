"""What the sensors could tell apart, as a table beside what was located."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.diagnosis.location.isolability import Isolability
from workbench.reports.tables import Cell, Table, number

_SENSORS = 3


def isolability_table(found: Isolability, located: Sequence[str] = ()) -> Table:
    """Build the table of groups of ports that the recorded outputs can tell apart.

    Args:
        found: What structure and transfers say.
        located: Ports at which something was located; their groups come first.

    Returns:
        One row per group, with the group that is hardest to tell from it.

    Example:
        >>> from workbench.diagnosis.location.isolability import isolability
        >>> from workbench.plants.servo_axis import servo_axis
        >>> print(isolability_table(isolability(servo_axis()), ["axis.force"]))
        What these sensors can tell apart
        ports that cannot be told apart  hardest to tell from
        axis.force, position.reading
        ...
    """
    rows: list[tuple[Cell | str, ...]] = []
    groups = sorted(found.groups, key=lambda group: not set(group) & set(located))
    for group in groups:
        near = found.nearest.get(group[0])
        beside = "" if near is None else f"{near[0]}, {number(math.degrees(near[1]), 2)}° apart"
        # The port that was located stands first in its group.
        named = _plain(sorted(group, key=lambda port: port not in located))
        here = "located here" if set(group) & set(located) else ""
        rows.append((Cell(named, reason=here), beside.replace("_", " ")))
    if found.unseen:
        rows.append((_plain(found.unseen), "cannot be seen at all"))
    return Table(
        "What these sensors can tell apart",
        ("ports that cannot be told apart", "hardest to tell from"),
        tuple(rows),
        _note(found, located),
    )


def _plain(ports: Sequence[str]) -> str:
    return ", ".join(ports).replace("_", " ")


def _note(found: Isolability, located: Sequence[str]) -> str:
    text = (
        "From the equations alone, with the recorded outputs; the angle is that between the"
        " directions in which signals there move the measurements, 90° at most. Within a group only"
        " the form of the signal tells, not its place."
    )
    own = [group for group in found.groups if len(group) > 1 and set(group) & set(located)]
    if not own:
        return text
    left: dict[str, int] = {}
    for sensor in found.sensors_that_split(own[0]):
        with_it = [part for part in sensor.splits[0] if set(part) & set(located)]
        left[sensor.text.replace("_", " ")] = sum(map(len, with_it))
    # The fewer ports remain with the located one, the better.
    apart = sorted((name for name in left if left[name] < len(own[0])), key=left.__getitem__)
    if not apart:
        return text
    few = ", ".join(apart[:_SENSORS])
    return f"{text} The group that was located would be split by measuring {few}."
