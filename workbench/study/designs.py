"""Controllers of a study, designed from linear models of its plant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import lru_cache
from typing import Any, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from controllers.design import DESIGNS, Design
from controllers.joint.schedule import JointSchedule, joint_schedule
from controllers.joint.tracking import TrackingSpecification
from controllers.largest_bandwidth import Limits, MarginedDesign, largest_bandwidth
from controllers.plain.loop import held_outputs
from controllers.protocol import Controller
from controllers.uncertainty import NONE, Uncertainty
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import LinearModel, linearise
from workbench.linearisation.operating_map import default_input, operating_map
from workbench.operating_point import operating_point
from workbench.plants.plant import Plant
from workbench.simulation.equations import compiled
from workbench.study.dependencies import forgotten_with_its_code
from workbench.study.plants import PlantRecipe
from workbench.verification.guard_limits import guarded

Pairs = tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Fastest:
    """Search of the fastest design within limits on the peaks of the sensitivities.

    Args:
        speeds: First speed, last speed, in rad/s, and how many are tried between them.
        maximum_sensitivity: Limit on Ms, a ratio.
        maximum_complementary: Limit on Mt, a ratio.
        late_sensitivity: Limit on Ms with every command one sample late, a ratio.
        uncertainty: What the limits hold for beside the plants; the middle of its delay and lag is
            compensated by designs that can.
        factors: What it is reduced by, ratios, in the order in which they are tried.
    """

    key: str
    speeds: tuple[float, float, int]
    at: tuple[Pairs, ...]
    plants: tuple[PlantRecipe, ...]
    maximum_sensitivity: float = 2.0
    maximum_complementary: float = 1.9
    late_sensitivity: float = math.inf
    uncertainty: Uncertainty = NONE
    reduced: str = ""
    factors: tuple[float, ...] = (1.0,)


@dataclass(frozen=True)
class ControllerRecipe:
    """How to design a controller.

    Args:
        design: Name of a design, or ``module:function`` of one's own, called with the linear model
            and the specification as a mapping.
        at: Given values of the operating point by name, in SI.
        inertia_margin: What is added to parameters, in SI, for the inertia that the feedback is
            designed for; the plant at rest stays as it is.
    """

    name: str
    design: str
    plant: PlantRecipe
    at: Pairs
    specification: Pairs = ()
    inertia_margin: Pairs = ()
    plan: Pairs = ()
    fastest: Fastest | None = None
    guard: bool = False

    def kind(self) -> Design:
        """Return the design of the registry."""
        return DESIGNS.get(self.design, folder=self.plant.folder)

    def linear(self, at: Pairs | None = None) -> LinearModel:
        """Return the linear model of the design, or the one where other values, in SI, are given.

        Raises:
            WorkbenchError: If the plant cannot rest there.
        """
        return _linear(self.plant, self.at if at is None else at)

    def designed(self) -> MarginedDesign[Controller]:
        """Return the controller under its name in the study, with its margins if it was searched.

        It is designed once per process.

        Raises:
            WorkbenchError: If the design does not meet its specification.
        """
        # A specification may hold tables, which have no hash but are written the same every time.
        key = f"{self!r} {self.plant.folder}"
        if key not in _DESIGNED:
            _DESIGNED[key] = _designed(self)
        return _DESIGNED[key]

    def build(self) -> Controller:
        """Return the controller under its name in the study."""
        return self.designed().controller

    def guarded(self, controller: Controller) -> Controller:
        """Return a controller of this design inside its guard, if it has one."""
        if not self.guard:
            return controller
        return guarded(controller, self.plant.build(), at=dict(self.at))

    def checked_specification(self, given: Mapping[str, Any] | None = None) -> Any:
        """Return the specification, by default the recipe's: its class's, or a mapping."""
        design = self.kind()
        found = dict(self.specification if given is None else given)
        if self.fastest is not None:
            name, _, inner = self.fastest.key.partition(".")
            if name not in found or (inner and inner not in found[name]):
                # Not searched yet: the first speed stands for all.
                found = _with(found, self.fastest.key, self.fastest.speeds[0])
        hints = _hints(design)
        for name, value in found.items():
            if isinstance(value, Mapping) and is_dataclass(hints.get(name)):
                kind = cast(Any, hints[name])
                for key in value:
                    check_choice(f"key of {name}", key, kind.__dataclass_fields__)
                try:
                    found[name] = kind(**value)
                except TypeError as error:
                    raise WorkbenchError(f"{name} of design {design.name!r}: {error}") from None
        return design.specified(found)


def _hints(design: Design) -> dict[str, Any]:
    """Return the class of each entry of a specification, None taken away."""
    found = get_type_hints(design.specification) if design.specification else {}
    return {name: _plain(hint) for name, hint in found.items()}


def _plain(hint: Any) -> Any:
    union = get_origin(hint) is Union or type(hint).__name__ == "UnionType"
    kinds = [k for k in get_args(hint) if k is not type(None)] if union else [hint]
    return kinds[0] if len(kinds) == 1 else None


@lru_cache(maxsize=64)
def _linear(plant: PlantRecipe, at: Pairs) -> LinearModel:
    model = plant.build()
    return linearise(operating_point(model.without(*model.dry_effects), dict(at)), verdict=False)


@lru_cache(maxsize=16)
def _map(plant: PlantRecipe) -> JointSchedule:
    grid = plant.plant().design_map
    if not grid:
        raise WorkbenchError(
            f"plant {plant.kind!r} declares no map of operating points, which a scheduled design"
            " needs; give its Plant a design_map, or use another design"
        )
    return joint_schedule(operating_map(plant.build(), grid))


def _heavier(recipe: ControllerRecipe) -> PlantRecipe:
    """Return the plant with the margin of inertia, within the bounds of its parameters."""
    model = recipe.plant.build()
    changed = []
    for name, more in recipe.inertia_margin:
        quantity = model.parameter(name)
        changed.append((name, min(max(quantity.value + more, quantity.lower), quantity.upper)))
    return recipe.plant.varied(parameters=changed)


def _schedule(recipe: ControllerRecipe) -> JointSchedule:
    own, heavier = _map(recipe.plant), _heavier(recipe)
    same = np.array_equal(heavier.build().values, recipe.plant.build().values)
    return own if same else own.with_inertia_of(_map(heavier))


_DESIGNED: dict[str, MarginedDesign[Controller]] = {}

for _kept in (_DESIGNED.clear, _linear.cache_clear, _map.cache_clear):
    forgotten_with_its_code(_kept)


def _designed(recipe: ControllerRecipe) -> MarginedDesign[Controller]:
    given = dict(recipe.specification)
    if recipe.fastest is None:
        return MarginedDesign(_made(recipe, given), math.nan, math.nan, math.nan)
    want = recipe.fastest
    models = [
        linearise(point, input=default_input(point.model), verdict=False)
        for plant in want.plants
        for at in want.at
        for point in (operating_point(plant.build(), dict(at)),)
    ]
    first, last, count = want.speeds
    speeds = [float(v) for v in np.round(np.geomspace(first, last, int(count)), 1)]
    unsure = want.uncertainty
    if unsure != NONE and is_dataclass(kind := recipe.kind().specification):
        known = {"latency": unsure.known_delay, "sensor_lag": unsure.known_lag}
        given = {**{k: v for k, v in known.items() if k in kind.__dataclass_fields__}, **given}

    peaks = (want.maximum_sensitivity, want.maximum_complementary, want.late_sensitivity)
    limits = Limits(*peaks, unsure)

    def search(factor: float) -> MarginedDesign[Controller]:
        own = {**given, want.reduced: factor * given[want.reduced]} if want.reduced else given
        return largest_bandwidth(
            lambda speed: _made(recipe, _with(own, want.key, speed)), models, speeds, limits
        )

    for factor in want.factors[:-1]:
        try:
            return search(factor)
        except WorkbenchError:
            continue
    return search(want.factors[-1])


def _with(given: Mapping[str, Any], key: str, value: float) -> dict[str, Any]:
    """Return a specification with an entry, such as ``slope`` or ``weights.speed``."""
    name, _, inner = key.partition(".")
    return {**given, name: {**given.get(name, {}), inner: value} if inner else value}


def _made(recipe: ControllerRecipe, given: Mapping[str, Any]) -> Controller:
    design = recipe.kind()
    if design.needs == "map":
        want = recipe.checked_specification(given)
        found = design.controller(_schedule(recipe), want, name=recipe.name)
    elif design.needs == "model":
        model = _heavier(recipe).build()
        model = model.without(*model.dry_effects)
        if recipe.plan:
            given = {
                **given,
                "planner": TrackingSpecification(**dict(recipe.plan)).planner(_schedule(recipe)),
            }
        found = design.controller(
            model,
            recipe.checked_specification(given),
            name=recipe.name,
            given={"rest": operating_point(model, dict(recipe.at)).x, "compile_function": compiled},
        )
    else:
        want, linear = recipe.checked_specification(given), recipe.linear()
        try:
            found = design.controller(linear, want, name=recipe.name)
        except WorkbenchError as error:
            if design.own:
                raise
            rest = linear.operating_point.in_words()
            raise type(error)(f"{error} (designed where it rests: {rest})") from error
    return cast(Controller, found)


def followed_by_default(plant: Plant, linear: LinearModel) -> tuple[str, ...]:
    """Return the outputs that are controlled: what a plant declares, or its commands can hold."""
    model = linear.operating_point.model
    first, commands = plant.controlled_outputs(model), [q.name for q in model.commands]
    if plant.controlled or not set(commands) <= set(linear.input_names):
        return first
    return held_outputs(linear, commands) or first


def with_plan(controller: Controller, *, duration: float = 1.0, lead: float = 0.0) -> Controller:
    """Stretch the planned moves of a scheduled controller, and lead its feedforward by more.

    ``plan(t / k)`` has jerk, acceleration and speed that scale with k^-3, k^-2 and k^-1. The
    feedback stays, so that it shows what a faster plan costs.

    Args:
        duration: Duration k of every move relative to its own, a ratio.
        lead: What is added to the lead of the feedforward, in s.

    Raises:
        WorkbenchError: If the controller plans no moves.
    """
    law = cast(Any, controller)
    if not hasattr(law, "tracking"):
        raise WorkbenchError(f"controller {controller.name!r} plans no moves, so none can change")
    own = law.tracking.planner
    planner = replace(
        own,
        jerk=own.jerk / duration**3,
        acceleration=own.acceleration / duration**2,
        speed=own.speed / duration,
        shortest=max(own.shortest * duration, own.sample_time),
    )
    tracking = replace(law.tracking, planner=planner, lead=max(law.tracking.lead + lead, 0.0))
    return cast(Controller, replace(law, tracking=tracking))


def bandwidth_against_delay(
    recipe: ControllerRecipe, shares: Sequence[float]
) -> tuple[tuple[float, float], ...]:
    """Search the fastest designs for shares (ratios) of the delay and lag that a recipe tolerates.

    Returns:
        Largest delay in s and speed in rad/s for each share; no speed, NaN, meets the limits where
        more is asked than the family bears.
    """
    want = recipe.fastest
    if want is None:
        raise WorkbenchError(f"controller {recipe.name!r} has no 'fastest', so no speed to trade")
    found = []
    for share in shares:
        unsure = want.uncertainty.reduced(share)
        try:
            speed = replace(recipe, fastest=replace(want, uncertainty=unsure)).designed().speed
        except WorkbenchError:
            speed = math.nan
        found.append((unsure.delay[1], speed))
    return tuple(found)
