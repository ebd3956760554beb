"""Rates over judged answers, with their uncertainty.

Units: all numbers are dimensionless, sizes as `true_size` states them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from workbench.evaluation.answer_key import Truth
from workbench.evaluation.blind_round import (
    Answer,
    Line,
    RoundScore,
    answer_of,
    over_limit,
    score_case,
    score_round,
)
from workbench.evaluation.own_cases.plan import COUNTERPARTS, FACTORS, OUTSIDE, SINGLE, SIZES, names
from workbench.evaluation.rates import Rate
from workbench.evaluation.rig.parameters import nominal

ANSWERERS = {"tool": "#35618f", "refit only": "#b0b0b0", "greedy": "#e08214", "sindy": "#8073ac"}
"""Who answers on each case, the diagnosis and the baselines, and its colour."""

REGIONS = {"motion": "motion"} | dict.fromkeys(("chamber 1", "chamber 2", "valve", "supply"), "air")
"""Coarser places: the joint with the muscle forces, and all that moves air. Sensors are their own
place."""


@dataclass(frozen=True)
class Judged:
    """One answer to one case.

    Args:
        factor: Size relative to the rig's own.
        regions: Whether each hidden effect was put into the right region.
        sure: Whether a wrong name, if there is one, was said without a doubt.
        over_limit: Held-out error over that of the true model, root mean square over the outputs,
            dimensionless; NaN if it was not given.
        seconds: Processor time, in s.
    """

    kind: str
    effects: tuple[str, ...]
    factor: float
    line: Line
    answer: Answer
    regions: tuple[bool, ...]
    sure: bool = True
    sizes: tuple[SizeFound, ...] = ()
    over_limit: float = math.nan
    seconds: float = math.nan

    @property
    def wrong(self) -> bool:
        """Whether anything was named that is not hidden.

        Where nothing is hidden, something that is located but not named costs as many points, but
        is not a name.
        """
        return "wrong name" in self.line.remark and self.answer.names > 0


@dataclass(frozen=True)
class SizeFound:
    """A size beside the true one.

    Args:
        true: True size, in SI.
        value: Estimate, in SI.
        std: Standard deviation of the estimate, in SI; NaN if none was given.
    """

    true: float
    value: float
    std: float

    @property
    def error(self) -> float:
        """Relative error, dimensionless."""
        return abs(self.value - self.true) / abs(self.true)

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval contains the true size."""
        return abs(self.value - self.true) <= 1.96 * self.std


def verdict_of(row: Mapping[str, Any], who: str) -> Mapping[str, Any] | None:
    """Return an answerer's verdict on a case; None if it was not asked.

    A baseline that failed has answered nothing, which scores as an abstention.
    """
    answers: Mapping[str, Any] = {"tool": row["verdict"], **row["baselines"]}
    return answers.get(who)


def truths_of(row: Mapping[str, Any]) -> tuple[Truth, ...]:
    """Return what a case hides."""
    return names().truths(row["case"], list(row["effects"]))


def judge(row: Mapping[str, Any], who: str = "tool") -> Judged:
    """Judge one kept answer of who was asked."""
    verdict = verdict_of(row, who)
    assert verdict is not None
    given, truths = answer_of(verdict, row["case"], names()), truths_of(row)
    line = score_case(given, truths)
    found = {REGIONS.get(groups[0], groups[0]) for _, groups in given.findings if groups}
    regions = tuple(bool(found & {REGIONS.get(g, g) for g in truth.groups}) for truth in truths)
    seconds = row.get("processor_seconds") if who == "tool" else verdict.get("processor_seconds")
    sure = any(_surely_wrong(f, truths) for f in verdict["findings"])
    sizes, over = tuple(_sizes(row, verdict)), over_limit(verdict, row["limit"])
    hidden = (row["kind"], tuple(row["effects"]), row["factor"])
    spent = math.nan if seconds is None else float(seconds)
    return Judged(*hidden, line, given, regions, sure, sizes, over, spent)


def _surely_wrong(finding: Mapping[str, Any], truths: Sequence[Truth]) -> bool:
    """Tell whether a finding without a doubt names nothing that is hidden."""
    names = {finding["effect"], *(finding.get("class") or ())} - {None, "nonparametric"}
    hidden = {name for truth in truths for name in truth.library}
    return bool(names) and finding.get("belief", "sure") == "sure" and not names & hidden


def _sizes(row: Mapping[str, Any], verdict: Mapping[str, Any]) -> list[SizeFound]:
    """Compare sizes where rig and library state the same quantity."""
    found = []
    for finding in verdict["findings"]:
        for effect in row["effects"]:
            counterpart = COUNTERPARTS.get((effect, finding["effect"]))
            if counterpart is None:
                continue
            value = (finding.get("parameters") or {}).get(counterpart.parameter)
            if value is None or value["value"] is None:
                continue
            true = counterpart.true(nominal() | row["true"])
            std = math.nan if value.get("std") is None else float(value["std"])
            found.append(SizeFound(true, float(value["value"]), std))
    return found


