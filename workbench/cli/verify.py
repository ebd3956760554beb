"""The verb ``verify``."""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from workbench.cli.options import AsJson
from workbench.cli.plant import Chosen, value_at_rest, with_plant
from workbench.cli.running import counting, tell, typed
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_range

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel
    from workbench.model import Input, Model, Output
    from workbench.study.designs import ControllerRecipe
    from workbench.study.study import Demand, Study
    from workbench.verification import Scenario

Progress = Callable[[str, int, int, str], None]
"""Told what is being done, how many are done, of how many, and which one."""


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
            moves at once, or another as NAME=VALUE, which is then controlled alone; several that
            step together are NAME=VALUE,NAME=VALUE; a plant that declares no point of its own is
            designed for there. By default every output that the commands hold independently is
            controlled, and each steps by itself.
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
    """
    from workbench.model.units import in_time
    from workbench.reports.study_page import write_study_files
    from workbench.study.result import run_study
    from workbench.study.summary import plain_summary

    controlled, begins, ends = _controlled(chosen, start, end)
    changes = [*(design or ()), *chosen.design]
    if not changes and not chosen.plant.design_point:
        # What declares no point of its own is designed for where the step starts.
        for name, value in begins.items():
            _level(chosen.model, f"{name}={value}", f"{name} before the step")
            changes.append(f"{name}={value}")
    base = nominal_design(chosen, changes)
    names = controller or ()
    with counting() as counter:
        recipes, scenarios = tried(
            chosen, controlled, base, begins, ends, hold, sample_time, names, delay, counter
        )
    if delay is not None:
        late, h = scenarios[0].late_samples, scenarios[0].sample_time
        told = f"commands are late by {late} samples of {in_time(h)}, {in_time(late * h)}"
        typer.echo(told, err=True)
    study = replace(study_of_steps(chosen, recipes, scenarios, require or ()), seeds=(seed,))
    with tempfile.TemporaryDirectory() as folder, counting() as counter:
        result = run_study(study, out or Path(folder), progress=counter)
    if len(result.failed) == len(result.records):
        raise WorkbenchError(result.records[0].reason)
    for record in result.records:
        if record.metrics is not None:
            shown = replace(record.metrics, plant=chosen.model.name)
            typer.echo(str(shown), err=as_json)
    if result.judgements or result.failed:
        typer.echo(plain_summary(result), err=as_json)
    if out is not None:
        files = write_study_files(result, out, command=typed())
        typer.echo(f"written to {out}: {', '.join(path.name for path in files)}", err=as_json)
    tell(result.table(), as_json=as_json)
    return 0 if result.passed else 1


def nominal_design(chosen: Chosen, changes: Sequence[str] = ()) -> ControllerRecipe:
    """Return the recipe of a design for the nominal plant, or for another than the plant is."""
    from workbench.study.designs import ControllerRecipe
    from workbench.study.plants import PlantRecipe

    options, at = dict(chosen.recipe.options), dict(chosen.plant.design_point)
    known = {n for o in chosen.plant.options for n in (o.name, o.keyword)}
    for text in changes:
        name, _, value = text.partition("=")
        if name.replace("-", "_") in known:
            options |= chosen.plant.parse({name: value})
        else:
            at |= dict([value_at_rest(chosen.nominal, text)])
    plant = PlantRecipe(chosen.recipe.kind, tuple(options.items()), folder=chosen.recipe.folder)
    return ControllerRecipe("", "", plant, tuple(at.items()))


def tried(
    chosen: Chosen,
    controlled: tuple[str, ...],
    base: ControllerRecipe,
    begins: Mapping[str, str] | None = None,
    ends: Mapping[str, str] | None = None,
    hold: str | None = None,
    sample_time: str | None = None,
    controllers: Sequence[str] = (),
    delay: str | None = None,
    progress: Progress | None = None,
) -> tuple[list[ControllerRecipe], list[Scenario]]:
    """Return designs, and the steps through which they run: as given, or of each output alone.

    Args:
        controlled: What is controlled; by default (nothing) all that the commands hold
            independently, or the first alone if no design fits them.
        progress: Told ``"designs"``, how many are done of how many, and which one is next.
    """
    from workbench.linearisation.pace import rounded_up
    from workbench.model.units import in_time, quantity
    from workbench.study.designs import followed_by_default

    own = controlled or followed_by_default(chosen.plant, base.linear())
    begins, ends = begins or {}, ends or {}
    moved = [tuple(ends or begins)] if ends or begins else [(name,) for name in own]

    def scenarios(hold: str | None, sample_time: str | None) -> list[Scenario]:
        found = [
            step_of(chosen, own, base, begins, ends, hold, sample_time, controllers, stepped)
            for stepped in moved
        ]
        return [_late(scenario, delay) for scenario in found]

    found = scenarios(hold, sample_time)
    if delay is not None and sample_time is None and _stated(base, controllers) is None:
        late, h = found[0].late_samples, found[0].sample_time
        part = quantity("delay", delay, "s") / max(late, 1)
        if part >= FINER * h:
            found = scenarios(hold, sample_time := f"{part!r} s")
    try:
        recipes = recipes_of(base, controllers, found[0], progress)
    except WorkbenchError:
        alone = chosen.plant.controlled_outputs(chosen.model)
        if controlled or alone == own or chosen.plant.controlled or len(own) == 1:
            raise
        return tried(
            chosen, alone, base, begins, ends, hold, sample_time, controllers, delay, progress
        )
    followed = {name for recipe in recipes for name in _follows(recipe)}
    moved = [names for names in moved if followed & set(names)] or moved[:1]
    same = f"{found[0].sample_time!r} s"
    if hold is None:
        slow: dict[str, float] = {}
        long = max(settling(recipes, base.linear(), scenario, slow) for scenario in found)
        hold = f"{long!r} s" if long else None
        for name, settled in slow.items():
            whole = in_time(rounded_up(2.0 * settled)).replace(" ", "")
            typer.echo(
                f"{name} settles in {in_time(settled)}, later than the step is run for by default;"
                f" --hold {whole} runs all of it",
                err=True,
            )
    return recipes, scenarios(hold, same)


FINER = 0.25
"""Least sample time over the usual that is taken for a delay to be one of whole samples."""


def _late(scenario: Scenario, delay: str | None) -> Scenario:
    """Return a scenario in which commands are late by a time, by the next whole sample."""
    from workbench.model.units import quantity

    if delay is None:
        return scenario
    h, late = scenario.sample_time, quantity("delay", delay, "s")
    check_range("delay", late, 0.0, 0.5 * scenario.duration, "s")
    return replace(scenario, late_samples=math.ceil(late / h - 1e-9))


def _follows(recipe: ControllerRecipe) -> tuple[str, ...]:
    # One that cannot be built is a run that failed.
    with suppress(WorkbenchError):
        return recipe.build().controlled
    return ()


def study_of_steps(
    chosen: Chosen,
    recipes: Sequence[ControllerRecipe],
    steps: Sequence[Scenario],
    require: Sequence[str],
    name: str = "verify",
) -> Study:
    """Return the study of steps: controllers for the nominal plant, on the chosen one."""
    from workbench.study.study import NOMINAL, Case, Study, Variation

    plant = chosen.recipe
    controllers = {r.name: r for r in recipes}
    scenarios = {scenario.name: scenario for scenario in steps}
    demands, metrics = _demands(chosen, require, scenarios, controllers)
    return Study(
        name,
        Path.cwd() / name,
        {"": Case("", plant, controllers, scenarios)},
        {NOMINAL: Variation(NOMINAL, plant)},
        controllers,
        scenarios,
        demands,
        points=tuple(dict.fromkeys(r.at for r in recipes)),
        own_metrics=metrics,
    )


def _controlled(
    chosen: Chosen, start: str | None, end: str | None
) -> tuple[tuple[str, ...], dict[str, str], dict[str, str]]:
    """Return the outputs that are named, and the levels before and after the step by name."""
    controlled = chosen.plant.controlled_outputs(chosen.model)
    texts = [[] if text is None else text.split(",") for text in (start, end)]
    pairs = [[part.rpartition("=") for part in parts] for parts in texts]
    named = dict.fromkeys(name.strip() for found in pairs for name, _, _ in found if name)
    for name in named:
        check_choice("controlled output", name, [q.name for q in chosen.model.outputs])
    only = next(iter(named), controlled[0])
    begins, ends = ({name.strip() or only: value for name, _, value in found} for found in pairs)
    if begins and ends and begins.keys() != ends.keys():
        raise WorkbenchError(
            f"--from is of {', '.join(begins)} and --to of {', '.join(ends)}; step one output, or"
            " name all that step in both"
        )
    return tuple(named) or (controlled if begins or ends else ()), begins, ends


def step_of(
    chosen: Chosen,
    controlled: tuple[str, ...],
    base: ControllerRecipe,
    begins: Mapping[str, str] | None = None,
    ends: Mapping[str, str] | None = None,
    hold: str | None = None,
    sample_time: str | None = None,
    controllers: Sequence[str] = (),
    stepped: Sequence[str] = (),
) -> Scenario:
    """Return a step of controlled outputs and back, as given or as the plant has it.

    Args:
        begins: Levels before the step by output, as text; those of the design by default.
        ends: The same after the step.
        stepped: Outputs that step, by default the first; the others stay where they are.
    """
    from workbench.linearisation.pace import integrated_within, step_time, usual_sample_time
    from workbench.model.units import from_si, quantity
    from workbench.verification import Steps, step_scenario

    linear, begins, ends = base.linear(), begins or {}, ends or {}
    y0 = {n: float(y) for n, y in zip(linear.output_names, linear.y0, strict=True)}

    def levels(name: str) -> tuple[float, float]:
        about = next(q for q in chosen.model.outputs if q.name == name)
        own = name == chosen.plant.controlled_outputs(chosen.model)[0]
        # A size that nobody declared is all that the inputs bring about, from end to end.
        size = about.scale
        if not about.sized:
            size = max(size, SHOWS * _noise(about), integrated_within(linear, name))
        if own and chosen.plant.step:
            first, last = chosen.plant.step
        else:
            size = size if about.sized else _round(0.25 * size, about.display_unit)
            start = {n: y0[n] for n in (controlled if len(controlled) > 1 else (name,))}
            command = "" if len(controlled) > 1 else _command_of_loop(linear, name)
            first = y0[name]
            last = first + _reached(chosen.model, linear, name, size, start, command)
        begin, end = (
            _level(chosen.model, f"{name}={given[name]}", f"{name} {when} the step")
            if name in given
            else default
            for given, default, when in ((begins, first, "before"), (ends, last, "after"))
        )
        return begin, end

    moved = {name: levels(name) for name in (stepped or controlled[:1])}
    shown = step_time(linear)
    held = shown if hold is None else quantity("time", hold, "s")
    check_range("time between the steps", held, *TIMES_S, "s")
    step = (
        _stated(base, controllers)
        or usual_sample_time(linear, controlled, {n: b - a for n, (a, b) in moved.items()})
        if sample_time is None
        else quantity("sample time", sample_time, "s")
    )
    check_range("sample time", step, TIMES_S[0], held, "s")
    units = {q.name: q.display_unit for q in chosen.model.outputs}
    each = [
        step_scenario(
            name,
            *(float(from_si(level, units[name])) for level in ends_of),
            unit=units[name],
            back=True,
            lead=0.25 * held,
            hold=held,
            sample_time=step,
        )
        for name, ends_of in moved.items()
    ]
    # Other controlled outputs stay as they are at the design point.
    references = {n: Steps((0.0,), (y0[n],)) for n in controlled if n not in moved}
    moving = {name: signal for asked in each for name, signal in asked.references.items()}
    several = len(controlled) > 1
    return replace(
        each[0],
        name=", ".join(
            f"{name}: {asked.name}" if several else asked.name
            for name, asked in zip(moved, each, strict=True)
        ),
        references=dict(sorted({**references, **moving}.items())),
    )


def _round(size: float, unit: str) -> float:
    """Return a difference, in SI, down to one that reads well in its unit."""
    from workbench.model.units import from_si, of_difference, to_si

    shown = float(from_si(size, of_difference(unit)))
    decade = 10.0 ** math.floor(math.log10(shown))
    part = max(n for n in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0) if n <= shown / decade)
    return float(to_si(part * decade, of_difference(unit)))


SHOWS = 200.0
"""Reach over the noise of its sensor of an output of which nobody declares a size: a step is a
quarter of it, and what a loop makes of that noise still fits within 2 % of it."""


def _noise(output: Output) -> float:
    return math.hypot(output.noise_rms, output.resolution / math.sqrt(12.0))


LONGEST = 20_000
"""Most samples between steps that a loop that is slower than its plant is given by default."""


def settling(
    recipes: Sequence[ControllerRecipe],
    linear: LinearModel,
    scenario: Scenario,
    slow: dict[str, float],
) -> float:
    """Return the time between steps, in s, that the slowest loop needs; 0 if they have it.

    It is twice what that loop takes to settle, or five times that where this is less than they
    have, as of fast loops of slow plants: a step that a command's end slows down still shows, and
    the step back. One that ends near the end of a command keeps the time of the plant.

    Args:
        slow: Takes up, by name, what loops that would need too many samples take to settle, in s.
    """
    from controllers.plain.limits import settled_after
    from controllers.plain.loop import PlainLaw
    from workbench.linearisation.pace import has_room, least_time, rounded_up

    changes = {name: signal.changes for name, signal in scenario.references.items()}
    steps = {name: own[0][2] - own[0][1] for name, own in changes.items() if own}
    times = [change[0] for own in changes.values() for change in own]
    usual = max(times, default=0.0) - min(times, default=0.0)
    long, ended, all_told, room = 0.0, 0.0, True, True
    for recipe in recipes:
        told = False
        # One that cannot be built is a run that failed.
        with suppress(WorkbenchError):
            law: Any = recipe.build()
            told = hasattr(law, "around_rest") and not recipe.kind().sensors
            if told := told or isinstance(law, PlainLaw):
                late = scenario.late_samples * scenario.sample_time
                settled = settled_after(law, linear, steps) + late
                if 2.0 * settled > max(usual, LONGEST * scenario.sample_time):
                    slow[recipe.name], told = max(settled, slow.get(recipe.name, 0.0)), False
                else:
                    long = max(long, settled)
            room = room and has_room(linear, law.actuators, steps)
            ended = max(ended, least_time(linear, law.actuators, steps))
        all_told = all_told and told
    if not long:
        return 0.0
    if (least := rounded_up(2.0 * long)) > usual:
        return least
    # A step back may have less of the command than the step, as what only cools.
    enough = max(5.0 * long, 2.0 * (long + ended))
    return rounded_up(enough) if all_told and room and enough < 0.99 * usual else 0.0


def _reached(
    model: Model,
    linear: LinearModel,
    name: str,
    size: float,
    start: Mapping[str, float],
    command: str = "",
) -> float:
    """Return a step, halved until the plant rests behind it and its linear model is still of use.

    Args:
        linear: The model that controllers are designed on.
        start: Controlled outputs before it, in SI.
        command: What a single loop commands; all else rests.
    """
    from workbench.linearisation import linearise
    from workbench.operating_point import operating_point

    rests: list[float] = []
    for halvings in range(6):
        part = 0.5**halvings * size
        at = tuple((n, y + part if n == name else y) for n, y in start.items())
        with suppress(WorkbenchError):
            point = operating_point(
                model, dict(_as_the_loop_rests(model, at, command) if command else at)
            )
            rests.append(part)
            after = linearise(point, verdict=False)
            if after.inverse is not linear.inverse or _alike(linear, after, tuple(start), command):
                return part
    return min(rests, default=size)


ALIKE, NEARLY_ALIKE = 0.5, 0.15
"""Most by which the responses at both ends of a step may differ, over the lesser of them; and that
of a plant that is unstable, of which a loop bears less."""


def _alike(one: LinearModel, other: LinearModel, outputs: Sequence[str], command: str) -> bool:
    """Tell whether commands move outputs alike by two linear models.

    They do by C (i w - A)^-1 B where that of one differs from the other by no more than a part; w
    is how fast the plant grows, or 1 / `step_time`.
    """
    import numpy as np

    from workbench.linearisation.pace import step_time
    from workbench.linearisation.transfer import transfer_function

    inputs = {q.name: q for q in one.operating_point.model.inputs}
    outs = {q.name: q for q in one.operating_point.model.outputs}
    acting = [command] if command else [n for n in one.input_names if inputs[n].commanded]
    slow = 1.0 / step_time(one)
    growing = float(np.max(one.poles.real, initial=0.0))
    found = []
    for linear in (one, other):
        own = linear.select(inputs=acting, outputs=outputs)
        rows = np.array([outs[n].scale for n in own.output_names])
        columns = np.array([inputs[n].scale for n in own.input_names])
        response = transfer_function(own.A, own.B, own.C, own.D, 1j * max(growing, slow))
        found.append(response * columns / rows[:, None])
    least = min(float(np.linalg.norm(response)) for response in found)
    apart = float(np.linalg.norm(found[1] - found[0]))
    return apart <= (NEARLY_ALIKE if growing > slow else ALIKE) * least


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


def _demands(
    chosen: Chosen,
    given: Sequence[str],
    scenarios: Mapping[str, Scenario],
    controllers: Mapping[str, ControllerRecipe],
) -> tuple[tuple[Demand, ...], tuple[str, ...]]:
    """Return what is required, and the metrics of the user's own that it names."""
    from workbench.model.units import convert, of_difference, quantity
    from workbench.study.feasible import check_demand
    from workbench.study.study import Demand, load_metrics
    from workbench.verification import Requirement
    from workbench.verification.metrics import metric_of, metric_units

    pairs = [(name.strip(), value.strip()) for name, _, value in (t.partition("=") for t in given)]
    own = tuple(name for name, _ in pairs if ":" in name)
    metrics = load_metrics(own, Path.cwd())
    called = dict(zip(own, (m.name for m in metrics), strict=True))
    followed = next(iter(scenarios.values())).references
    units = metric_units(chosen.model, tuple(followed), metrics)
    wanted = []
    for name, value in pairs:
        metric = check_choice("metric", called.get(name, name), units)
        about = metric_of(metric, metrics)
        level = about is not None and about.level
        limit = quantity(f"limit of {metric}", value, units[metric], difference=not level)
        unit = re.sub(r"^[-+.\d]+([eE][-+]?\d+)?\s*", "", value) or units[metric]
        unit = unit if level else of_difference(unit)
        wanted.append(Requirement(metric, float(convert(limit, units[metric], unit)), unit))
    demands = [Demand(r) for r in wanted or (Requirement(*r) for r in chosen.plant.requirements)]
    for demand in demands:
        check_demand(demand, units, scenarios, controllers, metrics)
    return tuple(demands), own


