"""The cascaded PID: its difference equation, anti-windup and design."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers import PIDSpecification, ValveInverse, cascade_pid, design_pid
from controllers.arithmetic import FLOATS
from controllers.joint.at_one_point import UNIT, LaggedReference
from controllers.joint.model import joint_model
from controllers.sensitivity import peak_sensitivities
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel

GAINS = {"proportional": 5e5, "integral": 2e6, "derivative": 1e5, "inner": 1e-6}

# Without filters the law is its textbook equation.
BARE = cascade_pid(
    **GAINS, derivative_filter=0.0, pressure_filter=0.0, reference_speed=0.0, tracking_time=0.1
)


def test_first_samples_by_hand() -> None:
    measured = (0.5, 4e5, 4e5)
    state = BARE.initial_state(measured)
    _, state, info = BARE.step(state, measured, (0.51,))
    # P 5e5 * 0.01, D 1e5 * 0.01 / 0.002
    assert info["asked_difference"] == pytest.approx(5e3 + 5e5)
    assert info["opening"] == pytest.approx(1e-6 * (5e3 + 5e5))
    assert state.integral == pytest.approx(0.002 * 2e6 * 0.01)
    _, state, info = BARE.step(state, measured, (0.51,))
    assert info["asked_difference"] == pytest.approx(5e3 + 40.0)


def test_command_is_the_inverse_of_the_opening() -> None:
    measured = (0.5, 4e5, 4e5)
    (command,), _, info = BARE.step(BARE.initial_state(measured), measured, (0.5005,))
    assert ValveInverse().opening(command) == pytest.approx(float(info["opening"]))


def test_start_is_bumpless_away_from_balance() -> None:
    measured = (0.7, 5e5, 3e5)
    for weight in (0.0, 1.0):
        pid = replace(
            BARE,
            tracking=LaggedReference(20.0, 0.0),
            setpoint_weight=weight,
            derivative_weight=weight,
        )
        state = pid.initial_state(measured)
        for _ in range(5):
            (command,), state, _ = pid.step(state, measured, (0.7,))
            assert command == pytest.approx(5.0, abs=1e-9)


def test_integral_stops_where_the_command_is_clipped() -> None:
    measured = (0.2, 4e5, 4e5)
    wound = replace(BARE, tracking_time=1e3)
    ends = []
    for pid in (BARE, wound):
        state = pid.initial_state(measured)
        for _ in range(2000):
            _, state, _ = pid.step(state, measured, (1.0,))
        ends.append(state.integral)
    # Back-calculation settles where Ki e = (v - u) / Tt: v exceeds the limit by 0.1 * 2e6 * 0.8.
    assert ends[0] == pytest.approx(6e5 + 1.6e5 - 5e5 * 0.8, rel=1e-3)
    assert ends[1] > 5 * ends[0]


def test_design_meets_its_limits_and_lowers_gains_for_tighter_ones(linear: LinearModel) -> None:
    gains = []
    for limit in (2.0, 1.6):
        pid = design_pid(linear, PIDSpecification(maximum_sensitivity=limit))
        ms, mt = peak_sensitivities(pid, linear)
        assert ms <= limit
        assert mt <= 1.6
        gains.append(pid.gains.at(UNIT, FLOATS).proportional)
    assert gains[1] < gains[0]


def test_design_places_the_poles_of_the_joint(linear: LinearModel) -> None:
    pid = design_pid(linear)
    joint, gains = joint_model(linear), pid.gains.at(UNIT, FLOATS)
    # s^3 + (a1 + b Kd) s^2 + (a0 + b Kp) s + b Ki: one real pole, one pair of damping 0.8.
    poles = np.roots(
        [
            1.0,
            joint.a1 + joint.b * gains.derivative,
            joint.a0 + joint.b * gains.proportional,
            joint.b * gains.integral,
        ]
    )
    pair = poles[np.abs(poles.imag) > 1e-6]
    assert len(pair) == 2
    assert -pair[0].real / abs(pair[0]) == pytest.approx(0.8, rel=1e-6)
    real = poles[np.abs(poles.imag) <= 1e-6][0].real
    assert -real / abs(pair[0]) == pytest.approx(0.6, rel=1e-6)


def test_impossible_limits_are_refused(linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match="no bandwidth"):
        design_pid(linear, PIDSpecification(maximum_sensitivity=1.05, maximum_complementary=1.0))


@pytest.mark.parametrize(
    ("name", "value"),
    [("proportional", -1.0), ("inner", 0.0), ("tracking_time", 0.0), ("integral", math.nan)],
)
def test_bad_gains_are_refused(name: str, value: float) -> None:
    with pytest.raises(WorkbenchError, match=name.split("_")[0]):
        cascade_pid(
            **{"proportional": 5e5, "integral": 2e6, "derivative": 1e5, "inner": 1e-6, name: value}
        )
