"""The verb ``compare``."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.options import AsJson, Jobs
from workbench.cli.running import counting, write_study
from workbench.errors import WorkbenchError
from workbench.work.processes import processes

if TYPE_CHECKING:
    from workbench.study.study import Study

Limit = Annotated[
    bool | None,
    typer.Option(
        "--limit/--no-limit",
        help="Compare steps with the physical limit, the fastest that the plant can do. By "
        "default as the study says.",
        show_default=False,
    ),
]


def compare(
    study: Path,
    *,
    out: Path,
    baseline: Path | None = None,
    jobs: Jobs = None,
    dask: str | None = None,
    option: list[str] | None = None,
    limit: Limit = None,
    fresh: bool = False,
    verify_cache: bool = False,
    as_json: AsJson = False,
) -> int:
    """Run a study: every controller on every plant in every scenario, judged and compared.

    Writes results.json, summary.md (for a pull request), junit.xml and report.html with its
    pictures. A study that was stopped goes on where it was. Exit status 1 if a run failed, a hard
    requirement is missed or something is worse than the baseline.

    Example: 'workbench compare arm --out comparison'.

    Args:
        study: Study file (TOML), or the name of a shipped one such as arm.
        out (DIR): Folder for the results.
        baseline (FILE): Stored results; anything worse fails.
        dask (ADDRESS): Let a Dask cluster do the runs: address of its scheduler, such as
            tcp://host:8786.
        option (-o NAME=VALUE): Option of the study's plant in the place of the study's own, such as
            load=3kg.
        fresh: Do all runs again, also finished ones.
        verify_cache: Do a sample of the finished runs again and compare.
    """
    from workbench.reports.figure import own_figures
    from workbench.study.ci_files import github_annotations, on_github
    from workbench.study.result import run_study
    from workbench.study.summary import plain_summary

    chosen = named_study(study, limit, option or ())
    # A mistake in a module of figures shows before the runs, not after them.
    own_figures(chosen.report.figures, folder=chosen.path.parent)
    typer.echo(str(chosen), err=True)
    with counting() as counter:
        outcome = run_study(
            chosen,
            out,
            baseline=baseline,
            jobs=processes(jobs),
            dask=dask,
            fresh=fresh,
            verify_cache=verify_cache,
            progress=counter,
        )
    write_study(outcome, out, as_json=as_json)
    if on_github(os.environ) and not as_json:
        for line in github_annotations(outcome):
            typer.echo(line)
    typer.echo(plain_summary(outcome), err=as_json)
    if as_json:
        typer.echo((out / "results.json").read_text(encoding="utf-8"), nl=False)
    return 0 if outcome.passed else 1


def named_study(given: Path, limit: bool | None, options: Iterable[str]) -> Study:
    """Return the study of a file, or a shipped one that is named without folder or suffix.

    Args:
        options: Options of its plant that hold in the place of its own, as ``NAME=VALUE``.
    """
    from workbench.model.units import named_value
    from workbench.study.schema import read_study, resolve, shipped_study

    named = given.is_file() or given.suffix or len(given.parts) > 1
    try:
        file = read_study(given if named else shipped_study(str(given)))
    except WorkbenchError:
        if not given.is_dir():
            raise
        raise WorkbenchError(
            f"study {str(given)!r} is a folder; give the file of the study, and a folder of results"
            " with --out"
        ) from None
    if changed := dict(named_value("option", text) for text in options):
        plant = {**file.table.get("plant", {}), **changed}
        file = replace(file, table={**file.table, "plant": plant})
    study = resolve(file)
    return study if limit is None else study.with_limit(limit)
