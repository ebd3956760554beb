"""The result of a study, and whether it passes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from workbench.computing.counted import Work, done, since
from workbench.display import Drawn, Rows, notebook_progress
from workbench.errors import WorkbenchError, check_range
from workbench.files import check_folder, picked, write_whole
from workbench.study.baseline import (
    RESULTS_KIND,
    Baseline,
    Change,
    box_changes,
    changes,
    read_baseline,
)
from workbench.study.conditions import ConditionChange, condition_changes, conditions
from workbench.study.dependencies import installed
from workbench.study.execution import Workers, store_of, verify_kept
from workbench.study.judgements import Judgement, Score, judge_records, scores
from workbench.study.margins import LoopAnalysis, analyse_study
from workbench.study.physical_limit import Distances, distances, find_limits
from workbench.study.robustness import Robustness, robustness
from workbench.study.study import Study
from workbench.study.tasks import Record, tasks

_KEY = ("controller", "variation", "scenario", "seed")
_JUDGED = (
    "metric=demand.requirement.metric hard weight=demand.weight controller variation scenario seed"
    " value unit=demand.requirement.unit score met reason"
)
_CHANGED = "metric before after unit way fails reason"
"""What is told of a judgement and of a change."""

RESULTS_SCHEMA = 1
"""Version of ``results.json``; a change of meaning or a removed entry raises it."""


@dataclass(frozen=True, repr=False)
class StudyResult(Drawn):
    """Everything a study found.

    Args:
        work: What its runs took, in units that no machine changes; also those finished before.
    """

    study: Study
    records: tuple[Record, ...]
    judgements: tuple[Judgement, ...]
    scores: tuple[Score, ...]
    robustness: tuple[Robustness, ...]
    loops: tuple[LoopAnalysis, ...]
    baseline: Baseline | None
    changes: tuple[Change, ...]
    distances: Distances = Distances()
    work: Work = field(default_factory=dict)

    @property
    def failed(self) -> tuple[Record, ...]:
        """Runs that gave no metrics."""
        return tuple(r for r in self.records if r.failed)

    @property
    def missed(self) -> tuple[Judgement, ...]:
        """Hard requirements that are missed, the worst first."""
        return self._missed(hard=True)

    @property
    def missed_softly(self) -> tuple[Judgement, ...]:
        """Soft requirements that are missed, the worst first."""
        return self._missed(hard=False)

    def _missed(self, *, hard: bool) -> tuple[Judgement, ...]:
        found = [j for j in self.judgements if j.hard == hard and not j.met]
        return tuple(sorted(found, key=lambda j: -j.score))

    @property
    def required(self) -> tuple[str, ...]:
        """Names of the metrics that hard requirements bound."""
        wanted = (d.requirement for d in self.study.demands)
        return tuple(dict.fromkeys(r.metric for r in wanted if r.hard))

    @property
    def worse(self) -> tuple[Change, ...]:
        """Differences from the baseline that fail the study."""
        return tuple(c for c in self.changes if c.fails)

    @property
    def better(self) -> tuple[Change, ...]:
        """Differences from the baseline for the better."""
        return tuple(c for c in self.changes if c.way == "better")

    @property
    def condition_changes(self) -> tuple[ConditionChange, ...]:
        """What differs from the conditions that the baseline keeps."""
        if self.baseline is None:
            return ()
        return condition_changes(self.baseline.conditions, conditions(self.study))

    @property
    def weakened(self) -> tuple[ConditionChange, ...]:
        """Changed conditions that must be accepted."""
        return tuple(c for c in self.condition_changes if c.fails)

    @property
    def fragile(self) -> tuple[Robustness, ...]:
        """What misses a hard requirement in the box, where that fails the study."""
        return self.box_missed if self.study.box is not None and self.study.box.hard else ()

    @property
    def box_missed(self) -> tuple[Robustness, ...]:
        """What misses a hard requirement in the box, whether or not that fails the study."""
        return tuple(r for r in self.robustness if r.missed)

    @property
    def judged(self) -> bool:
        """Whether anything was held against a requirement, or against a baseline."""
        return bool(self.judgements) or self.baseline is not None

    @property
    def passed(self) -> bool:
        """Whether nothing failed, nothing hard is missed, and nothing is worse or weaker."""
        return not (self.failed or self.missed or self.worse or self.fragile or self.weakened)

    def tables(self) -> tuple[Rows, ...]:
        """Return the score of every controller and what it comes from, and what changed."""
        boxes = {found.controller: found.worst_score for found in self.robustness}
        rows = [
            (s.controller, s.worst, boxes.get(s.controller, math.nan), str(s.judgement or ""))
            for s in self.scores
        ]
        heads = ("controller", "score", "worst score of the box", "worst requirement")
        ordered = sorted(self.changes, key=lambda change: not change.gates)
        changed = [(str(c), "yes" if c.gates else "no") for c in ordered]
        return (
            Rows("scores, at most 1 where all is met", heads, rows),
            *([Rows("changes from the baseline", ("change", "gates"), changed)] if changed else []),
        )

    def __str__(self) -> str:
        return f"{self.study.name} {self.verdict()}: {self.headline()}"

    def headline(self) -> str:
        """Return in one line what was found: nominal, varied, in the box, soft, baseline."""
        hard, variations = [j for j in self.judgements if j.hard], self.study.variations
        nominal = [j for j in hard if variations[j.variation].nominal]
        varied = [j for j in hard if not variations[j.variation].nominal]
        said = [f"{sum(j.met for j in nominal)} of {len(nominal)} hard requirements met nominally"]
        if not nominal and not varied:
            declared = any(d.requirement.hard for d in self.study.demands)
            said = [f"no hard requirement {'applies' if declared else 'declared'}"]
        if varied:
            said.append(f"{sum(j.met for j in varied)} of {len(varied)} on the variations")
        if self.robustness:
            said.append(self._box_words())
        soft = sum(not j.hard for j in self.judgements)
        if soft:
            said.append(f"{len(self.missed_softly)} of {soft} soft ones missed")
        if self.failed:
            said.append(f"{len(self.failed)} of {len(self.records)} runs failed")
        if self.baseline is not None:
            said.append(f"{len(self.worse)} worse and {len(self.better)} better than the baseline")
            if self.weakened:
                said.append(f"{len(self.weakened)} conditions weaker or other than its own")
        return ", ".join(said)

    def _box_words(self) -> str:
        if not self.box_missed:
            return "all met in the box"
        names = "; ".join(f"{r.controller}: {r.why()}" for r in self.box_missed)
        tail = "" if self.fragile else ", which only informs"
        return f"box missed by {len(self.box_missed)} of {len(self.robustness)} ({names}){tail}"

    def verdict(self) -> str:
        """Return "passed", "failed" or "nothing required", with what a pass leaves open."""
        passed = "passed" if self.judged else "nothing required"
        said = [passed if self.passed else "failed"]
        if self.box_missed:
            said.append("box missed")
        if self.weakened:
            said.append("conditions changed")
        if self.missed_softly:
            said.append(f"{len(self.missed_softly)} soft missed")
        return ", ".join(said)

    def table(self) -> dict[str, Any]:
        """Return everything as plain numbers and words, for ``results.json``."""
        return {
            "kind": RESULTS_KIND,
            "schema": RESULTS_SCHEMA,
            "workbench": installed_version(),
            "study": self.study.name,
            "study_file": self.study.path.name,
            "passed": self.passed,
            "verdict": self.verdict(),
            "headline": self.headline(),
            "scores": [
                picked(s, "controller worst weighted_mean=mean")
                | {"worst_requirement": str(s.judgement) if s.judgement else ""}
                for s in self.scores
            ],
            "requirements": [
                {"requirement": str(j.demand), **picked(j, _JUDGED)} for j in self.judgements
            ],
            "tolerances": {name: rule._asdict() for name, rule in self.rules().items()},
            "conditions": conditions(self.study),
            "changed_conditions": [vars(c) for c in self.condition_changes],
            "runs": [r.table() for r in self.records],
            "changes": [
                dict(zip(_KEY, c.key, strict=True)) | picked(c, _CHANGED) for c in self.changes
            ],
            "robustness": [r.table() for r in self.robustness],
            "linear": [a.table() for a in self.loops],
            "physical_limit": self.distances.table(),
            "work": dict(self.work),
        }

    def rules(self) -> dict[str, Any]:
        """Return the rule of comparison of every metric of the runs and the baseline."""
        known = list(self.records)
        known += list(self.baseline.records.values()) if self.baseline else []
        names = dict.fromkeys(name for r in known if r.metrics for name in r.metrics)
        return {name: self.study.tolerance(name) for name in names}

    def record(self, controller: str, scenario: str, case: str = "") -> Record | None:
        """Return the run on the nominal plant of a case with the first seed, or None."""
        key = (controller, self.study.nominal(case).name, scenario, self.study.seeds[0])
        return next((r for r in self.records if r.key == key), None)


def installed_version() -> str:
    """Return the version of the package."""
    return installed("muscle-arm-workbench") or "unknown"


def _claim(folder: Path, study: str) -> None:
    """Note whose runs a folder holds; a study never takes the folder of another."""
    note = folder / "of-study"
    try:
        owner = note.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        owner = study
    if owner != study:
        raise WorkbenchError(
            f"folder {str(folder.parent)!r} holds the results of study {owner!r}, this one is"
            f" {study!r}; give another folder"
        )
    write_whole(note, study)


def run_study(
    study: Study,
    out: str | Path,
    *,
    baseline: str | Path | None = None,
    jobs: int = 1,
    dask: str | None = None,
    fresh: bool = False,
    verify_cache: bool = False,
    traces: bool = True,
    progress: Callable[[str, int, int, str], None] | None = None,
) -> StudyResult:
    """Run a study, judge it, and compare it with a baseline.

    Finished runs are kept in ``runs`` below the folder of results, so that a study that was stopped
    goes on where it was.

    Args:
        verify_cache: Whether a sample of the finished runs is done again and must agree.
        traces: Whether trajectories are kept for the pictures of a page.
        progress: Told the part of the study, finished and all runs of it, and what was finished;
            by default a notebook shows a bar.
    """
    begun = done()
    # Wrong use is told before an hour of runs, not after.
    before = read_baseline(baseline, of=study.name) if baseline is not None else None
    check_range("number of processes", jobs, 1, 1024)
    store = store_of(study, Path(out))
    check_folder(out)
    _claim(store.folder, study.name)
    if fresh:
        store.prune()
    if verify_cache:
        verify_kept(tasks(study), store)
    workers, say = Workers(store, jobs, dask), progress or notebook_progress()
    records = workers.records(tasks(study, traces=traces), partial(say, "runs"))
    found = robustness(study, workers, partial(say, "parameter box"))
    limits = find_limits(study, workers, partial(say, "physical limit"))
    loops = analyse_study(study)
    store.prune()
    judged = judge_records(study, records)
    worst, far = scores(study, judged), distances(study, records, limits)
    outcome = StudyResult(
        study, records, judged, worst, found, loops, before, (), far, since(begun)
    )
    if before is None:
        return outcome
    box = box_changes([r.table() for r in found], before)
    return replace(outcome, changes=(*changes(outcome.rules(), records, before), *box))
