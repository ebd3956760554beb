"""The arm with one valve per muscle against the arm with one valve for both."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.plants.arm.arm import two_valve_arm


@pytest.mark.parametrize("form", ["exact", "regularised"])
@pytest.mark.parametrize("spool", [-2.3, 0.0, 0.7, 4.0])
def test_opposite_commands_make_it_the_arm_with_one_valve(form: str, spool: float) -> None:
    one, two = arm(3), two_valve_arm(3)
    common = {
        "pressure_1": 3.2e5,
        "temperature_1": 280.0,
        "pressure_2": 4.9e5,
        "temperature_2": 301.0,
        "angle": 0.4,
        "speed": -0.3,
    }
    x_one = one.initial_state({"spool": spool, "spool_speed": 30.0, **common})
    x_two = two.initial_state(
        {
            "spool_1": spool,
            "spool_speed_1": 30.0,
            "spool_2": -spool,
            "spool_speed_2": -30.0,
            **common,
        }
    )
    rates_one = one.rates(x_one, [5.9], form=form)
    rates_two = two.rates(x_two, [5.9, 4.1], form=form)
    # The same laws with the same numbers: equal to rounding.
    np.testing.assert_allclose(rates_two[4:], rates_one[2:], rtol=1e-12)
    np.testing.assert_allclose(rates_two[:2], rates_one[:2], rtol=1e-12)
    np.testing.assert_allclose(rates_two[2:4], -rates_one[:2], rtol=1e-12)


def test_mean_pressure_is_held_where_one_valve_lets_it_drift() -> None:
    given = {"angle": math.radians(20.0), "mean_pressure": 3e5}
    point = operating_point(two_valve_arm(3), given)
    assert point.is_equilibrium
    assert point["pressure_1"] / 1e5 == pytest.approx(2.54, abs=0.01)
    assert point["pressure_2"] / 1e5 == pytest.approx(3.46, abs=0.01)
    drifting = operating_point(arm(3), {"angle": math.radians(20.0), "mean_pressure": 3e5})
    assert not drifting.is_equilibrium


def test_effects_attach_to_the_same_ports() -> None:
    plant = two_valve_arm(3, silencers=True, line_volumes=True)
    names = {port.name for port in plant.ports}
    missing = {port.name for port in arm(3).ports} - names
    assert missing == {"valve.command", "valve.spool"}
    assert {"valve_1.command", "valve_2.command", "valve_1.spool", "valve_2.spool"} <= names
