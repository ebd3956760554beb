"""Controllers of a study, designed from a linear model of its plant."""

from __future__ import annotations

import importlib
import inspect
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np

from controllers.joint.schedule import JointSchedule, joint_schedule
from controllers.protocol import Controller
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import LinearModel, linearise
from workbench.operating_point import operating_point
from workbench.simulation.compiled import compiled
from workbench.study.plants import PlantRecipe, own_function


class Design(NamedTuple):
    """Where a design that comes with the workbench is found.

    Args:
        module: Name of the module.
        function: Name of the function that returns a controller.
        specification: Name of the specification's class; empty if its fields are keywords of the
            function.
        source: What the design starts from: ``"linear"`` model at one operating point, a
            ``"map"`` of linear models over angle and mean pressure, or the plant's ``"model"``.
        solves: Whether the controller solves an optimisation at each sample.
        slides: Whether it has a sliding surface, and is judged by invariants.
    """

    module: str
    function: str
    specification: str = ""
    source: str = "linear"
    solves: bool = False
    slides: bool = False


DESIGNS: dict[str, Design] = {
    "pid": Design("controllers.pid", "design_pid", "PIDSpecification"),
    "sliding-mode": Design(
        "controllers.sliding_mode", "design_sliding_mode", "SlidingModeSpecification", slides=True
    ),
    "mpc": Design("controllers.mpc.whole_model", "design_mpc", "MPCSpecification", solves=True),
    "scheduled-pid": Design("controllers.scheduled_pid", "design_scheduled_pid", source="map"),
    "scheduled-sliding-mode": Design(
        "controllers.scheduled_sliding_mode",
        "design_scheduled_sliding_mode",
        source="map",
        slides=True,
    ),
    "scheduled-mpc": Design(
        "controllers.mpc.along_plan", "design_scheduled_mpc", source="map", solves=True
    ),
    "scheduled-state-feedback": Design(
        "controllers.state_feedback", "design_scheduled_state_feedback", source="map"
    ),
    "nonlinear-mpc": Design(
        "controllers.nonlinear_mpc.controller",
        "design_nonlinear_mpc",
        "NonlinearMPCSpecification",
        source="model",
        solves=True,
    ),
}
"""Designs by the name used in a study; others are named as ``module:function``."""

MAP_ANGLES_DEG = (1.0, 59.0, 13)
"""First and last angle of a design map in °, and how many."""

MAP_MEAN_PRESSURES = (2.8e5, 3.6e5)
"""Mean gauge pressures of a design map, in Pa."""

DRY = ("bearing_friction", "muscle_hysteresis")
"""Left out of design models: at rest their slopes look like damping and stiffness that a moving arm
does not have."""


@dataclass(frozen=True)
class ControllerRecipe:
    """How to design a controller.

    Args:
        name: Name in the study.
        design: Name from `DESIGNS`, or ``module:function`` called with the linear model and the
            specification as a mapping.
        plant: Plant of the linear model.
        at: Given values of the operating point by name, in SI.
        specification: Fields of the design's specification.

    Example:
        >>> recipe = ControllerRecipe("mine", "pid", PlantRecipe(), (("angle", 0.5),))
        >>> recipe.build().name
        'mine'
    """

    name: str
    design: str
    plant: PlantRecipe
    at: tuple[tuple[str, float], ...]
    specification: tuple[tuple[str, Any], ...] = ()

    def linear(self, at: tuple[tuple[str, float], ...] | None = None) -> LinearModel:
        """Return the linear model of the design, or the one at another operating point.

        Args:
            at: Given values by name, in SI; those of the design by default.

        Returns:
            The linear model, without friction at rest.

        Raises:
            WorkbenchError: If the plant cannot rest there.
        """
        return _linear(self.plant, self.at if at is None else at)

    def build(self) -> Controller:
        """Return the controller under its name in the study; designed once per process.

        Raises:
            WorkbenchError: If the design does not meet its specification.
        """
        # A specification may hold tables, which have no hash but are written the same every time.
        key = repr(self)
        if key not in _DESIGNED:
            _DESIGNED[key] = _designed(self)
        return _DESIGNED[key]

    def checked_specification(self) -> Any:
        """Return the specification: an object of the design's class, or a mapping.

        Raises:
            WorkbenchError: If a key is unknown or a value outside its range.
        """
        if ":" in self.design:
            return dict(self.specification)
        design = DESIGNS[check_choice("design", self.design, DESIGNS)]
        module = importlib.import_module(design.module)
        what = f"key of the {self.design} specification"
        if not design.specification:
            parameters = inspect.signature(getattr(module, design.function)).parameters
            words = [n for n, p in parameters.items() if p.kind is p.KEYWORD_ONLY and n != "valve"]
            for key, _ in self.specification:
                check_choice(what, key, words)
            return dict(self.specification)
        kind = getattr(module, design.specification)
        for key, _ in self.specification:
            check_choice(what, key, [f.name for f in fields(kind)])
        try:
            return kind(**dict(self.specification))
        except TypeError as error:
            raise WorkbenchError(f"specification of controller {self.name!r}: {error}") from None


