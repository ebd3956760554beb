"""Controllers tried through steps: which designs, of which outputs, how far, how long, how often.

Who tries a plant for the first time need not say: what is not given follows from the linear model
that the controllers are designed on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controllers.design import DESIGNS, designs_for
from controllers.plain.limits import of_whole_samples
from controllers.plain.loop import loop_of
from controllers.plain.pairing import interaction, wrong_way
from controllers.plain.plain_law import PlainLaw
from controllers.plain.selection import settled_after
from controllers.sensitivity import stirred
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_range
from workbench.linearisation import LinearModel, linearise
from workbench.linearisation.first_step import as_the_loop_rests, command_of_loop, step_of
from workbench.linearisation.time_scales import (
    farthest,
    has_room,
    least_time,
    rounded_up,
    step_time,
    usual_sample_time,
)
from workbench.model import Model
from workbench.model.quantities import of_names
from workbench.model.units import (
    from_si,
    in_time,
    named_value,
    of_difference,
    with_unit,
)
from workbench.operating_point import operating_point
from workbench.physics.delay import clock_shift, delay, sensor_delay, valve_delay
from workbench.plants.plant import Plant
from workbench.study.designs import ControllerRecipe, followed_by_default
from workbench.study.feasible import check_demand
from workbench.study.margins import analyse_loop
from workbench.study.plants import PlantRecipe
from workbench.study.study import NOMINAL, Case, Demand, Study, Variation, load_metrics
from workbench.verification import Requirement, Scenario, Signal, Steps, step_scenario
from workbench.verification.metrics import metric_of, metric_units
from workbench.verification.requirements import limit_in_words

Progress = Callable[[str, int, int, str], None]
"""Told what is being done, how many are done, of how many, and which one."""


@dataclass(frozen=True)
class StepTrial:
    """What is tried: controllers for a nominal plant, on a machine, through steps.

    Args:
        machine: The plant that they run on.
        base: Recipe of a design, for the nominal plant or another, whose name is still open.
        designs: Names of designs, or ``module:function``; by default all that fit.
        controlled: Outputs that are controlled; by default (none) all that the commands hold
            independently, or the first alone if no design fits them.
        begins: Levels before the step by output, in SI; those of the design by default.
        ends: The same after the step, in SI.
        hold: Time between the steps, in s; by default what plant and loops take.
        sample_time: Sample time of the loop, in s; by default that of the controllers or the plant.
        delay: Time by which commands are late, in s.
        say: Told what a reader should know, in sentences.
        progress: Told ``"designs"``, how many are done of how many, and which one is next.
    """

    machine: PlantRecipe
    base: ControllerRecipe
    designs: tuple[str, ...] = ()
    controlled: tuple[str, ...] = ()
    begins: Mapping[str, float] = field(default_factory=dict)
    ends: Mapping[str, float] = field(default_factory=dict)
    hold: float | None = None
    sample_time: float | None = None
    delay: float | None = None
    say: Callable[[str], None] = lambda said: None
    progress: Progress | None = None

    @cached_property
    def model(self) -> Model:
        """The model of the machine."""
        return self.machine.build()

    @cached_property
    def plant(self) -> Plant:
        """What the machine is one of."""
        return self.machine.plant()

    @property
    def linear(self) -> LinearModel:
        """The linear model that controllers are designed on."""
        return self.base.linear()

    def exact(self) -> StepTrial:
        """Return the trial whose designs know delays of the plant as those of late commands.

        Of what a delay is in equations a design may ask more than of the delay. Designs that are
        not told delays know the equations.
        """
        late, time = _delays(self.base.plant.build())
        if not late or not all(map(self._told, self._names)):
            return self
        self.say(f"commands are late by {in_time(time)}, which is what {', '.join(late)} comes to")
        base = replace(self.base, plant=self.base.plant.varied(without=late))
        machine = self.machine.varied(without=late)
        return replace(self, machine=machine, base=base, delay=time + (self.delay or 0.0))

    def prepared(self) -> tuple[list[ControllerRecipe], list[Scenario]]:
        """Return designs, and the steps through which they run: as given, or of each output alone.

        Raises:
            WorkbenchError: If no design fits, or the plant does not rest where the steps begin.
        """
        own = self.controlled or followed_by_default(self.plant, self.linear)
        given = tuple(self.ends or self.begins)
        moved = [given] if given else [(name,) for name in own]
        hold, sample_time = self.hold, self.sample_time

        def scenarios() -> list[Scenario]:
            asked = replace(self, controlled=own, hold=hold, sample_time=sample_time)
            return [asked.scenario(stepped) for stepped in moved]

        found = scenarios()
        if sample_time is None and self._stated is None:
            usual, commands = found[0].sample_time, len(self.model.commands)
            time = of_whole_samples(self.linear, usual, commands, self.delay)
            if time != usual:
                sample_time = time
                found = scenarios()
        try:
            recipes = self.recipes(found[0])
        except WorkbenchError:
            alone = self.plant.controlled_outputs(self.model)
            if self.controlled or alone == own or self.plant.controlled or len(own) == 1:
                raise
            return replace(self, controlled=alone, sample_time=sample_time).prepared()
        followed = {name for recipe in recipes for name in _follows(recipe)}
        moved = [names for names in moved if followed & set(names)] or moved[:1]
        sample_time = found[0].sample_time
        late: dict[str, tuple[str, float, float]] = {}
        if hold is None:
            first = {n: _first_step(a) for s in found for n, a in s.references.items() if a.changes}
            usual = step_time(self.linear, first)
            needed = [settling(recipes, self.linear, scenario) for scenario in found]
            hold = max(each.time or min(usual, each.most * sample_time) for each in needed)
            slowest: dict[str, float] = {}
            for name, settled in (pair for each in needed for pair in each.slow.items()):
                slowest[name] = max(settled, slowest.get(name, 0.0))
            late = {
                n: (f"{n} settles in", t, 2.0 * t) for n, t in slowest.items() if 2.0 * t > hold
            }
            if hold < usual and not all(each.most == LONGEST for each in needed):
                late[""] = "the plant responds in", usual, usual
        found = scenarios()
        # What commands are too weak for takes longer than a loop does.
        if not self._tell_far(found, hold):
            for what, time, whole in late.values():
                self.say(
                    f"{what} {in_time(time)}, later than the step is run for by default; 'workbench"
                    f" verify' with --hold {_option(whole)} runs all of it"
                )
        if hold > UNTOLD * sample_time:
            self.say(
                f"there are {hold / sample_time:.2g} samples of {in_time(sample_time)} between the"
                " steps, which takes minutes; take longer ones (--sample-time), or less time"
                " (--hold)"
            )
        self._tell_noise(recipes, found)
        self._tell_ends()
        self._tell_rest()
        return recipes, found

    def _tell_ends(self) -> None:
        """Say where a plant of which nobody says where it rests does so with nothing on."""
        inputs = {q.name: q for q in self.model.commands}
        rest = zip(self.linear.input_names, self.linear.u0.tolist(), strict=True)
        at = [(inputs[name], u) for name, u in rest if name in inputs]
        ended = [min(abs(u - q.lower), abs(q.upper - u)) <= ROUNDED * q.scale for q, u in at]
        if ended and all(ended) and not self.begins:
            names = ", ".join(q.name for q, _ in at)
            self.say(
                f"at rest every command is at an end of its range ({names}) and goes one way only;"
                " rest the plant where it works (--from)"
            )

    def _tell_rest(self) -> None:
        """Say which outputs rest far from where they start, though nobody asked for that.

        And which states go on where all others rest, if the plant does not declare them.
        """
        point = self.linear.operating_point
        start = self.model.read(self.model.initial_state(), self.model.nominal_input)
        far = [
            f"{q.name} {with_unit(f'{float(from_si(y, q.display_unit)):.3g}', q.display_unit)}"
            for q, y, begin in zip(self.model.outputs, point.y, start, strict=True)
            if q.sized and abs(y - begin) > _FAR * q.scale
        ]
        if far and not self.begins:
            self.say(
                f"at rest with its usual inputs the plant is far from where it starts"
                f" ({', '.join(far)}); rest it where it works (--from)"
            )
        if point.drift and not self.model.traits.sums:
            self.say(
                f"a state does not rest there but goes on ({point.drift_in_words()}); designs and"
                " steps are those of where it begins"
            )

    def _tell_far(self, scenarios: Sequence[Scenario], hold: float) -> bool:
        """Say which outputs commands at their limits move less far than steps do, if any."""
        told = False
        for name, asked in ((n, a) for s in scenarios for n, a in s.references.items()):
            if not asked.changes or name not in self.linear.output_names:
                continue
            start = float(self.linear.y0[self.linear.output_names.index(name)])
            ways = [b - start for _, _, b in asked.changes if b != start]
            reached = {way: farthest(self.linear, name, hold, up=way > 0.0) for way in set(ways)}
            if short := [most for way, most in reached.items() if most < abs(way)]:
                most, told = min(short), True
                about = next(q for q in self.model.outputs if q.name == name)
                unit = of_difference(about.display_unit)
                commands = [q.name for q in self.model.commands]
                least = max(least_time(self.linear, commands, {name: way}) for way in reached)
                longer = f"--hold {_option(_ROOM * least)}" if least < math.inf else "--hold"
                self.say(
                    f"commands at their limits move {name} by {float(from_si(most, unit)):.3g}"
                    f" {unit} in the {in_time(hold)} that a step lasts, less than it shall: step"
                    f" less far (--to), or take longer ({longer})"
                )
        return told

    def _tell_noise(
        self, recipes: Sequence[ControllerRecipe], scenarios: Sequence[Scenario]
    ) -> None:
        """Say which steps are so small that noise may keep them from settling."""
        moved: dict[str, list[str]] = {}
        for recipe in recipes:
            late = scenarios[0].late_samples * scenarios[0].sample_time
            rms = _stirred(recipe, self.linear, late)
            for scenario in scenarios:
                for name, asked in scenario.references.items():
                    size = max((abs(b - a) for _, a, b in asked.changes), default=math.inf)
                    if (share := rms.get(name, 0.0) / size) > LOUD:
                        moved.setdefault(name, []).append(f"{recipe.name} {100.0 * share:.2g} %")
        for name, each in moved.items():
            self.say(
                f"noise of the sensors moves {name} by so much of its step, rms, that it may not"
                f" settle: {', '.join(each)}; step farther if the plant lets you (--to), or take"
                " quieter sensors"
            )

    def scenario(self, stepped: Sequence[str]) -> Scenario:
        """Return a step of some controlled outputs and back, the others staying where they are."""
        linear = self.linear
        at = zip(of_names(self.model.outputs, linear.output_names), linear.y0.tolist(), strict=True)
        # What rounding leaves is nothing, and zero plus zero has no sign.
        y0 = {q.name: 0.0 if abs(y) < ROUNDED * q.scale else y + 0.0 for q, y in at}
        moved = {name: self._levels(name, y0) for name in stepped}
        sizes = {name: end - begin for name, (begin, end) in moved.items()}
        held = step_time(linear, sizes) if self.hold is None else self.hold
        check_range("time between the steps", held, *TIMES_S, "s")
        step = self.sample_time
        if step is None:
            step = self._stated or usual_sample_time(linear, self.controlled, sizes)
        check_range("sample time", step, TIMES_S[0], held, "s")
        units = {q.name: q.display_unit for q in self.model.outputs}
        back = partial(step_scenario, back=True, lead=0.25 * held, hold=held, sample_time=step)
        each = [
            back(name, *(float(from_si(level, units[name])) for level in ends), unit=units[name])
            for name, ends in moved.items()
        ]
        # Other controlled outputs stay as they are at the design point.
        references = {n: Steps((0.0,), (y0[n],)) for n in self.controlled if n not in moved}
        moving = {name: signal for asked in each for name, signal in asked.references.items()}
        several = len(self.controlled) > 1
        named = zip(moved, each, strict=True)
        title = ", ".join(f"{n}: {one.name}" if several else one.name for n, one in named)
        every = dict(sorted({**references, **moving}.items()))
        found = replace(each[0], name=title, references=every)
        if self.delay is None:
            return found
        fix = "give more time between the steps (--hold)"
        check_range("delay", self.delay, 0.0, 0.5 * found.duration, "s", fix=fix)
        # By the next whole sample.
        late = math.ceil(self.delay / found.sample_time - SHORTEST)
        if not late and self.delay:
            raise WorkbenchError(
                f"the delay of {in_time(self.delay)} is less than {SHORTEST:.0%} of a sample,"
                f" {in_time(found.sample_time)}, and delays nothing; leave it out, or take shorter"
                " samples (--sample-time)"
            )
        return replace(found, late_samples=late)

    def _levels(self, name: str, y0: Mapping[str, float]) -> tuple[float, float]:
        """Return the levels of an output before and after a step, in SI, as given or usual."""
        if name in self.begins and name in self.ends:
            return self.begins[name], self.ends[name]
        if self.plant.step and name == self.plant.controlled_outputs(self.model)[0]:
            first, last = self.plant.step
        else:
            several = len(self.controlled) > 1
            command = "" if several else command_of_loop(self.linear, name)
            followed = self.controlled if several else (name,)
            first = y0[name]
            last = first + step_of(self.model, self.linear, name, followed, command)
        return self.begins.get(name, first), self.ends.get(name, last)

    @property
    def _names(self) -> Sequence[str]:
        return self.designs or [design.name for design in designs_for(self.linear)]

    def _told(self, name: str) -> bool:
        """Whether a design is told outputs, sample time and delay: those for any linear model."""
        kind = replace(self.base, name=name, design=name).kind()
        return not (kind.sensors or kind.own)

    @cached_property
    def _stated(self) -> float | None:
        """Sample time of the first controller that has one of its own, in s."""
        for name in self._names:
            made = replace(self.base, name=name, design=name)
            if not self._told(name):
                # One that cannot be built is told with the others (`recipes`).
                with suppress(WorkbenchError):
                    return made.build().sample_time
        return None

    def recipes(self, scenario: Scenario) -> list[ControllerRecipe]:
        """Return the named designs, or those made for such a plant, or those for any plant."""
        base, names, progress, linear = self.base, self.designs, self.progress, self.linear
        model = linear.operating_point.model
        followed = tuple(name for name in linear.output_names if name in scenario.references)
        # What a design for any linear model must be told: which outputs, and how often.
        told: tuple[tuple[str, Any], ...] = (
            ("measured", followed[0] if len(followed) == 1 else followed),
            ("sample_time", scenario.sample_time),
        )
        if late := scenario.late_samples * scenario.sample_time:
            told = (*told, ("delay", late))
        if self.ends:
            # What somebody asks for may be farther than a first trial would step.
            sizes = tuple(_first_step(scenario.references[name]) for name in followed)
            told = (*told, ("step", sizes[0] if len(sizes) == 1 else sizes))

        def recipe(name: str) -> ControllerRecipe:
            made = replace(base, name=name, design=name)
            return replace(made, specification=told, at=held) if self._told(name) else made

        held, other = base.at, ""
        if len(followed) == 1:
            taken = command_of_loop(linear, followed[0])
            other = taken if taken and taken != model.commands[0].name else ""
            told = (*told, ("actuator", other)) if other else told
            held = as_the_loop_rests(model, base.at, taken)
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
        partly: dict[str, list[ControllerRecipe]] = {}
        refused: dict[str, list[str]] = {}
        every = self._names
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
                plain = made.specification == told or made.kind().own
                if plain and (said := hardly_stable(law, linear, late)):
                    weak.append(f"{made.name}: {said}")
                elif plain and behind and (said := hardly_stable(law, behind, late)):
                    words = f"{made.name}: where the step ends it is {said.partition(';')[0]}"
                    weak.append(f"{words}; {_design_for_the_end(behind, scenario)}")
                idle = [n for n in linear.input_names if n not in (*law.actuators, *only_measured)]
                others = partly.setdefault(", ".join(idle), []) if idle and not names else found
                others.append(made)
        if progress and len(every) > 1:
            progress("designs", len(every), len(every), "")
        for sentence in (*weak, *(f"{', '.join(n)}: {reason}" for reason, n in refused.items())):
            self.say(sentence)
        # Of designs that nobody asked for, those that command every input come first.
        if partly and not found:
            self.say(f"what a design does not command rests, such as {list(partly)[-1]}")
            found = [made for every in partly.values() for made in every]
        else:
            for resting, left_out in partly.items():
                asked = " ".join(f"-c {made.name}" for made in left_out)
                who = ", ".join(made.name for made in left_out)
                self.say(f"{who}: leaves {resting} at rest, and is left out; {asked} runs it")
        if not found:
            raise WorkbenchError(
                f"no design of the workbench fits {model.name!r}; give one of your own with"
                " --controller module:function"
            )
        if other and any(made.specification == told for made in found):
            self.say(f"a single loop commands {other}, which acts most on {followed[0]}")
        if any(made.specification == told for made in found):
            loop = loop_of(linear, followed, other)
            for sentence in interaction(loop) if len(followed) > 1 else wrong_way(loop):
                self.say(sentence)
        return found

    def study(
        self,
        recipes: Sequence[ControllerRecipe],
        steps: Sequence[Scenario],
        require: Sequence[str] = (),
        name: str = "verify",
    ) -> Study:
        """Return the study of controllers for the nominal plant, through steps on the machine.

        Args:
            require: What is required, as ``METRIC=LIMIT``; by default what the plant declares.
        """
        controllers = {r.name: r for r in recipes}
        scenarios = {scenario.name: scenario for scenario in steps}
        demands, metrics = self._demands(require, scenarios, controllers)
        return Study(
            name,
            Path.cwd() / name,
            {"": Case("", self.machine, controllers, scenarios)},
            {NOMINAL: Variation(NOMINAL, self.machine)},
            controllers,
            scenarios,
            demands,
            points=tuple(dict.fromkeys(r.at for r in recipes)),
            own_metrics=metrics,
        )

    def _demands(
        self,
        given: Sequence[str],
        scenarios: Mapping[str, Scenario],
        controllers: Mapping[str, ControllerRecipe],
    ) -> tuple[tuple[Demand, ...], tuple[str, ...]]:
        """Return what is required, and the metrics of the user's own that it names."""
        pairs = [named_value("requirement", text) for text in given]
        own = tuple(name for name, _ in pairs if ":" in name)
        metrics = load_metrics(own, Path.cwd())
        called = dict(zip(own, (m.name for m in metrics), strict=True))
        followed = next(iter(scenarios.values())).references
        units = metric_units(self.model, tuple(followed), metrics)
        wanted = []
        for name, value in pairs:
            metric = check_choice("metric", called.get(name, name), units)
            about = metric_of(metric, metrics)
            assert about is not None, "it is one of those that have a unit"
            wanted.append(Requirement(metric, *limit_in_words(about, metric, value, units[metric])))
        demands = [Demand(r) for r in wanted or (Requirement(*r) for r in self.plant.requirements)]
        for demand in demands:
            check_demand(demand, units, scenarios, controllers, metrics)
        return tuple(demands), own


