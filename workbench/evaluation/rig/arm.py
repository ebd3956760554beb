"""Geometry, inertia, gravity of the arm (angles in rad, lengths in m).

Units: SI.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

SPAN = math.radians(60.0)
FITTINGS = 0.223
"""Distance between the joining points minus the length of the fibre."""
ARM_MASS, ARM_X, ARM_Y = 0.987, 0.205, 0.0176
LOAD_X, LOAD_Y = 0.367, -0.024
G = 9.81


def distance(angle: float) -> float:
    """Return the distance between the joining points of muscle 1."""
    x = 0.0444 + 0.032 * math.cos(angle)
    y = 0.416 - 0.032 * math.sin(angle)
    return math.hypot(x, y)


def distance_slope(angle: float) -> float:
    """Return d(distance)/d(angle) of muscle 1."""
    x = 0.0444 + 0.032 * math.cos(angle)
    y = 0.416 - 0.032 * math.sin(angle)
    return 0.032 * (-x * math.sin(angle) - y * math.cos(angle)) / math.hypot(x, y)


def gravity(angle: float, load: float, p: SimpleNamespace) -> float:
    """Return the torque of gravity on the joint (positive angles are against gravity)."""
    moment = ARM_MASS * (ARM_X * math.cos(angle) - ARM_Y * math.sin(angle))
    moment += load * (LOAD_X * math.cos(angle) - LOAD_Y * math.sin(angle))
    # A small tilt about the axis that is level with the arm at 90 deg acts on the cosine only.
    tilted = (ARM_MASS * ARM_X + load * LOAD_X) * math.cos(angle) * math.sin(p.tilt)
    return float(-G * (moment * p.vertical + tilted))