def _stated(base: ControllerRecipe, names: Sequence[str]) -> float | None:
    """Return the sample time of the first controller that has one of its own, in s."""
    from controllers.design import designs_for

    for name in names or [design.name for design in designs_for(base.linear())]:
        made = replace(base, name=name, design=name)
        if made.kind().sensors or made.kind().own:
            # One that cannot be built is told with the others (`recipes_of`).
            with suppress(WorkbenchError):
                return made.build().sample_time
    return None


def _as_the_loop_rests(
    model: Model, at: tuple[tuple[str, float], ...], command: str
) -> tuple[tuple[str, float], ...]:
    """Hold what a single loop does not command at its nominal value, where the loop leaves it."""
    idle = [q for q in model.inputs if q.name != command and q.name not in dict(at)]
    room = len(model.inputs) - len(at) if at else 0
    return (*at, *((q.name, q.nominal) for q in idle[: max(room, 0)]))


def recipes_of(
    base: ControllerRecipe,
    names: Sequence[str],
    scenario: Scenario,
    progress: Progress | None = None,
) -> list[ControllerRecipe]:
    """Return the named designs, or those made for such a plant, or those for any plant."""
    from controllers.design import DESIGNS, designs_for
    from controllers.plain.loop import loop_of
    from controllers.plain.pairing import interaction

    linear = base.linear()
    model = linear.operating_point.model
    followed = tuple(name for name in linear.output_names if name in scenario.references)
    # What a design for any linear model must be told: which outputs, and how often.
    told: tuple[tuple[str, Any], ...] = (
        ("measured", followed[0] if len(followed) == 1 else followed),
        ("sample_time", scenario.sample_time),
    )
    if late := scenario.late_samples * scenario.sample_time:
        told = (*told, ("delay", late))

    def recipe(name: str) -> ControllerRecipe:
        made = replace(base, name=name, design=name)
        own = made.kind().sensors or made.kind().own
        return made if own else replace(made, specification=told, at=held)

    held, other = base.at, ""
    if len(followed) == 1:
        taken = _command_of_loop(linear, followed[0])
        other = taken if taken and taken != model.commands[0].name else ""
        told = (*told, ("actuator", other)) if other else told
        held = _as_the_loop_rests(model, base.at, taken)
    one = {n: d for n, d in DESIGNS.members().items() if d.needs == "linear"}
    for name in names:
        if (design := DESIGNS.get(name, folder=Path.cwd())).needs != "linear":
            check_choice("controller", design.name, one)
    only_measured = [q.name for q in model.inputs if not q.commanded]
    stepped = [name for name, asked in scenario.references.items() if asked.changes]
    stepped = stepped if len(stepped) > 1 else []
    behind = _linear_behind(linear, scenario, taken if len(followed) == 1 else "")
    weak: list[str] = []
    found: list[ControllerRecipe] = []
    partly: list[ControllerRecipe] = []
    refused: dict[str, list[str]] = {}
    every = names or [design.name for design in designs_for(linear)]
    for number, made in enumerate(map(recipe, every)):
        if progress and len(every) > 1:
            progress("designs", number, len(every), made.name)
        try:
            law = made.build()
        except WorkbenchError as error:
            # Of designs that nobody asked for, those count that suit the plant; of several that
            # were, one that does not is a run that failed.
            if len(names) > 1:
                found.append(made)
            elif names or made.kind().sensors:
                raise
            else:
                refused.setdefault(str(error), []).append(made.name)
        else:
            if left := [name for name in stepped if name not in law.controlled]:
                reason = f"follows {', '.join(law.controlled)}, not {', '.join(left)} too"
                refused.setdefault(reason, []).append(made.name)
                continue
            plain = made.specification == told
            if plain and (said := hardly_stable(law, linear, late)):
                weak.append(f"{made.name}: {said}")
            elif plain and behind and (said := hardly_stable(law, behind, late)):
                words = f"{made.name}: where the step ends it is {said.partition(';')[0]}"
                weak.append(f"{words}; {_design_for_the_end(behind, scenario)}")
            idle = [n for n in linear.input_names if n not in (*law.actuators, *only_measured)]
            (partly if idle and not names else found).append(made)
    if progress and len(every) > 1:
        progress("designs", len(every), len(every), "")
    for sentence in (*weak, *(f"{', '.join(n)}: {reason}" for reason, n in refused.items())):
        typer.echo(sentence, err=True)
    if partly and not found:
        # Of designs that nobody asked for, those that command every input come first.
        typer.echo(f"what a design does not command rests, such as {', '.join(idle)}", err=True)
        found = partly
    if not found:
        raise WorkbenchError(
            f"no design of the workbench fits {model.name!r}; give one of your own with"
            " --controller module:function"
        )
    if other and any(made.specification == told for made in found):
        typer.echo(f"a single loop commands {other}, which acts most on {followed[0]}", err=True)
    if any(made.specification == told for made in found):
        for sentence in interaction(loop_of(linear, followed, other)):
            typer.echo(sentence, err=True)
    return found


