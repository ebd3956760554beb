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
    blind: Annotated[
        bool,
        typer.Option(
            "--blind",
            help="Run designs that tolerate delay, lags and wrong loads on drawn machines instead,"
            " on the workbench's own plant and on an independent simulator.",
        ),
    ] = False,
    draws: Annotated[int, typer.Option(help="Number of drawn machines.", min=1, max=10000)] = 200,
    jobs: Jobs = None,
) -> int:
    """Compare all families of controllers on the full plant, with what physics allows beside them.

    Runs the shipped study 'controllers': each family designed for 0, 3 and 8 kg horizontal and 3 kg
    vertical, steps and sines on the full plant with muscle hysteresis, another load, supply and
    valve. Exit status 1 if a requirement is missed.

    With --blind: designs of the study 'tolerant' on machines that differ from what they know by one
    thing in turn or by three, drawn with a seed that nothing was tuned with.

    Example: 'workbench controllers --out controllers'.
    """
    if blind:
        return _blind(out, draws, jobs)
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


def _blind(out: Path, count: int, jobs: int | None) -> int:
    """Run tolerant designs on drawn machines."""
    import os

    from workbench.cli.counter import Counter
    from workbench.cli.typed import typed
    from workbench.evaluation.rig.variations import BLIND_SEED
    from workbench.evaluation.rig.variations import draws as drawn
    from workbench.evaluation.tolerance import SIMULATORS, tolerance, tolerant_study
    from workbench.reports.page import write_page
    from workbench.reports.tolerance_page import margins_table, reached_table, tolerance_page
    from workbench.study.designs import bandwidth_against_delay

    machines = drawn(count, BLIND_SEED)
    workers = (os.cpu_count() or 1) if jobs is None else jobs
    counter, rows = Counter(), []
    try:
        for row in tolerance(dict.fromkeys(SIMULATORS, machines), out / "blind", jobs=workers):
            rows.append(row)
            what = f"{row['simulator']} / {row['draw']}"
            counter("machines", len(rows), len(SIMULATORS) * count, what)
    finally:
        counter.close()
    designs = {name: recipe.designed() for name, recipe in tolerant_study().controllers.items()}
    for table in (*(reached_table(rows, name) for name in SIMULATORS), margins_table(designs)):
        typer.echo(f"{table}\n")
    trades = {
        name: bandwidth_against_delay(recipe, (0.0, 0.5, 1.0, 1.5, 2.0))
        for name, recipe in tolerant_study().controllers.items()
    }
    page = tolerance_page(rows, designs, trades, command=typed())
    path = write_page(page, out / "blind.html")
    typer.echo(f"written to {path}")
    return 0
