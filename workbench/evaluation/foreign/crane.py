"""A cart with a load that hangs from it: a motor voltage in, position and angle out.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.evaluation.foreign.excitation import machine
from workbench.evaluation.foreign.machine import Array, Parameters, State, dry_friction

GRAVITY = 9.81
JUMP = 8.0
"""When the grease runs out, in s."""


def _rates(t: float, x: State, u: Sequence[float], p: Parameters) -> State:
    place, speed, angle, turn = x
    m, length = p["load"], p["length"]
    viscous = p["drag"] * (1.0 + (p["grease"] if t > JUMP else 0.0))
    force = p["gain"] * u[0] - viscous * speed - p["slope"] - p["chain"] * place
    pivot = -p["pivot_drag"] * turn - p["air_drag"] * turn * abs(turn)
    pivot -= dry_friction(turn, 0.0, p["pivot_friction"], inertia=m * length**2, stuck=2e-3)
    # The load pulls at the cart; both accelerations from two linear equations.
    c, s = math.cos(angle), math.sin(angle)
    pulled = pivot / length - m * GRAVITY * s
    mass = p["cart"] + m * (1.0 - c * c)
    pushed = force + m * length * turn**2 * s - c * pulled
    dry = dry_friction(
        speed,
        pushed,
        p["rail_friction"] + 0.4 * p["rail_stribeck"],
        break_away=p["rail_stribeck"],
        fade=0.05,
        inertia=mass,
        stuck=1e-3,
    )
    acceleration = (pushed - dry) / mass
    return [speed, acceleration, turn, (pulled / m - acceleration * c) / length]


def _position_loop(reference: Array, now: Array, last: Array) -> Array:
    speed = (now[0] - last[0]) / 0.02
    volt = 14.0 * (reference[0] - now[0]) - 4.0 * speed
    return np.array([min(7.0, max(-7.0, volt))])


CRANE = machine("crane", _rates, lambda p: [0.0, 0.0, 0.0, 0.0], _position_loop)
