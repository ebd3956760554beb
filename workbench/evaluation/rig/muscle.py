"""Force and gas volume of the muscle (lengths in m, gauge pressure in Pa, force in N).

Units: SI, contraction q in mm.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

NOMINAL_LENGTH = 0.200
FIBRE_ANGLE = math.radians(25.0)
NOMINAL_DIAMETER = 0.020
FIBRE_LENGTH = NOMINAL_LENGTH / math.cos(FIBRE_ANGLE)
TURNS = NOMINAL_LENGTH * math.tan(FIBRE_ANGLE) / (math.pi * NOMINAL_DIAMETER)
FLOOR_BELOW = 1.757
"""Contraction in mm below which the pressure-free force is the constant -9.2101 N."""


def pressure_free_force(q: float) -> float:
    """Return phi in N at the contraction q in mm."""
    if q <= FLOOR_BELOW:
        return -9.2101
    return (((0.00045804 * q - 0.053424) * q + 2.0189) * q - 43.691) * q + 61.62


def clamp(x: float, width: float, law: float) -> float:
    """Return x clamped at zero from below, rounded over `width` newtons by the chosen law."""
    if law == 0:
        return 0.5 * (x + math.sqrt(x * x + width * width))
    if law == 1:
        z = x / width
        return x if z > 35 else (0.0 if z < -35 else width * math.log1p(math.exp(z)))
    return max(0.0, x)


def raw_force(s: float, pressure: float, p: SimpleNamespace) -> float:
    """Return the tension at fibre length s and gauge pressure before clamp and gain."""
    q = (NOMINAL_LENGTH - s) * 1e3
    raw = (280.0 - 2.2 * q + 0.033 * q * q) * pressure * 1e-5 + pressure_free_force(q)
    return float(raw * (1.0 + p.force_shape * (q / 30.0) ** 2))


def force(s: float, pressure: float, gain: float, p: SimpleNamespace) -> float:
    """Return the static tension at fibre length s and gauge pressure; never below zero."""
    clamped = clamp(raw_force(s, pressure, p), p.slack_width, p.slack_law)
    return float(p.force_gain * gain * clamped)


def volume(s: float) -> float:
    """Return the volume inside a muscle of fibre length s, its ends flattened."""
    d = math.sqrt(FIBRE_LENGTH**2 - s * s) / (math.pi * TURNS)
    d0 = NOMINAL_DIAMETER
    h = 0.5 * math.sqrt(d * d - d0 * d0) if d > d0 else 1e-7
    zone = math.pi * h / 6.0 * (0.75 * d * d + 0.75 * d0 * d0 + h * h)
    return 0.25 * math.pi * d * d * (s - 2.0 * h) + 2.0 * zone


def volume_slope(s: float) -> float:
    """Return dV/ds; the terms in dh/ds cancel because h^2 = (d^2 - d0^2)/4."""
    pitch = math.pi * TURNS
    d2 = (FIBRE_LENGTH**2 - s * s) / pitch**2
    d0 = NOMINAL_DIAMETER
    h = 0.5 * math.sqrt(d2 - d0 * d0) if d2 > d0 * d0 else 0.0
    return -0.5 * math.pi * s / pitch**2 * (s - h) + 0.25 * math.pi * d2
