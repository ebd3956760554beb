"""What simple methods answer to a case, in the form of a verdict."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.diagnosis.diagnose import stages
from workbench.diagnosis.selection.held_out import held_out_errors, settled_run
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import SCHEMA
from workbench.errors import WorkbenchError, check_choice
from workbench.evaluation.benchmark.greedy import greedy
from workbench.evaluation.benchmark.neural import neural
from workbench.evaluation.benchmark.random_walk import random_walk
from workbench.evaluation.benchmark.sindy import sindy
from workbench.evaluation.kept_answers import keep, silent
from workbench.recordings import read_case

BASELINES = ("refit only", "greedy", "sindy", "random walk", "neural residual")
"""Methods, from the simplest: parameters alone; forward selection; sparse regression of the
residual; a Kalman filter with states that walk at random; a network in the equations."""


def run_baselines(cases: Path, out: Path, only: Sequence[str] = ()) -> Iterator[str]:
    """Let the baselines answer the cases of a benchmark; yields one line per case and method.

    Args:
        out: Folder of the answers: one folder per method with ``CASE.json``; those found there are
            not given again.
    """
    for name in only:
        check_choice("baseline", name, BASELINES)
    for folder in case_folders(cases):
        paths = {
            name: out / name.replace(" ", "-") / f"{folder.name}.json" for name in only or BASELINES
        }
        open_ = {name: path for name, path in paths.items() if not path.exists()}
        if not open_:
            continue
        case = read_case(folder)
        fit_on, hold_out = tuple(case.fit.values()), tuple(case.hold_out.values())
        for found in stages(case.model(), fit_on, hold_out, advise=False, progress=lambda _: None):
            if found.fitted is not None or found.prepared.unfit or found.concluded is not None:
                break
        for name, path in open_.items():
            given = answers(found, (name,))[name] if found.fitted else silent("data_unfit")
            keep(path, given)
            yield f"{folder.name} {name:<16} {given['verdict']:<16} {_said(given)}"


def _said(verdict: Mapping[str, Any]) -> str:
    return ", ".join(f["effect"] or f"at {f['where'][0]}" for f in verdict["findings"])


def answers(diagnosis: Diagnosis, names: Sequence[str] = BASELINES) -> dict[str, Any]:
    """Return what baselines answer, from the same refit of the nominal model.

    Args:
        diagnosis: A diagnosis that came as far as its refit; what it found further is not used, but
            that greedy selection takes over its first scores.
    """
    prepared, base, nominal = diagnosis.prepared, diagnosis.base, diagnosis.nominal
    runs = diagnosis.runs.get("refitted") or {
        seen.name: settled_run(base.model, nominal, seen) for seen in prepared.judging
    }
    errors = held_out_errors({"refitted": runs}, prepared.judging)
    given: dict[str, Any] = {}
    for name in names:
        began = time.process_time()
        # A baseline that fails must not end the run; it is counted as no answer.
        try:
            given[name] = _answer(name, diagnosis, errors)
        except Exception as error:  # noqa: BLE001
            given[name] = silent("failed", error)
        if name != "refit only":
            given[name]["processor_seconds"] = time.process_time() - began
    return given


def _answer(
    name: str, diagnosis: Diagnosis, errors: Mapping[str, Mapping[str, float]]
) -> dict[str, Any]:
    prepared, base, nominal = diagnosis.prepared, diagnosis.base, diagnosis.nominal
    findings: list[dict[str, Any]] = []
    extended: Mapping[str, float] = errors["refitted"]
    more: dict[str, Any] = {}
    kind = "named"
    if name == "greedy":
        findings, found, stopped = greedy(diagnosis)
        extended, more = found or extended, {"stopped": stopped}
    elif name == "sindy":
        findings, extended = sindy(base.model, prepared.fitting, base.noise_scale), {}
    elif name == "random walk":
        findings, kind = random_walk(base, nominal, prepared.fitting), "unexplained"
    elif name == "neural residual":
        findings, extended = neural(base, nominal, prepared.fitting, prepared.judging)
        kind = "located_unnamed"
    held_out = {"refitted": errors["refitted"], "extended": extended}
    return {
        "schema": SCHEMA,
        "verdict": kind if findings else "nothing_missing",
        "findings": findings,
        "fit": {"held_out": held_out | {"noise_floor": errors["noise_floor"]}},
    } | more


def case_folders(cases: Path) -> list[Path]:
    """Return the case folders of a benchmark, by name."""
    found = sorted(path.parent for path in cases.glob("*/case.toml"))
    if not found:
        raise WorkbenchError(
            f"{cases} holds no case (a folder with case.toml); write some with 'workbench evaluate"
            " cases'"
        )
    return found
