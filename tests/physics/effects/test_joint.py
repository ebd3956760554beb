"""Effects of the joint against the arm itself, and against their defining properties."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.machines import machine
from tests.physics.effects.bench import bench, read, response, run
from workbench.physics.creep import maxwell_element
from workbench.physics.delay import elastic_drive
from workbench.physics.stiffness import (
    unbalanced_mass,
)
from workbench.plants.arm import arm
from workbench.plants.arm.joint import ArmBody
from workbench.plants.arm.laws import load_error, loose_load, tilt_gravity

TORQUE = "joint.torque"
MOVING = {"angle": 0.6, "speed": 0.7, "pressure_1": 5e5, "pressure_2": 3e5}


@pytest.mark.parametrize("plane", ["horizontal", "vertical"])
def test_an_error_of_one_kilogram_is_an_arm_with_one_more(plane) -> None:
    vertical = plane == "vertical"
    ports = ("joint.inertia", "joint.torque") if vertical else ("joint.inertia",)
    wrong = arm(3.0, plane=plane).with_effect(
        load_error([ports], mass=1.0, gravity_share=float(vertical))
    )
    right = arm(4.0, plane=plane)
    x = right.initial_state(MOVING)
    np.testing.assert_allclose(wrong.rates(x, [5.5]), right.rates(x, [5.5]), rtol=1e-9)


def test_gravity_on_a_mass_beside_the_axis_is_that_of_the_upright_arm() -> None:
    """Its two parameters follow from the arm's torque at two angles and give that at any other."""
    torque = lambda angle: -ArmBody().gravity_torque(angle, 3.0)  # noqa: E731
    at_zero, at_right = float(torque(0.0)), float(torque(0.5 * math.pi))
    law = unbalanced_mass(
        "joint.torque",
        moment=math.hypot(at_zero, at_right),
        phase=math.atan2(at_zero, at_right),
    )
    model = bench(law, "N m", "angle")
    for angle in (-0.4, 0.3, 2.0):
        assert read(model, angle=angle) == pytest.approx(float(torque(angle)), rel=1e-9)


@pytest.mark.parametrize("motor", [False, True], ids=["the load is read", "the motor is read"])
def test_two_bodies_and_a_spring_are_one_body_behind_an_elastic_drive(motor: bool) -> None:
    """Motor 0.8 kg in a bearing of 4 N s/m, load 0.9 kg, between them 2200 N/m and 2 N s/m."""
    m1, m2, k, d, b = 0.8, 0.9, 2200.0, 2.0, 4.0
    whole, frequency = m1 + m2, math.sqrt(k / m1 + k / m2)

    def equations(m):
        force = m.port("body.force", m.u.drive - b * m.x.v, unit="N", signals={"speed": m.x.v})
        return {"v": force / whole}

    body = machine(equations, "v m/s", "drive N", "v m/s")
    law = elastic_drive(
        "body.force",
        share=-m2 / m1 if motor else 1.0,
        frequency=frequency,
        damping=0.5 * d / k * frequency,
        compliance=0.0 if motor else m2 / (k * whole),
    )
    sprung = body.with_effect(law)
    found = sprung.exact.jacobian_function(np.zeros(3), [0.0], sprung.values)
    a, by_drive, *_ = map(np.asarray, found)
    # Speeds of motor and load, and how far the one is ahead.
    two = np.array([[-(b + d) / m1, d / m1, -k / m1], [d / m2, -d / m2, k / m2], [1.0, -1.0, 0.0]])
    for s in (0.3j, 30j, 1.02j * frequency, 2000j):
        read = np.linalg.solve(s * np.eye(3) - a, by_drive)[0, 0]
        true = np.linalg.solve(s * np.eye(3) - two, [1.0 / m1, 0.0, 0.0])[0 if motor else 1]
        assert read == pytest.approx(true, rel=1e-9)


def test_tilt_by_a_right_angle_is_the_vertical_plane() -> None:
    # The tilt is bounded to half a radian; its sine is scaled up by hand.
    x = arm(3.0).initial_state(MOVING)
    speed = arm(3.0).rates(x, [5.0])[-1]
    tilted = arm(3.0).with_effect(tilt_gravity(tilt=0.3)).rates(x, [5.0])[-1]
    upright = arm(3.0, plane="vertical").rates(x, [5.0])[-1]
    assert (tilted - speed) / math.sin(0.3) == pytest.approx(upright - speed, rel=1e-9)


def test_turned_along_with_the_arm_a_tilt_pulls_as_hard() -> None:
    def torque(angle: float, direction: float) -> float:
        at = {"angle": angle}
        model = arm(3.0).with_effect(tilt_gravity(tilt=0.1, direction=direction))
        level, tilted = (m.rates(m.initial_state(at), [5.0])[-1] for m in (arm(3.0), model))
        return float(tilted - level)

    assert torque(0.7, 0.3) == pytest.approx(torque(0.4, 0.0), rel=1e-9)
    assert torque(0.7, 0.3) != pytest.approx(torque(0.7, 0.0), rel=0.01)


def test_a_loose_load_that_moves_along_leaves_the_arm_as_it_is() -> None:
    """Where the load has the arm's own acceleration, its coupling replaces its inertia."""
    base = arm(3.0)
    x = base.initial_state(MOVING)
    acceleration = base.rates(x, [5.0])[-1]
    frequency = 40.0
    model = base.with_effect(loose_load(frequency=frequency, damping=0.0))
    # The spring is bent so that it gives the load just that acceleration.
    bent = model.initial_state({**MOVING, "loose_load.angle": 0.6 - acceleration / frequency**2})
    rates = dict(zip([q.name for q in model.states], model.rates(bent, [5.0]), strict=True))
    assert rates["loose_load.speed"] == pytest.approx(acceleration, rel=1e-9)
    # The radius of gyration is given to four digits.
    assert rates["speed"] == pytest.approx(acceleration, rel=1e-3)


def test_a_loose_load_starts_with_the_arm() -> None:
    model = arm(3.0).with_effect(loose_load())
    x = dict(zip([q.name for q in model.states], model.initial_state(MOVING), strict=True))
    assert (x["loose_load.angle"], x["loose_load.speed"]) == (0.6, 0.7)


def test_a_maxwell_element_holds_a_step_at_first_and_lets_go_of_it() -> None:
    effect = maxwell_element(("spring.force",), stiffness=3e3, time_constant=0.2)
    times = np.linspace(0.0, 1.0, 501)
    held = run(
        bench(effect, "N", "coordinate"), lambda t: {"coordinate": 0.01 if t > 0 else 0.0}, times
    )
    np.testing.assert_allclose(held[1:], -30.0 * np.exp(-times[1:] / 0.2), atol=0.35)
    assert held[-1] == pytest.approx(-30.0 * math.exp(-5.0), abs=0.01)


@pytest.mark.parametrize("frequency", [0.5, 5.0, 50.0])
def test_a_maxwell_element_is_a_damper_when_slow_and_a_spring_when_quick(frequency: float) -> None:
    effect = maxwell_element(("spring.force",), stiffness=3e3, time_constant=0.2)
    model = bench(effect, "N", "coordinate")
    turned = replace(model, inputs=(model.inputs[1], model.inputs[0]))
    s = 1j * frequency
    exact = -3e3 * 0.2 * s / (0.2 * s + 1.0)
    assert response(turned, frequency) == pytest.approx(exact, rel=1e-9)
