"""What could be located at all: which ports the sensors can tell apart, before any recording.

Two routes, and only what both tell apart counts: the structure of the equations, and the directions
in which a signal at each port moves the measurements. Ports whose directions are the same at every
frequency and operating point cannot be told apart by any recording.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.location.structure import Structure, cut, structure_of
from workbench.diagnosis.location.transfers import Transfers, transfers
from workbench.errors import check_choice
from workbench.model import Model

Groups = tuple[tuple[str, ...], ...]

_SAME = 1e-6
"""Sine of the angle between two directions below which they are one."""


@dataclass(frozen=True)
class Sensor:
    """A sensor to add, and what it would split.

    Args:
        signal: Name of the port, signal or state to read.
        before: Whether to read what enters the port rather than what leaves it, so on the other
            side of what may be missing there.
        splits: For each group that it would split, the parts.
    """

    signal: str
    before: bool
    splits: tuple[Groups, ...]

    @property
    def gained(self) -> int:
        """How many more groups there would be."""
        return sum(len(parts) - 1 for parts in self.splits)

    @property
    def text(self) -> str:
        """What to read, in words."""
        return f"{self.signal} (as it enters)" if self.before else self.signal

    def __str__(self) -> str:
        """Return one line."""
        splits = "; ".join(" | ".join(", ".join(part) for part in parts) for parts in self.splits)
        return f"{self.text} splits {splits}"


@dataclass(frozen=True)
class Isolability:
    """Which ports the sensors can tell apart.

    Args:
        groups: Ports that cannot be told apart, group by group.
        unseen: Ports at which nothing that is missing could be seen.
        nearest: For each group, by its first port: the first port of the group that is hardest to
            tell from it, and the largest angle between the directions of their measurements, in
            rad.
        readable: Unknowns in each signal that could be read.
    """

    model: str
    outputs: tuple[str, ...]
    groups: Groups
    unseen: tuple[str, ...]
    nearest: Mapping[str, tuple[str, float]]
    structure: Structure = field(repr=False)
    readable: Mapping[str, tuple[str, ...]] = field(repr=False)
    transfers: Transfers = field(repr=False)

    def group_of(self, port: str) -> tuple[str, ...]:
        """Return the ports that cannot be told from one; itself alone if nothing is seen there."""
        check_choice("port", port, [*(p for g in self.groups for p in g), *self.unseen])
        return next((g for g in self.groups if port in g), (port,))

    def sensors_that_split(self, group: Sequence[str] | None = None) -> tuple[Sensor, ...]:
        """Return sensors that would split the group of some ports, or any, the best first.

        Of several that split the same, it is the first in the order of the equations.
        """
        wanted = self.groups if group is None else (self.group_of(next(iter(group))),)
        found: dict[tuple[Groups, ...], Sensor] = {}
        for name, holds in self.readable.items():
            sines = self.transfers.sines(name)
            finer = _joined(
                self.structure.with_measurement(holds).groups()[0], self.transfers, sines
            )
            splits = []
            for old in wanted:
                parts = tuple(p for f in finer if (p := tuple(n for n in old if n in f)))
                if len(parts) > 1:
                    splits.append(parts)
            key = tuple(splits)
            if splits and key not in found:
                signal = name.removesuffix(" before")
                found[key] = Sensor(signal, name != signal, key)
        return tuple(sorted(found.values(), key=lambda s: -s.gained))

    def __str__(self) -> str:
        """Return an aligned table of groups."""
        width = 60
        lines = [
            f"{self.model} with {', '.join(self.outputs)}: groups of ports that can be told apart",
            f"  {'ports of a group':<{width}}  hardest to tell from",
        ]
        for group in self.groups:
            near = self.nearest.get(group[0])
            beside = "" if near is None else f"{near[0]} ({np.degrees(near[1]):.2g} deg)"
            for i, part in enumerate(textwrap.wrap(", ".join(group), width)):
                lines.append(f"  {part:<{width}}  {beside if i == 0 else ''}".rstrip())
        if self.unseen:
            lines.append("  cannot be seen")
            lines += [f"  {part}" for part in textwrap.wrap(", ".join(self.unseen), width)]
        return "\n".join(lines)


def isolability(model: Model, *, outputs: Sequence[str] | None = None) -> Isolability:
    """Find out which ports the sensors could tell apart, from the equations alone.

    A port is told from another if its equation can still be checked against the measurements when
    the equation of the other is not used (Krysander and Frisk 2008). Structure alone may promise
    too much, so ports are joined whose signals move the measurements in the same direction,
    ``G_i(jw) = a(jw) G_j(jw)`` with the linearised transfers from ports to measurements, at every
    one of several operating points and frequencies.

    Raises:
        WorkbenchError: If there is no such output.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> print(isolability(servo_axis()))
        servo axis with position: groups of ports that can be told apart
          ports of a group                                              hardest to tell from
          axis.force, position.reading
    """
    read = tuple(q.name for q in model.outputs) if outputs is None else tuple(outputs)
    parts = cut(model)
    structure, readable = structure_of(parts, read)
    moved = transfers(parts, read)
    sines = moved.sines()
    groups, unseen = structure.groups()
    groups = _joined(groups, moved, sines)
    nearest = {}
    for group in groups:
        angles = {
            other[0]: float(np.nanmax(near))
            for other in groups
            if other is not group
            and np.isfinite(near := sines[np.ix_(moved.rows(group), moved.rows(other))]).any()
        }
        if angles:
            hardest = min(angles, key=angles.__getitem__)
            nearest[group[0]] = hardest, float(np.arcsin(min(angles[hardest], 1.0)))
    return Isolability(model.name, read, groups, unseen, nearest, structure, readable, moved)


def _joined(groups: Groups, moved: Transfers, sines: Vector) -> Groups:
    """Join groups in which two ports move the measurements in the same direction."""
    joined: list[tuple[str, ...]] = []
    alike = np.nan_to_num(sines, nan=1.0) < _SAME
    for group in groups:
        same = [g for g in joined if alike[np.ix_(moved.rows(group), moved.rows(g))].any()]
        joined = [g for g in joined if g not in same]
        together = {*group, *(p for g in same for p in g)}
        joined.append(tuple(p for p in moved.ports if p in together))
    return tuple(sorted(joined, key=lambda g: moved.ports.index(g[0])))
