"""Friction: limits at high speed, steady curves, presliding, proportionality."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.machines import machine
from tests.physics.effects.bench import bench, offered, read, run, triangle
from workbench.model import Model, Scope
from workbench.physics.friction import (
    coulomb_friction,
    lugre_friction,
    stribeck_friction,
    viscous_friction,
)
from workbench.physics.library import library


def test_stribeck_adds_to_coulomb_at_low_speed_and_fades() -> None:
    coulomb = bench(coulomb_friction("joint.torque", level=0.3), "N m", "speed")
    both = coulomb.with_effect(
        stribeck_friction("joint.torque", break_away=1.2, stribeck_speed=0.1)
    )

    def friction(v: float) -> float:
        return -read(both, speed=v)

    # Beyond the transition of tanh: e^-1 of the break-away is left at the Stribeck speed.
    assert friction(0.1) == pytest.approx(0.3 + 1.2 * np.exp(-1.0), rel=1e-3)
    assert friction(1.0) == pytest.approx(0.3, rel=1e-6)
    assert friction(0.06) > friction(0.1) > friction(0.2)
    assert friction(-0.1) == pytest.approx(-friction(0.1))
    assert max(friction(v) for v in np.linspace(0, 0.2, 200)) > 1.2


def test_a_stribeck_curve_of_its_own_keeps_a_share_at_high_speed() -> None:
    whole = bench(
        stribeck_friction("joint.torque", break_away=1.2, stribeck_speed=0.1, coulomb_share=0.4),
        "N m", "speed",
    )  # fmt: skip
    assert -read(whole, speed=1.0) == pytest.approx(0.4 * 1.2, rel=1e-6)
    expected = 1.2 * (0.4 + 0.6 * np.exp(-1.0))
    assert -read(whole, speed=0.1) == pytest.approx(expected, rel=1e-3)
    # It is fitted only where no other dry friction takes it.
    for rubs in (viscous_friction("joint.torque", coefficient=0.1),
                 coulomb_friction("joint.torque", level=0.3)):  # fmt: skip
        (law,) = (
            e.effect for e in library(bench(rubs, "N m", "speed")) if e.law == "stribeck_friction"
        )
        assert {q.name: q.fitted for q in law.parameters}["coulomb_share"] == (not rubs.dry)


def lugre_run(turns: list[float], speed: float, **changes: float) -> np.ndarray:
    effect = lugre_friction(
        "joint.torque", level=0.4, presliding=2e-3, stribeck_share=0.5, **changes
    )
    path, _, times = triangle(turns, speed)
    return -run(bench(effect, "N m", "speed"), path, times)


def test_lugre_follows_its_steady_curve() -> None:
    for speed in (0.02, 0.1, 0.3):
        force = lugre_run([0.0, 50 * (2e-3 + speed / 1000)], speed)
        assert force[-1] == pytest.approx(0.4 * (1 + 0.5 * np.exp(-((speed / 0.1) ** 2))), rel=1e-3)


def test_lugre_is_a_spring_in_presliding() -> None:
    force = lugre_run([0.0, 2e-5], 1e-4)
    # One per cent of the presliding distance bends the bristles by 1 % less the first slip.
    assert force[-1] == pytest.approx(0.4 / 2e-3 * 2e-5, rel=0.01)


def test_lugre_damping_acts_on_the_bristle_only() -> None:
    still = lugre_run([0.0, 0.2], 0.05)
    damped = lugre_run([0.0, 0.2], 0.05, damping_time=0.01)
    assert damped[-1] == pytest.approx(still[-1], rel=1e-4)
    assert damped[0] == pytest.approx(0.4 * 0.01 * 0.05 / (2e-3 + 0.05 / 1000), rel=1e-6)


def test_lugre_dissipates_in_a_cycle() -> None:
    turns = [0.0, 0.01, -0.01, 0.01]
    force = lugre_run(turns, 0.05)
    q = np.interp(np.arange(len(force)), np.arange(4) * 80, turns)
    assert np.trapezoid(force[80:], q[80:]) > 0.0


def carousel() -> Model:
    """A turntable with a mass on a rail, which nothing but a torque moves round; no port."""

    def equations(m: Scope) -> dict[str, Any]:
        inertia = m.p.table + 2.0 * m.x.radius**2
        torque = m.u.torque - 0.1 * m.x.turning - 4.0 * m.x.radius * m.u.pull * m.x.turning
        return {"turning": torque / inertia, "radius": m.u.pull}

    return machine(
        equations,
        "turning rad/s scale=1, radius m 0.1 scale=0.3",
        "torque N m scale=1, pull m/s scale=0.1",
        "turning rad/s scale=1",
        "table kg m2 0.3 0.1 1",
    )


def test_friction_is_a_torque_whatever_it_turns() -> None:
    for table in (0.3, 0.6):
        model = carousel().with_parameters({"table": table})
        law = offered(model, "quadratic_drag")
        braked = model.with_effect(law.at_size(0.05))
        other = offered(braked, "cubic_drag")
        twice = braked.with_effect(other.at_size(0.02))
        for radius in (0.1, 0.4):
            x = model.initial_state({"turning": 0.9, "radius": radius})
            free, once, both = (float(m.rates(x, [0.2, 0.0])[0]) for m in (model, braked, twice))
            share = (table + 2.0 * 0.1**2) / (table + 2.0 * radius**2)
            assert free - once == pytest.approx(0.05 * 0.9**2 * share)
            assert once - both == pytest.approx(0.02 * 0.9**3 * share)
