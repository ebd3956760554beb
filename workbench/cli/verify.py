"""The verb ``verify``."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from workbench.cli.options import AsJson
from workbench.cli.plant import Chosen, value_at_rest, with_plant
from workbench.cli.running import counting, note, tell, tell_runs, write_in_c, write_study
from workbench.errors import WorkbenchError, check_choice, check_range

if TYPE_CHECKING:
    from workbench.model import Model
    from workbench.study.designs import ControllerRecipe


@with_plant("option", "effect", "design")
def verify(
    chosen: Chosen,
    *,
    controller: list[str] | None = None,
    design: list[str] | None = None,
    start: str | None = None,
    end: str | None = None,
    hold: str | None = None,
    sample_time: str | None = None,
    delay: str | None = None,
    require: list[str] | None = None,
    seed: int = 0,
    out: Path | None = None,
    in_c: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Run controllers on the full plant through a step and back, and score what they do.

    A study of one scenario, or of one for each output: each controller is designed from the linear
    model of the nominal plant, without effects that are attached here, and run on the full plant
    with saturation, converters and sensor noise. Exit status 1 if a requirement is missed.

    Examples: 'workbench verify -c pid -c mpc --from 15deg --to 45deg --hysteresis',
    'workbench verify --plant my_plants:circuit -c my_designs:integral --from 0V --to 1V'.

    Args:
        controller (-c NAME): Design that starts from one linear model, such as pid, sliding-mode or
            mpc, or module:function of your own; may be given several times. By default all that
            fit.
        design (NAME=VALUE): What the design takes for another than the plant has: an option, or a
            value at rest, such as load=1kg or angle=30deg; the short form is --design-load 1kg.
        start (--from VALUE): Controlled output before the step, the plant's first that no command
            moves at once, or another as NAME=VALUE or in a unit that it alone is measured in, which
            is then controlled alone; several that step together are NAME=VALUE,NAME=VALUE; a plant
            that declares no point of its own is designed for there. By default every output that
            the commands hold independently is controlled, and each steps by itself.
        end (--to VALUE): Controlled output after the step, or several as before it.
        hold (TIME): Time between the steps. By default what the linear model takes to respond, but
            between two and five times what the slowest loop of it takes to settle.
        sample_time (TIME): Sample time of controllers and loop. By default the controllers' own, or
            a thousandth of that response, less where the plant is unstable or where the commands
            can move the controlled output sooner.
        delay (TIME): How late every command acts beside the sampling, as by a computer, a bus or a
            pipe: in whole samples, of which the usual one is made a part of it. Designs for any
            plant reckon with it.
        require (METRIC=LIMIT): Largest value of a metric, such as settling_time=0.5s; may be given
            several times. By default what the plant declares.
        seed: Seed of the sensors' noise.
        out (DIR): Folder for results.json, summary.md, junit.xml and report.html.
        in_c (--c DIR): Folder for each controller inside its guard, as C99 without dependencies.
    """
    from workbench.model.units import in_time, quantity
    from workbench.study.result import run_study
    from workbench.study.step_trial import StepTrial
    from workbench.study.summary import plain_summary

    def seconds(name: str, given: str | None) -> float | None:
        return None if given is None else quantity(name, given, "s")

    controlled, begins, ends = _controlled(chosen, start, end)
    changes = [*(design or ()), *chosen.design]
    base = nominal_design(chosen, changes)
    if not changes and not chosen.plant.design_point:
        # What declares no point of its own is designed for where the step starts.
        base = replace(base, at=tuple(begins.items()))
    named = tuple(controller or ())
    times = seconds("time", hold), seconds("sample time", sample_time), seconds("delay", delay)
    with counting() as counter:
        trial = StepTrial(
            chosen.recipe, base, named, controlled, begins, ends, *times, note, counter
        ).exact()
        recipes, scenarios = trial.prepared()
    if trial.delay is not None:
        late, h = scenarios[0].late_samples, scenarios[0].sample_time
        samples = "1 sample" if late == 1 else f"{late} samples"
        note(f"commands are late by {samples} of {in_time(h)}, {in_time(late * h)}")
    study = replace(trial.study(recipes, scenarios, require or ()), seeds=(seed,))
    with tempfile.TemporaryDirectory() as folder, counting() as counter:
        kept = out or Path(folder)
        result = run_study(study, kept, traces=out is not None, progress=counter)
    if len(result.failed) == len(result.records):
        raise WorkbenchError(result.records[0].reason)
    tell_runs(result, chosen.model.name, as_json=as_json)
    if result.judgements or result.failed:
        typer.echo(plain_summary(result), err=as_json)
    if in_c is not None:
        write_in_c(study.controllers, in_c, chosen.model)
    if out is not None:
        write_study(result, out, as_json=as_json)
    tell(result.table(), as_json=as_json)
    return 0 if result.passed else 1


