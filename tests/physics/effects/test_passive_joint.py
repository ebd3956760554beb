"""What rubs in a joint that no command works on, beside a SciPy reference with a mass matrix."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.machines import machine
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.physics.friction import joint_drag, joint_friction
from workbench.physics.library import library
from workbench.physics.parameter_arguments import joint_dampings
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.survey import Survey

CART, BOB, LENGTH, DAMPING, HINGE = 1.1, 0.25, 0.4, 4.0, 0.01


def crane() -> Model:
    """A trolley with a hanging load, its accelerations solved for by hand."""

    def equations(m: Scope) -> dict[str, Any]:
        s, c = ca.sin(m.x.angle), ca.cos(m.x.angle)
        turn = m.p.hinge * m.x.rate
        push = m.u.force - m.p.damping * m.x.speed
        a = (push + BOB * s * (LENGTH * m.x.rate**2 + 9.81 * c) + turn * c / LENGTH) / (
            CART + BOB * s * s
        )
        swing = -(9.81 * s + a * c) / LENGTH - turn / (BOB * LENGTH**2)
        return {"place": m.x.speed, "speed": a, "angle": m.x.rate, "rate": swing}

    return machine(
        equations,
        "place m, speed m/s, angle rad, rate rad/s",
        "force N",
        "place m, angle rad",
        f"damping N s/m {DAMPING} 0 40, hinge N m s/rad {HINGE} 0 0.2",
    )


def test_only_the_joint_without_a_command_is_offered_them() -> None:
    """What rubs under the trolley acts where the command does."""
    joints = [h.name for h in library(crane()) if h.name.startswith("joint_")]
    assert {"joint_friction_hinge", "joint_drag_hinge"} <= set(joints)
    assert not any("damping" in name for name in joints)
    ((q, places, speed),) = joint_dampings(Survey(crane()))
    assert q.name == "hinge"
    assert [at.name for at in places] == ["speed.rate", "rate.rate"]
    assert speed.source == "rate"


@pytest.mark.parametrize("dry", [True, False])
def test_it_turns_both_bodies(dry: bool) -> None:
    """The reference has M q'' = forces with the torque of the joint at the load alone."""

    def torque(w: float) -> float:
        more = 0.05 * np.tanh(w / 0.1) if dry else 0.02 * w * abs(w)
        return float(-HINGE * w - more)

    def reference(t: float, x: np.ndarray) -> np.ndarray:
        _, v, q, w = x
        coupling = BOB * LENGTH * np.cos(q)
        mass = [[CART + BOB, coupling], [coupling, BOB * LENGTH**2]]
        pushed = 3.0 * np.sin(4.0 * t) - DAMPING * v + BOB * LENGTH * w * w * np.sin(q)
        turned = torque(w) - BOB * 9.81 * LENGTH * np.sin(q)
        a, b = np.linalg.solve(mass, [pushed, turned])
        return np.array([v, a, w, b])

    effect = (
        joint_friction(level=0.05, transition_speed=0.1) if dry else joint_drag(coefficient=0.02)
    )
    model = crane().with_effect(effect)
    start = [0.0, 0.0, 0.6, 0.0]

    def of(plant: Model) -> np.ndarray:
        return ended(lambda t, x: plant.rates(x, [3.0 * np.sin(4.0 * t)]))

    def ended(f: Callable[[float, np.ndarray], np.ndarray]) -> np.ndarray:
        return solve_ivp(f, (0.0, 2.0), start, rtol=1e-9, atol=1e-11).y[:, -1]

    np.testing.assert_allclose(of(model), ended(reference), atol=1e-6)
    assert np.max(np.abs(of(crane()) - ended(reference))) > 1e-2


@pytest.mark.parametrize("bends", [0.0, 5.0])
def test_what_rubs_between_a_wheel_and_the_body_that_drives_it_acts_as_the_damping(
    bends: float,
) -> None:
    """Where the ratio of what it does to them turns with the tilt, it is no exchange of theirs."""

    def equations(m: Scope) -> Equations:
        sliding = m.x.speed / 0.03 - m.x.rate
        torque = m.u.torque - m.p.bearing * sliding
        turned = (70.0 + bends * ca.sin(m.x.tilt)) * torque
        rates = {"speed": torque / 0.03 + 2.0 * m.x.tilt, "rate": 90.0 * m.x.tilt - turned}
        return rates | {"tilt": m.x.rate, "way": m.x.speed}

    states = "tilt rad, rate rad/s, way m, speed m/s"
    bearing = "bearing N m s/rad 5e-4 0 0.01"
    robot = machine(equations, states, "torque N m", "tilt rad, way m", bearing)
    seen = RecordedFacts(ranges={"argument of bearing": (-20.0, 20.0)})
    offered = {h.name: h for h in library(robot, seen)}
    if bends:
        assert {"joint_friction_bearing", "joint_drag_bearing"} < offered.keys()
        rubbing = robot.with_effect(offered["joint_friction_bearing"].at_size(0.005))
    else:
        # The torque is told by what it does to the rate of the tilt.
        law = offered["coulomb_friction_rate_speed"]
        rubbing = robot.with_effect(law.at_size(70.0 * 0.005))
    state = [0.1, 0.5, 0.0, 0.3]
    # 0.3 / 0.03 - 0.5 rad/s is far beyond where the reversal is rounded.
    expected = robot.rates(state, [0.04 - 0.005])
    np.testing.assert_allclose(rubbing.rates(state, [0.04]), expected, rtol=1e-9)
