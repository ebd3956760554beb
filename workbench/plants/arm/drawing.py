"""Where the parts of the arm are at an angle, for drawings.

The pivot is the origin, the muscles lie along the negative x axis, and y points up. Half way
between the stops the arm lies along the positive x axis; the angle turns it counterclockwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.plants.arm.arm import ArmEquations
from workbench.plants.arm.geometry import TRAVEL, ArmGeometry


@dataclass(frozen=True)
class MusclePlaces:
    """Where one muscle is, over the angles of a drawing.

    Args:
        anchor: Its fixed end, x and y, in m.
        end: Its end on the lever, shape (n, 2), in m.
        fibre: Length of its fibres, shape (n,), in m; the rest is fittings.
        diameter: Diameter of its middle, shape (n,), in m.
    """

    anchor: tuple[float, float]
    end: Vector
    fibre: Vector
    diameter: Vector

    @property
    def length(self) -> Vector:
        """Distance of both ends, shape (n,), in m."""
        return np.asarray(np.hypot(*(self.end - self.anchor).T))

    @property
    def direction(self) -> Vector:
        """Direction from the anchor to the lever, counterclockwise from x, shape (n,), in rad."""
        x, y = (self.end - self.anchor).T
        return np.asarray(np.arctan2(y, x))


@dataclass(frozen=True)
class ArmDrawing:
    """The parts of an arm over the angles of a drawing.

    Args:
        direction: Direction of the arm, counterclockwise from x, shape (n,), in rad.
        stops: Directions of the arm on its two stops, in rad.
        plates: Centre of the plates along and above the arm, in m.
        plate_width: Side of a plate, in m.
    """

    geometry: ArmGeometry
    muscles: tuple[MusclePlaces, MusclePlaces]
    direction: Vector
    stops: tuple[float, float]
    plates: tuple[float, float]
    plate_width: float


def arm_drawing(model: Model, angle: npt.ArrayLike) -> ArmDrawing:
    """Place the parts of an arm as its equations declare them, at angles of shape (n,), in rad."""
    equations: Any = model.equations
    if not isinstance(equations, ArmEquations):
        raise WorkbenchError(f"model {model.name!r} is no arm, so its drawing is unknown")
    geometry, body = equations.geometry, equations.body
    theta = np.atleast_1d(np.asarray(angle, dtype=float))
    places = [
        _muscle(equations, side, own, np.asarray(fibre))
        for side, own, fibre in zip(
            (1.0, -1.0), (theta, TRAVEL - theta), geometry.fibre_lengths(theta), strict=True
        )
    ]
    values = {q.name: q.value for q in model.parameters}
    middle = 0.5 * TRAVEL
    return ArmDrawing(
        geometry,
        (places[0], places[1]),
        theta - middle,
        (values["lower_stop"] - middle, values["upper_stop"] - middle),
        body.plate_centre,
        # A square plate has the inertia a^2 / 6 per mass about its own centre.
        float((6 * body.plate_inertia) ** 0.5),
    )


def _muscle(equations: ArmEquations, side: float, own: Vector, fibre: Vector) -> MusclePlaces:
    """Place a muscle: its lever is on one side of the axis, its anchor on the other."""
    g = equations.geometry
    end = np.column_stack([-g.lever * np.sin(own), side * g.lever * np.cos(own)])
    diameter = np.asarray(equations.laws.volume.diameter(fibre))
    return MusclePlaces((-g.anchor_distance, -side * g.anchor_offset), end, fibre, diameter)
