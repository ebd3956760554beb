"""Runs a study: in parallel, with progress, and so that a stopped study goes on."""

from __future__ import annotations

import hashlib
import json
import math
import os
import random
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from workbench.checked_json import Shape, TableShape, anything, named, read_json, text, whole
from workbench.computing.counted import Work, add, done, since
from workbench.computing.processes import parallel
from workbench.errors import WorkbenchError
from workbench.files import digest_of_code, write_whole
from workbench.study.dependencies import Seen, digest, installed, seen, seen_elsewhere, versions
from workbench.study.study import Study
from workbench.study.tasks import RECORD, Record, Task, execute, record_from_table
from workbench.verification.metrics import tolerance_of

_RESULTS = ("results.json", "baseline.json")
_KEPT = TableShape(
    {"inputs": TableShape({"files": named(text), "packages": named(text)}), "work": named(whole)}
)


class Store:
    """A folder with one file per finished run, named by what the run depends on.

    A run is found again only if plant, controller, scenario, seed and the code are the same.

    Args:
        base: Folder of the study; files below it are known by their path from there.
    """

    def __init__(self, folder: Path, code: str, base: Path | None = None) -> None:
        self.folder = folder
        self.code = code
        self.base = str((base or Path.cwd()).resolve())
        self.touched: set[str] = set()
        self._now: dict[str, str] = {}

    def key(self, task: Any) -> str:
        """Return the name under which a task's result is kept.

        Args:
            task: A frozen task, whose representation says all it depends on.
        """
        return hashlib.sha256(f"{self.code}\0{task!r}".encode()).hexdigest()[:32]

    def get(self, key: str, shape: Shape = anything) -> dict[str, Any] | None:
        """Return what was kept under a key, whose work now counts as done.

        None if there is nothing, only a damaged one, or something that it was made from has
        changed.
        """
        known = f"{key}.json" in self.touched
        self.touched.add(f"{key}.json")
        try:
            found = read_json(self.folder / f"{key}.json", "run", _KEPT)
            shape(found, ())
        except WorkbenchError:
            return None
        if not self._current(found["inputs"]):
            return None
        if not known:
            add(found["work"])
        return dict(found)

    def _current(self, inputs: dict[str, Any]) -> bool:
        for name, known in inputs["files"].items():
            path = str(Path(self.base) / name)
            if path not in self._now:
                self._now[path] = digest(path)
            if self._now[path] != known:
                return False
        return all(installed(name) == known for name, known in inputs["packages"].items())

    def put(
        self, key: str, table: dict[str, Any], read: Seen | None = None, work: Work | None = None
    ) -> None:
        """Keep a table.

        Args:
            read: What the process that made it has read, beside what this one has.
        """
        self.touched.add(f"{key}.json")
        kept = {**table, "inputs": self._inputs(read), "work": dict(work or {})}
        write_whole(self.folder / f"{key}.json", json.dumps(kept))

    def _inputs(self, read: Seen | None) -> dict[str, Any]:
        results = str(self.folder.resolve().parent) + os.sep
        files, packages = seen()
        if read is not None:
            files, packages = {**files, **read.files}, (*packages, *read.packages)
        below = self.base + os.sep
        named = {
            path.removeprefix(below): known
            for path, known in files.items()
            if not path.startswith(results) and not path.endswith(_RESULTS)
        }
        return {"files": named, "packages": versions(packages)}

    def prune(self) -> None:
        """Remove the files of runs that the finished study no longer has, and no other files."""
        for path in self.folder.glob("*.json"):
            if re.fullmatch(r"[0-9a-f]{32}", path.stem) and path.name not in self.touched:
                path.unlink(missing_ok=True)


T = TypeVar("T")

FINISHED_BEFORE = "finished before"
"""What progress is told of runs that an earlier study finished."""

Progress = Callable[[int, int, str], None]
"""Called with the number of finished runs, of all runs, and what was finished."""


