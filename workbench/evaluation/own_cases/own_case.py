"""Make a planned case, diagnose it, let the baselines answer, and keep all of it as data."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.diagnosis.stages import Diagnosis
from workbench.evaluation.benchmark.baselines import answers
from workbench.evaluation.kept import diagnosed, version
from workbench.evaluation.own_cases.judge import ANSWERERS
from workbench.evaluation.own_cases.limit import limited_errors
from workbench.evaluation.own_cases.plan import FIRST_SEED, Planned, plan
from workbench.evaluation.rig.cases import make_case
from workbench.evaluation.rig.parameters import nominal
from workbench.recordings import read_case

_BASELINES = [who for who in ANSWERERS if who != "tool"]


def made(case: Planned, folder: Path, *, seconds: float = 20.0) -> Path:
    """Write the recordings of a planned case, of this length in s; returns the folder."""
    return make_case(
        case.seed,
        list(case.effects),
        case.load,
        folder,
        sizes=case.changes,
        load_error=case.load_error,
        seconds=seconds,
        spread=case.spread,
        recorded=case.recorded,
    )


def cases(
    count: int | None, first_seed: int | None, only: Sequence[str] = ()
) -> tuple[Planned, ...]:
    """Return the first cases of the plan, all of it without a count or where some are named.

    Args:
        first_seed: Seed of the first case; None for that of the plan.
    """
    planned = plan(FIRST_SEED if first_seed is None else first_seed)
    return planned if only else planned[:count]


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a kept case."""
    found = ", ".join(f["effect"] or "?" for f in row["verdict"]["findings"]) or "-"
    said = row["verdict"]["verdict"]
    return f"{row['case']} {row['title']:<38} -> {said:<16} {found}  ({row['seconds']:.0f} s)"


def answer_alone(case: Planned, jobs: int) -> dict[str, Any]:
    """Diagnose one case without asking the baselines; returns what is kept of it."""
    return answer(case, jobs, baselines=False)


def answer(case: Planned, jobs: int, *, baselines: bool = True) -> dict[str, Any]:
    """Diagnose one case and let the baselines answer too; returns what is kept of it."""
    with tempfile.TemporaryDirectory() as place:
        folder = made(case, Path(place) / case.name)
        truth = json.loads((folder / "truth.json").read_text())
        row: dict[str, Any] = {
            "schema": "own_case/1",
            "case": case.name,
            "title": case.title,
            "kind": case.kind,
            "effects": list(case.effects),
            "load_kg": case.load,
            "factor": case.factor,
            "recorded": case.recorded,
            "spread": case.spread,
            "true": _changed(truth["parameters"]) | {"load_error": truth["load_error"]},
            "limit": limited_errors(folder),
            "version": version(),
            "baselines": {},
        }
        found = read_case(folder)
        fit_on, hold_out = list(found.fit.values()), list(found.hold_out.values())

        def more(diagnosis: Diagnosis) -> dict[str, Any]:
            scores = diagnosis.rounds[0][0].scores if diagnosis.rounds else ()
            given = answers(diagnosis, _BASELINES) if diagnosis.runs and baselines else {}
            smallest = [{"effect": s.entry.name, "smallest": s.smallest} for s in scores]
            return {"scores": smallest, "baselines": given}

        return diagnosed(row, found.model(), fit_on, hold_out, jobs=jobs, more=more)


def _changed(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the rig's parameters that differ from nominal ones, and those sizes refer to."""
    plain = nominal()
    always = ("load", "load_inertia_per_kg", "conductance")
    return {k: v for k, v in parameters.items() if v != plain[k] or k in always}
