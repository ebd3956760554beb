"""The verb ``redesign``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import typer

from workbench.errors import WorkbenchError


def redesign(
    verdict: str, *, out: Path, family: list[str] | None = None, at: list[str] | None = None
) -> int:
    """Design anew for a machine that was diagnosed, and show what knowing it is worth.

    Laws that were found enter the linear models. Each design for the nominal plant, and the same
    for the machine that was found, run on that machine through a step and back.

    Of the arm, latency and lags are predicted over, hysteresis is compensated, and beside each
    redesign run the nominal design on the nominal plant, and the tolerant one, which knows nothing,
    on the machine.

    Example: 'workbench redesign diagnosis/verdict.json -f "state feedback" --out redesign'.

    Args:
        verdict (FILE): The verdict.json of a diagnosis.
        out (DIR): Folder for the page and the controllers in C.
        family (-f NAME): Family of controllers of the arm, such as 'state feedback', or a design as
            'workbench verify' takes it; may be given several times. By default all that fit.
        at (NAME=VALUE): Value of an output, state or input at rest, where the step starts; may be
            given several times. By default the plant's own. The arm has its own steps.
    """
    from workbench.study.plants import PlantRecipe

    if not PlantRecipe(verdict, folder=Path.cwd()).plant().tolerant:
        return _redesigned(verdict, family or (), at or (), out)
    if at:
        raise WorkbenchError("the arm is redesigned for steps of its own; leave out --at")
    from controllers.c_export import export_c
    from workbench.cli.running import typed
    from workbench.evaluation.regained import WHICH, regained
    from workbench.reports.page import write_page
    from workbench.reports.regained_page import regained_page, regained_table

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


def _redesigned(verdict: str, designs: Sequence[str], at: Sequence[str], out: Path) -> int:
    """Run designs for the nominal plant and for the machine that was found on that machine."""
    from controllers.c_export import export_c
    from workbench.cli.plant import chosen_plant
    from workbench.cli.running import counting, typed
    from workbench.cli.verify import nominal_design, recipes_of, study_of_steps, tried
    from workbench.plants.registry import nominal_of_file
    from workbench.reports.study_page import write_study_files
    from workbench.study.plants import PlantRecipe
    from workbench.study.result import run_study
    from workbench.study.summary import plain_summary

    found = chosen_plant(verdict)
    kind, options = nominal_of_file(Path(verdict))
    base = nominal_design(found, at)
    nominal = replace(base, plant=PlantRecipe(kind, options, folder=base.plant.folder))
    after, scenarios = tried(found, (), base, controllers=designs)
    before = recipes_of(nominal, designs, scenarios[0])
    recipes = [
        replace(recipe, name=f"{recipe.name}, {word}")
        for known, word in ((before, "nominal"), (after, "redesigned"))
        for recipe in known
    ]
    study = study_of_steps(found, recipes, scenarios, (), "redesign")
    # A family has one colour, whatever it was designed for.
    kin = tuple((r.name, own.name) for r, own in zip(recipes, (*before, *after), strict=True))
    study = replace(study, report=replace(study.report, kin=kin))
    with counting() as counter:
        result = run_study(study, out, progress=counter)
    units = {q.name: q.unit for q in (*found.model.outputs, *found.model.inputs)}
    for recipe in after:
        export_c(recipe.build(), out, name=recipe.name.replace("-", "_"), units=units)
    for record in result.records:
        if record.metrics is not None:
            typer.echo(str(replace(record.metrics, plant=found.model.name)))
    if result.judgements or result.failed:
        typer.echo(plain_summary(result))
    files = write_study_files(result, out, command=typed())
    typer.echo(f"written to {out}: {', '.join(p.name for p in files)}, and the redesigned in C")
    return 0
