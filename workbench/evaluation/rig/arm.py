"""Geometry of the arm (angles in rad, lengths in m).

Units: SI.
"""

from __future__ import annotations

import math

SPAN = math.radians(60.0)
FITTINGS = 0.223
"""Distance between the joining points minus the length of the fibre."""


def distance(angle: float) -> float:
    """Return the distance between the joining points of muscle 1."""
    x = 0.0444 + 0.032 * math.cos(angle)
    y = 0.416 - 0.032 * math.sin(angle)
    return math.hypot(x, y)
