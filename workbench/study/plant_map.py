"""The nominal plant of a study over the range of its output: oscillation and gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.linearisation.operating_map import operating_map
from workbench.linearisation.pace import horizon_of
from workbench.linearisation.transfer import frequency_response
from workbench.study.study import Study

COUNT = 30


@dataclass(frozen=True)
class PlantMap:
    """Linear models of a plant over one of its outputs, in three numbers each.

    Args:
        values: Its values at rest, shape (n,), in SI.
        frequency_hz: Frequency of the oscillation, shape (n,), in Hz; NaN where it cannot rest.
        damping: Damping ratio of the oscillation, shape (n,), dimensionless.
        gain_hz: Frequency of the gain, in Hz: above slow drifts, a quarter of the oscillation.
        gain: Output per command there, shape (n,), in SI.
    """

    output: str
    values: Vector
    frequency_hz: Vector
    damping: Vector
    gain_hz: float
    gain: Vector


def plant_map(study: Study) -> PlantMap | None:
    """Linearise the nominal plant over the first axis of the map that it declares.

    Returns:
        The map; None if that is no output, the plant has several inputs, or it rests nowhere.
    """
    model = study.plant.build()
    output, grid = next(iter(study.plant.plant().design_map.items()), ("", ()))
    if output not in [q.name for q in model.outputs] or len(model.inputs) != 1:
        return None
    values = np.linspace(grid[0], grid[-1], COUNT)
    try:
        smooth = model.without(*model.dry_effects)
        found = operating_map(smooth, {output: values}, input="plant")
    except WorkbenchError:
        return None
    hertz = float(f"{0.5 / np.median([horizon_of(m) for m in found.models.values()]):.2g}")
    gain = np.full(len(values), np.nan)
    for (i,), linear in found.models.items():
        gain[i] = abs(frequency_response(linear, output, [hertz])[0])
    return PlantMap(output, values, found.frequency_hz, found.damping, hertz, gain)
