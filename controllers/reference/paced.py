"""A reference that moves at a pace, and slower the sooner it has to stop.

Units: SI.
"""

from __future__ import annotations

import math

from controllers.arithmetic import Arithmetic, Number


def paced(
    away: Number, moved: Number, pace: Number, brake: Number, leap: Number, a: Arithmetic
) -> Number:
    """Return by how much a reference moves in this sample, which moved by so much in the last one.

    It moves as fast as it may, and no faster than it can stop from at what is asked: n samples that
    each take ``brake`` off a move of n times that go n (n + 1) / 2 times as far. Moves of ``leap``
    begin and end at once.

    Args:
        away: What it is away from what is asked, in SI.
    """
    fast = a.clip(away, -pace, pace)
    if isinstance(brake, float) and brake == math.inf:
        return fast
    size = a.largest(away, -away)
    stops = a.largest(4.0 * size / (1.0 + a.root(1.0 + 8.0 * size / brake)), leap)
    # From the other way, faster than a leap, it brakes first.
    less = a.where(moved > leap, brake - moved, a.largest(brake - moved, leap))
    more = a.where(moved < -leap, brake + moved, a.largest(brake + moved, leap))
    return a.clip(a.clip(fast, -stops, stops), -less, more)
