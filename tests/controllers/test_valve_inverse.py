"""The controllers' inverse valve curve against the plant's curve."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.valve_inverse import ValveInverse
from workbench.errors import WorkbenchError
from workbench.plants.arm.servovalve import MPYE, opening


def test_data_sheet_is_the_one_of_the_plant() -> None:
    valve = ValveInverse()
    assert valve.voltages == MPYE.voltage
    assert valve.fractions == MPYE.fraction


def test_plant_opens_as_commanded() -> None:
    valve = ValveInverse()
    for wanted in np.linspace(-1.0, 1.0, 401):
        command = valve.command(float(wanted))
        # Straight lines inverted by straight lines: only rounding remains.
        reached = float(opening(command - 5.0)) - float(opening(5.0 - command))
        assert reached == pytest.approx(wanted, abs=1e-12)
        assert valve.opening(command) == pytest.approx(wanted, abs=1e-12)


def test_beyond_full_opening_is_full_voltage() -> None:
    valve = ValveInverse()
    assert valve.command(3.0) == 10.0
    assert valve.command(-3.0) == 0.0


def test_linear_command_has_the_same_opening_on_the_tangent() -> None:
    valve = ValveInverse()
    # 0.002 at 0.1 V: the slope at rest is 0.02 per V, so a tenth is 5 V from the centre.
    assert valve.linear_command(valve.command(0.1)) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("voltages", "fractions"),
    [((0.0, 1.0), (0.0,)), ((0.0, 1.0, 1.0), (0.0, 0.1, 0.2)), ((0.1, 1.0), (0.0, 1.0))],
)
def test_a_curve_without_inverse_is_refused(
    voltages: tuple[float, ...], fractions: tuple[float, ...]
) -> None:
    with pytest.raises(WorkbenchError, match="inverted"):
        ValveInverse(voltages, fractions)
