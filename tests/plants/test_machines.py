"""Plants of real machines against what can be said of them by hand."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from workbench.data_folder import shipped_folder
from workbench.plants.cascaded_tanks import FULL, cascaded_tanks
from workbench.plants.cylinder import cylinder
from workbench.plants.emps import emps
from workbench.plants.servo_pendulum import servo_pendulum
from workbench.simulation import simulate


def test_emps_moves_at_the_speed_at_which_friction_eats_the_force() -> None:
    case = tomllib.loads((shipped_folder() / "machines/emps/case.toml").read_text())
    published = case["published"]
    axis = emps().with_parameters(published)
    run = simulate(axis, np.full(4000, 100.0), sample_time=1e-3, check=False)
    speed = run["speed"][-1]
    # 100 N + 3.1648 N - 20.3935 N = 203.5034 N s/m v; the time constant is 0.47 s.
    assert speed == pytest.approx((100.0 + 3.1648 - 20.3935) / 203.5034, rel=1e-3)


def test_tanks_settle_where_the_flows_balance() -> None:
    tanks = cascaded_tanks()
    run = simulate(tanks, np.full(600, 2.0), sample_time=4.0, check=False)
    # Without bends: a u = b sqrt(x / 10).
    level = FULL * (0.04 * 2.0 / 0.15) ** 2
    assert run["upper_level"][-1] == pytest.approx(level, rel=1e-2)
    assert run["lower_level"][-1] == pytest.approx(level, rel=1e-2)


def test_a_tank_that_overflows_stays_near_its_rim_and_the_sensor_at_its_end() -> None:
    tanks = cascaded_tanks().with_parameters({"overflow.rim": 12.0, "overflow.weir": 1.0})
    run = simulate(tanks, np.full(300, 10.0), sample_time=4.0, check=False)
    # The spill is what the pump brings beyond the outflow, over the weir's rate.
    spill = 0.04 * 10.0 - 0.15 * np.sqrt(run["upper_level"][-1] / FULL)
    assert run["upper_level"][-1] == pytest.approx(12.0 + spill, abs=0.02)
    assert run.outputs[-1, 0] == pytest.approx(FULL, abs=0.02)


def test_a_cylinder_needs_more_force_inwards_by_twice_its_friction() -> None:
    model = cylinder()
    forces = []
    for speed in (-0.01, 0.01):
        inputs = np.tile([speed, 5e5], (400, 1))
        run = simulate(model, inputs, sample_time=0.01, start={"rod_force": 245.0}, check=False)
        forces.append(run.outputs[-1, 0])
    # 3 N + 1e-5 N/Pa 5e5 Pa + 100 N s/m 0.01 m/s
    assert 0.5 * (forces[0] - forces[1]) == pytest.approx(9.0, rel=1e-3)
    assert 0.5 * (forces[0] + forces[1]) == pytest.approx(4.909e-4 * 5e5, rel=1e-3)


def test_a_free_pendulum_swings_at_its_own_frequency() -> None:
    model = servo_pendulum().without(
        "coulomb_friction", "viscous_friction", "stribeck_friction", "gear_friction"
    )
    model = model.with_parameters({"rotor_inertia": 0.0})
    off = np.tile([0.0, 400.0, 7.4, 0.0], (1500, 1))
    run = simulate(model, off, sample_time=2e-3, start={"angle": 0.05}, check=False)
    crossings = np.flatnonzero(np.diff(np.sign(run["angle"]))) * 2e-3
    half = np.mean(np.diff(crossings))
    assert half == pytest.approx(np.pi * np.sqrt(0.1 / 9.81), rel=2e-3)


def test_a_servo_at_full_duty_holds_what_its_motor_can() -> None:
    model = servo_pendulum().without("stribeck_friction", "gear_friction", "coulomb_friction")
    model = model.with_parameters({"viscous_friction.coefficient": 0.2})
    full = np.tile([3.0, 800.0, 5.0, 1.0], (3000, 1))
    run = simulate(model, full, sample_time=2e-3, check=False)
    # 0.08 N m/V 5 V = 0.49 kg 9.81 m/s2 0.1 m sin(angle)
    assert run["angle"][-1] == pytest.approx(np.arcsin(0.4 / (0.49 * 0.981)), rel=5e-3)
