"""Plants of which a state goes on slowly while all others rest: a roll, a cell, a rocket."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.machines import machine
from workbench.errors import WorkbenchError
from workbench.linearisation import linearise
from workbench.model import Model, Scope
from workbench.model.trace import Named
from workbench.operating_point import operating_point

STRETCH, SPAN, THICK, DRAG = 120e3, 3.0, 5e-5, 0.1


def _inertia(radius: float) -> float:
    return 0.5 + 1696.0 * (radius**4 - 0.05**4)


def _winder() -> Model:
    def equations(m: Scope) -> tuple[Named, Named]:
        x, line = m.x, m.u.line
        rates = {
            "pull": STRETCH / SPAN * (x.speed * x.radius - line) - line / SPAN * x.pull,
            "speed": (m.u.torque - x.pull * x.radius - DRAG * x.speed) / _inertia(x.radius),
            "radius": THICK * x.speed / (2.0 * math.pi),
        }
        return rates, {"tension": x.pull, "width": 2.0 * x.radius}

    return machine(
        equations,
        "pull N 200 scale=200, speed rad/s 20 scale=30, radius m 0.2 scale=0.2",
        "torque N·m -150 150 40, line m/s 0 15 5 commanded=0",
        "tension N 1, width m 1e-4",
    )


def _rested(radius: float, torque: float) -> tuple[float, float]:
    """Return pull and speed where both rest at a radius, by running on for a minute."""

    def rates(t: float, x: list[float]) -> list[float]:
        pulled = STRETCH / SPAN * (x[1] * radius - 5.0) - 5.0 / SPAN * x[0]
        return [pulled, (torque - x[0] * radius - DRAG * x[1]) / _inertia(radius)]

    run = solve_ivp(rates, (0.0, 60.0), [200.0, 25.0], "LSODA", rtol=1e-10, atol=1e-8)
    return float(run.y[0, -1]), float(run.y[1, -1])


def test_a_roll_that_grows_is_held_at_its_radius_while_the_web_rests() -> None:
    model = _winder()
    for asked, radius in (({}, 0.2), ({"width": 0.5}, 0.25)):
        point = operating_point(model, asked)
        pull, speed = _rested(radius, 40.0)
        assert point.values == pytest.approx(
            {"torque": 40.0, "line": 5.0, "pull": pull, "tension": pull, "speed": speed}
            | {"radius": radius, "width": 2.0 * radius},
            rel=1e-6,
        )
        assert point.drift == pytest.approx({"radius": THICK * speed / (2.0 * math.pi)}, rel=1e-6)
    linear = linearise(operating_point(model))
    assert "drifts: radius by 0.000199 m/s" in str(linear)
    # With the radius held, the web and the roll swing as they do on their own.
    inertia = _inertia(0.2)
    own = [[-5.0 / SPAN, STRETCH / SPAN * 0.2], [-0.2 / inertia, -DRAG / inertia]]
    swing = max(np.linalg.eigvals(np.array(own)), key=lambda pole: pole.imag)
    assert max(linear.poles, key=lambda pole: pole.imag) == pytest.approx(swing, rel=1e-2)


def test_a_line_that_nobody_commands_keeps_its_speed_beside_two_given_values() -> None:
    point = operating_point(_winder(), {"tension": 150.0, "width": 0.44})
    assert point["line"] == 5.0 and point["radius"] == pytest.approx(0.22)
    assert _rested(0.22, point["torque"])[0] == pytest.approx(150.0, rel=1e-6)


def test_a_cell_is_looked_at_at_its_charge_while_it_is_discharged() -> None:
    cell = machine(
        lambda m: (
            {"charge": -m.u.current / 9000.0, "film": (m.u.current - m.x.film / 0.02) / 1500.0},
            {"voltage": 3.2 + 0.8 * m.x.charge - 0.03 * m.u.current - m.x.film},
        ),
        "charge 1 0.5 scale=1, film V scale=0.05",
        "current A -10 10 2",
        "voltage V 1e-3",
    )
    point = operating_point(cell)
    assert point["voltage"] == pytest.approx(3.2 + 0.4 - 0.06 - 0.04)
    assert point.drift == pytest.approx({"charge": -2.0 / 9000.0})


def test_a_rocket_hovers_while_it_burns_its_fuel() -> None:
    rocket = machine(
        lambda m: (
            {"height": m.x.speed, "speed": m.u.thrust / m.x.mass - 9.81, "mass": -0.02},
            {"height": m.x.height},
        ),
        "height m 100 scale=100, speed m/s scale=10, mass kg 50 scale=50",
        "thrust N 0 1000",
        "height m 0.1",
    )
    point = operating_point(rocket, {"height": 100.0})
    assert point["thrust"] == pytest.approx(490.5) and point.drift == {"mass": -0.02}


@pytest.mark.parametrize("taken", [2e-4, 0.0])
def test_what_goes_on_as_fast_as_everything_else_does_not_rest(taken: float) -> None:
    # A body that nothing carries, and a tank beside it that rests only if nothing is taken.
    falling = machine(
        lambda m: (
            {"height": m.x.speed, "speed": -9.81 + m.u.fan, "level": (m.u.inflow - taken)},
            {"height": m.x.height, "level": m.x.level},
        ),
        "height m 5 scale=1, speed m/s scale=1, level m 1 scale=1",
        "fan m/s2 0 2 1, inflow m/s 0 1e-4 0",
        "height m, level m",
    )
    with pytest.raises(WorkbenchError, match="no operating point"):
        operating_point(falling)


def _rotor() -> Model:
    """A rotor in a wind, whose blades turn out of it by a command."""
    return machine(
        lambda m: {
            "rotor": 0.2 * (m.u.wind - m.x.blade) - 0.05 * (m.x.rotor - 2.0) ** 2,
            "blade": (m.u.pitch - m.x.blade) / 0.3,
        },
        "rotor rad/s 2, blade 1 1",
        "pitch 1 0 10 nominal=1, wind m/s 0 20 nominal=3 commanded=0",
        "rotor rad/s",
    )


def test_commands_rest_beside_another_disturbance_as_beside_the_usual_one() -> None:
    usual, windy = (operating_point(_rotor(), given) for given in (None, {"wind": 5.0}))
    for point, wind in ((usual, 3.0), (windy, 5.0)):
        assert point["pitch"] == pytest.approx(1.0)
        assert point["rotor"] == pytest.approx(2.0 + math.sqrt(4.0 * (wind - 1.0)))
    # It is a point of the plant as it was declared.
    assert windy.model.inputs[1].nominal == 3.0


def test_what_rests_elsewhere_does_not_go_by_where_it_cannot_rest() -> None:
    # 5.46 rad/s is the most, with a pitch of 0.
    with pytest.raises(WorkbenchError, match="no operating point"):
        operating_point(_rotor(), {"rotor": 7.0})
    assert operating_point(_rotor(), {"rotor": 5.0}).is_equilibrium
