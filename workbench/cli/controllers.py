"""The verb ``controllers``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.counter import Jobs, run_counted


def controllers(
    out: Annotated[
        Path, typer.Option(help="Folder for results.json, summary.md, junit.xml and report.html.")
    ],
    family: Annotated[
        list[str] | None,
        typer.Option(
            "--family",
            "-f",
            help="Name of a controller of the study; by default all.",
            metavar="NAME",
        ),
    ] = None,
    limits: Annotated[
        bool, typer.Option(help="Compute the physical limits (kept on disk once found).")
    ] = True,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.")] = 0,
    seeds: Annotated[
        int, typer.Option(help="Number of seeds; the worst of all counts.", min=1)
    ] = 1,
    fresh: Annotated[
        bool,
        typer.Option(
            "--fresh",
            help="Run loads, variations and steps too that no choice of a design was made with.",
        ),
    ] = False,
    jobs: Jobs = None,
) -> int:
    """Compare all families of controllers on the full plant, with what physics allows beside them.

    Runs the shipped study 'controllers': each family designed for 0, 3 and 8 kg horizontal and 3 kg
    vertical, steps and sines on the full plant with muscle hysteresis, another load, supply and
    valve. Exit status 1 if a requirement is missed.

    Example: 'workbench controllers --out controllers'.
    """
    from dataclasses import replace

    from workbench.cli.typed import typed
    from workbench.reports.figures.limitations import limitation_tables, missed_table
    from workbench.reports.study_files import write_study_files
    from workbench.study.schema import load_study
    from workbench.study.shipped import shipped_study
    from workbench.study.summary import plain_summary

    study = load_study(shipped_study("controllers"), optional=fresh).with_limit(limits)
    if family:
        study = study.only(family)
    study = replace(study, seeds=tuple(range(seed, seed + seeds)))
    typer.echo(str(study), err=True)
    result = run_counted(study, out, jobs=jobs)
    for table in limitation_tables(result):
        typer.echo(f"{table}\n")
    written = write_study_files(result, out, command=typed())
    typer.echo(plain_summary(result))
    typer.echo(f"written to {out}: {', '.join(path.name for path in written)}")
    return 0 if result.passed and not missed_table(result).rows else 1
