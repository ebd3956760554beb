"""The verb ``report``."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer


def report(
    study: Annotated[
        Path, typer.Argument(help="Study file (TOML), or the name of a shipped one such as arm.")
    ],
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
    angle: Annotated[
        list[str] | None,
        typer.Option(
            help="Operating angle of the linear analysis; may be given several times.",
            metavar="ANGLE",
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
    jobs: Annotated[
        int | None,
        typer.Option(help="Number of processes; by default one per core.", metavar="N"),
    ] = None,
) -> int:
    """Write the page of a study, and each of its pictures as PNG and SVG.

    Finished runs of the folder are used, missing ones are done. With --bode: Bode and Nyquist plots
    and margins of the controllers at several angles, in a second or two.

    Example: 'workbench report arm --bode --angle 20deg --angle 40deg --out margins'.

    Args:
        study: Study file, or the name of a shipped study.
        out: Folder for page and pictures.
        bode: Whether only the linear analysis is wanted.
        controller: Names of controllers; all by default.
        angle: Operating angles; those of the study by default.
        limit: Whether steps are compared with the physical limit, or None as the study says.
        jobs: Number of processes, or None for one per core.

    Returns:
        Exit status 0: a report tells, it does not judge.

    Example:
        >>> report(Path("nowhere.toml"), Path("out"))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: study 'nowhere.toml' cannot be read: no such file ...
    """
    from workbench.cli.compare import study_file
    from workbench.cli.counter import Counter
    from workbench.errors import WorkbenchError, check_choice, check_range
    from workbench.model.units import quantity, to_si
    from workbench.reports.page import write_page
    from workbench.reports.study_files import linear_page, write_pictures
    from workbench.reports.study_page import study_page
    from workbench.study.linear_loop import analyse_study
    from workbench.study.result import run_study
    from workbench.study.schema import load_study

    wanted = load_study(study_file(study))
    if limit is not None:
        if bode:
            raise WorkbenchError("--limit needs the runs of the study; leave out --bode")
        wanted = wanted.with_limit(limit)
    if controller:
        for name in controller:
            check_choice("controller", name, wanted.controllers)
        if not bode:
            raise WorkbenchError("--controller chooses for the linear analysis; add --bode")
        chosen = {n: c for n, c in wanted.controllers.items() if n in controller}
        wanted = replace(wanted, controllers=chosen)
    if angle:
        degrees = [
            check_range("operating angle", quantity("angle", text, "deg"), -90.0, 90.0, "deg")
            for text in angle
        ]
        wanted = replace(wanted, points=tuple((("angle", to_si(d, "deg")),) for d in degrees))
    if bode:
        loops = analyse_study(wanted)
        page = linear_page(wanted, loops)
        for loop in loops:
            said = loop.reason or (
                f"disk margin {loop.disk_margin:.2f}, Ms {loop.sensitivity:.2f},"
                f" Mt {loop.complementary:.2f}, delay margin {1e3 * loop.delay_margin:.1f} ms"
            )
            typer.echo(f"{loop.controller:<20} {loop.where:<8} {loop.opened:<8} {said}")
    else:
        counter = Counter()
        try:
            outcome = run_study(
                wanted, out, jobs=(os.cpu_count() or 1) if jobs is None else jobs, progress=counter
            )
        finally:
            counter.close()
        page = study_page(outcome)
    path = write_page(page, out / "report.html")
    count = write_pictures(page, out)
    typer.echo(f"written to {path}, and {count} pictures as PNG and SVG to {out / 'pictures'}")
    return 0
