"""A plant as the workbench offers it: a function that builds a model, and options with units.

A built-in plant is declared by a `Plant` beside its function. A user's own function, or a model,
is adopted: its keyword parameters become options, with the unit that their names end in.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import casadi as ca
import numpy as np

from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.model import Effect, Model
from workbench.model.linear_system import is_system, model_of_system
from workbench.model.quantities import units_together
from workbench.model.rate_functions import is_rates, model_of_rates
from workbench.model.units import (
    ends_a_name,
    is_known,
    named_value,
    quantity,
    same_dimension,
    to_si,
)
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.law import Law
from workbench.physics.survey import Survey
from workbench.registry import load_object, user_code


def own_laws(
    model: Model, references: Sequence[str], *, folder: Path | None = None
) -> tuple[Hypothesis | Law, ...]:
    """Return effects of the user's own, to be offered beside the library.

    Args:
        references: Each ``module:object``: a law, an effect, a hypothesis, several of them, or a
            function that returns them, called with the model if it takes an argument.
        folder: Where the modules stand, beside the Python path.
    """
    return tuple(item for name in references for item in _own(model, name, folder))


def _own(model: Model, reference: str, folder: Path | None) -> list[Hypothesis | Law]:
    found = load_object("effect", reference, folder=folder)
    if callable(found) and not isinstance(found, (Effect, Hypothesis, Law)):
        with user_code(f"effect {reference!r}"):
            required = [
                p
                for p in inspect.signature(found).parameters.values()
                if p.default is p.empty and p.kind is not p.VAR_KEYWORD
            ]
            found = found(model) if required else found()
    several = found if isinstance(found, Iterable) else (found,)
    return [_hypothesis(item, reference) for item in several]


def _hypothesis(item: object, reference: str) -> Hypothesis | Law:
    if isinstance(item, (Hypothesis, Law)):
        return item
    if not isinstance(item, Effect) or not item.parameters:
        raise WorkbenchError(
            f"effect {reference!r} gave a {type(item).__name__}; it must be an Effect with a"
            " parameter for its size, a Law or a Hypothesis"
        )
    size = item.parameters[0]
    largest = max(abs(size.lower), abs(size.upper))
    # Bounds are all that the user says of sizes; beyond them nothing is plausible.
    typical = abs(size.value) or (0.2 * largest if np.isfinite(largest) else size.scale)
    return Hypothesis(item.with_parameters({size.name: 0.0}), size.name, typical)


Value = float | bool | str
"""Value of an option: a number in the option's unit, a switch or a word."""

_SWITCHES = {"true": True, "yes": True, "on": True, "": True, "false": False, "no": False}
_SWITCHES["off"] = False


@dataclass(frozen=True)
class Option:
    """One thing that may be chosen about a plant.

    Args:
        name: Name that the user writes: ``load``.
        default: Value if nothing is said; its type says whether the option is a number, a switch or
            a word.
        unit: Unit of a number, in which the build function takes it.
        lower: Smallest number, in ``unit``.
        upper: Largest number, in ``unit``.
        keyword: Parameter of the build function and key in a case file; the name by default.
        label: What it is called in a sentence; the name by default.
        measured: Whether a case must say it, because it differs from rig to rig.
        fractions: Whether it may be a fraction although the default is a whole number.

    Example:
        >>> Option("load", 3.0, "kg", upper=8.0, lower=0.0).parse("500g")
        0.5
    """

    name: str
    default: Value
    unit: str = ""
    help: str = ""
    lower: float = float("-inf")
    upper: float = float("inf")
    choices: tuple[str, ...] = ()
    keyword: str = ""
    label: str = ""
    measured: bool = False
    fractions: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "keyword", self.keyword or self.name)
        object.__setattr__(self, "label", self.label or self.name.replace("_", " "))

    def parse(self, given: object, *, in_si: bool = False) -> Value:
        """Return a value as the build function takes it.

        Args:
            given: Number, switch or text; text may carry a unit.
            in_si: Whether a bare number is in SI; by default it is in the option's unit.
        """
        if isinstance(self.default, bool):
            if isinstance(given, bool):
                return given
            word = str(given).strip().lower()
            if word not in _SWITCHES:
                raise WorkbenchError(f"{self.label} is {given!r}; it must be true or false")
            return _SWITCHES[word]
        if isinstance(self.default, str):
            return str(self.check(str(given)))
        if in_si and isinstance(given, (int, float)):
            given = f"{given!r} {si_unit(self.unit)}"
        found: float = self.check(quantity(self.label, given, self.unit))
        return found

    def check(self, value: Any) -> Any:
        """Return a value if it is valid."""
        if isinstance(self.default, str):
            return check_choice(self.label, value, self.choices) if self.choices else value
        if isinstance(self.default, bool):
            return bool(value)
        found = check_range(self.label, value, self.lower, self.upper, self.unit)
        if isinstance(self.default, int):
            if found == int(found):
                return int(found)
            if not self.fractions:
                raise WorkbenchError(f"{self.label} is {found:g}; it must be a whole number")
        return found

    def __str__(self) -> str:
        if isinstance(self.default, bool):
            what = "switch"
        elif isinstance(self.default, str):
            what = "|".join(self.choices) or "word"
        elif self.lower > float("-inf") and self.upper < float("inf"):
            what = f"{self.lower:g} to {self.upper:g} {self.unit}".rstrip()
        else:
            what = f"number in {self.unit}" if self.unit else "number"
        shown = str(self.default).lower() if isinstance(self.default, bool) else self.default
        tail = f"; {self.help}" if self.help else ""
        return f"{self.name:<14} {what}, by default {shown} {self.unit}".rstrip() + tail