def nominal_design(chosen: Chosen, changes: Sequence[str] = ()) -> ControllerRecipe:
    """Return the recipe of a design for the nominal plant, or for another than the plant is."""
    from workbench.model.units import named_value
    from workbench.study.designs import ControllerRecipe
    from workbench.study.plants import PlantRecipe

    options, at = dict(chosen.recipe.options), dict(chosen.plant.design_point)
    known = {n for o in chosen.plant.options for n in (o.name, o.keyword)}
    for text in changes:
        name, value = named_value("design", text)
        if name.replace("-", "_") in known:
            options |= chosen.plant.parse({name: value})
        else:
            at |= dict([value_at_rest(chosen.nominal, text)])
    plant = PlantRecipe(chosen.recipe.kind, tuple(options.items()), folder=chosen.recipe.folder)
    return ControllerRecipe("", "", plant, tuple(at.items()))


def _controlled(
    chosen: Chosen, start: str | None, end: str | None
) -> tuple[tuple[str, ...], dict[str, float], dict[str, float]]:
    """Return the outputs that are named, and their levels before and after the step, in SI."""
    controlled = chosen.plant.controlled_outputs(chosen.model)
    texts = [[] if text is None else text.split(",") for text in (start, end)]
    pairs = [[part.rpartition("=") for part in parts] for parts in texts]
    named = dict.fromkeys(name.strip() for found in pairs for name, _, _ in found if name)
    for name in named:
        check_choice("controlled output", name, [q.name for q in chosen.model.outputs])
    for value in (value for found in pairs for name, _, value in found if not named and not name):
        alone = _measured_in(chosen.model, value)
        if len(alone) == 1 and alone[0] != controlled[0]:
            named = dict.fromkeys(alone)
    only = next(iter(named), controlled[0])
    begins, ends = (
        {
            name: _level(chosen.model, f"{name}={value}", f"{name} {when} the step")
            for name, value in ((name.strip() or only, value) for name, _, value in found)
        }
        for found, when in zip(pairs, ("before", "after"), strict=True)
    )
    if begins and ends and begins.keys() != ends.keys():
        raise WorkbenchError(
            f"--from is of {', '.join(begins)} and --to of {', '.join(ends)}; step one output, or"
            " name all that step in both"
        )
    return tuple(named) or (controlled if begins or ends else ()), begins, ends


def _measured_in(model: Model, text: str) -> list[str]:
    """Return the outputs that a value may be one of, by its unit."""
    from workbench.model.units import quantity

    found = []
    for q in model.outputs:
        with suppress(WorkbenchError):
            quantity(q.name, text, q.unit)
            found.append(q.name)
    return found


def _level(model: Model, text: str, what: str) -> float:
    """Return a level of the controlled output, inside the range of the state that it shows."""
    from workbench.model.units import from_si

    name, value = value_at_rest(model, text)
    about = next(q for q in model.outputs if q.name == name)
    bounded: Any = next((q for q in model.states if q.name == name and q.unit == about.unit), about)
    unit = about.display_unit
    lower, upper = (from_si(v, unit) for v in (bounded.lower, bounded.upper))
    check_range(what, from_si(value, unit), lower, upper, unit)
    return value
