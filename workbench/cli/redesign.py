"""The verb ``redesign``."""

from __future__ import annotations

from pathlib import Path

import typer


def redesign(verdict: str, *, out: Path, family: list[str] | None = None) -> int:
    """Design anew for a machine that was diagnosed, and show what knowing it is worth.

    Latency and lags that were found are predicted over, lines and other laws enter the linear
    models, hysteresis is compensated. Beside each redesign run the nominal design on the nominal
    plant, and the tolerant one, which knows nothing, on the machine that was found.

    Example: 'workbench redesign diagnosis/verdict.json -f "state feedback" --out redesign'.

    Args:
        verdict (FILE): The verdict.json of a diagnosis of the arm.
        out (DIR): Folder for the page and the controllers in C.
        family (-f NAME): Family of controllers, such as 'state feedback'; may be given several
            times. By default all of the study 'tolerant'.
    """
    from controllers.c_export import export_c
    from workbench.cli.running import typed
    from workbench.evaluation.regained import WHICH, regained
    from workbench.reports.page import write_page
    from workbench.reports.regained_page import regained_page, regained_table
    from workbench.study.plants import PlantRecipe

    runs, plant = [], PlantRecipe(verdict)
    units = {q.name: q.unit for model in (plant.build(),) for q in (*model.outputs, *model.inputs)}
    for run in regained(plant, family or ()):
        runs.append(run)
        typer.echo(f"{run.family}: {run.which}", err=True)
        if run.which == WHICH[-1]:
            name = run.family.lower().replace(" ", "_")
            export_c(run.controller, out, name=name, units=units)
    typer.echo(str(regained_table(runs)))
    page = regained_page(runs, Path(verdict).name, command=typed())
    path = write_page(page, out / "redesign.html")
    typer.echo(f"written to {path}, and the redesigned controllers in C beside it")
    return 0