@dataclass(frozen=True)
class Plant:
    """A plant: how its model is built and what may be chosen about it.

    Args:
        controlled: Outputs that a controller makes follow a reference; the first one by default.
        design_point: Where it is linearised and a run starts if nothing is said: values of outputs,
            states or inputs by name, in SI; by default where the nominal inputs hold it.
        design_map: Grid of linear models for scheduled designs: values of outputs by name, in SI.
        effects: Effects of the library under the plant's own words, sized for it.
        tolerated: How far parameters may be from what a design knows, by name: least and largest
            change, in SI, within the parameter's bounds.
        step: Values of the first controlled output between which a controller is tried, in SI; by
            default from the design point on by the output's scale, a quarter of it where the model
            has found it.
        start_samples: Samples over which hidden states at the start of a free run are estimated.
        requirements: Metrics with their largest value and its unit that a controller must keep.
        tolerant: Shipped study whose designs tolerate a machine that nobody has identified.

    Example:
        >>> from workbench.plants.servo_axis import SERVO_AXIS
        >>> SERVO_AXIS.model(parameters=["mass=80kg"]).parameter("mass").value
        80.0
    """

    name: str
    build: Callable[..., Model]
    summary: str = ""
    options: tuple[Option, ...] = ()
    controlled: tuple[str, ...] = ()
    design_point: Mapping[str, float] = field(default_factory=dict)
    design_map: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    effects: Mapping[str, Callable[[], Effect]] = field(default_factory=dict)
    tolerated: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    step: tuple[float, float] | None = None
    requirements: tuple[tuple[str, float, str], ...] = ()
    start_samples: int = 0
    tolerant: str = ""

    def option(self, name: str) -> Option:
        """Return an option by its name, or by the keyword of the build function."""
        plain = name.replace("-", "_")
        for option in self.options:
            if plain in (option.name, option.keyword):
                return option
        if not self.options:
            raise WorkbenchError(
                f"option of plant {self.name!r} is {name!r}, but it has none; change a parameter"
                " with NAME=VALUE instead"
            )
        check_choice(f"option of plant {self.name!r}", name, [o.name for o in self.options])
        raise AssertionError("unreachable")

    def parse(self, given: Mapping[str, object], *, in_si: bool = False) -> dict[str, Value]:
        """Return checked options by name; those that are not given are left out.

        Args:
            given: Values by name or keyword, text with or without unit.
            in_si: Whether bare numbers are in SI; by default they are in each option's unit.
        """
        parsed: dict[str, Value] = {}
        for name, value in given.items():
            option = self.option(name)
            parsed[option.name] = option.parse(value, in_si=in_si)
        return parsed

    def model(
        self,
        options: Mapping[str, object] | None = None,
        *,
        effects: Iterable[str] = (),
        without: Iterable[str] = (),
        parameters: Iterable[str] = (),
        folder: Path | None = None,
        own: Sequence[str] = (),
    ) -> Model:
        """Build the model that options, effects and parameters describe.

        Args:
            options: Values by name; text with or without unit, bare numbers in the option's unit.
            own: Laws of the user's own as ``module:object``, of which effects are named too.
            folder: Where modules of the user may stand, beside the Python path.
        """
        given = self.parse(options or {})
        keywords = {o.keyword: given.get(o.name, o.default) for o in self.options}
        with user_code(f"plant {self.name!r}"), units_together():
            found: Any = self.build(**keywords)
        model = _as_model(found)
        if model is None:
            raise WorkbenchError(
                f"plant {self.name!r} returned {type(found).__name__}, not a model; {_WANTED}"
            )
        for effect in effects:
            # One may change a parameter of another that stands before it.
            model = model.with_effect(self.effect(model, effect, folder=folder, own=own))
        model = model.without(*without)
        return model.with_parameters(dict(parse_parameter(model, text) for text in parameters))

    def effect(
        self, model: Model, name: str, *, folder: Path | None = None, own: Sequence[str] = ()
    ) -> Effect:
        """Return an effect that fits a model of this plant.

        Args:
            name: The plant's own word, a name of the library, or ``module:object``; the object is
                a law, an effect, or a function without arguments that returns one.
        """
        if ":" in name:
            found = load_object("effect", name, folder=folder)
            if isinstance(found, Law):
                return _placed(found, model)
            if callable(found) and not isinstance(found, Effect):
                with user_code(f"effect {name!r}"):
                    found = found()
            if not isinstance(found, Effect):
                raise WorkbenchError(
                    f"effect {name!r} is a {type(found).__name__}; it must be an Effect, a Law or a"
                    " function that returns one"
                )
            return found
        words = {n.replace("-", "_"): build for n, build in self.effects.items()}
        if name.replace("-", "_") in words:
            return words[name.replace("-", "_")]()
        # The library is large; a plant without further effects does not wait for it.
        from workbench.physics.library import every_name, library

        known = every_name(model, named=name)
        if name not in known:
            known |= every_name(model.opened(), named=name)
        if name not in known:
            known = every_name(model.opened()) | every_name(model)
        if own:
            extra = library(model, extra=own_laws(model, own, folder=folder))
            known |= {one.name: one for h in extra for one in (h, *h.alone)}
        place = f"workbench plants {self.name}"
        check_choice("effect", name, [*known, *self.effects], listed=place)
        return known[name].effect

    def controlled_outputs(self, model: Model) -> tuple[str, ...]:
        """Return the outputs that a controller makes follow a reference.

        By default the first that no command moves within the sample, as it does an acceleration.
        """
        names = tuple(q.name for q in model.outputs)
        commands = [i for i, q in enumerate(model.inputs) if q.commanded]
        if self.controlled or len(names) < 2 or not commands:
            return self.controlled or names[:1]
        at_once = ca.which_depends(model.exact.outputs, model.exact.u[commands], 1, True)
        late = [name for name, now in zip(names, at_once, strict=True) if not now]
        return (*late, *names)[:1]

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.summary}".rstrip(": ")]
        lines += [f"  {option}" for option in self.options] or ["  no options"]
        if self.effects:
            lines.append(f"  effects of its own: {', '.join(self.effects)}")
        return "\n".join(lines)


