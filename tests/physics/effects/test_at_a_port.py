"""What comes out of a port for what is there, by laws without a memory."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.physics.effects.bench import bench, read
from workbench.model import Effect
from workbench.physics.force_laws import Sarosi
from workbench.physics.friction import (
    direction_dependent_friction,
    direction_dependent_viscous,
    load_dependent_friction,
    muscle_viscosity,
    quadratic_drag,
    transmission_friction,
)
from workbench.physics.offset_gain import asymmetric_gain, gain, offset
from workbench.physics.saturation import (
    dead_band,
    lower_saturation,
    rectification,
    saturation,
    upper_saturation,
)
from workbench.physics.stiffness import (
    cubic_stiffness,
    linear_spring,
    local_catch,
    local_friction,
    ripple,
    stop_compliance,
)
from workbench.plants.arm.laws import (
    contraction_force_correction,
    force_shape,
    pressure_force_correction,
)

READ, JOINT, TENSION = ("p.reading",), "joint.torque", ("muscle.tension",)
BOTH = (1.0, -1.0)

LAWS: tuple[tuple[Effect, str, dict[str, Any], Any], ...] = (
    (offset(READ, amount=0.2), "V", {"value": 1.0}, 1.2),
    (gain(READ, excess=-0.1), "V", {"value": 2.0}, 1.8),
    (asymmetric_gain("valve.spool", difference=0.2), "V", {"value": BOTH}, (1.1, -0.9)),
    (dead_band("valve.spool", half_width=0.2, centre=5.0), "V",
     {"value": (4.81, 5.0, 5.19, 6.0, 4.0)}, (5.0, 5.0, 5.0, 5.8, 4.2)),
    (saturation(READ, limit=4e5), "Pa", {"value": (3e5, 5e5, -5e5)}, (3e5, 4e5, -4e5)),
    (saturation(READ, limit=4e5, share=0.5), "Pa", {"value": 5e5}, 4.5e5),
    (lower_saturation(READ, limit=1e5), "Pa", {"value": (0.0, 3e5)}, (1e5, 3e5)),
    (upper_saturation(READ, limit=1e5), "Pa", {"value": (-3e5, 3e5)}, (-3e5, 1e5)),
    (rectification(("pump.flow",)), "m3/s", {"value": (-2.0, 3.0)}, (0.0, 3.0)),
    (ripple(JOINT, amplitude=0.4, frequency=12.0, phase=0.5), "N m",
     {"angle": (0.1, 0.7)}, (0.4 * math.sin(1.7), 0.4 * math.sin(8.9))),
    (local_catch(JOINT, height=0.6, centre=0.5, width=0.05), "N m",
     {"angle": (0.5, 0.55, 0.8), "speed": 0.0}, (0.6, 0.6 * math.exp(-1.0), 0.0)),
    (local_friction(JOINT, level=0.6, centre=0.5, width=0.05), "N m",
     {"angle": 0.5, "speed": BOTH}, (-0.6, 0.6)),
    (linear_spring(JOINT, stiffness=2.0, rest=0.5), "N m",
     {"angle": (0.3, 0.5, 0.7)}, (0.4, 0.0, -0.4)),
    (cubic_stiffness(JOINT, stiffness=2.0, rest=0.5), "N m",
     {"angle": (0.3, 0.5, 0.7, 0.9)}, (0.016, 0.0, -0.016, -0.128)),
    (stop_compliance(("lower_stop.torque",), stiffness=50.0, thickness=0.05), "N m",
     {"penetration": (-0.06, -0.03, 0.0)}, (0.0, 1.0, 2.5)),
    (quadratic_drag(JOINT, coefficient=0.1), "N m",
     {"speed": (*BOTH, 2.0, -2.0)}, (-0.1, 0.1, -0.4, 0.4)),
    # Beside a damper of 0.5 that is 0.6 forwards and 0.4 backwards.
    (direction_dependent_viscous(JOINT, difference=0.2), "N m", {"speed": BOTH}, -0.1),
    (direction_dependent_friction(JOINT, difference=0.4), "N m",
     {"speed": (*BOTH, 0.0)}, (-0.2, -0.2, 0.0)),
    (load_dependent_friction(JOINT, coefficient=1e-3), "N m",
     {"speed": 0.5, "force_1": (300.0, 600.0, -1.0), "force_2": (200.0, 400.0, -50.0)},
     (-0.5, -1.0, 0.0)),
    # Less comes out on its way out, and more takes part on its way back.
    (transmission_friction("cable.command", share=0.2), "N",
     {"value": (10.0, 10.0, -10.0), "speed": (*BOTH, 1.0)},
     (10.0 * math.exp(-0.2), 10.0 * math.exp(0.2), -10.0 * math.exp(0.2))),
    (muscle_viscosity(("muscle.force",), coefficient=300.0, growth=1e-6), "N",
     {"contraction_speed": 0.1, "gauge_pressure": (0.0, 5e5)}, (-30.0, -45.0)),
    (contraction_force_correction(TENSION, gain=0.2), "N",
     {"value": 100.0, "contraction": (0.0, 0.015, 0.03)}, (80.0, 100.0, 120.0)),
    (pressure_force_correction(TENSION, gain=0.1), "N",
     {"value": 100.0, "gauge_pressure": (0.0, 3e5, 6e5)}, (90.0, 100.0, 110.0)),
    # The whole share is the other law.
    (force_shape(TENSION, share=1.0), "N",
     {"value": 123.0, "contraction": (0.0, 0.02), "gauge_pressure": (2e5, 5e5)},
     [float(Sarosi().tension(q, p)) for q, p in ((0.0, 2e5), (0.02, 5e5))]),
)  # fmt: skip


@pytest.mark.parametrize(
    ("law", "unit", "given", "expected"), LAWS, ids=[law.name for law, *_ in LAWS]
)
def test_what_comes_out_is_that_of_the_equation(
    law: Effect, unit: str, given: dict[str, Any], expected: Any
) -> None:
    model = bench(law, unit, *(name for name in given if name != "value"))
    *rows, wanted = np.broadcast_arrays(*given.values(), expected)
    seen = [
        read(model, **dict(zip(given, row, strict=True)))
        for row in zip(*(row.ravel().tolist() for row in rows), strict=True)
    ]
    np.testing.assert_allclose(seen, wanted.ravel(), rtol=1e-9, atol=1e-12)
