"""The verb ``redesign``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from workbench.cli.plant import Chosen, chosen_plant
from workbench.cli.running import counting, note, tell_runs, write_in_c, write_study
from workbench.cli.verify import nominal_design
from workbench.errors import WorkbenchError

if TYPE_CHECKING:
    from workbench.study.study import Study


_DESCRIPTION = """Each family as it is designed for the nominal plant, on that plant; as it \
tolerates a machine that nobody has identified; and made anew from what was found of the machine."""


def redesign(
    verdict: str, *, out: Path, family: list[str] | None = None, at: list[str] | None = None
) -> None:
    """Design anew for a machine that was diagnosed, and show what knowing it is worth.

    Laws that were found enter the linear models. Each design for the nominal plant, and the same
    for the machine that was found, run on that machine through a step and back.

    Of the arm, latency and lags are predicted over, hysteresis is compensated, and beside each
    redesign run the nominal design on the nominal plant, and the tolerant one, which knows nothing,
    on the machine.

    Example: 'workbench redesign diagnosis/verdict.json -f "state feedback" --out redesign'.

    Args:
        verdict (FILE): The verdict.json of a diagnosis.
        out (DIR): Folder for results.json, summary.md, junit.xml, report.html and the controllers
            in C.
        family (-f NAME): Family of controllers of the arm, such as 'state feedback', or a design as
            'workbench verify' takes it; may be given several times. By default all that fit.
        at (NAME=VALUE): Value of an output, state or input at rest, where the step starts; may be
            given several times. By default the plant's own. The arm has its own steps.
    """
    from workbench.study.result import run_study
    from workbench.study.summary import plain_summary

    found = chosen_plant(verdict)
    if found.plant.tolerant:
        if at:
            raise WorkbenchError("the arm is redesigned for steps of its own; leave out --at")
        study = _beside_tolerant(found, family or ())
    else:
        study = _nominal_and_redesigned(found, Path(verdict), family or (), at or ())
    with counting() as counter:
        result = run_study(study, out, progress=counter)
    redesigned = {
        title.removesuffix(", redesigned"): recipe
        for title, recipe in study.controllers.items()
        if title.endswith(", redesigned")
    }
    write_in_c(redesigned, out, found.model)
    tell_runs(result, found.model.name)
    if result.judgements or result.failed:
        typer.echo(plain_summary(result))
    write_study(result, out, more=", and the redesigned in C")


def _beside_tolerant(found: Chosen, families: Sequence[str]) -> Study:
    """Return the study of nominal, tolerant and redesigned designs, and say how fast they are."""
    from workbench.evaluation.regained_speed import study_of_redesign

    study = study_of_redesign(found.recipe, families)
    said, kept, count = [], [], len(study.controllers)
    with counting() as counter:
        for number, (name, recipe) in enumerate(study.controllers.items()):
            counter("designs", number, count, name)
            try:
                made = recipe.designed()
            except WorkbenchError as error:
                # What one family cannot do costs no other its result.
                said.append(f"{name}: {error}.")
                continue
            limit = f"; the next faster misses: {made.limit}" if made.limit else ""
            said.append(f"{name}: {made.speed:.3g} rad/s{limit}.")
            kept.append(name)
        counter("designs", count, count, "")
    if not kept:
        raise WorkbenchError(" ".join(said))
    typer.echo("\n".join(said))
    report = replace(study.report, said=tuple(said))
    return replace(study.only(kept), description=_DESCRIPTION, report=report)


def _nominal_and_redesigned(
    found: Chosen, verdict: Path, designs: Sequence[str], at: Sequence[str]
) -> Study:
    """Return the study of designs for the nominal plant and for the machine, on that machine."""
    from workbench.model.units import in_time
    from workbench.plants.registry import nominal_of_file
    from workbench.study.plants import PlantRecipe
    from workbench.study.step_trial import StepTrial

    kind, options = nominal_of_file(verdict)
    base = nominal_design(found, at)
    nominal = replace(base, plant=PlantRecipe(kind, options, folder=base.plant.folder))
    known = {effect.name for effect in nominal.plant.build().effects}
    if dry := [name for name in found.model.dry_effects if name not in known]:
        note(
            f"{', '.join(dry)} has no slope at rest, so that linear models leave it out: what is"
            " designed anew knows the refitted parameters and other laws alone"
        )
    trial = StepTrial(found.recipe, base, tuple(designs), say=note).exact()
    with counting() as counter:
        after, scenarios = replace(trial, progress=counter).prepared()
    with counting() as counter:
        # They know of no delay.
        untold = replace(scenarios[0], late_samples=0)
        before = replace(trial, base=nominal, progress=counter).recipes(untold)
    recipes = [
        replace(recipe, name=f"{recipe.name}, {word}")
        for known, word in ((before, "nominal"), (after, "redesigned"))
        for recipe in known
    ]
    study = trial.study(recipes, scenarios, name="redesign")
    # A family has one colour, whatever it was designed for.
    kin = tuple((r.name, own.name) for r, own in zip(recipes, (*before, *after), strict=True))
    said = "Each design for the nominal plant, and made anew for the machine, on the machine."
    if trial.delay is not None:
        said += f" Its commands are late by {in_time(trial.delay)}."
    return replace(study, description=said, report=replace(study.report, kin=kin))
