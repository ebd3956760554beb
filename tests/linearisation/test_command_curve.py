"""The static curve of a command, read off the equations."""

from __future__ import annotations

import numpy as np
import pytest

from tests.machines import machine
from workbench.linearisation.command_curve import CommandCurve, command_curves
from workbench.model import Model, Scope
from workbench.model.regularisation import Expression
from workbench.model.trace import Equations
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis


def bath(power: str = "square") -> Model:
    """A bath that a voltage heats, directly or behind the lag of its supply."""

    def equations(m: Scope) -> Equations:
        x, u = m.x, m.u.volts
        heat: Expression = {
            "square": u**2,
            "lag": x.supply**2,
            "straight": 115.0 * u,
            "by state": u * (115.0 + u * (x.temperature - 8.0)),
        }[power]
        rate = heat / 26.0 - 8.0 * x.temperature
        rates = {"temperature": rate / 12e3, "supply": (2.0 * u - x.supply) / 5.0}
        return rates, {"temperature": x.temperature}

    return machine(
        equations,
        "temperature K 20 scale=20, supply V 65",
        "volts V 0 230",
        "temperature K 0.02 scale=20 display_unit=K",
        "capacity J/K 12e3",
    )


def curve_of(model: Model, **at: float) -> CommandCurve | None:
    (found,) = command_curves(operating_point(model, at))
    return found


@pytest.mark.parametrize(("power", "lags", "rate"), [("square", 0, np.inf), ("lag", 1, 0.2)])
def test_a_curve_is_that_of_the_equations(power: str, lags: int, rate: float) -> None:
    found = curve_of(bath(power), temperature=20.0)
    assert found is not None
    rest = np.sqrt(20.0 * 8.0 * 26.0) / (2.0 if lags else 1.0)
    u = rest + found.command
    np.testing.assert_allclose(found.straight, (u**2 - rest**2) / (2.0 * rest), atol=1e-6)
    assert (found.lags, found.rate) == (lags, pytest.approx(rate))
    assert (u[0], u[-1]) == (pytest.approx(0.0, abs=1e-9), pytest.approx(230.0))


@pytest.mark.parametrize("power", ["straight", "by state"])
def test_what_is_straight_or_no_curve_of_the_command_alone_has_none(power: str) -> None:
    assert curve_of(bath(power), temperature=10.0) is None
    assert curve_of(servo_axis()) is None


def test_the_curve_of_a_valve_is_found_behind_its_spool() -> None:
    found = curve_of(arm(3), angle=0.3)
    assert found is not None
    # 2 % of the opening per volt at rest, 20 % on average.
    assert found.straight[-1] == pytest.approx(14.0 * found.command[-1], rel=0.2)
