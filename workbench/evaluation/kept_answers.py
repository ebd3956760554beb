"""Answers kept in a folder, one JSON file per case, so that an interrupted run goes on."""

from __future__ import annotations

import json
import subprocess
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from workbench.computing.processes import parallel
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import SCHEMA
from workbench.errors import WorkbenchError, check_choice
from workbench.files import check_folder, plain, write_whole
from workbench.model import Model
from workbench.physics.library import Hypothesis
from workbench.recordings import Recording


class Case(Protocol):
    """A case that has a name."""

    @property
    def name(self) -> str:
        """Its name, by which its answer is kept."""


C = TypeVar("C", bound=Case)

Answer = Callable[[Any, int], dict[str, Any]]
"""Answers a case with a number of processes; a function that other processes find by its name."""


def chosen_cases(
    cases: Sequence[C], part: tuple[int, int] = (1, 1), only: Sequence[str] = ()
) -> Sequence[C]:
    """Return part K of N of the cases, every Nth of those that are named; all without a name."""
    known = [case.name for case in cases]
    for name in only:
        check_choice("case", name, known)
    k, n = part
    return [case for case in cases if not only or case.name in only][k - 1 :: n]


def answered(
    cases: Sequence[Case], out: Path, answer: Answer, *, jobs: int = 1, dask: str | None = None
) -> Iterator[dict[str, Any]]:
    """Answer cases side by side, each kept as soon as it is there; those kept before come first.

    Args:
        out: Where answers are kept, one JSON file each; those found there are not asked for again.
        jobs: Number of processes; one case alone has all of them.
        dask: Address of a Dask scheduler that answers, instead of local processes.

    Raises:
        WorkbenchError: If there is no cluster, or the folder cannot be written.
    """
    check_folder(out)
    left = []
    for case in cases:
        kept = out / f"{case.name}.json"
        if kept.exists():
            yield dict(json.loads(kept.read_text(encoding="utf-8")))
        else:
            left.append(case)
    own = jobs if dask is None and len(left) == 1 else 1
    calls = [(answer, (case, own)) for case in left]
    for i, row in parallel(calls, jobs=jobs, dask=dask):
        yield keep(out / f"{left[i].name}.json", row)


def keep(path: Path, row: Mapping[str, Any]) -> dict[str, Any]:
    """Write an answer and return it as it will be read; numbers that are not finite become null."""
    write_whole(path, json.dumps(plain(row), indent=1))
    return dict(json.loads(path.read_text(encoding="utf-8")))


def read_kept(out: Path) -> list[dict[str, Any]]:
    """Return the answers that a folder keeps, by the names of their cases."""
    rows = [json.loads(path.read_text()) for path in sorted(out.glob("*.json"))]
    rows = [row for row in rows if isinstance(row, dict) and "verdict" in row]
    if not rows:
        raise WorkbenchError(
            f"{out} holds no answers; run 'workbench evaluate own-cases' or 'foreign' first"
        )
    return rows


def diagnosed(
    row: dict[str, Any],
    model: Model,
    fit: Sequence[Recording],
    hold_out: Sequence[Recording],
    *,
    jobs: int,
    entries: Sequence[Hypothesis] | None = None,
    advise: bool = False,
    more: Callable[[Diagnosis], Mapping[str, Any]] = lambda found: {},
) -> dict[str, Any]:
    """Diagnose and return a row with verdict, times in s, and what more is kept of a diagnosis.

    A diagnosis that fails is a result too, and does not end the run.
    """
    wall, processor = time.perf_counter(), time.process_time()

    def times() -> dict[str, float]:
        return {
            "seconds": time.perf_counter() - wall,
            "processor_seconds": time.process_time() - processor,
        }

    try:
        found = diagnose(model, fit, hold_out, entries=entries, jobs=jobs, advise=advise)
        took = times()
        return row | {"verdict": found.verdict.as_data(), **took, **more(found)}
    except Exception as error:  # noqa: BLE001
        return row | {"verdict": silent("failed", error), **times()}


def silent(kind: str, error: Exception | None = None) -> dict[str, Any]:
    """Return a verdict that says nothing, of an answerer that failed."""
    verdict: dict[str, Any] = {"schema": SCHEMA, "verdict": kind}
    verdict |= {"findings": [], "fit": {"held_out": {}}}
    if error is None:
        return verdict
    way = " > ".join(frame.name for frame in traceback.extract_tb(error.__traceback__)[-5:])
    return verdict | {"failure": f"{type(error).__name__}: {error} (in {way})"}


def version() -> str:
    """Return the commit under test, with a mark if files of the product differ from it."""
    root = Path(__file__).parents[2]

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=root, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    commit = git("rev-parse", "--short", "HEAD")
    return commit + ("+" if git("status", "--porcelain", "--", "workbench") else "")
