"""The verb ``report``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import typer

from workbench.cli.compare import Limit, named_study
from workbench.cli.options import Jobs, Short
from workbench.cli.plant import value_at_rest
from workbench.cli.running import counting, typed
from workbench.work.processes import processes


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
) -> int:
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
    from workbench.errors import WorkbenchError
    from workbench.reports.figures.linear_analysis import delay_words
    from workbench.reports.figures.study_traces import point_text
    from workbench.reports.page import write_page
    from workbench.reports.study_page import linear_page, study_page
    from workbench.study.linear_loop import analyse_study
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
    return 0
