"""The verbs ``demo`` and ``force-map``."""

from __future__ import annotations

import time
from pathlib import Path

import typer

from workbench.cli.running import note, telling, typed
from workbench.files import json_text, write_whole


def demo(*, out: Path = Path("demo"), data: Path | None = None) -> int:
    """Show the whole workbench on one page: model, linear models, controllers, recording.

    Takes less than a minute on two cores and ends by saying what to open. Only the shipped
    recordings are needed.

    Args:
        out: Folder for the page, the pictures and results.json.
        data: Folder with recordings of real machines; adds measured force maps. By default the
            environment variable WORKBENCH_DATA, if set.
    """
    from workbench.demo import run_demo

    with telling(time.perf_counter()) as say:
        result = run_demo(out, data=data, progress=say)
    typer.echo(str(result))
    if result.interrupted:
        raise KeyboardInterrupt
    return 0 if result.complete else 1


def force_map(file: Path, *, out: Path | None = None) -> None:
    """Fit every force law to a measured force map and judge it on points left out.

    Example: 'workbench force-map dmsp-20-300_static_force.csv --out map'.

    Args:
        file: Table of static forces with the columns pressure, length and force, each with its unit
            (pressure_Pa, length_m, force_N).
        out: Folder for the page, the pictures and results.json.
    """
    from workbench.demo.force_map_study import study_map
    from workbench.demo.force_maps import errors_table, force_map_page, read_force_map
    from workbench.reports.page import write_page

    points = read_force_map(file)
    study = study_map(points, file.stem, progress=note)
    typer.echo(f"{study.name}: {len(study.points.force)} points\n{errors_table(study)}")
    typer.echo(study.headline)
    if out is not None:
        page = force_map_page(study, command=typed())
        results = {"schema": "workbench.force-map/1", **study.table()}
        write_whole(out / "results.json", json_text(results))
        typer.echo(f"open {write_page(page, out / 'report.html', pictures=out)}")
