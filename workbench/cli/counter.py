"""Progress of many runs, as one line that counts."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from workbench.study.result import StudyResult
    from workbench.study.study import Study

Jobs = Annotated[
    int | None, typer.Option(help="Number of processes; by default one per core.", metavar="N")
]


def run_counted(
    study: Study,
    out: Path,
    *,
    jobs: int | None,
    dask: str | None = None,
    baseline: Path | None = None,
    fresh: bool = False,
    verify_cache: bool = False,
) -> StudyResult:
    """Run a study with its progress on the error stream, on all cores unless told otherwise."""
    from workbench.study.result import run_study

    counter = Counter()
    workers = (os.cpu_count() or 1) if jobs is None else jobs
    try:
        return run_study(
            study,
            out,
            baseline=baseline,
            jobs=workers,
            dask=dask,
            fresh=fresh,
            verify_cache=verify_cache,
            progress=counter,
        )
    finally:
        counter.close()


class Counter:
    """Counts finished runs on the error stream: a bar on a screen, a line per tenth in a log."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._part = ""

    def __call__(self, part: str, done: int, total: int, what: str) -> None:
        """Show what is finished."""
        from tqdm import tqdm

        from workbench.study.execution import FINISHED_BEFORE

        if self._bar is None or part != self._part or total != self._bar.total:
            self.close()
            self._part = part
            screen = sys.stderr.isatty()
            # A log keeps every line: there, one per tenth is enough.
            self._bar = tqdm(
                total=total,
                # What was finished before took no time of this run.
                initial=done if what == FINISHED_BEFORE else 0,
                desc=part,
                unit="run",
                file=sys.stderr,
                miniters=1 if screen else max(1, total // 10),
                mininterval=0.1 if screen else 0.0,
                maxinterval=1e9,
                leave=True,
            )
        self._bar.update(done - self._bar.n)
        if sys.stderr.isatty():
            self._bar.set_postfix_str(what, refresh=False)

    def close(self) -> None:
        """End the line."""
        if self._bar is not None:
            self._bar.close()
        self._bar = None