def _placed(law: Law, model: Model) -> Effect:
    places = list(law.hypotheses(Survey(model)))
    if len(places) != 1:
        where = ", ".join(port for h in places for port in h.ports) or "none"
        raise WorkbenchError(
            f"law {law.name!r} fits {len(places)} places of {model.name!r} ({where}); attach it"
            " with a function of your own that returns the Effect at one of them"
        )
    return places[0].effect


def parse_parameter(model: Model, text: str) -> tuple[str, float]:
    """Return name and value, in SI, of a parameter written as ``NAME=VALUE``."""
    name, value = named_value("parameter", text)
    check_choice("parameter", name, [q.name for q in model.parameters])
    parameter = model.parameter(name)
    unit = parameter.display_unit or parameter.unit
    return name, to_si(quantity(f"parameter {name}", value, unit), unit)


def si_unit(unit: str) -> str:
    """Return the SI unit that measures the same as a unit, as this package writes it.

    Example:
        >>> si_unit("bar"), si_unit("deg"), si_unit("mm/s")
        ('Pa', 'rad', 'mm/s')
    """
    for plain in ("m", "kg", "s", "K", "A", "rad", "N", "Pa", "J", "W", "V", "Hz", "m3", "1"):
        if same_dimension(plain, unit):
            return plain
    return unit


