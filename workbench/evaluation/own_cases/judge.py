"""Judging kept answers against what was hidden, by the rules of a blind round."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.evaluation.answer_key import Truth
from workbench.evaluation.blind_round import Line, answer_of, error_ratio, score_case
from workbench.evaluation.own_cases.plan import names
from workbench.evaluation.own_cases.sizes import COUNTERPARTS, SIZES
from workbench.evaluation.rig.parameters import nominal

ANSWERERS = {"tool": "#35618f", "refit only": "#b0b0b0", "greedy": "#e08214", "sindy": "#8073ac"}
"""Who answers on each case, the diagnosis and the baselines, and its colour."""

REGIONS: dict[str, str] = {
    "motion": "motion",
    "chamber 1": "air",
    "chamber 2": "air",
    "valve": "air",
    "supply": "air",
}
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

    case: str
    kind: str
    effects: tuple[str, ...]
    factor: float
    line: Line
    names: int
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
        return "wrong name" in self.line.remark and self.names > 0

    @property
    def outside(self) -> bool:
        """Whether the library does not have what is hidden."""
        return self.kind == "outside"


@dataclass(frozen=True)
class SizeFound:
    """A size beside the true one.

    Args:
        true: True size, in SI.
        value: Estimate, in SI.
        std: Standard deviation of the estimate, in SI; NaN if none was given.
    """

    effect: str
    named: str
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
    found: Mapping[str, Any] | None = row["verdict"] if who == "tool" else row["baselines"].get(who)
    return found


def truths_of(row: Mapping[str, Any]) -> tuple[Truth, ...]:
    """Return what a case hides."""
    return names().truths(row["case"], list(row["effects"]))


def judge(row: Mapping[str, Any], who: str = "tool") -> Judged | None:
    """Judge one kept answer; None if there is no such answer."""
    verdict = verdict_of(row, who)
    if verdict is None:
        return None
    given, truths = answer_of(verdict, row["case"], names()), truths_of(row)
    line = score_case(given, truths)
    found = {_region(groups[0]) for _, groups in given.findings if groups}
    regions = tuple(bool(found & set(map(_region, truth.groups))) for truth in truths)
    held_out = verdict.get("fit", {}).get("held_out", {})
    seconds = row.get("processor_seconds") if who == "tool" else verdict.get("processor_seconds")
    return Judged(
        row["case"],
        row["kind"],
        tuple(row["effects"]),
        row["factor"],
        line,
        given.names,
        regions,
        any(_surely_wrong(f, truths) for f in verdict["findings"]),
        tuple(_sizes(row, verdict)),
        error_ratio(held_out.get("extended") or {}, row["limit"]),
        math.nan if seconds is None else float(seconds),
    )


def _surely_wrong(finding: Mapping[str, Any], truths: Sequence[Truth]) -> bool:
    """Tell whether a finding without a doubt names nothing that is hidden."""
    names = {finding["effect"], *(finding.get("class") or ())} - {None, "nonparametric"}
    hidden = {name for truth in truths for name in truth.library}
    return bool(names) and finding.get("belief", "sure") == "sure" and not names & hidden


def _region(group: str) -> str:
    return REGIONS.get(group, group)


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
            found.append(SizeFound(effect, finding["effect"], true, float(value["value"]), std))
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