def _option(time: float) -> str:
    """Write a time, in s, rounded up, as an option takes it."""
    return in_time(rounded_up(time)).replace(" ", "")


def _first_step(reference: Signal) -> float:
    """Return by how much a reference steps first, in SI; 0 where it does not."""
    return next((after - before for _, before, after in reference.changes), 0.0)


def _delays(model: Model) -> tuple[tuple[str, ...], float]:
    """Return effects by which all that a loop sends or reads is late, and by how long, in s.

    That is of one command, or of all measurements.
    """
    command = (valve_delay, delay) if len(model.commands) == 1 else ()
    reading = (sensor_delay,) if len(model.outputs) == 1 else ()
    starts = tuple(law.name for law in (clock_shift, *command, *reading))
    names = tuple(effect.name for effect in model.effects if effect.name.startswith(starts))
    return names, sum(max(model.parameter(f"{name}.time").value, 0.0) for name in names)


_ROOM = 1.5
"""Time between steps over what commands at their ends take for a step: a loop settles after it."""

_FAR = 10.0
"""Distance of an output at rest from where it starts, over its scale, that surprises its author."""

ROUNDED = 1e-12
"""Output at rest over its scale that is what rounding leaves."""


def _follows(recipe: ControllerRecipe) -> tuple[str, ...]:
    # One that cannot be built is a run that failed.
    with suppress(WorkbenchError):
        return recipe.build().controlled
    return ()