@dataclass(frozen=True)
class Workers:
    """Who does the work of a study, and where what is finished is kept.

    Args:
        dask: Address of a Dask scheduler that does it, instead of local processes.
    """

    store: Store
    jobs: int = 1
    dask: str | None = None

    def finished(
        self,
        asked: Sequence[T],
        do: Callable[[T], dict[str, Any]],
        shape: Shape,
        *,
        name: Callable[[T], str],
        progress: Progress | None = None,
    ) -> list[dict[str, Any]]:
        """Do what is not finished yet, and keep each result as soon as there is one.

        Args:
            asked: Frozen data whose representation says all that a result depends on.
            do: Returns the result as a table that JSON can hold; called in any process.
            shape: What a kept result must be; another one is done again. So is one that failed: its
                cause may be cured.
            name: What progress is told of one that is finished.
        """
        keys = [self.store.key(one) for one in asked]
        kept = ((i, self.store.get(key, shape)) for i, key in enumerate(keys))
        found = {i: t for i, t in kept if t is not None and t.get("status") != "failed"}
        if progress and found:
            progress(len(found), len(asked), FINISHED_BEFORE)
        left = [i for i in range(len(asked)) if i not in found]
        calls = [(_with_inputs, (do, asked[i])) for i in left]
        for place, (table, read, work) in parallel(calls, jobs=self.jobs, dask=self.dask):
            i = left[place]
            found[i] = table
            seen_elsewhere(read)
            self.store.put(keys[i], table, read, work)
            if progress:
                progress(len(found), len(asked), name(asked[i]))
        return [found[i] for i in range(len(asked))]

    def records(
        self, asked: Sequence[Task], progress: Progress | None = None
    ) -> tuple[Record, ...]:
        """Do runs that are not finished yet."""

        def name(task: Task) -> str:
            return " / ".join(map(str, task.key))

        tables = self.finished(asked, _stored, RECORD, name=name, progress=progress)
        return tuple(map(record_from_table, tables))


def _with_inputs(do: Callable[[T], dict[str, Any]], one: T) -> tuple[dict[str, Any], Seen, Work]:
    """Return a result, what its process has read so far, and what it cost."""
    before = done()
    table = do(one)
    return table, seen(), since(before)


def _stored(task: Task) -> dict[str, Any]:
    record = execute(task)
    return {**record.table(), "traces": dict(record.traces)}


def kept(store: Store, task: Task) -> Record | None:
    """Return the finished run of a task, or None."""
    table = store.get(store.key(task), RECORD)
    return None if table is None else record_from_table(table)


SAMPLE = 3
"""Finished runs that `verify_kept` does again at least."""


def verify_kept(asked: Sequence[Task], store: Store) -> None:
    """Do a sample of the finished runs again, 5 % of them, and compare.

    Raises:
        WorkbenchError: If one does not come out as it was kept.
    """
    found = [(task, record) for task in asked if (record := kept(store, task)) is not None]
    count = min(len(found), max(SAMPLE, len(found) // 20))
    for task, record in random.sample(found, count):
        if differs := _difference(record, execute(task)):
            name = " / ".join(map(str, task.key))
            raise WorkbenchError(
                f"the finished run {name} does not come out as it was kept: {differs}; something"
                " that it depends on is not seen; run the study with --fresh"
            )


def _difference(kept: Record, now: Record) -> str:
    if kept.metrics is None or now.metrics is None:
        outcomes = f"{kept.reason or 'done'}, {now.reason or 'done'}"
        return "" if kept.failed == now.failed else outcomes
    for metric in now.metrics.values:
        if not tolerance_of(metric.name).repeats:
            continue
        old = kept.metrics[metric.name].value if metric.name in kept.metrics else math.nan
        same = math.isclose(old, metric.value, rel_tol=1e-6, abs_tol=1e-12)
        if not same and not (math.isnan(old) and math.isnan(metric.value)):
            return f"{metric.name} was {old:.6g} and is {metric.value:.6g} {metric.unit}"
    return ""


def store_of(study: Study, folder: Path) -> Store:
    """Return the store of a study's runs, in ``runs`` below its folder of results."""
    return Store(Path(folder) / "runs", digest_of_code().hex(), study.path.parent)
