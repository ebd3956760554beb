"""Design on the model that a diagnosis improved: the same rules, one more law in the model.

Linear models see what has a slope at rest. Dry friction and hysteresis have none, so they are left
out of the linear models; hysteresis of the muscles is compensated along the planned move instead.

A latency of the command and a lag of the pressure sensors are predicted over by scheduled designs,
so they are left out of the linear models too and stand in the specification. What is slower than
the joint's third-order model beside them, spool, lines and sample, is one lag more (`lag_beside`,
and half a sample): the feedforward leads by it, and laws that know of a lag predict over it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from controllers.design import DESIGNS, Design
from controllers.joint.hysteresis_compensation import with_compensation
from controllers.joint.model import lag_beside
from controllers.joint.schedule import joint_schedule
from workbench.linearisation import linearise
from workbench.linearisation.operating_map import OperatingMap, operating_map
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.physics.delay import clock_shift, sensor_lag, valve_delay
from workbench.plants.plant import Plant
from workbench.simulation.equations import compiled


def redesign(
    model: Model, plant: Plant, design: str, specification: Mapping[str, Any] | None = None
) -> Any:
    """Design a controller on a model of a plant, whatever effects it has.

    Args:
        model: Nominal, refitted, or the improved one of a verdict.
        plant: The plant that it is a model of, which declares where controllers are designed.
        design: Name of a design, or ``module:function`` of one's own.

    Returns:
        The controller; with compensation where the model has hysteresis of the muscles, and
        predicting over latency and lags that were found.

    Raises:
        WorkbenchError: If the model cannot rest there, or the design does not fit the plant.
    """
    kind = DESIGNS.get(design)
    smooth = model.without(*model.dry_effects)
    source: Any
    given: dict[str, Any] = {}
    wanted = dict(specification or {})
    if kind.needs == "map":
        known = found_lags(model)
        found = operating_map(smooth.without(*known), plant.design_map)
        source = joint_schedule(found)
        wanted = {**_predicting(kind, known, found), **wanted}
    elif kind.needs == "linear":
        source = linearise(operating_point(smooth, plant.design_point), verdict=False)
    else:
        rest = operating_point(smooth, plant.design_point)
        source, given = smooth, {"rest": rest.x, "compile_function": compiled}
    law = kind.controller(source, kind.specified(wanted), given=given)
    return with_compensation(law, model)


def found_lags(model: Model) -> dict[str, tuple[str, float]]:
    """Return ``latency`` or ``sensor_lag``, and how long, in s, by the effects of a model."""
    values = {q.name: q.value for q in model.parameters}
    found = {}
    for effect in model.effects:
        time = values.get(f"{effect.name}.time", 0.0)
        if effect.name in (valve_delay.name, clock_shift.name):
            found[effect.name] = ("latency", time)
        elif effect.name.startswith(f"{sensor_lag.name}_pressure"):
            found[effect.name] = ("sensor_lag", time)
    return found


def _predicting(
    kind: Design, known: Mapping[str, tuple[str, float]], found: OperatingMap
) -> dict[str, float]:
    """Return the entries of a specification by which a design predicts over known lags."""
    fields = getattr(kind.specification, "__dataclass_fields__", {})
    if not known or not is_dataclass(kind.specification):
        return {}
    latency = sum(time for what, time in known.values() if what == "latency")
    lags = [time for what, time in known.values() if what == "sensor_lag"]
    slow = float(np.median([lag_beside(linear) for linear in found.models.values()]))
    slow += 0.5 * fields["sample_time"].default
    asked = {"latency": latency, "sensor_lag": max(lags, default=0.0), "lead": slow, "lag": slow}
    return {name: max(value, 0.0) for name, value in asked.items() if name in fields}
