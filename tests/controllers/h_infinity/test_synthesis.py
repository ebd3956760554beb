"""The H-infinity synthesis: its norm by frequency responses, its law, and the full plant."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest

from controllers.h_infinity import synthesis
from controllers.h_infinity.controller import HInfinity, HInfinitySpecification, design_h_infinity
from controllers.h_infinity.synthesis import Weights, joint_behind_pressure_loop, synthesise
from controllers.joint.model import JointModel
from controllers.joint.schedule import JointSchedule
from controllers.sensitivity import frequencies, loops_at, peak_sensitivities, peaks_of
from tests.controllers.families import assert_settles, moves
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.verification import metrics, verify

if not synthesis.has_slycot():
    pytest.skip("slycot is not installed", allow_module_level=True)

JOINT = JointModel(b=1.6e-4, a1=1.5, a0=96.0, g=3.5e7, e=6.2e5, d=0.8)
WEIGHTS = Weights(25.0)
BANDWIDTH, DELAY = 120.0, 0.004
PLANT = joint_behind_pressure_loop(JOINT, BANDWIDTH, DELAY)


@pytest.fixture(scope="module")
def found() -> HInfinity:
    return synthesise(PLANT, WEIGHTS)


@pytest.fixture(scope="module")
def law(schedule: JointSchedule) -> HInfinity:
    return design_h_infinity(schedule, HInfinitySpecification(speed=25.0))


def test_weighted_norms_are_below_gamma(found: HInfinity) -> None:
    # Independent route: transfer functions by hand, no state space, no generalised plant.
    w = np.geomspace(1e-3, 1e4, 4000)
    s = 1j * w
    late = (1.0 - 0.5 * DELAY * s) / (1.0 + 0.5 * DELAY * s)
    joint = 1.0 / (s**2 + JOINT.a1 * s + JOINT.a0)
    # dc/dt = v (late u - c) - e b s x,  x = joint (c + d)
    inner = 1.0 / (s + BANDWIDTH)
    back = 1.0 + joint * inner * JOINT.e * JOINT.b * s
    from_u = joint * inner * BANDWIDTH * late / back
    from_d = joint / back
    A, B, C, D = found.continuous
    K = np.array([(C @ np.linalg.solve(si * np.eye(len(A)) - A, B) + D)[0, 0] for si in s])
    S = 1.0 / (1.0 + from_u * K)
    u0 = WEIGHTS.speed
    w1 = (s / WEIGHTS.peak + u0) / (s + WEIGHTS.floor * u0)
    w2 = 1.0 / (WEIGHTS.input_size * u0**2)
    edge = WEIGHTS.roll_off * u0
    w3 = (s + edge / WEIGHTS.complementary_peak) / (WEIGHTS.complementary_floor * s + edge)
    d = WEIGHTS.disturbance * u0**2
    blocks = np.array(
        [
            [w1 * S, -w1 * from_d * d * S],
            [w2 * K * S, -w2 * K * from_d * d * S],
            [w3 * from_u * K * S, w3 * from_d * d * S],
        ]
    )
    norm = np.linalg.norm(np.moveaxis(blocks, 2, 0), ord=2, axis=(1, 2)).max()
    # The grid is finer here: another maximum by 0.1 % at most.
    assert norm == pytest.approx(found.norm, rel=1e-3)
    assert norm <= 1.03 * found.gamma * 1.001
    # each block by itself: the promises about S, K S and T
    for row, weight in ((S, w1), (K * S, w2), (from_u * K * S, w3)):
        assert np.all(np.abs(row) <= found.norm * 1.001 / np.abs(weight))
    # no smaller gamma: with the whole controller the norm is gamma
    assert found.norm >= found.gamma * 0.999


def test_order_is_reduced_and_the_sampled_controller_agrees(found: HInfinity) -> None:
    assert len(found.A) < found.full_order
    assert np.abs(np.linalg.eigvals(found.A)).max() < 1.0
    w = np.geomspace(1.0, 60.0, 20)
    sampled = ct.ss(found.A, found.B, found.C, found.D, 0.002)(np.exp(0.002j * w))
    continuous = ct.ss(*found.continuous)(1j * w)
    # Tustin's rule bends frequencies by (w h)^2 / 12, 0.1 % at 60 rad/s
    np.testing.assert_allclose(np.ravel(sampled), np.ravel(continuous), rtol=0.01)


def test_a_faster_wish_costs_a_larger_norm() -> None:
    assert synthesise(PLANT, Weights(35.0)).gamma > synthesise(PLANT, Weights(15.0)).gamma


def test_steps_on_the_plant(law: HInfinity, plant_with_hysteresis: Model) -> None:
    steps = moves((0.1, 1.1, 2.1), 20, 35, 50, 20, duration=3.1, settle=0.3)
    assert_settles(law, plant_with_hysteresis, steps, 0.45)


def test_margins_and_linear_model(law: HInfinity, linear_by_opening: LinearModel) -> None:
    ms, mt = peak_sensitivities(law, linear_by_opening)
    assert ms < 2.0
    assert mt < 1.9
    # one sample late is worse, and stable
    loop = loops_at(law, linear_by_opening, [(law.sample_time, 0.0)])[0]
    late = peaks_of(loop, frequencies()).sensitivity
    assert ms < late < 4.0
    step = moves((0.1,), 28, 31, duration=1.0).without_imperfections()
    run = verify(law, linear_by_opening, step)
    assert metrics(run)["steady_error"].value < math.radians(0.05)


def test_anti_windup_forgets(law: HInfinity) -> None:
    # With the valve fully open the state comes to rest in some 1 / w; without anti-windup it
    # would go on integrating an error of half a radian.
    at = (0.5, 4e5, 4e5)
    state = law.initial_state(at)
    for _ in range(500):
        _, state, info = law.step(state, at, (1.0,))
    assert info["opening"] == 1.0
    held = np.array(state.controller)
    for _ in range(500):
        _, state, info = law.step(state, at, (1.0,))
    np.testing.assert_allclose(state.controller, held, rtol=0.02, atol=1e-3 * np.abs(held).max())
    observer = np.array(law.A) - np.outer(law.L, law.C)
    assert np.abs(np.linalg.eigvals(observer)).max() == pytest.approx(
        math.exp(-25.0 * law.sample_time), rel=1e-6
    )


def test_absent_slycot_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthesis.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(WorkbenchError, match=r"pip install 'muscle-arm-workbench\[hinf\]'"):
        synthesise(PLANT, WEIGHTS)


def test_wrong_weights_are_named() -> None:
    with pytest.raises(WorkbenchError, match="speed of the performance weight"):
        Weights(0.0)