def _levels_behind(linear: LinearModel, scenario: Scenario) -> dict[str, float]:
    """Return where the controlled outputs are behind the first step, in SI."""
    return {
        name: asked.changes[0][2] if asked.changes else float(asked.sample(0.0))
        for name, asked in scenario.references.items()
        if name in linear.output_names
    }


def _linear_behind(linear: LinearModel, scenario: Scenario, command: str) -> LinearModel | None:
    """Return the linear model behind the first step; None where it is the same, or is not found."""
    import numpy as np

    from workbench.linearisation import linearise
    from workbench.operating_point import operating_point

    model, at = linear.operating_point.model, tuple(_levels_behind(linear, scenario).items())
    with suppress(WorkbenchError):
        given = dict(_as_the_loop_rests(model, at, command) if command else at)
        found = linearise(operating_point(model, given), verdict=False)
        if found.A.shape == linear.A.shape and not np.allclose(found.A, linear.A):
            return found
    return None


def _design_for_the_end(behind: LinearModel, scenario: Scenario) -> str:
    from workbench.model.units import from_si

    units = {q.name: q.display_unit for q in behind.operating_point.model.outputs}
    levels = _levels_behind(behind, scenario).items()
    told = (f"--design-{n} {float(from_si(v, units[n])):.4g}{units[n]}" for n, v in levels)
    return f"design it for there ({' '.join(told)}) or step less far"


