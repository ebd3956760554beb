"""Friction torque of the joint: smooth Coulomb, Stribeck, LuGre, viscous, quadratic.

Units: SI.
"""

from __future__ import annotations

import math
from types import SimpleNamespace


def level(speed: float, tension: float, p: SimpleNamespace) -> float:
    """Return the dry friction level at a speed; tension is F1 + F2."""
    dry = p.coulomb + p.load_friction * tension
    if p.stribeck_torque != 0.0:
        dry += p.stribeck_torque * math.exp(-((speed / p.stribeck_speed) ** 2))
    return float(dry)


def torque(speed: float, bristle: float, tension: float, p: SimpleNamespace) -> tuple[float, float]:
    """Return the friction torque (against the motion) and the rate of the bristle."""
    dry = level(speed, tension, p)
    drag = p.viscous * speed + p.quadratic_drag * speed * abs(speed)
    if p.lugre_stiffness > 0.0:
        rate = speed - p.lugre_stiffness * abs(speed) * bristle / dry
        return p.lugre_stiffness * bristle + p.lugre_damping * rate + drag, rate
    return dry * math.tanh(speed / p.coulomb_speed) + drag, 0.0
