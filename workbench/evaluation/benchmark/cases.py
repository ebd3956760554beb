"""Cases of the benchmark as folders that any method can read, and the table of the answers.

The answers stand apart from the cases.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.display import aligned_table
from workbench.errors import WorkbenchError
from workbench.evaluation.answer_key import NOTHING
from workbench.evaluation.blind_round import (
    RoundScore,
    held_out,
    names_of,
    over_limit,
    score_verdicts,
    verdict_file,
)
from workbench.evaluation.own_cases.own_case import limited_errors, made
from workbench.evaluation.own_cases.plan import Planned, plan
from workbench.files import write_whole
from workbench.physics.library import every_name
from workbench.plants.arm import arm

KEY, NAMES = "key.json", "names.toml"
"""Files of the answers beside the cases, and of how their words are read."""


def write_cases(out: Path, count: int, first_seed: int | None = None) -> Iterator[str]:
    """Write the first cases of a plan of own cases; yields one line each.

    Each case is a folder with ``case.toml`` and its recordings. What it hides stands in
    ``key.json`` beside the folders, with the error ``limit`` that the true model makes on the
    held-out recordings, in SI by output.

    Args:
        first_seed: Seed of the first case; None for that of the plan.
    """
    if (out / KEY).exists():
        raise WorkbenchError(f"{out} holds a benchmark already; give the name of another folder")
    answers: dict[str, Any] = {}
    for case in plan(first_seed)[:count]:
        folder = made(case, out / case.name)
        answers[case.name] = _truth_of(case, folder)
        (folder / "truth.json").unlink()
        yield f"{case.name}: {folder}"
    table = Path(__file__).parents[1] / "own_cases" / NAMES
    write_whole(out / NAMES, table.read_text(encoding="utf-8"))
    write_whole(out / KEY, json.dumps(answers, indent=1) + "\n")


def _truth_of(case: Planned, folder: Path) -> dict[str, Any]:
    truth = json.loads((folder / "truth.json").read_text())
    return {
        "truth": [{"effect": word} for word in case.effects or (NOTHING,)],
        "kind": case.kind,
        "parameters": truth["parameters"],
        "load_error": truth["load_error"],
        "limit": limited_errors(folder),
    }


@dataclass(frozen=True)
class Scored:
    """One method's score on the cases.

    Args:
        over_limit: Median of the held-out error over that of the true model, or over the noise of
            the sensors where the key does not give it, dimensionless; NaN if no answer gives it.
        unknown: Names that it gave and that no law has: they count as wrong.
    """

    method: str
    score: RoundScore
    over_limit: float
    unknown: tuple[str, ...] = ()

    def as_data(self) -> dict[str, Any]:
        """Return the score as plain data."""
        return self.score.as_data() | {
            "method": self.method,
            "over_limit": self.over_limit,
            "rates": {name: rate.as_data() for name, rate in self.score.rates.items()},
        }


def compared(cases: Path, verdicts: Sequence[Path]) -> tuple[Scored, ...]:
    """Score the answers of several methods to the cases of a benchmark.

    Args:
        cases: Folder with ``key.json`` and, if its words need one, ``names.toml``.
        verdicts: One folder per method with ``CASE.json`` or ``CASE/verdict.json``.
    """
    key, table = cases / KEY, cases / NAMES
    names = table if table.exists() else None
    answers, known = json.loads(key.read_text(encoding="utf-8")), every_name(arm())
    limits = {case: answer["limit"] for case, answer in answers.items() if "limit" in answer}
    scores = []
    for folder in verdicts:
        score = score_verdicts(folder, key, names=names)
        files = {line.case: verdict_file(folder, line.case) for line in score.lines}
        said = {case: json.loads(file.read_text(encoding="utf-8")) for case, file in files.items()}
        unknown = sorted({n for v in said.values() for n in names_of(v) if n not in known})
        scores.append(Scored(folder.resolve().name, score, _over(said, limits), tuple(unknown)))
    return tuple(scores)


def _over(verdicts: Mapping[str, Mapping[str, Any]], limits: Mapping[str, Any]) -> float:
    ratios = [
        over_limit(verdict, limits.get(case) or held_out(verdict, "noise_floor"))
        for case, verdict in verdicts.items()
    ]
    known = [ratio for ratio in ratios if math.isfinite(ratio)]
    return float(np.median(known)) if known else math.nan


def table(scores: Sequence[Scored]) -> str:
    """Return the table as text, one line per method, with the names below that no law has."""
    titles = (
        "method", "points", "by chance", "right group", "right name or class", "wrong name",
        "false alarm", "held-out error",
    )  # fmt: skip
    rows = []
    for s in scores:
        points, chance = f"{s.score.points} of {s.score.most}", f"{s.score.chance:.1f}"
        over = "–" if math.isnan(s.over_limit) else f"{s.over_limit:.3g}"
        rows.append((s.method, points, chance, *map(str, s.score.rates.values()), over))
    notes = [
        f"\n{s.method}: no law is called {', '.join(s.unknown)}, which counts as wrong; 'workbench"
        " plants arm' lists the names"
        for s in scores
        if s.unknown
    ]
    return aligned_table(titles, rows) + "".join(notes)
