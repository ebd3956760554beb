"""The verb ``controllers``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def controllers(
    out: Annotated[
        Path, typer.Option(help="Folder for results.json, the pictures and report.html.")
    ],
    family: Annotated[
        list[str] | None,
        typer.Option(
            "--family",
            "-f",
            help="cascade PID, sliding mode, linear MPC, nonlinear MPC, state feedback or"
            " H-infinity; by default all.",
            metavar="NAME",
        ),
    ] = None,
    limits: Annotated[
        bool, typer.Option(help="Compute the physical limits (kept on disk once found).")
    ] = True,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.")] = 0,
    seeds: Annotated[
        int, typer.Option(help="Number of seeds; a figure is the worst of all.", min=1)
    ] = 1,
    fresh: Annotated[
        bool,
        typer.Option(
            "--fresh",
            help="Run loads, variations and steps too that no choice of a design was made with.",
        ),
    ] = False,
    jobs: Annotated[
        int | None, typer.Option(help="Number of processes; by default one per processor.")
    ] = None,
) -> int:
    """Compare all families of controllers on the full plant, with what physics allows beside them.

    Designs each family for 0, 3 and 8 kg horizontal and 3 kg vertical, and runs steps and sines on
    the full plant with muscle hysteresis, another load, supply and valve. Exit status 1 if a goal
    is missed.

    Example: 'workbench controllers --out controllers'.

    Args:
        out: Folder for the results.
        family: Families; all by default.
        limits: Whether the physical limits are computed.
        seed: Seed of the sensors' noise.
        seeds: Number of seeds, from ``seed`` on.
        fresh: Whether fresh loads and variations are run.
        jobs: Number of processes, or None for one per processor.

    Returns:
        Exit status: 1 if a goal is missed.

    Example:
        >>> controllers(Path("never"), ["fuzzy"])
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: family of controllers is 'fuzzy'; it must be one of ...
    """
    import time

    from tqdm import tqdm

    from workbench.benchmark.designs import FAMILIES, available_families
    from workbench.benchmark.obstacles import obstacles_table, plan_table
    from workbench.benchmark.page import missed_table, write_comparison
    from workbench.benchmark.run import compare_controllers
    from workbench.benchmark.table import (
        changes_table,
        comparison_table,
        courses_table,
        fast_table,
        margins_table,
    )
    from workbench.errors import check_choice

    wanted = tuple(family) if family else available_families()
    for name in wanted:
        check_choice("family of controllers", name, FAMILIES)
    begin = time.perf_counter()
    with tqdm(desc="runs", unit="run", leave=False) as bar:

        def progress(done: int, count: int, what: str) -> None:
            bar.total = count
            bar.set_postfix_str(what, refresh=False)
            bar.update(done - bar.n)

        found = compare_controllers(
            families=wanted,
            limits=limits,
            seed=seed,
            seeds=seeds,
            fresh=fresh,
            jobs=jobs,
            progress=progress,
        )
    for build in (comparison_table, courses_table):
        for nominal in (True, False):
            typer.echo(f"{build(found, nominal=nominal)}\n")
    missed = missed_table(found)
    evidence = (plan_table(found), obstacles_table(found), fast_table(found))
    for table in (changes_table(found), margins_table(found), *evidence, missed):
        typer.echo(f"{table}\n")
    minutes = (time.perf_counter() - begin) / 60.0
    page = write_comparison(found, out, minutes=minutes)
    typer.echo(f"written to {out} in {minutes:.1f} min; open {page}")
    return 1 if missed.rows else 0
