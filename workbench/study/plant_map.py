"""The nominal plant of a study over its whole range of angles: how it swings, how far it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError
from workbench.linearisation.angle_map import angle_map
from workbench.linearisation.transfer import transfer_function
from workbench.study.study import Study

Vector = npt.NDArray[np.float64]

GAIN_HZ = 0.5
"""Frequency of the gain: above the creep of the leakage, below the swing of the arm, Hz."""

COUNT = 30


@dataclass(frozen=True)
class PlantMap:
    """Linear models of a plant over its angles, in three numbers each.

    Args:
        angles: Angles, shape (n,), in rad.
        frequency_hz: Frequency of the arm's swing, shape (n,), in Hz; NaN where it cannot rest.
        damping: Damping ratio of the swing, shape (n,), dimensionless.
        gain: Angle per volt at `GAIN_HZ`, shape (n,), in rad/V.

    Example:
        >>> list(PlantMap.__dataclass_fields__)[0]
        'angles'
    """

    angles: Vector
    frequency_hz: Vector
    damping: Vector
    gain: Vector


def plant_map(study: Study) -> PlantMap | None:
    """Linearise the nominal plant over its angles.

    Args:
        study: The study.

    Returns:
        The map; None if the plant has no angle, no voltage as its only input, or rests nowhere.

    Example:
        >>> from workbench.study.schema import load_study
        >>> from workbench.study.shipped import shipped_study
        >>> found = plant_map(load_study(shipped_study("arm")))
        >>> found is not None and len(found.angles)
        30
    """
    model = study.plant.build()
    if "angle" not in [q.name for q in model.outputs] or [q.unit for q in model.inputs] != ["V"]:
        return None
    grid = study.plant.plant().design_map.get("angle")
    if not grid:
        return None
    angles = np.linspace(grid[0], grid[-1], COUNT)
    try:
        found = angle_map(model.without(*model.dry_effects), angles, input="plant")
    except WorkbenchError:
        return None
    gain = np.full(len(angles), np.nan)
    s = 2j * math.pi * GAIN_HZ
    for (i, _, _), linear in found.models.items():
        row = linear.output_names.index("angle")
        response = transfer_function(linear.A, linear.B, linear.C, linear.D, s)
        gain[i] = abs(response[row, 0])
    return PlantMap(angles, found.frequency_hz[:, 0, 0], found.damping[:, 0, 0], gain)
