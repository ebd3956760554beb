"""Laws of the concealed effects, in forms of their own.

Dry friction sticks (Karnopp) where the workbench rounds the sign of the speed; backlash is a dead
zone of the twist; hysteresis is Bouc and Wen's.

Units: SI.
"""

from __future__ import annotations

import math


def dry_friction(
    speed: float,
    applied: float,
    level: float,
    *,
    inertia: float,
    break_away: float = 0.0,
    fade: float = 1.0,
    stuck: float,
) -> float:
    """Return the friction against the motion, after Karnopp (1985).

    Below the speed `stuck` the friction balances what is applied, up to ``level + break_away``, and
    takes the rest of the speed away within 5 ms; above it the break-away fades as
    ``1/(1 + (speed/fade)^2)``.
    """
    top = level + break_away
    if top <= 0.0:
        return 0.0
    if abs(speed) < stuck:
        return min(top, max(-top, applied + inertia * speed / 5e-3))
    return math.copysign(level + break_away / (1.0 + (speed / fade) ** 2), speed)


def dead_zone(value: float, half_width: float) -> float:
    """Return what is left of a value beyond a gap of two half widths."""
    return math.copysign(max(0.0, abs(value) - half_width), value)


def limited(value: float, limit: float) -> float:
    """Return a value cut at plus and minus a limit; no limit at 0."""
    return min(limit, max(-limit, value)) if limit > 0.0 else value