def _as_model(found: Any) -> Model | None:
    """Return what is a plant, or a linear one, as its model."""
    # A linear model is one of a plant.
    found = getattr(getattr(found, "operating_point", None), "model", found)
    if isinstance(found, Model):
        return found
    if is_rates(found):
        return model_of_rates(found)
    system = _as_system(found)
    return None if system is None else model_of_system(system)


def _as_system(found: Any) -> Any | None:
    """Return what is a linear system, of python-control or SciPy."""
    if isinstance(found, tuple) and len(found) in (2, 3, 4):
        # What SciPy's functions take for a system: num, den; zeros, poles, gain; A, B, C, D.
        import scipy.signal

        found = scipy.signal.lti(*found)
    return found if is_system(found) else None


def linear_plant(name: str, system: Any, summary: str, *, delay: float = 0.0) -> Plant:
    """Return a linear system as a plant whose commands may be limited.

    Args:
        delay: Time by which its commands act late, in s.
    """

    def build(limit: float = 0.0) -> Model:
        return model_of_system(system, limits=limit or None, delay=delay)

    return Plant(name, build, summary, (_LIMIT,))


_LIMIT = Option(
    "limit", 0.0, lower=0.0, help="largest magnitude of each command; 0 for one without limits"
)


_WANTED = (
    "a plant is a function that returns a Model ('workbench new-plant FILE' writes one), or a"
    " system of python-control, SciPy or CasADi"
)

_TYPED = (bool, int, float, str)
"""What somebody can type as the value of an option."""


def adopt(found: object, reference: str) -> Plant:
    """Return a plant of the user's own: a model, a linear system, or a function that returns one.

    Keyword parameters of the function become options, unless their default is nothing that one
    types, such as a table. A name that ends in a unit, ``mass_kg`` or ``supply_bar``, gives the
    unit; the option is then called ``mass``, ``supply``.
    """
    with user_code(f"plant {reference!r}"):
        model = _as_model(found)
    if model is not None:
        # A linear model knows the limits of its plant, a model its own.
        system = None if hasattr(found, "operating_point") else _as_system(found)
        if system is not None:
            return linear_plant(reference, system, model.description)
        return Plant(reference, lambda: model, model.description)
    if not callable(found):
        raise WorkbenchError(f"plant {reference!r} is a {type(found).__name__}; {_WANTED}")
    try:
        parameters = inspect.signature(found).parameters.values()
    except (TypeError, ValueError):
        parameters = {}.values()
    try:
        hints = get_type_hints(found)
    except (NameError, TypeError):
        hints = {}
    options = tuple(
        _adopted(reference, parameter, hints.get(parameter.name))
        for parameter in parameters
        if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
        and (parameter.default is parameter.empty or isinstance(parameter.default, _TYPED))
    )
    summary = (inspect.getdoc(found) or "").split("\n")[0].rstrip(".")
    return Plant(reference, found, summary, options)


def _adopted(reference: str, parameter: inspect.Parameter, hint: Any) -> Option:
    default = parameter.default
    if default is parameter.empty:
        raise WorkbenchError(
            f"parameter {parameter.name!r} of plant {reference!r} has no default; give it one, such"
            f" as mass_kg=3.0: {_WANTED}"
        )
    choices = get_args(hint) if get_origin(hint) is Literal else ()
    name, _, suffix = parameter.name.rpartition("_")
    if isinstance(default, (bool, str)) or not name or not _is_unit(suffix):
        name, suffix = parameter.name, ""
    # Only a parameter that is said to be an integer refuses fractions.
    fractions = bool(suffix) or hint is not int
    return Option(
        name, default, suffix, choices=choices, keyword=parameter.name, fractions=fractions
    )


def _is_unit(text: str) -> bool:
    # "level_min" is a smallest level, not one in minutes.
    if not text or ends_a_name(text) or text in ("min", "t", "h", "l", "count", "turn", "rev"):
        return False
    return is_known(text) and not text.isdigit()
