"""The verb ``controllers``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.options import Jobs, Positive
from workbench.cli.running import counting, processes, typed
from workbench.errors import WorkbenchError


def controllers(
    *,
    out: Path,
    family: list[str] | None = None,
    limits: bool = True,
    seed: int = 0,
    seeds: Positive = 1,
    fresh: bool = False,
    blind: bool = False,
    draws: Annotated[int, typer.Option(help="Number of drawn machines.", min=1, max=10000)] = 200,
    jobs: Jobs = None,
) -> int:
    """Compare all families of controllers on the full arm, with what physics allows beside them.

    Of a plant of your own 'workbench verify --plant my_plants:rig' tries them all, and 'workbench
    new-study' writes a study of it.

    Runs the shipped study 'controllers': each family designed for 0, 3 and 8 kg horizontal and 3 kg
    vertical, steps and sines on the full plant with muscle hysteresis, another load, supply and
    valve. Exit status 1 if a hard requirement is missed. A step that takes more than twice the
    physical limit is marked, with what prevents less; it changes no exit status.

    With --blind: designs of the study 'tolerant' on machines that differ from what they know by one
    thing in turn or by three, drawn with a seed that nothing was tuned with. Tells on how many each
    holds its limits, and which differences cost most; about 6 s of processor time per machine and
    two minutes for designs. Runs are kept in OUT and not done again.

    Example: 'workbench controllers --out controllers'.

    Args:
        out: Folder for results.json, summary.md, junit.xml and report.html, or for blind.html.
        family (-f NAME): Name of a controller of the study; by default all.
        limits: Compute the physical limits (kept on disk once found).
        seed: Seed of the sensors' noise.
        seeds: Number of seeds; the worst of all counts.
        fresh: Run loads, variations and steps too that no choice of a design was made with.
        blind: Run designs that tolerate delay, lags and wrong loads on drawn machines instead, on
            the workbench's own plant and on an independent simulator.
    """
    if blind:
        if family:
            raise WorkbenchError(
                f"--blind tries all designs of the study 'tolerant', and {family[0]!r} was named;"
                " leave --family out"
            )
        return _blind(out, draws, jobs)
    from dataclasses import replace

    from workbench.reports.figures.limitations import limitation_tables
    from workbench.reports.study_page import write_study_files
    from workbench.study.result import run_study
    from workbench.study.schema import load_study, shipped_study
    from workbench.study.summary import plain_summary

    study = load_study(shipped_study("controllers"), optional=fresh).with_limit(limits)
    if family:
        study = study.only(family)
    study = replace(study, seeds=tuple(range(seed, seed + seeds)))
    typer.echo(str(study), err=True)
    with counting() as counter:
        result = run_study(study, out, jobs=processes(jobs), progress=counter)
    for table in limitation_tables(result):
        typer.echo(f"{table}\n")
    written = write_study_files(result, out, command=typed())
    typer.echo(plain_summary(result))
    typer.echo(f"written to {out}: {', '.join(path.name for path in written)}")
    return 0 if result.passed else 1


def _blind(out: Path, count: int, jobs: int | None) -> int:
    """Run tolerant designs on drawn machines."""
    from workbench.evaluation.rig.variations import BLIND_SEED
    from workbench.evaluation.rig.variations import draws as drawn
    from workbench.evaluation.tolerance import (
        SIMULATORS,
        tolerance,
        tolerant_designs,
        tolerant_study,
        traded,
    )
    from workbench.reports.page import write_page
    from workbench.reports.tolerance_page import (
        margins_table,
        missed_table,
        reached_table,
        tolerance_page,
    )

    names, jobs = list(tolerant_study().controllers), processes(jobs)
    plan, rows = dict.fromkeys(SIMULATORS, drawn(count, BLIND_SEED)), []
    found, trades = {}, {}
    with counting() as counter:
        counter("designs", 0, len(names), "")
        for name, design in tolerant_designs(jobs=jobs):
            found[name] = design
            counter("designs", len(found), len(names), name)
        designs = {name: found[name] for name in names}
        for row in tolerance(plan, designs, out / "blind", jobs=jobs):
            rows.append(row)
            what = f"{row['simulator']} / {row['draw']}"
            counter("machines", len(rows), len(SIMULATORS) * count, what)
        for table in (*(reached_table(rows, name) for name in SIMULATORS), missed_table(rows)):
            typer.echo(f"{table}\n")
        counter("trades", 0, len(names), "")
        for name, points in traded(designs, jobs=jobs):
            trades[name] = points
            counter("trades", len(trades), len(names), name)
    typer.echo(f"{margins_table(designs)}\n")
    page = tolerance_page(rows, designs, {name: trades[name] for name in names}, command=typed())
    path = write_page(page, out / "blind.html")
    typer.echo(f"written to {path}")
    return 0
