"""The verb ``report``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.compare import Limit, StudyName, StudyOptions, named_study
from workbench.cli.counter import Jobs, run_counted
from workbench.cli.plant import Short, value_at_rest


def report(
    study: StudyName,
    out: Annotated[Path, typer.Option(help="Folder for page and pictures.", metavar="DIR")],
    bode: Annotated[
        bool,
        typer.Option("--bode", help="Linear analysis of the controllers alone, without any run."),
    ] = False,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="Controller of the study; may be given several times. By default all.",
            metavar="NAME",
        ),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            "--at",
            help="Operating point of the linear analysis, such as angle=30deg; may be given several"
            " times. The short form is --angle 30deg. By default those of the study.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    option: StudyOptions = None,
    limit: Limit = None,
    jobs: Jobs = None,
    short: Short = None,
) -> int:
    """Write the page of a study, and each of its pictures as PNG and SVG.

    Finished runs of the folder are used, missing ones are done. With --bode: Bode and Nyquist plots
    and margins of the controllers at several angles, in a second or two.

    Example: 'workbench report arm --bode --angle 20deg --angle 40deg --out margins'.
    """
    from workbench.cli.typed import typed
    from workbench.errors import WorkbenchError, check_choice
    from workbench.reports.figures.study_traces import point_text
    from workbench.reports.page import write_page
    from workbench.reports.study_files import linear_page
    from workbench.reports.study_page import study_page
    from workbench.study.linear_loop import analyse_study

    chosen = named_study(study, limit, option or ())
    if limit is not None and bode:
        raise WorkbenchError("--limit needs the runs of the study; leave out --bode")
    if controller:
        for name in controller:
            check_choice("controller", name, chosen.controllers)
        if not bode:
            raise WorkbenchError("--controller chooses for the linear analysis; add --bode")
        kept = {n: c for n, c in chosen.controllers.items() if n in controller}
        chosen = replace(chosen, controllers=kept)
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
                f" Mt {loop.complementary:.2f}, delay margin {1e3 * loop.delay_margin:.1f} ms"
            )
            typer.echo(
                f"{loop.controller:<20} {point_text(chosen, loop.point):<8} {loop.opened:<8} {said}"
            )
    else:
        page = study_page(run_counted(chosen, out, jobs=jobs), command=typed())
    folder = out / "pictures"
    path = write_page(page, out / "report.html", pictures=folder)
    count = len(page.pictures)
    typer.echo(f"written to {path}, and {count} pictures as PNG and SVG to {folder}")
    return 0