def smallest_predicted(row: Mapping[str, Any], effect: str) -> float | None:
    """Return the smallest size that the scores predicted to be seen, in the library's unit."""
    name = _by_size(effect)
    return next((s["smallest"] for s in row.get("scores", ()) if s["effect"] == name), None)


def _by_size(effect: str) -> str | None:
    """Return the name in the library whose size states that of an effect of the rig."""
    return next((n for (e, n), c in COUNTERPARTS.items() if e == effect and c.size), None)


def true_size(row: Mapping[str, Any], effect: str) -> float | None:
    """Return the size of a hidden effect; None for one that is either there or not.

    It is in the library's unit where the library has that size; else how far the rig's parameter
    departs from that of the plain rig, or the parameter itself where the effect grows as it falls.
    """
    true = nominal() | row["true"]
    name = _by_size(effect)
    if name is not None:
        return abs(COUNTERPARTS[effect, name].true(true))
    size = SIZES.get(effect)
    if size is None:
        return None
    return float(true[size.main] if size.inverse else abs(true[size.main] - nominal()[size.main]))


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

KINDS = (*HIDING, "nothing", "outside", "limited")
"""All kinds of cases."""


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
        return Rate.of(f.covered for f in self.found if math.isfinite(f.std))


def _quantile(values: Sequence[float], at: float) -> float:
    return float(np.quantile(values, at)) if values else math.nan


@dataclass(frozen=True)
class Score:
    """How one answerer did, case by case and as a blind round."""

    who: str
    judged: tuple[Judged, ...]
    round: RoundScore

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
            "right group": _share(faulty, "located"),
            "right region": Rate.of(flag for j in faulty for flag in j.regions),
            "right name or class": _share(faulty, "named"),
            **{
                f"right name or class of {many}": _share(
                    [j for j in faulty if j.kind == kind], "named"
                )
                for kind, many in HIDING.items()
            },
            "wrong name": Rate.of(j.wrong for j in self.judged),
            "confidently wrong": Rate.of(j.wrong and j.sure for j in self.judged),
            "outside the library: right group": _share(outside, "located"),
            "outside the library: wrong name": Rate.of(j.wrong for j in outside),
            "closed loop only: wrong name": Rate.of(j.wrong for j in limited),
            "closed loop only: right name": _share(limited, "named"),
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


def _share(judged: Sequence[Judged], which: Literal["located", "named"]) -> Rate:
    """Return the share of hidden effects that are located or named."""
    return Rate.of(flag for j in judged for flag in getattr(j.line, which))


def right_of(judged: Sequence[Judged]) -> dict[str, Rate]:
    """Return how often hidden effects were located and named, and how often a name was wrong."""
    return {
        "right group": _share(judged, "located"),
        "right name or class": _share(judged, "named"),
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
    judged = tuple(judge(row, who) for row in rows)
    hidden = [truths_of(row) for row in rows]
    return Score(who, judged, score_round([j.answer for j in judged], hidden))


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
        alone = [r for r in rows if r["effects"] == [effect] and r["kind"] in ("single", "outside")]
        own = [r for r in alone if not r["true"].get("pressure_noise_time")]
        if not own:
            continue
        judged = [(row, judge(row)) for row in own]
        named = [row for row, j in judged if any(j.line.named)]
        # An effect may grow as its parameter falls: the smallest is that of the least factor.
        least = min(named, key=lambda row: row["factor"], default=None)
        predicted = [s for row in own if (s := smallest_predicted(row, effect)) is not None]
        outcomes = {row["factor"]: j.line.remark for row, j in judged}
        smallest = true_size(least, effect) if least is not None else None
        middle = _quantile(predicted, 0.5) if predicted else None
        sizes = Sizes(tuple(found for _, j in judged for found in j.sizes))
        result.append(ByEffect(effect, outcomes, smallest, middle, sizes))
    return tuple(result)


def grouped(
    rows: Sequence[Mapping[str, Any]], key: str, values: Sequence[Any]
) -> dict[Any, list[Judged]]:
    """Return how the tool did on the cases with each value of a key, where there are any."""
    judged = [(row[key], judge(row)) for row in rows]
    groups = {value: [j for found, j in judged if found == value] for value in values}
    return {value: own for value, own in groups.items() if own}


def by_size(rows: Sequence[Mapping[str, Any]]) -> dict[float, dict[str, Rate]]:
    """Return rates of single effects by their size over the rig's own."""
    single = [row for row in rows if row["kind"] == "single"]
    return {f: right_of(own) for f, own in grouped(single, "factor", sorted(FACTORS)).items()}
