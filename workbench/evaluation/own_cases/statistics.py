"""Rates over judged answers, with their uncertainty.

Units: all numbers are dimensionless, sizes as `true_size` states them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.evaluation.blind_round import answer_of, score_round
from workbench.evaluation.own_cases.judge import (
    ANSWERERS,
    Judged,
    SizeFound,
    judge,
    smallest_predicted,
    true_size,
    truths_of,
    verdict_of,
)
from workbench.evaluation.own_cases.plan import FACTORS, OUTSIDE, SINGLE, names
from workbench.evaluation.rates import Rate

BARS: dict[str, tuple[str, float]] = {
    "false alarms": ("at most", 0.0),
    "right group": ("at least", 0.96),
    "right name or class of one": ("at least", 0.9),
    "right name or class of two": ("at least", 0.8),
    "right name or class of three": ("at least", 0.65),
    "confidently wrong": ("at most", 0.02),
    "held out within 1.3 of the limit": ("at least", 0.85),
    "95 % intervals that cover": ("at least", 0.92),
}
"""What the tool must reach."""

NEAR = 1.3
"""Held-out error over that of the true model that counts as right."""

HIDING = {"single": "one", "pair": "two", "triple": "three"}
"""Kinds of cases that hide what the library has, and how many effects those are."""


@dataclass(frozen=True)
class Sizes:
    """How well the sizes of rightly named effects are estimated."""

    found: tuple[SizeFound, ...]

    @property
    def median(self) -> float:
        """Median relative error; NaN of none."""
        return _quantile([f.error for f in self.found], 0.5)

    @property
    def worst(self) -> float:
        """90 % point of the relative error; NaN of none."""
        return _quantile([f.error for f in self.found], 0.9)

    @property
    def coverage(self) -> Rate:
        """How often the 95 % interval contains the true size."""
        told = [f for f in self.found if math.isfinite(f.std)]
        return Rate(sum(f.covered for f in told), len(told))


def _quantile(values: Sequence[float], at: float) -> float:
    return float(np.quantile(values, at)) if values else math.nan


@dataclass(frozen=True)
class Score:
    """How one answerer did.

    Args:
        chance: Mean points of the same answers dealt out at random.
        p_value: Probability that those score as much.
    """

    who: str
    judged: tuple[Judged, ...]
    points: int
    most: int
    chance: float
    p_value: float

    def rates(self) -> dict[str, Rate]:
        """Return the rates that the bars are about, and others beside them."""
        faulty = [j for j in self.judged if j.effects and j.kind in HIDING]
        clean = [j for j in self.judged if not j.effects]
        outside = [j for j in self.judged if j.kind == "outside"]
        limited = [j for j in self.judged if j.kind == "limited" and j.effects]
        near = [j.over_limit for j in [*faulty, *clean] if math.isfinite(j.over_limit)]
        return {
            "false alarms": Rate.of(j.wrong for j in clean),
            "nothing hidden: not silent": Rate.of(j.line.points < 0 for j in clean),
            "right group": Rate.of(flag for j in faulty for flag in j.line.located),
            "right region": Rate.of(flag for j in faulty for flag in j.regions),
            "right name or class": Rate.of(flag for j in faulty for flag in j.line.named),
            **{
                f"right name or class of {many}": Rate.of(
                    flag for j in faulty if j.kind == kind for flag in j.line.named
                )
                for kind, many in HIDING.items()
            },
            "wrong name": Rate.of(j.wrong for j in self.judged),
            "confidently wrong": Rate.of(j.wrong and j.sure for j in self.judged),
            "outside the library: right group": Rate.of(
                flag for j in outside for flag in j.line.located
            ),
            "outside the library: wrong name": Rate.of(j.wrong for j in outside),
            "closed loop only: wrong name": Rate.of(j.wrong for j in limited),
            "closed loop only: right name": Rate.of(flag for j in limited for flag in j.line.named),
            f"held out within {NEAR} of the limit": Rate.of(value <= NEAR for value in near),
            "95 % intervals that cover": self.sizes.coverage,
        }

    @property
    def ratio(self) -> float:
        """Median held-out error over that of the true model; NaN if none was given."""
        return _quantile([j.over_limit for j in self.judged if math.isfinite(j.over_limit)], 0.5)

    @property
    def seconds(self) -> float:
        """Median processor time of a case, in s; NaN if none was given."""
        return _quantile([j.seconds for j in self.judged if math.isfinite(j.seconds)], 0.5)

    @property
    def sizes(self) -> Sizes:
        """Sizes that were estimated."""
        return Sizes(tuple(found for j in self.judged for found in j.sizes))


def _right(judged: Sequence[Judged]) -> dict[str, Rate]:
    return {
        "right group": Rate.of(flag for j in judged for flag in j.line.located),
        "right name or class": Rate.of(flag for j in judged for flag in j.line.named),
        "wrong name": Rate.of(j.wrong for j in judged),
    }


def scores(rows: Sequence[Mapping[str, Any]]) -> tuple[Score, ...]:
    """Score every answerer on the cases that all of them were asked, the tool first.

    Args:
        rows: What is kept of the cases. Where no baseline was asked, the tool alone is scored.
    """
    who = [w for w in ANSWERERS if any(verdict_of(row, w) is not None for row in rows)]
    common = [row for row in rows if all(verdict_of(row, w) is not None for w in who)]
    return tuple(score_of(w, common) for w in who)


def score_of(who: str, rows: Sequence[Mapping[str, Any]]) -> Score:
    """Score one answerer."""
    judged = tuple(j for row in rows if (j := judge(row, who)) is not None)
    given = [answer_of(verdict_of(row, who) or {}, row["case"], names()) for row in rows]
    round_ = score_round(given, [truths_of(row) for row in rows])
    return Score(who, judged, round_.points, round_.most, round_.chance, round_.p_value)


@dataclass(frozen=True)
class ByEffect:
    """How the tool did on one effect.

    Args:
        outcomes: Remark of the score by size over the rig's own.
        smallest_named: Smallest size that was named, as `true_size` states it; None if none was,
            or the effect is either there or not.
        predicted: Smallest size that the scores predicted to be seen, median over its cases, in
            the same unit; None where the library has no such size.
    """

    effect: str
    outcomes: Mapping[float, str]
    smallest_named: float | None
    predicted: float | None
    sizes: Sizes


def by_effect(rows: Sequence[Mapping[str, Any]]) -> tuple[ByEffect, ...]:
    """Return how the tool did on each single effect."""
    result = []
    for effect in (*SINGLE, *OUTSIDE):
        own = [
            r
            for r in rows
            if r["effects"] == [effect]
            and r["kind"] in ("single", "outside")
            and not r["true"].get("pressure_noise_time")
        ]
        if not own:
            continue
        judged = [(row, judge(row)) for row in own]
        named = [row for row, j in judged if j is not None and any(j.line.named)]
        told = [size for row in named if (size := true_size(row, effect)) is not None]
        # An effect may grow as its parameter falls: the smallest is that of the least factor.
        least = min(named, key=lambda row: row["factor"]) if told else None
        predicted = [s for row in own if (s := smallest_predicted(row, effect)) is not None]
        result.append(
            ByEffect(
                effect,
                {row["factor"]: j.line.remark for row, j in judged if j is not None},
                true_size(least, effect) if least is not None else None,
                _quantile(predicted, 0.5) if predicted else None,
                Sizes(tuple(found for _, j in judged if j is not None for found in j.sizes)),
            )
        )
    return tuple(result)


def by_size(rows: Sequence[Mapping[str, Any]]) -> dict[float, dict[str, Rate]]:
    """Return rates of single effects by their size over the rig's own."""
    judged = [j for row in rows if row["kind"] == "single" and (j := judge(row)) is not None]
    sizes = {factor: [j for j in judged if j.factor == factor] for factor in sorted(FACTORS)}
    return {factor: _right(own) for factor, own in sizes.items() if own}


def by_kind(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return how the tool did on each kind of case."""
    result: dict[str, dict[str, Any]] = {}
    for kind in (*HIDING, "nothing", "outside", "limited"):
        own = [j for row in rows if row["kind"] == kind and (j := judge(row)) is not None]
        if own:
            result[kind] = {
                "cases": len(own),
                "points": sum(j.line.points for j in own),
                "most": sum(j.line.most for j in own),
                **_right(own),
            }
    return result
