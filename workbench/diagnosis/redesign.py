"""Design on the model that a diagnosis improved: the same rules, one more law in the model.

Linear models see what has a slope at rest. Dry friction and hysteresis have none, so they are left
out of the linear models; hysteresis of the muscles is compensated along the planned move instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from controllers.design import DESIGNS
from controllers.joint.hysteresis_compensation import with_compensation
from controllers.joint.schedule import joint_schedule
from workbench.linearisation import linearise
from workbench.linearisation.operating_map import operating_map
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.plants.plant import Plant
from workbench.simulation.compiled import compiled


def redesign(
    model: Model,
    plant: Plant,
    design: str,
    specification: Mapping[str, Any] | None = None,
) -> Any:
    """Design a controller on a model of a plant, whatever effects it has.

    Args:
        model: Nominal, refitted, or the improved one of a verdict.
        plant: The plant that it is a model of, which declares where controllers are designed.
        design: Name of a design, or ``module:function`` of one's own.

    Returns:
        The controller; with compensation where the model has hysteresis of the muscles.

    Raises:
        WorkbenchError: If the model cannot rest there, or the design does not fit the plant.

    Example:
        >>> from workbench.physics.hysteresis import muscle_hysteresis
        >>> from workbench.plants.arm.arm import ARM, arm
        >>> better = arm(3).with_effect(muscle_hysteresis())
        >>> pids = [redesign(m, ARM, "scheduled-pid") for m in (arm(3), better)]
        >>> [pid.tracking.hysteresis is None for pid in pids]
        [True, False]
    """
    kind = DESIGNS.get(design)
    smooth = model.without(*model.dry_effects)
    source: Any
    given: dict[str, Any] = {}
    if kind.needs == "map":
        source = joint_schedule(operating_map(smooth, plant.design_map))
    elif kind.needs == "linear":
        source = linearise(operating_point(smooth, plant.design_point), verdict=False)
    else:
        rest = operating_point(smooth, plant.design_point)
        source, given = smooth, {"rest": rest.x, "compile_function": compiled}
    law = kind.controller(source, kind.specified(specification or {}), given=given)
    return with_compensation(law, model)
