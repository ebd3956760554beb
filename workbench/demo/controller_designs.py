"""The controllers that come with the workbench, each designed from one linear model of the arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from controllers.protocol import Controller
from workbench.errors import check_choice, check_range
from workbench.linearisation import LinearModel, linearise
from workbench.model import Model
from workbench.operating_point import operating_point

if TYPE_CHECKING:
    from collections.abc import Mapping


def _pid(linear: LinearModel) -> Controller:
    from controllers.pid import design_pid

    return design_pid(linear)


def _sliding_mode(linear: LinearModel) -> Controller:
    from controllers.sliding_mode import design_sliding_mode

    return design_sliding_mode(linear)


def _mpc(linear: LinearModel) -> Controller:
    from controllers.mpc import design_mpc

    return design_mpc(linear)


DESIGNS: Mapping[str, Callable[[LinearModel], Controller]] = {
    "pid": _pid,
    "sliding-mode": _sliding_mode,
    "mpc": _mpc,
}
"""Designs by the name used on the command line."""


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
    dry = [e.name for e in plant.effects if e.name in ("bearing_friction", "muscle_hysteresis")]
    point = operating_point(plant.without(*dry), {"angle": math.radians(angle_deg)})
    return linearise(point, verdict=False)


def design_controllers(
    linear: LinearModel, names: Iterable[str] = tuple(DESIGNS)
) -> tuple[Controller, ...]:
    """Design controllers from a linear model.

    Args:
        linear: The linear model.
        names: Names from `DESIGNS`.

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
        check_choice("controller", name, DESIGNS)
        found.append(DESIGNS[name](linear))
    return tuple(found)
