"""The verbs of a study: ``compare``, ``bless`` and ``report``."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.options import AsJson, Jobs, Short
from workbench.cli.plant import value_at_rest
from workbench.cli.running import counting, typed, write_study
from workbench.computing.processes import processes
from workbench.errors import WorkbenchError

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
    from workbench.study.ci_files import github_annotations
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
    if os.environ.get("GITHUB_ACTIONS") == "true" and not as_json:
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
    from workbench.study.read import read_study, resolve, shipped_study

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


def bless(results: Path, *, baseline: Path) -> None:
    """Accept the results of a study as the baseline, showing what changes by that.

    Requirements that are missed are still missed afterwards: a baseline accepts changes, not
    failures.

    Example: 'workbench bless comparison --baseline arm.baseline.json'.

    Args:
        results (DIR): Folder written by 'workbench compare'.
        baseline (FILE): File to write.
    """
    from workbench.study.baseline import bless as accept

    typer.echo(accept(results, baseline))


def report(
    study: Path,
    *,
    out: Path,
    bode: bool = False,
    controller: list[str] | None = None,
    at: list[str] | None = None,
    option: list[str] | None = None,
    limit: Limit = None,
    jobs: Jobs = None,
    short: Short = None,
) -> None:
    """Write the page of a study, and each of its pictures as PNG and SVG.

    Finished runs of the folder are used, missing ones are done. With --bode: Bode and Nyquist plots
    and margins of the controllers at several operating points, without any run.

    Example: 'workbench report arm --bode --angle 20deg --angle 40deg --out margins'.

    Args:
        study: Study file (TOML), or the name of a shipped one such as arm.
        out (DIR): Folder for page and pictures.
        bode: Linear analysis of the controllers alone, without any run.
        controller (-c NAME): Controller of the study; may be given several times. By default all.
        at (NAME=VALUE): Operating point of the linear analysis, such as angle=30deg; may be given
            several times. The short form is --angle 30deg. By default those of the study.
        option (-o NAME=VALUE): Option of the study's plant in the place of the study's own, such as
            load=3kg.
    """
    from workbench.reports.figures.linear_analysis import delay_words
    from workbench.reports.figures.study_traces import point_text
    from workbench.reports.page import write_page
    from workbench.reports.study_page import linear_page, study_page
    from workbench.study.margins import analyse_study
    from workbench.study.result import run_study

    chosen = named_study(study, limit, option or ())
    if limit is not None and bode:
        raise WorkbenchError("--limit needs the runs of the study; leave out --bode")
    if controller:
        chosen = chosen.only(controller)
        if not bode:
            raise WorkbenchError("--controller chooses for the linear analysis; add --bode")
    points = [*(at or ()), *(short or ())]
    if points:
        model = next(iter(chosen.controllers.values())).plant.build()
        chosen = replace(chosen, points=tuple((value_at_rest(model, p),) for p in points))
    if bode:
        loops = analyse_study(chosen)
        page = linear_page(chosen, loops, command=typed())
        for loop in loops:
            said = loop.reason or (
                f"disk margin {loop.disk_margin:.2f}, Ms {loop.sensitivity:.2f},"
                f" Mt {loop.complementary:.2f}"
                + (f", {delay_words(loop.delay_margin)}" if len(loop.response) else "")
            )
            typer.echo(
                f"{loop.controller:<20} {point_text(chosen, loop.point):<8} {loop.opened:<8} {said}"
            )
    else:
        with counting() as counter:
            result = run_study(chosen, out, jobs=processes(jobs), progress=counter)
        page = study_page(result, command=typed())
    folder = out / "pictures"
    path = write_page(page, out / "report.html", pictures=folder)
    count = len(page.pictures)
    typer.echo(f"written to {path}, and {count} pictures as PNG and SVG to {folder}")
