"""Designs: every way from a model of a plant to a controller, each stated once beside its law.

A `Design` says what it starts from, what may be specified, and what its controllers do; `DESIGNS`
finds those of the workbench, of installed packages and of the user. A user's plain function
``(linear_model, specification) -> controller``, named as ``module:function``, is a design too.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from typing import Any, Literal, NamedTuple, cast

from controllers.protocol import check_controller
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import LinearModel
from workbench.model.units import parse_unit, quantity, to_si
from workbench.registry import Registry, user_code

Source = Literal["linear", "map", "model"]
"""What a design starts from: a linear model at one operating point, a `JointSchedule` of linear
models over angle and mean pressure, or the plant's model."""


class Key(NamedTuple):
    """A number that may be specified: its name, default value, and meaning with unit."""

    name: str
    default: Any
    meaning: str

    @property
    def unit(self) -> str:
        """Its unit; empty where that follows from the plant, or it is no number."""
        stated = re.search(r"\bin ([^,;.()]+)[,;.]", f"{self.meaning}.")
        try:
            return parse_unit(stated[1]).text if stated and isinstance(self.default, float) else ""
        except WorkbenchError:
            return ""

    def read(self, given: Any) -> Any:
        """Return a value in SI: a text such as ``"2 ms"`` is taken in the key's unit."""
        if not isinstance(given, str) or not self.unit:
            return given
        return to_si(quantity(self.name.replace("_", " "), given, self.unit), self.unit)


@dataclass(frozen=True, kw_only=True)
class Design:
    """A way to design a controller.

    Args:
        name: Name in a study: ``"pid"``.
        family: Family of its controllers, by which pages call them: ``"cascade PID"``.
        function: Called with the source and the specification; returns a controller.
        specification: Class of the specification; None for a mapping.
        sensors: Outputs of the plant that its controllers read; none if any linear model will do.
        actuators: Inputs of the plant that they command; none if any linear model will do.
        solves: Whether they solve an optimisation at each sample.
        slides: Whether they have a sliding surface, and are judged by invariants.
        exports: Whether they can be written as C.
        colour: Colours of the family on light paper and on a dark screen; none for the next free
            ones of a picture.
        own: Whether it is a user's plain function, called with the specification as a mapping.
    """

    name: str
    family: str
    summary: str
    function: Callable[..., Any]
    needs: Source = "linear"
    specification: type[Any] | None = None
    sensors: tuple[str, ...] = ()
    actuators: tuple[str, ...] = ()
    solves: bool = False
    slides: bool = False
    exports: bool = True
    colour: tuple[str, str] | None = None
    own: bool = False

    @property
    def keys(self) -> tuple[Key, ...]:
        """What may be specified; nothing is known of a user's plain function."""
        if self.specification is None:
            return ()
        meaning = _meanings(self.specification)
        # What the family alone may be told comes before what it shares with others.
        own = vars(self.specification).get("__annotations__", {})
        ordered = sorted(fields(self.specification), key=lambda f: f.name not in own)
        return tuple(Key(f.name, _default(f), meaning.get(f.name, "")) for f in ordered)

    def specified(self, values: Mapping[str, Any]) -> Any:
        """Return a specification: an object of the design's class, or a mapping."""
        if self.specification is None:
            return dict(values)
        known = [key.name for key in self.keys]
        for key in values:
            check_choice(f"key of the {self.name} specification", key, known)
        try:
            return self.specification(**values)
        except TypeError as error:
            raise WorkbenchError(f"specification of design {self.name!r}: {error}") from None

    def controller(
        self,
        source: Any,
        specification: Any,
        *,
        name: str = "",
        given: Mapping[str, Any] | None = None,
    ) -> Any:
        """Design a controller.

        Raises:
            WorkbenchError: If the specification cannot be met, or what a user's function returns
                is no controller.
        """
        if self.own:
            with user_code(f"design {self.name!r}"):
                found: Any = self.function(source, specification)
        else:
            found = self.function(source, specification, **(given or {}))
        check_controller(found, f"what design {self.name!r} returned")
        return _named(found, name) if name else found


def _named(controller: Any, name: str) -> Any:
    if is_dataclass(controller) and "name" in {f.name for f in fields(controller)}:
        return replace(cast(Any, controller), name=name)
    return controller


def _default(field: Any) -> Any:
    if field.default is not MISSING:
        return field.default
    return None if field.default_factory is MISSING else field.default_factory()


def _meanings(described: type[Any]) -> dict[str, str]:
    """Return the lines of a docstring's ``Args`` by name, those of base classes included."""
    found: dict[str, str] = {}
    for part in reversed(described.__mro__):
        _, _, args = inspect.cleandoc(part.__doc__ or "").partition("\nArgs:\n")
        section = re.split(r"\n(?=\S)", args)[0]
        lines = re.findall(r"^    (\w+): (.*(?:\n        .*)*)", section, re.MULTILINE)
        found |= {name: " ".join(text.split()) for name, text in lines}
    return found


def _adopted(found: Any, reference: str) -> Design:
    if not callable(found):
        raise WorkbenchError(
            f"design {reference!r} is a {type(found).__name__}; write a function that takes a"
            " linear model and a specification and returns a controller"
        )
    return Design(
        name=reference,
        family="own",
        summary=(inspect.getdoc(found) or "a design of one's own").partition("\n")[0],
        function=found,
        # What is not known may be: metrics of a solver and of a surface can be asked for.
        solves=True,
        slides=True,
        exports=False,
        own=True,
    )


DESIGNS: Registry[Design] = Registry(
    "design", Design, package="controllers", group="workbench.designs", adopt=_adopted
)
"""Every design, by the name used in a study."""


def designs_for(linear: LinearModel) -> tuple[Design, ...]:
    """Return the designs that start from one linear model: those made for such a plant, else all.

    Returns:
        Designs whose sensors and actuators the model has; those for any linear model if none has.
    """
    one = [d for d in DESIGNS.members().values() if d.needs == "linear"]
    own = [
        d
        for d in one
        if d.sensors
        and set(d.sensors) <= set(linear.output_names)
        and set(d.actuators) <= set(linear.input_names)
    ]
    return tuple(own or [d for d in one if not d.sensors and not d.own])
