"""A two-mass drive: motor, elastic shaft, load; a voltage in, two tachometers out.

Units: SI.
"""

from __future__ import annotations

from collections.abc import Sequence

from workbench.evaluation.foreign.excitation import machine
from workbench.evaluation.foreign.machine import Parameters, State, dead_zone, dry_friction


def _rates(_: float, x: State, u: Sequence[float], p: Parameters) -> State:
    twist, motor, load = x
    left = dead_zone(twist, p["backlash"])
    # Out of contact the shaft does not damp either.
    damped = p["shaft_damping"] * (motor - load) if left != 0.0 or p["backlash"] == 0.0 else 0.0
    shaft = p["stiffness"] * left + p["shaft_cubic"] * left**3 + damped
    at_motor = p["gain"] * u[0] - p["motor_drag"] * motor - shaft
    at_load = shaft - p["load_drag"] * load - p["fan"] * load * abs(load) - p["constant_load"]
    dry_motor = dry_friction(
        motor, at_motor, p["motor_coulomb"], inertia=p["motor_inertia"], stuck=0.02
    )
    dry_load = dry_friction(
        load,
        at_load,
        0.4 * p["load_stribeck"],
        break_away=p["load_stribeck"],
        fade=3.0,
        inertia=p["load_inertia"],
        stuck=0.02,
    )
    return [
        motor - load,
        (at_motor - dry_motor) / p["motor_inertia"],
        (at_load - dry_load) / p["load_inertia"],
    ]


DRIVE = machine("drive", _rates, lambda p: [0.0, 0.0, 0.0])
