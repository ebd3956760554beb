"""Design on the model that a diagnosis improved: the same rules, one more law in the model.

Linear models see what has a slope at rest. Dry friction and hysteresis have none, so they are left
out of the linear models; hysteresis of the muscles is compensated along the planned move instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from controllers.joint.hysteresis_compensation import (
    HysteresisCompensation,
    hysteresis_compensation,
)
from controllers.joint.schedule import JointSchedule, joint_schedule
from controllers.joint.tracking import JointTracking
from workbench.linearisation.angle_map import angle_map
from workbench.model import Model
from workbench.study.plants import PlantRecipe

WITHOUT_SLOPE = (
    "bearing_friction",
    "coulomb_friction",
    "stribeck_friction",
    "lugre_friction",
    "load_dependent_friction",
    "pressure_friction",
    "local_friction",
    "joint_hysteresis",
    "muscle_hysteresis",
    "maxwell_slip_hysteresis",
)
"""Effects that act by the direction of motion or by its history."""

ANGLES_DEG = (1.0, 59.0, 7)
"""First angle, last angle and number of angles of a schedule, in degrees."""

MEAN_PRESSURES = (2.8e5, 3.6e5)
"""Mean gauge pressures of a schedule, Pa."""


class Tracking(Protocol):
    """A scheduled controller."""

    tracking: JointTracking


Law = TypeVar("Law", bound=Tracking)


def redesign(
    model: Model,
    design: Callable[[JointSchedule], Law],
    *,
    angles_deg: Sequence[float] = ANGLES_DEG,
    mean_pressures: Sequence[float] = MEAN_PRESSURES,
) -> Law:
    """Design a scheduled controller on a model of the arm, whatever effects it has.

    Args:
        model: The plant: nominal, refitted, or the improved one of a verdict.
        design: Designs the controller from a schedule.
        angles_deg: First angle, last angle and number of angles of the schedule, in degrees.
        mean_pressures: Two mean gauge pressures of the schedule, shape (2,), in Pa.

    Returns:
        The controller; with compensation where the model has hysteresis of the muscles.

    Raises:
        WorkbenchError: If the model has no operating points there.

    Example:
        >>> from controllers.pid import design_scheduled_pid
        >>> from workbench.physics.hysteresis import muscle_hysteresis
        >>> from workbench.plants.arm import arm
        >>> better = arm(3).with_effect(muscle_hysteresis())
        >>> pids = [redesign(m, design_scheduled_pid) for m in (arm(3), better)]
        >>> [pid.tracking.hysteresis is None for pid in pids]
        [True, False]
    """
    first, last, count = angles_deg
    smooth = without_dry_laws(model)
    found = angle_map(
        smooth,
        np.radians(np.linspace(first, last, round(count))),
        mean_pressures=list(mean_pressures),
    )
    schedule = joint_schedule(found.models, found.angles, found.mean_pressures)
    law = design(schedule)
    own = hysteresis_of(model, schedule)
    if own is None:
        return law
    changed: Law = replace(law, tracking=replace(law.tracking, hysteresis=own))  # type: ignore[type-var]
    return changed


def without_dry_laws(model: Model) -> Model:
    """Return a model without the effects that have no slope at rest.

    Args:
        model: The plant.

    Example:
        >>> from workbench.plants.arm import arm
        >>> [e.name for e in without_dry_laws(arm(3)).effects][-2:]
        ['centre_leakage', 'damper']
    """
    return model.without(*(e.name for e in model.effects if e.name in WITHOUT_SLOPE))


def study_plant(model: Model, nominal: Model, *, load: float) -> PlantRecipe:
    """Return the recipe by which a study builds an improved arm.

    Args:
        model: The improved model of a verdict.
        nominal: The arm that was diagnosed, without options but its load.
        load: Its load, in kg.

    Returns:
        The recipe: attached effects, removed effects, and parameters that changed.

    Example:
        >>> from workbench.physics.tilt import tilt_gravity
        >>> from workbench.plants.arm import arm
        >>> better = arm(3).with_effect(tilt_gravity(tilt=0.1))
        >>> recipe = study_plant(better, arm(3), load=3.0)
        >>> recipe.effects, recipe.parameters[0]
        (('tilt_gravity',), ('tilt_gravity.tilt', 0.1))
    """
    before, after = ([e.name for e in m.effects] for m in (nominal, model))
    known = {q.name: q.value for q in nominal.parameters}
    return PlantRecipe(
        "arm",
        (("load", load),),
        effects=tuple(name for name in after if name not in before),
        without=tuple(name for name in before if name not in after),
        parameters=tuple(
            (q.name, q.value) for q in model.parameters if known.get(q.name) != q.value
        ),
    )


def hysteresis_of(model: Model, schedule: JointSchedule) -> HysteresisCompensation | None:
    """Return the compensation of the hysteresis that a model's muscles have.

    Elements that slip after d_i are replaced by Dahl's law of the same half width which, after a
    turn, loses the same work: its breakaway is the mean of the d_i.

    Args:
        model: The plant.
        schedule: The joint over angle and mean pressure, for the torque per pressure difference.

    Returns:
        The compensation, or None if the muscles have no hysteresis.

    Example:
        >>> from workbench.plants.arm import arm
        >>> hysteresis_of(arm(3), JointSchedule(0.0, 1.0, (), (), 3e5, 4e5)) is None
        True
    """
    values = {q.name: q.value for q in model.parameters}
    names = {effect.name for effect in model.effects}
    if "muscle_hysteresis" in names:
        fitted: Mapping[str, float] = values
    elif "maxwell_slip_hysteresis" in names:
        fitted = _as_dahl(values)
    else:
        return None
    middle = {"angle": math.radians(30.0)}
    inertia = model.signals(model.initial_state(middle), model.nominal_input)["joint.inertia"]
    b = schedule.at(middle["angle"], 0.5 * (schedule.mean_low + schedule.mean_high)).b
    return hysteresis_compensation(fitted, torque_per_difference=float(inertia * b))


def _as_dahl(values: Mapping[str, float]) -> dict[str, float]:
    own = {
        name.removeprefix("maxwell_slip_hysteresis."): value
        for name, value in values.items()
        if name.startswith("maxwell_slip_hysteresis.")
    }
    count = 1 + sum(name.startswith("weight_") for name in own)
    weights = np.array([1.0, *(own[f"weight_{i + 1}"] for i in range(1, count))])
    slips = own["breakaway"] * own.get("spread", 1.0) ** np.arange(count)
    return {
        "muscle_hysteresis.level": own["level"],
        "muscle_hysteresis.level_per_pressure": own["level"] * own["growth"],
        "muscle_hysteresis.breakaway": float(weights @ slips / weights.sum()),
    }
