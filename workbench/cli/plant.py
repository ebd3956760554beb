"""What every verb says about its plant: the plant itself, its options, effects and values.

A verb of this kind takes any word that the chosen plant declares as an option of its own:
``--load 3kg`` means ``--option load=3kg``, ``--angle 30deg`` means ``--at angle=30deg``,
``--valve 0:5.5`` means ``--input valve=0:5.5``, and ``--hysteresis`` means
``--effect hysteresis``. Nothing here knows a plant.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.cli.options import Short, Verb, VerbCommand, taking
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_range
from workbench.plants import DEFAULT_PLANT

if TYPE_CHECKING:
    from workbench.model import Input, Model
    from workbench.plants.plant import Plant
    from workbench.study.plants import PlantRecipe

CHANGES = ("option", "parameter", "without", "effect", "short")
"""What may differ of a plant."""


class _UnknownOptionError(WorkbenchError):
    """A word that neither the verb nor the plant knows."""


class PlantCommand(VerbCommand):
    """A verb that takes the options of its plant, and lists the plants in its help."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Collect words that are the plant's to understand."""
        return super().parse_args(ctx, self._collected(args, set(ctx.help_option_names)))

    def invoke(self, ctx: Any) -> Any:
        """Run the verb; an option that nobody knows is told with the place to look."""
        try:
            return super().invoke(ctx)
        except _UnknownOptionError as error:
            raise WorkbenchError(f"{error}; see '{ctx.command_path} --help'") from None

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Add what the plants are called, which is not known before they are asked for."""
        from workbench.plants.registry import PLANTS

        self.epilog = (
            f"Plants: {', '.join(PLANTS.names())}, '1/(s + 1)', or module:object of your own."
            " 'workbench plants NAME' lists what each of them takes."
        )
        super().format_help(ctx, formatter)

    def _collected(self, args: Sequence[str], own: set[str]) -> list[str]:
        flags: set[str] = set()
        for parameter in self.params:
            names = {*parameter.opts, *parameter.secondary_opts}
            own |= names
            if getattr(parameter, "is_flag", False):
                flags |= names
        found: list[str] = []
        rest = list(args)
        while rest:
            word = rest.pop(0)
            name, sign, value = word.partition("=")
            if word == "--":
                found += [word, *rest]
                break
            if not word.startswith("-") or name in flags or (name in own and sign):
                found.append(word)
            elif name in own or not name.startswith("--"):
                found.append(word)
                if name in own and rest:
                    found.append(rest.pop(0))
            else:
                if not sign and rest and not re.match(r"--|-[A-Za-z]", rest[0]):
                    value = rest.pop(0)
                found += ["--set", f"{name[2:]}={value}"]
        return found


@dataclass(frozen=True)
class Chosen:
    """A plant as the options of a verb describe it.

    Args:
        recipe: What was chosen: its name, ``module:object`` or file, options, effects, parameters.
        nominal: Its model with the options, without effects and changed parameters: what a design
            is made for.
        at: Values at rest that were given, by name, in SI.
        inputs: Steps of inputs by name: times, in s, and values, in SI.
        design: Words ``--design-NAME VALUE``, as ``NAME=VALUE``.
    """

    recipe: PlantRecipe
    plant: Plant
    model: Model
    nominal: Model
    at: Mapping[str, float]
    inputs: Mapping[str, tuple[tuple[float, float], ...]]
    design: tuple[str, ...] = ()

    @property
    def design_point(self) -> Mapping[str, float]:
        """Where the plant rests, by name, in SI: as given, else as the plant declares."""
        given = {**self.plant.design_point, **self.at}
        sums = {total.name for total in self.model.traits.sums}
        # A value that takes the place of the plant's own leaves no input to hold that one.
        return given if len(given.keys() - sums) <= len(self.model.inputs) else self.at


def with_plant(*takes: str) -> Callable[[Verb], Verb]:
    """Give a verb a plant: its parameter ``chosen`` becomes the options that describe one.

    Args:
        takes: What a word of the plant may be that was given as an option of the verb:
            ``"option"``, ``"effect"``, ``"at"``, ``"input"``, ``"design"``.
    """
    offered = ["plant", *CHANGES, *(["inputs"] if "input" in takes else [])]
    offered += ["at"] if "at" in takes else []
    return taking("chosen", chosen_plant, offered, make=partial(chosen_plant, takes=takes))


def chosen_plant(
    plant: str = DEFAULT_PLANT,
    *,
    inputs: list[str] | None = None,
    at: list[str] | None = None,
    option: list[str] | None = None,
    parameter: list[str] | None = None,
    without: list[str] | None = None,
    effect: list[str] | None = None,
    short: Short = None,
    takes: Sequence[str] = ("option", "effect"),
    defaults: Mapping[str, object] | None = None,
    folder: Path | None = None,
) -> Chosen:
    """Build the plant that the options of a verb describe.

    Args:
        plant (--plant NAME): Plant: a name of 'workbench plants', a transfer function such as
            '2 exp(-0.1 s) / (s + 1)', a function, model or system of python-control, SciPy or
            CasADi of your own as module:object, looked up in the current folder, the .mat file of a
            system, or the verdict.json of a diagnosis.
        inputs (--input NAME=TIME:VALUE,...): Values of an input from times on, such as
            valve=0:5.5,1.5:4.6, or one value throughout; a number alone in the input's display
            unit; the short form is --valve 0:5.5.
        at (NAME=VALUE): Value of an output, state or input at rest, such as angle=30deg; the short
            form is --angle 30deg. By default the plant's own.
        option (-o NAME=VALUE): Choose an option of the plant, such as load=3kg; the short form is
            --load 3kg.
        parameter (-p NAME=VALUE): Change a parameter, such as mass=80kg or supply_pressure=5.5bar;
            may be given several times.
        without (EFFECT): Leave out an effect, such as bearing_friction; may be given several times.
        effect (NAME): Attach an effect: a name of the library, a word of the plant, or
            module:object of your own; may be given several times.
        takes: What a word of the plant may be, see `with_plant`.
        defaults: Options that hold unless others are given, such as those of a case.
        folder: Where modules of the user stand; the current folder by default.
    """
    from workbench.model.units import named_value
    from workbench.plants.plant import parse_parameter
    from workbench.plants.registry import PLANTS
    from workbench.study.plants import PlantRecipe

    folder = folder or Path.cwd()
    kind = PLANTS.get(plant, folder=folder)
    given = dict(named_value("option", text) for text in option or ())
    attached, states, driven = list(effect or ()), list(at or ()), list(inputs or ())
    words, design = [named_value("option", text) for text in short or ()], []
    own = {n.replace("_", "-"): n for o in kind.options for n in (o.name, o.keyword)}
    rest = []
    for word, value in words:
        if "design" in takes and word.startswith("design-"):
            design.append(f"{word.removeprefix('design-')}={value}")
        elif word in own or word.replace("_", "-") in own:
            about = kind.option(word)
            if not value and not isinstance(about.default, bool):
                raise _UnknownOptionError(f"option --{word} requires a value")
            given[about.name] = value
        elif word.replace("-", "_") in kind.effects and not value:
            attached.append(word)
        else:
            rest.append((word, value))
    checked = kind.parse({**(defaults or {}), **given})
    base = PlantRecipe(plant, tuple(checked.items()), folder=folder)
    nominal = base.build()
    known = {"at": _resting(nominal), "input": {q.name for q in nominal.inputs}}
    for word, value in rest:
        plain = word.replace("-", "_")
        if "input" in takes and plain in known["input"]:
            driven.append(f"{plain}={value}")
        elif "at" in takes and plain in known["at"]:
            states.append(f"{plain}={value}")
        else:
            offered = [*own, *kind.effects, *(n for t in takes for n in known.get(t, ()))]
            near = difflib.get_close_matches(word, [n.replace("_", "-") for n in offered], n=1)
            hint = f"; did you mean --{near[0]}?" if near else ""
            raise _UnknownOptionError(f"No such option: --{word}{hint}")
        if not value:
            raise _UnknownOptionError(f"option --{word} requires a value")
    recipe = replace(base, effects=tuple(attached), without=tuple(without or ()))
    changed = [parse_parameter(recipe.build(), text) for text in parameter or ()]
    recipe = replace(recipe, parameters=tuple(changed))
    model = recipe.build()
    resting = dict(value_at_rest(model, text) for text in states)
    return Chosen(recipe, kind, model, nominal, resting, _steps(model, driven), tuple(design))


def value_at_rest(model: Model, text: str) -> tuple[str, float]:
    """Return name and value, in SI, of a quantity written as ``NAME=VALUE``."""
    from workbench.model.units import named_value, quantity, to_si

    name, value = named_value("value", text)
    name = name.replace("-", "_")
    units = _resting(model)
    if not value:
        raise WorkbenchError(f"{name} has no value; write it as NAME=VALUE")
    check_choice(f"quantity of {model.name!r}", name, units)
    return name, to_si(quantity(name.replace("_", " "), value, units[name]), units[name])


def _resting(model: Model) -> dict[str, str]:
    """Return everything whose value at rest may be given, with the unit that a number has."""
    units = {q.name: q.display_unit or q.unit for q in model.states}
    units |= {total.name: total.display_unit for total in model.traits.sums}
    return units | {q.name: q.display_unit for q in (*model.inputs, *model.outputs)}


def _in_range(about: Input, text: str) -> float:
    """Return the value of an input, in SI; a number alone is in its display unit."""
    from workbench.model.units import from_si, quantity, to_si

    name, unit = about.name.replace("_", " "), about.display_unit
    low, high = (float(from_si(end, unit)) for end in (about.lower, about.upper))
    value = to_si(check_range(name, quantity(name, text, unit), low, high, unit), unit)
    return min(max(value, about.lower), about.upper)


def _steps(model: Model, texts: Iterable[str]) -> dict[str, tuple[tuple[float, float], ...]]:
    from workbench.model.units import named_value, quantity

    quantities = {q.name: q for q in model.inputs}
    found: dict[str, list[tuple[float, float]]] = {}
    for text in texts:
        name, steps = named_value("input", text)
        name = name.replace("-", "_")
        check_choice("input", name, quantities)
        about, word = quantities[name], name.replace("_", " ")
        # A value alone is held from the start on.
        for step in steps.split(",") if ":" in steps else [f"0:{steps}"]:
            time, sign, value = step.partition(":")
            if not sign:
                raise WorkbenchError(
                    f"step of {word} {step!r} has no time or no value; write it as TIME:VALUE,"
                    f" such as 0:{step}"
                )
            at = check_range(
                f"time of a step of {word}", quantity("time", time, "s"), 0.0, TIMES_S[1], "s"
            )
            found.setdefault(name, []).append((at, _in_range(about, value)))
    return {name: tuple(sorted(steps)) for name, steps in found.items()}