@lru_cache(maxsize=64)
def _linear(plant: PlantRecipe, at: tuple[tuple[str, float], ...]) -> LinearModel:
    model = plant.build()
    dry = [e.name for e in model.effects if e.name in DRY]
    return linearise(operating_point(model.without(*dry), dict(at)), verdict=False)


@lru_cache(maxsize=16)
def _schedule(plant: PlantRecipe) -> JointSchedule:
    from workbench.linearisation.angle_map import angle_map

    first, last, count = MAP_ANGLES_DEG
    angles = np.radians(np.linspace(first, last, int(count)))
    found = angle_map(plant.build(), angles, mean_pressures=MAP_MEAN_PRESSURES)
    return joint_schedule(found.models, found.angles, found.mean_pressures)


_DESIGNED: dict[str, Controller] = {}


def _designed(recipe: ControllerRecipe) -> Controller:
    want = recipe.checked_specification()
    if ":" in recipe.design:
        found = own_function("design", recipe.design)(recipe.linear(), want)
    else:
        design = DESIGNS[recipe.design]
        function = getattr(importlib.import_module(design.module), design.function)
        if design.source == "map":
            found = function(_schedule(recipe.plant), **want)
        elif design.source == "model":
            dry = [e.name for e in recipe.plant.build().effects if e.name in DRY]
            model = recipe.plant.build().without(*dry)
            rest = operating_point(model, dict(recipe.at)).x
            found = function(model, want, rest=rest, compile_function=compiled)
        else:
            found = function(recipe.linear(), want)
    if not isinstance(found, Controller):
        raise WorkbenchError(
            f"design {recipe.design!r} returned {type(found).__name__}, which is no controller"
        )
    return _named(found, recipe.name)


def _named(controller: Any, name: str) -> Controller:
    """Return the controller under its name in the study, where its class has names."""
    if is_dataclass(controller) and "name" in {f.name for f in fields(controller)}:
        return cast(Controller, replace(cast(Any, controller), name=name))
    return cast(Controller, controller)


def solves(design: str) -> bool:
    """Tell whether controllers of a design may solve an optimisation at each sample.

    Args:
        design: Name of the design; one of one's own may.

    Returns:
        Whether metrics of a solver can be asked for.

    Example:
        >>> solves("pid"), solves("mpc")
        (False, True)
    """
    return ":" in design or DESIGNS[design].solves


def slides(design: str) -> bool:
    """Tell whether controllers of a design may have a sliding surface.

    Args:
        design: Name of the design; one of one's own may.

    Returns:
        Whether metrics of the surface can be asked for.

    Example:
        >>> slides("pid"), slides("sliding-mode")
        (False, True)
    """
    return ":" in design or DESIGNS[design].slides
