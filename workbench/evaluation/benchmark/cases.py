"""Cases of the benchmark as folders that any method can read, with the answers apart from them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError
from workbench.evaluation.answer_key import NOTHING
from workbench.evaluation.own_cases.limit import limited_errors
from workbench.evaluation.own_cases.own_case import made
from workbench.evaluation.own_cases.plan import FIRST_SEED, Planned, plan
from workbench.files import write_whole

KEY, NAMES = "key.json", "names.toml"
"""Files of the answers beside the cases, and of how their words are read."""


def write_cases(out: Path, count: int, first_seed: int | None = None) -> Iterator[str]:
    """Write the first cases of a plan of own cases; yields one line each.

    Each case is a folder with ``case.toml`` and its recordings. What it hides stands in
    ``key.json`` beside the folders, with the error ``limit`` that the true model makes on the
    held-out recordings, in SI by output.

    Args:
        first_seed: Seed of the first case, a multiple of 1000; None for that of the plan.

    Raises:
        WorkbenchError: If the folder holds a key already.
    """
    if (out / KEY).exists():
        raise WorkbenchError(f"{out} holds a benchmark already; give the name of another folder")
    answers: dict[str, Any] = {}
    for case in plan(FIRST_SEED if first_seed is None else first_seed)[:count]:
        folder = made(case, out / case.name)
        answers[case.name] = _answer(case, folder)
        (folder / "truth.json").unlink()
        yield f"{case.name}: {folder}"
    table = Path(__file__).parents[1] / "own_cases" / NAMES
    write_whole(out / NAMES, table.read_text(encoding="utf-8"))
    write_whole(out / KEY, json.dumps(answers, indent=1) + "\n")


def _answer(case: Planned, folder: Path) -> dict[str, Any]:
    truth = json.loads((folder / "truth.json").read_text())
    return {
        "truth": [{"effect": word} for word in case.effects or (NOTHING,)],
        "kind": case.kind,
        "parameters": truth["parameters"],
        "load_error": truth["load_error"],
        "limit": limited_errors(folder),
    }