def _stirred(recipe: ControllerRecipe, linear: LinearModel, delay: float) -> dict[str, float]:
    """Return what noise moves followed outputs by in a loop, rms, in SI; of none that fails."""
    with suppress(WorkbenchError):
        return stirred(recipe.build(), linear, delay)
    return {}


SHORTEST = 0.01
"""Part of a sample up to which a delay is none, or no more than whole samples."""

LOUD = 0.005
"""What noise moves an output by, rms, over its step, from which on it may keep that from settling
within 2 %: four times that is outside once in thousands of samples."""

LONGEST, UNTOLD, LONG = 20_000, 200_000, 5_000
"""Most samples between steps that a loop is given by default, seconds of computing; those that one
is of which nobody knows when it settles, beyond which a reader is told that runs take minutes; and
those that one which settles long before is given, for what its command does slowly then to begin to
show: some ten times as many as most settle in."""


class Needed(NamedTuple):
    """Time that loops need between steps.

    Args:
        time: Time between steps, in s; 0 if they have it.
        slow: By name, what loops that would need too many samples take to settle, in s.
        most: Most samples between steps.
    """

    time: float
    slow: Mapping[str, float]
    most: int = LONGEST


def settling(
    recipes: Sequence[ControllerRecipe], linear: LinearModel, scenario: Scenario
) -> Needed:
    """Return the time between steps that the slowest loop needs.

    It is twice what that loop takes to settle, with the time of commands that are at their ends, or
    five times what it takes where this is less than they have, as of fast loops of slow plants: a
    step that a command's end slows down still shows, and the step back. One that ends near the end
    of a command keeps the time of the plant, up to `LONG` samples.
    """
    slow: dict[str, float] = {}
    changes = {name: signal.changes for name, signal in scenario.references.items()}
    steps = {name: own[0][2] - own[0][1] for name, own in changes.items() if own}
    times = [change[0] for own in changes.values() for change in own]
    usual = max(times, default=0.0) - min(times, default=0.0)
    long, ended, all_told, room, most = 0.0, 0.0, True, True, LONGEST
    for recipe in recipes:
        told = False
        # One that cannot be built is a run that failed.
        with suppress(WorkbenchError):
            law: Any = recipe.build()
            told = hasattr(law, "around_rest") and not recipe.kind().sensors
            if told := told or isinstance(law, PlainLaw):
                late = scenario.late_samples * scenario.sample_time
                settled = settled_after(law, linear, steps) + late
                if 2.0 * settled > LONGEST * scenario.sample_time:
                    told = False
                    if settled < math.inf:
                        slow[recipe.name] = settled
                else:
                    long = max(long, settled)
            else:
                most = UNTOLD
            room = room and has_room(linear, law.actuators, steps)
            ended = max(ended, least_time(linear, law.actuators, steps))
        all_told = all_told and told
    if not long:
        return Needed(0.0, slow, most)
    # A step back may have less of the command than the step, as what only cools.
    both = 2.0 * (long + ended)
    least = rounded_up(2.0 * long)
    if least > usual or (room and usual < both < math.inf):
        return Needed(rounded_up(both) if both < math.inf else least, slow, most)
    enough = max(5.0 * long, both)
    if not room:
        enough = max(enough, LONG * scenario.sample_time)
    ends = all_told and enough < 0.99 * usual
    return Needed(rounded_up(enough) if ends else 0.0, slow, most)


def _levels_behind(linear: LinearModel, scenario: Scenario) -> dict[str, float]:
    """Return where the controlled outputs are behind the first step, in SI."""
    return {
        name: asked.changes[0][2] if asked.changes else float(asked.sample(0.0))
        for name, asked in scenario.references.items()
        if name in linear.output_names
    }


def _linear_behind(linear: LinearModel, scenario: Scenario, command: str) -> LinearModel | None:
    """Return the linear model behind the first step; None where it is the same, or is not found."""
    model, at = linear.operating_point.model, tuple(_levels_behind(linear, scenario).items())
    with suppress(WorkbenchError):
        given = dict(as_the_loop_rests(model, at, command) if command else at)
        found = linearise(operating_point(model, given), verdict=False)
        if found.A.shape == linear.A.shape and not np.allclose(found.A, linear.A):
            return found
    return None


def _design_for_the_end(behind: LinearModel, scenario: Scenario) -> str:
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
