"""The controllers that come with the workbench, each designed from one linear model of the arm."""

from __future__ import annotations

import math
from collections.abc import Iterable

from controllers.design import DESIGNS
from controllers.protocol import Controller
from workbench.errors import check_choice, check_range
from workbench.linearisation import LinearModel, linearise
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.study.designs import dry_effects

FROM_ONE_MODEL = ("pid", "sliding-mode", "mpc")
"""Designs that start from the linear model at one operating point, by name."""


def design_model(plant: Model, angle_deg: float = 30.0) -> LinearModel:
    """Linearise a plant for design, at rest at an angle.

    Bearing friction and hysteresis are left out if the plant has them: at rest their slopes look
    like damping and stiffness that a moving arm does not have.

    Args:
        plant: The arm.
        angle_deg: Angle of the operating point.

    Returns:
        The linear model.

    Raises:
        WorkbenchError: If the arm cannot rest there.

    Example:
        >>> from workbench.plants.arm import arm
        >>> design_model(arm(3)).input_names
        ('valve',)
    """
    check_range("design angle", angle_deg, 0.0, 60.0, "deg")
    point = operating_point(plant.without(*dry_effects(plant)), {"angle": math.radians(angle_deg)})
    return linearise(point, verdict=False)


def design_controllers(
    linear: LinearModel, names: Iterable[str] = FROM_ONE_MODEL
) -> tuple[Controller, ...]:
    """Design controllers from a linear model.

    Args:
        linear: The linear model.
        names: Names from `FROM_ONE_MODEL`.

    Returns:
        The controllers in the order of the names.

    Raises:
        WorkbenchError: If a name is unknown, or a design cannot meet its specification.

    Example:
        >>> from workbench.plants.arm import arm
        >>> [c.name for c in design_controllers(design_model(arm(3)), ["pid"])]
        ['cascade PID']
    """
    found = []
    for name in names:
        design = DESIGNS.get(check_choice("controller", name, FROM_ONE_MODEL))
        found.append(design.controller(linear, design.specified({})))
    return tuple(found)
