"""Findings that differ in the plant only, told once: the worst plant, and which others."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from workbench.study.baseline import Change
from workbench.study.judgements import Judgement

T = TypeVar("T")


@dataclass(frozen=True)
class Group(Generic[T]):
    """Findings on several plants."""

    worst: T
    others: tuple[str, ...] = ()

    @property
    def also(self) -> str:
        """The other plants in words; empty if there are none."""
        # A name may hold a comma of its own.
        return f"also with {'; '.join(self.others)}" if self.others else ""


def missed_by_plant(judgements: Iterable[Judgement]) -> tuple[Group[Judgement], ...]:
    """Put together a missed requirement on several plants."""
    return _grouped(
        judgements,
        key=lambda j: (id(j.demand), j.controller, j.scenario),
        plant=lambda j: j.variation,
        badness=lambda j: j.score,
    )


def changes_by_plant(
    changes: Iterable[Change], required: Iterable[str] = ()
) -> tuple[Group[Change], ...]:
    """Put together a change of one metric on several plants.

    Returns:
        One group per controller, scenario, metric and way; required metrics first, then those that
        are furthest beyond their tolerance.
    """
    first = set(required)
    found = _grouped(
        changes,
        key=lambda c: (c.key[0], c.key[2], c.metric, c.way, c.fails),
        plant=lambda c: c.key[1],
        badness=_beyond,
    )
    return tuple(sorted(found, key=lambda g: g.worst.metric not in first and g.worst.metric != ""))


def _beyond(change: Change) -> float:
    moved = abs(change.after - change.before)
    if math.isnan(moved):
        return math.inf
    return moved / max(change.tolerance, 1e-12)


def _grouped(
    items: Iterable[T],
    *,
    key: Callable[[T], Hashable],
    plant: Callable[[T], str],
    badness: Callable[[T], float],
) -> tuple[Group[T], ...]:
    groups: dict[Hashable, list[T]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    found = []
    for own in groups.values():
        worst = max(own, key=badness)
        names = dict.fromkeys(plant(item) for item in own)
        found.append(Group(worst, tuple(n for n in names if n != plant(worst))))
    return tuple(sorted(found, key=lambda g: -badness(g.worst)))
