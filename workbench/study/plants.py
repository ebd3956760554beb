"""Plants of a study, as recipes that another process or machine can cook again."""

from __future__ import annotations

import copy
import importlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.model import Model

ARM_OPTIONS: dict[str, str] = {
    "load": "kg",
    "supply": "Pa",
    "plane": "",
    "force_law": "",
    "valve_curve": "",
    "silencers": "",
    "line_volumes": "",
}
"""What a study may say about the arm, with the SI unit of each number."""


@dataclass(frozen=True)
class PlantRecipe:
    """How to build a plant.

    Args:
        kind: ``"arm"``, or ``module:function`` that returns a model.
        options: Options of the arm by name, numbers in SI.
        effects: Effects of the library that are attached, at zero size until a parameter says more.
        without: Effects that are left out.
        parameters: Changed parameters by name, in SI.
        noise: Factor on the noise of every sensor, dimensionless.

    Example:
        >>> PlantRecipe("arm", (("load", 3.0),)).build().parameter("load").value
        3.0
    """

    kind: str = "arm"
    options: tuple[tuple[str, Any], ...] = ()
    effects: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    parameters: tuple[tuple[str, float], ...] = ()
    noise: float = 1.0

    def build(self) -> Model:
        """Return the plant; the equations are written down once per process.

        Raises:
            WorkbenchError: If a name is unknown or a value outside its range.
        """
        model = _structure(self.kind, self.options, self.effects, self.without)
        model = model.with_parameters(dict(self.parameters))
        if self.noise == 1.0:
            return model
        noisy = copy.copy(model)
        outputs = tuple(replace(q, noise_rms=q.noise_rms * self.noise) for q in model.outputs)
        object.__setattr__(noisy, "outputs", outputs)
        return noisy

    def varied(
        self,
        *,
        parameters: Iterable[tuple[str, float]] = (),
        effects: Iterable[str] = (),
        without: Iterable[str] = (),
        noise: float = 1.0,
    ) -> PlantRecipe:
        """Return the recipe with more changes; a parameter named again takes the new value.

        Args:
            parameters: Changed parameters by name, in SI.
            effects: Further effects of the library.
            without: Further effects that are left out.
            noise: Factor on the noise of every sensor, dimensionless.

        Returns:
            Another recipe.
        """
        return replace(
            self,
            effects=(*self.effects, *effects),
            without=(*self.without, *without),
            parameters=tuple({**dict(self.parameters), **dict(parameters)}.items()),
            noise=self.noise * noise,
        )


@lru_cache(maxsize=32)
def _structure(
    kind: str,
    options: tuple[tuple[str, Any], ...],
    effects: tuple[str, ...],
    without: tuple[str, ...],
) -> Model:
    model = _arm(dict(options)) if kind == "arm" else _own(kind, dict(options))
    if effects:
        # The library is large; a study without effects does not wait for it.
        from workbench.physics.library import library

        entries = {entry.name: entry.effect for entry in library(model)}
        for name in effects:
            check_choice("effect", name, entries)
        model = model.with_effect(*(entries[name] for name in effects))
    return model.without(*without)


def _arm(options: dict[str, Any]) -> Model:
    from workbench.plants.arm import arm

    for name in options:
        check_choice("key of the plant", name, ARM_OPTIONS)
    supply = options.pop("supply", 6e5)
    return arm(options.pop("load", 3.0), supply_bar=supply / 1e5, **options)


def _own(kind: str, options: dict[str, Any]) -> Model:
    if options:
        raise WorkbenchError(
            f"key of the plant is {next(iter(options))!r}; a plant of one's own takes parameters,"
            " effects and without only"
        )
    model = own_function("plant", kind)()
    if not isinstance(model, Model):
        raise WorkbenchError(f"plant {kind!r} returned {type(model).__name__}, not a model")
    return model


def own_function(what: str, place: str) -> Callable[..., Any]:
    """Return a function that a study names as ``module:function``.

    Args:
        what: What the function stands for, as the user knows it.
        place: Module and function.

    Returns:
        The function.

    Raises:
        WorkbenchError: If there is no such module or function.

    Example:
        >>> own_function("plant", "workbench.plants.servo_axis:servo_axis").__name__
        'servo_axis'
    """
    module, sign, name = place.partition(":")
    if not sign:
        raise WorkbenchError(
            f"{what} is {place!r}; write a function of your own as module:function"
        )
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise WorkbenchError(
            f"{what} {place!r} cannot be imported: {error}; put the module beside the study file"
        ) from None
    if not callable(found):
        raise WorkbenchError(f"{what} {place!r} is not a function")
    return found  # type: ignore[no-any-return]


def checked_noise(value: float) -> float:
    """Return a factor on the sensors' noise if it is one.

    Args:
        value: Factor, dimensionless.

    Returns:
        The same number, dimensionless.

    Raises:
        WorkbenchError: If it is outside 0 to 100.

    Example:
        >>> checked_noise(2.0)
        2.0
    """
    return check_range("noise factor", value, 0.0, 100.0)