HARDLY = 5.0
"""Ms, a ratio, above which a loop is hardly stable: from there on, in zone D of ISO 14839-3 on
magnetic bearings, margins are too small to be run for long."""


def hardly_stable(law: Any, linear: LinearModel, delay: float = 0.0) -> str:
    """Return what is to be said of a loop with next to no margins; nothing of any other.

    Args:
        delay: Time by which every command is late, in s.
    """
    from workbench.study.linear_loop import analyse_loop

    with suppress(WorkbenchError):
        loops = analyse_loop(law, linear, points=200, delay=delay)
        if not all(loop.stable for loop in loops):
            return "not stable on its linear model; its steps here prove nothing"
        # What several sensors do together counts at the command.
        worst = max((loop for loop in loops if loop.command), key=lambda loop: loop.sensitivity)
        if worst.sensitivity > HARDLY:
            share = 100.0 * (worst.disk_gain_margin - 1.0)
            return (
                f"hardly stable: Ms is {worst.sensitivity:.3g} at {worst.opened}, where a gain"
                f" {share:.2g} % off may make it unstable; take another family, or measure more"
            )
    return ""


def _command_of_loop(linear: LinearModel, measured: str) -> str:
    """Return what a single loop commands: for the first output the first, else the strongest.

    The strongest is that whose range moves the output most in the time that a step takes: by its
    gain abs(C (i w - A)^-1 B + D) at w = 1 / `step_time`, times what the command may change.
    """
    import numpy as np

    from workbench.linearisation.pace import step_time

    model = linear.operating_point.model
    if len(model.commands) < 2 or measured == model.outputs[0].name:
        return next((q.name for q in model.commands), "")
    row = linear.output_names.index(measured)
    pole = 1j / step_time(linear) * np.eye(len(linear.A)) - linear.A
    gain = np.abs(linear.C[row] @ np.linalg.solve(pole, linear.B) + linear.D[row])

    def moved(command: Input) -> float:
        span = command.upper - command.lower
        size = span if math.isfinite(span) else command.scale
        return float(size * gain[linear.input_names.index(command.name)])

    return max(model.commands, key=moved).name
