"""A difference of temperatures has no zero of a scale: not in metrics, limits, noise or steps."""

from __future__ import annotations

from dataclasses import replace

import pytest

from controllers.plain.pid_design import PlainPIDSpecification, design_plain_pid
from tests.machines import at_rest, machine
from workbench.model import Model
from workbench.model.units import of_difference, parse_unit, quantity
from workbench.recordings.case import noise_of
from workbench.verification import Requirement, metrics, step_scenario, verify


def house() -> Model:
    def equations(m):  # type: ignore[no-untyped-def]
        heat = m.p.UA * (m.x.wall - m.x.room)
        lost = 150.0 * (m.u.outside - m.x.wall)
        return {"room": (m.u.heater + heat) / 5e6, "wall": (lost - heat) / 8e7}

    return machine(
        equations,
        "room K 293.15, wall K 290.15",
        "heater W 0 8000 2000, outside K nominal=278.15 display_unit=degC",
        "room K 0.05 display_unit=degC",
        "UA W/K 800",
    )


def test_a_difference_is_read_without_the_zero() -> None:
    assert quantity("noise", "0.1degC", "K", difference=True) == 0.1
    assert quantity("noise", "1.8 degF", "degC", difference=True) == pytest.approx(1.0)
    assert quantity("level", "0.1degC", "K") == pytest.approx(273.25)
    assert of_difference("degC") == "K" and of_difference("bar") == "bar"
    assert noise_of(house(), {"room": "0.2degC"}) == noise_of(house(), {"room": 0.2})
    assert noise_of(house(), {"room": 0.2}) == {"room": pytest.approx(0.2)}
    assert Requirement("steady_error", 0.1, "degC").unit == "K"
    assert Requirement("highest", 25.0, "degC").unit == "degC"
    assert Requirement("steady_error", 1.8, "degF").unit == "Δ°F"
    assert parse_unit("Δ°F").factor == pytest.approx(5.0 / 9.0)


def test_metrics_of_a_temperature() -> None:
    # Outside is a disturbance: what the controller does not command rests.
    plant = house()
    linear = at_rest(plant, room=293.15, outside=278.15)
    heater = linear.select(inputs=["heater"])
    law = design_plain_pid(heater, PlainPIDSpecification(sample_time=500.0))
    scenario = step_scenario("room", 20.0, 22.0, unit="degC", lead=1e4, hold=4e5, sample_time=500.0)
    run = verify(law, plant, scenario)
    assert set(run["outside"]) == {278.15}
    found = metrics(run)
    assert found["rmse"].shown()[1] == "K" and 0.0 < found["rmse"].shown()[0] < 2.0
    fahrenheit = replace(plant.outputs[0], display_unit="degF")
    shown = metrics(verify(law, replace(plant, outputs=(fahrenheit,)), scenario))["rmse"].shown()
    assert shown == (pytest.approx(1.8 * found["rmse"].shown()[0]), "Δ°F")
    assert found["highest"].shown()[1] == "degC" and 21.0 < found["highest"].shown()[0] < 25.0


@pytest.mark.parametrize(
    ("text", "factor"),
    [("K/min", 1 / 60), ("degC/min", 1 / 60), ("W/(m2 °C)", 1.0), ("hr", 3600.0), ("mph", 0.44704)],
)
def test_degrees_in_compound_units_are_differences(text: str, factor: float) -> None:
    found = parse_unit(text)
    assert found.factor == pytest.approx(factor) and found.offset == 0.0
