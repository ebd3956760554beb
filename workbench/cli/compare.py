"""The verb ``compare``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.as_json import AsJson


def compare(
    study: Annotated[
        Path, typer.Argument(help="Study file (TOML), or the name of a shipped one such as arm.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.", metavar="DIR")],
    baseline: Annotated[
        Path | None,
        typer.Option(help="Stored results; anything worse fails.", metavar="FILE"),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(help="Number of processes; by default one per core.", metavar="N"),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            help="Let a Dask cluster do the runs: address of its scheduler, such as "
            "tcp://host:8786.",
            metavar="ADDRESS",
        ),
    ] = None,
    limit: Annotated[
        bool | None,
        typer.Option(
            "--limit/--no-limit",
            help="Compare steps with the physical limit, the fastest that the plant can do. By "
            "default as the study says.",
            show_default=False,
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Do all runs again, also finished ones.")
    ] = False,
    verify_cache: Annotated[
        bool,
        typer.Option("--verify-cache", help="Do a sample of the finished runs again and compare."),
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Run a study: every controller on every plant in every scenario, judged and compared.

    Writes results.json, summary.md (for a pull request), junit.xml and report.html with its
    pictures. A study that was stopped goes on where it was. Exit status 1 if a run failed, a hard
    requirement is missed or something is worse than the baseline.

    Example: 'workbench compare arm --out comparison'.

    Args:
        study: Study file, or the name of a shipped study.
        baseline: Stored results to compare with, or None.
        jobs: Number of processes, or None for one per core.
        dask: Address of a Dask scheduler, or None.
        limit: Whether steps are compared with the physical limit, or None as the study says.
        fresh: Whether finished runs are done again.
        verify_cache: Whether a sample of them is done again and must come out the same.
        as_json: Whether results.json is printed too.

    Returns:
        Exit status: 1 if the study does not pass.

    Example:
        >>> compare(Path("nowhere.toml"), Path("out"))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: study 'nowhere.toml' cannot be read: no such file ...
    """
    from workbench.cli.counter import Counter
    from workbench.cli.typed import typed
    from workbench.reports.figure import own_figures
    from workbench.reports.study_files import write_study_files
    from workbench.study.annotations import github_annotations, on_github
    from workbench.study.result import run_study
    from workbench.study.schema import load_study
    from workbench.study.summary import plain_summary

    chosen = load_study(study_file(study))
    if limit is not None:
        chosen = chosen.with_limit(limit)
    # A mistake in a module of figures shows before the runs, not after them.
    own_figures(chosen.report.figures, folder=chosen.path.parent)
    typer.echo(str(chosen), err=True)
    counter = Counter()
    try:
        outcome = run_study(
            chosen,
            out,
            baseline=baseline,
            jobs=(os.cpu_count() or 1) if jobs is None else jobs,
            dask=dask,
            fresh=fresh,
            verify_cache=verify_cache,
            progress=counter,
        )
    finally:
        counter.close()
    typer.echo("writing the report ...", err=True)
    written = write_study_files(outcome, out, command=typed())
    if on_github(os.environ) and not as_json:
        for line in github_annotations(outcome):
            typer.echo(line)
    typer.echo(plain_summary(outcome), err=as_json)
    typer.echo(f"written to {out}: {', '.join(path.name for path in written)}", err=as_json)
    if as_json:
        typer.echo((out / "results.json").read_text(encoding="utf-8"), nl=False)
    return 0 if outcome.passed else 1


def study_file(given: Path) -> Path:
    """Return the file of a study that was named by its path or as a shipped one.

    Args:
        given: Path of a file, or a name without a folder or suffix.

    Raises:
        WorkbenchError: If no shipped study has that name.
    """
    from workbench.study.shipped import shipped_study

    if given.exists() or given.suffix or len(given.parts) > 1:
        return given
    return shipped_study(str(given))
