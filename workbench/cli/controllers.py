"""The verb ``controllers``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.options import Jobs, Positive
from workbench.cli.plant import Chosen, with_plant
from workbench.cli.running import counting, note, typed, write_study
from workbench.cli.verify import nominal_design
from workbench.computing.processes import processes
from workbench.errors import WorkbenchError

if TYPE_CHECKING:
    from workbench.study.study import Study

_DRAWS = "Number of drawn machines; of the arm 200, else twice what may differ."


@with_plant("option", "effect")
def controllers(
    chosen: Chosen,
    *,
    out: Path,
    family: list[str] | None = None,
    require: list[str] | None = None,
    limits: bool = True,
    seed: int = 0,
    seeds: Positive = 1,
    fresh: bool = False,
    blind: bool = False,
    draws: Annotated[int | None, typer.Option(help=_DRAWS, min=1, max=10000)] = None,
    jobs: Jobs = None,
) -> int:
    """Compare all families of controllers on the full plant, and on machines that differ from it.

    Of the arm it runs the shipped study 'controllers': each family designed for 0, 3 and 8 kg
    horizontal and 3 kg vertical, steps and sines on the full plant with muscle hysteresis, another
    load, supply and valve. A step that takes more than twice the physical limit is marked, with
    what prevents less.

    Of another plant, or with other options, it runs all designs that fit through the steps of
    'workbench verify', on machines of which one thing each differs: a law that machines usually
    have some of, wherever it fits; a parameter, or what the plant says that it tolerates; an
    option; noise.

    With --blind machines differ by one thing in turn or by three, drawn with a seed that nothing
    was tuned with; of the arm the designs are those of the study 'tolerant', about 6 s of processor
    time per machine and two minutes for designs, else some 1 s per machine. Tells on how many each
    design holds its limits, and which differences cost most. Runs are kept in OUT and not done
    again. Exit status 1 if a hard requirement is missed, but never with --blind of the arm.

    Examples: 'workbench controllers --out controllers', 'workbench controllers --plant servo-axis
    --blind --out table'.

    Args:
        out: Folder for results.json, summary.md, junit.xml and report.html; blind.html for the arm.
        family (-f NAME): Name of a controller of the study, or of a design; by default all.
        require (METRIC=LIMIT): Largest value of a metric, such as settling_time=0.5s, of a plant
            without study; may be given several times. By default what the plant declares, or that
            each step settles before the next one, which changes no exit status.
        limits: Compute the physical limits (kept on disk once found).
        seed: Seed of the sensors' noise.
        seeds: Number of seeds; the worst of all counts.
        fresh: Run loads, variations and steps too that no choice of a design was made with.
        blind: Run designs on drawn machines instead; those of the arm tolerate delay, lags and
            wrong loads, and run on the workbench's own plant and on an independent simulator.
    """
    from workbench.reports.figures.drawn_machines import drawn_tables
    from workbench.reports.figures.limitations import limitation_tables
    from workbench.study.plants import PlantRecipe
    from workbench.study.read import load_study, shipped_study
    from workbench.study.result import run_study
    from workbench.study.summary import plain_summary

    of_arm = chosen.recipe == PlantRecipe(folder=chosen.recipe.folder)
    if of_arm and require:
        raise WorkbenchError("the study of the arm has requirements; leave --require out")
    if of_arm and blind:
        if family:
            raise WorkbenchError(
                f"--blind tries all designs of the study 'tolerant', and {family[0]!r} was named;"
                " leave --family out"
            )
        return _blind(out, draws or 200, jobs)
    if of_arm:
        study = load_study(shipped_study("controllers"), optional=fresh).with_limit(limits)
        study = study.only(family) if family else study
    elif fresh:
        raise WorkbenchError("--fresh is of the shipped study of the arm; leave it out")
    else:
        study = _on_machines(chosen, family or (), require or (), draws, blind=blind)
    study = replace(study, seeds=tuple(range(seed, seed + seeds)))
    note(str(study))
    with counting() as counter:
        result = run_study(study, out, jobs=processes(jobs), progress=counter)
    for table in limitation_tables(result) if of_arm else drawn_tables(result):
        typer.echo(f"{table}\n")
    write_study(result, out)
    if not of_arm:
        return 1 if result.missed else 0
    typer.echo(plain_summary(result))
    return 0 if result.passed else 1


def _on_machines(
    chosen: Chosen,
    designs: Sequence[str],
    require: Sequence[str],
    draws: int | None,
    *,
    blind: bool,
) -> Study:
    """Return the study of designs that fit on machines that differ from what they know."""
    from workbench.study.drawn_machines import differences, drawn, each, on_machines
    from workbench.study.step_trial import StepTrial

    with counting() as counter:
        trial = StepTrial(
            chosen.recipe, nominal_design(chosen), tuple(designs), say=note, progress=counter
        )
        recipes, steps = trial.prepared()
    found = differences(chosen.recipe, steps[0].references, steps[0].sample_time)
    machines = (
        drawn(chosen.recipe, found, draws or 2 * len({one.kind for one in found}))
        if blind
        else each(chosen.recipe, found)
    )
    return on_machines(trial.study(recipes, steps, require, name="controllers"), machines)


def _blind(out: Path, count: int, jobs: int | None) -> int:
    """Run tolerant designs on drawn machines."""
    from workbench.evaluation.tolerance import (
        SIMULATORS,
        tolerance,
        tolerant_designs,
        tolerant_study,
        traded,
    )
    from workbench.evaluation.variations import draws as drawn
    from workbench.reports.page import write_page
    from workbench.reports.tolerance_page import margins_table, tables, tolerance_page
    from workbench.study.drawn_machines import BLIND_SEED

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
        for table in tables(rows):
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
