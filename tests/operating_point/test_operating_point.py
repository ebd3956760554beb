"""Operating points: figures of the rig, true equilibria, drift, and what cannot be held."""

from __future__ import annotations

import math
import pickle
import re
from typing import Any
from unittest.mock import Mock

import casadi as ca
import numpy as np
import pytest

from tests.machines import machine
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.operating_point import OperatingPoint, operating_point, usual_inputs
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.simulation import simulate

ARM = arm(3.0)


def at_three_bar(angle: float, **told: Any) -> OperatingPoint:
    """Return the arm at rest at an angle in degrees and a mean pressure of 3 bar."""
    given = {"angle": math.radians(angle), "mean_pressure": 3e5}
    return operating_point(ARM, given, **told)


@pytest.mark.parametrize(
    ("angle_deg", "p1_bar", "p2_bar"),
    [
        (0, 1.42, 4.58), (10, 2.00, 4.00), (20, 2.54, 3.46), (30, 3.00, 3.00),
        (40, 3.46, 2.54), (50, 4.00, 2.00), (60, 4.58, 1.42),
    ],
)  # fmt: skip
def test_pressures_in_the_horizontal_plane(angle_deg: float, p1_bar: float, p2_bar: float) -> None:
    point = at_three_bar(angle_deg)
    # The table is printed to 0.01 bar.
    assert point["pressure_1"] / 1e5 == pytest.approx(p1_bar, abs=0.006)
    assert point["pressure_2"] / 1e5 == pytest.approx(p2_bar, abs=0.006)
    assert point["angle"] == math.radians(angle_deg)
    assert point["load_cell"] == 0.0


def test_only_the_mean_drifts() -> None:
    point = at_three_bar(15)
    assert not point.is_equilibrium
    names = [q.name for q in ARM.states]
    drifting = {names[i] for i in np.flatnonzero(np.abs(point.rates) > 1e-3)}
    assert drifting == {"pressure_1", "pressure_2"} == set(point.drift)
    assert point.drift["pressure_1"] == pytest.approx(point.drift["pressure_2"])
    # Below the mean that leakage holds, pressures rise.
    assert point.drift["pressure_1"] > 0.0


def test_reported_drift_is_what_a_simulation_shows() -> None:
    point = at_three_bar(15)
    run = simulate(ARM, np.tile(point.u, (26, 1)), sample_time=0.002, start=point.x, check=False)
    mean = 0.5 * (run["pressure_1"] + run["pressure_2"])
    # The drift decays with some 6 s, so it changes by less than 1 % in 50 ms.
    assert (mean[-1] - mean[0]) / run.time[-1] == pytest.approx(point.drift["pressure_1"], rel=0.02)


def test_leakage_holds_a_mean_of_its_own() -> None:
    point = operating_point(ARM, {"angle": math.radians(30)})
    assert point.is_equilibrium
    assert 3.9 < point["pressure_1"] / 1e5 < 4.25
    signals = ARM.signals(point.x, point.u)
    assert signals["chamber_1.flow"] == pytest.approx(0.0, abs=1e-12)
    assert signals["exhaust_1.flow"] > 1e-6


@pytest.mark.parametrize("angle_deg", [0, 7, 30, 52])
def test_a_true_equilibrium_stays_in_simulation(angle_deg: float) -> None:
    point = operating_point(ARM, {"angle": math.radians(angle_deg)})
    run = simulate(ARM, np.tile(point.u, (500, 1)), sample_time=0.002, start=point.x, check=False)
    assert np.abs(run["angle"] - math.radians(angle_deg)).max() < math.radians(1e-3)
    assert np.ptp(run["pressure_1"]) < 10.0


def test_eight_plates_are_held_by_the_torque_that_gravity_needs() -> None:
    heavy = arm(8.0, plane="vertical")
    point = operating_point(heavy, {"angle": 0.0, "mean_pressure": 2e5})
    signals = heavy.signals(point.x, point.u)
    assert signals["joint.torque"] == pytest.approx(0.0, abs=1e-6)
    # 30.8 N m at a lever of 31.5 and 20.1 mm
    lift = 0.0315 * signals["muscle_1.force"] - 0.0201 * signals["muscle_2.force"]
    assert lift == pytest.approx(30.8, abs=0.1)


def test_an_impossible_trim_says_what_would_be_possible() -> None:
    def weak(supply_bar: float) -> object:
        plant = arm(8.0, plane="vertical", supply_bar=supply_bar)
        return operating_point(plant, {"angle": 0.0})

    with pytest.raises(WorkbenchError, match=r"no operating point.*angle 0 deg") as caught:
        weak(2.0)
    load = re.search(r"load from 0 to ([\d.]+) kg", str(caught.value))
    supply = re.search(r"supply pressure from ([\d.]+) to 10 bar", str(caught.value))
    assert load and supply
    # Seven bisections of a thirteenth of the range, printed to three digits.
    assert weak(1.02 * float(supply[1]))
    with pytest.raises(WorkbenchError):
        weak(0.96 * float(supply[1]))
    lighter = arm(0.97 * float(load[1]), plane="vertical", supply_bar=2.0)
    assert operating_point(lighter, {"angle": 0.0})


def test_what_would_be_possible_is_worked_out_when_somebody_reads_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    advice = Mock(return_value="take another")
    monkeypatch.setitem(operating_point.__globals__, "what_would_be_possible", advice)
    with pytest.raises(WorkbenchError) as caught:
        operating_point(arm(8.0, plane="vertical", supply_bar=2.0), {"angle": 0.0})
    assert advice.call_count == 0
    # Another process is told the same.
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)  # noqa: S301
    assert str(caught.value).endswith("take another") and advice.call_count == 1


def test_states_of_effects_are_trimmed_too() -> None:
    long = arm(3.0, silencers=True, line_volumes=True)
    point = operating_point(long, {"angle": math.radians(20)})
    assert np.abs(point.rates / [q.scale for q in long.states]).max() < 1e-8
    values = point.values
    # A leak of 0.4 % flows through a line of more than the full conductance.
    assert values["line_1.pressure"] == pytest.approx(point["pressure_1"] + 1.01325e5, abs=1e3)


def test_hysteresis_rests_anywhere_and_stays_at_its_start() -> None:
    point = operating_point(ARM.with_effect(muscle_hysteresis()), {"angle": math.radians(20)})
    assert set(point.undetermined) == {"muscle_hysteresis.turn_1", "muscle_hysteresis.turn_2"}
    assert point["muscle_hysteresis.turn_1"] == 0.0
    assert "rests at any value" in str(point)


def test_a_foreign_plant_uses_the_same_call() -> None:
    axis = servo_axis().with_parameters({"offset": 7.0})
    point = operating_point(axis, {"position": 0.25})
    assert point["position"] == 0.25
    assert point["force"] == pytest.approx(-7.0)
    # A position can be held anywhere: without a given one the input stays at rest.
    assert operating_point(servo_axis()).undetermined == ("position",)


def test_any_measurement_or_input_can_be_given() -> None:
    by_pressure = operating_point(ARM, {"pressure_1": 3.5e5})
    assert by_pressure["pressure_1"] == pytest.approx(3.5e5)
    by_voltage = operating_point(ARM, {"valve": float(by_pressure.u[0])})
    assert by_voltage["angle"] == pytest.approx(by_pressure["angle"], abs=1e-6)


def test_a_start_nearby_gives_the_same_point() -> None:
    first, again = at_three_bar(17), at_three_bar(34)
    warm = at_three_bar(34, near=first)
    assert warm.x == pytest.approx(again.x, rel=1e-6, abs=1e-9)


def test_table_is_aligned() -> None:
    text = str(at_three_bar(30))
    rows = [line for line in text.splitlines() if line.startswith(("  input", "  output"))]
    # Kind, name, value and unit stand in columns, then what it is.
    assert len({line.index(f" {line.split()[3]} ") for line in rows}) == 1
    assert all("gauge" in line for line in rows if "pressure" in line)
    assert "30 deg" in text and "bar/s" in text and "condition number" in text


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"angel": 0.5}, "did you mean 'angle'"),
        ({"angle": math.nan}, "not finite"),
        ({"angle": 30.0}, "valid range is -1 to 61 deg; values are given in rad"),
        ({"angle": 0.5, "pressure_1": 3e5}, "1 input"),
        ({"valve": 11.0}, "valid range is 0 to 10 V"),
    ],
)
def test_wrong_values_are_refused(given: dict[str, float], message: str) -> None:
    with pytest.raises(WorkbenchError, match=message):
        operating_point(ARM, given)


def test_wrong_pressures_and_bounds_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="0 to 6 bar"):
        operating_point(ARM, {"angle": 0.5, "mean_pressure": 7e5})
    with pytest.raises(WorkbenchError, match="given quantity is 'mean_pressure'"):
        operating_point(servo_axis(), {"position": 0.0, "mean_pressure": 3e5})
    with pytest.raises(WorkbenchError, match="must overlap"):
        operating_point(ARM, {"angle": 0.5}, bounds={"valve": (11.0, 12.0)})


def test_bounds_are_kept() -> None:
    with pytest.raises(WorkbenchError, match="no operating point"):
        operating_point(ARM, {"angle": 0.2}, bounds={"valve": (5.0, 10.0)})


def test_a_vessel_whose_rounded_flows_do_not_cancel_rests_where_it_starts() -> None:
    # Feed, heat and draw-off as they are read off a data sheet: the level integrates what is left.
    def equations(m: Any) -> Any:
        boiled = (m.u.heat - 2.0e3 * m.u.feed) / 2.26e6
        level = (m.u.feed - boiled - m.u.draw) / 500.0
        share = (0.1 * m.u.feed - m.x.share * m.u.draw) / 500.0
        return {"level": level, "share": share}

    vessel = machine(
        equations,
        "level m 0.8, share 1 0.21",
        "draw kg/s 0 1 0.48, heat W 0 3e6 1.18e6 display_unit=kW, feed kg/s nominal=1 commanded=0",
        "level m, share 1",
    )
    point = operating_point(vessel)
    assert point.is_equilibrium and (point["level"], point["share"]) == (0.8, 0.21)
    assert point["draw"] == pytest.approx(0.1 / 0.21) and point["feed"] == 1.0


def test_a_reactor_that_says_where_it_starts_is_held_there_and_not_washed_out() -> None:
    def equations(m: Any) -> Any:
        growth = 1.1e-4 * m.x.S / (0.2 + m.x.S)
        eaten = growth * m.x.X / 0.5
        return {"X": (growth - m.u.D) * m.x.X, "S": m.u.D * (10.0 - m.x.S) - eaten}

    chemostat = machine(equations, "X kg/m3 4.8, S kg/m3 0.4", "D 1/s 0 1.5e-4", "S kg/m3")
    # Without a flow it rests empty of food, and at any of it without what eats.
    point = operating_point(chemostat)
    assert point["S"] == pytest.approx(0.4) and point["D"] == pytest.approx(1.1e-4 / 1.5)
    for food in (0.41, 0.5, 1.0):
        assert operating_point(chemostat, {"S": food})["X"] == pytest.approx(0.5 * (10.0 - food))


def test_a_turbine_that_would_leave_its_rest_is_held_where_it_starts() -> None:
    turbine = machine(
        lambda m: ({"speed": (m.x.speed - 1.0) * (2.0 - m.x.speed) - m.u.pitch}, {"w": m.x.speed}),
        "speed rad/s 1.4",
        "pitch rad 0 1 0.09",
        "w rad/s",
    )
    # At the nominal pitch it stalls below 1.1 rad/s and runs up to 1.9 from above.
    point = operating_point(turbine)
    assert point["w"] == pytest.approx(1.4) and point["pitch"] == pytest.approx(0.24)


def test_a_saturation_beside_which_nothing_has_a_slope_is_found_a_way_around() -> None:
    # Without heat the air cools as fast as the law lets it, whatever is heated a little.
    def equations(m: Any) -> Any:
        free = (7400.0 * m.u.valve - 225.0 * (m.x.air - m.u.outside)) / 4e5
        return {"air": np.clip(free, -0.003, 0.003)}, {"room": m.x.air}

    house = machine(
        equations, "air K 293.15", "valve 1 0 1, outside K nominal=278.15 commanded=0", "room K"
    )
    point = operating_point(house, {"room": 303.15})
    assert point["valve"] == pytest.approx(225.0 * 25.0 / 7400.0)


def _tank(gain: float, closed: float, valve: str) -> Model:
    def equations(m: Any) -> Any:
        return {"level": gain * (m.u.valve - closed) - 0.001 * np.sqrt(m.x.level)}

    return machine(equations, "level m", f"valve A{valve}", "level m")


def test_a_valve_of_4_to_20_ma_rests_in_the_middle_of_its_range_unless_it_says_where() -> None:
    # An empty tank has a root without a slope, from which no search finds away.
    for valve, level in ((" 4e-3 20e-3", 1.0), (" 4e-3 20e-3 8e-3", 0.25)):
        point = operating_point(_tank(0.125, 4e-3, valve))
        assert point["level"] == pytest.approx(level)


def test_a_tank_that_says_nothing_of_rest_is_not_linearised_empty() -> None:
    ranged = _tank(0.1, 0.0, " 0 20e-3")
    assert operating_point(ranged)["valve"] == pytest.approx(0.01)
    # Without a range there is no middle, and where it is told to be empty it is.
    assert operating_point(_tank(0.1, 0.0, ""))["level"] == 0.0
    assert operating_point(ranged, {"valve": 0.0})["level"] == 0.0


def test_equations_that_divide_by_nothing_where_they_start_rest_beside_it() -> None:
    level, inflow = ca.SX.sym("level"), ca.SX.sym("inflow")
    rate = (inflow + 1.0 - level) / level
    found = operating_point(ca.Function("pan", [level, inflow], [rate]))
    assert found.x == pytest.approx([1.0])
    with pytest.raises(WorkbenchError, match="divide by"):
        operating_point(ca.Function("pan", [level, inflow], [rate]), {"x": 0.0})


def pan(feed: str, states: str = "level kg, salt kg, heat K") -> Model:
    """A pan that boils brine down: level and salt in it, steam under it."""

    def equations(m: Any) -> Any:
        x, u = m.x, m.u
        boiled = 0.002 * np.maximum(x.heat - 100.0, 0.0)
        heating = 500.0 * u.steam - 500.0 * boiled - 0.1 * x.heat + u.feed * (60.0 - x.heat)
        salt = 0.05 * u.feed - x.salt / x.level * u.drain
        rates = {"level": u.feed - boiled - u.drain, "salt": salt, "heat": heating / x.level}
        return rates, {"level": x.level, "brine": x.salt / x.level, "heat": x.heat}

    inputs = f"steam kg/s 0 0.2, feed kg/s {feed}, drain kg/s 0 1"
    return machine(equations, states, inputs, "level kg, brine 1, heat K")


def test_what_begins_nowhere_and_rests_anywhere_is_asked_where_it_rests() -> None:
    with pytest.raises(WorkbenchError, match="rests anywhere.*--at NAME=VALUE.*level, brine, heat"):
        operating_point(pan("0 1"))
    with pytest.raises(WorkbenchError, match=r"no operating point.*--at NAME=VALUE.*level, brine"):
        operating_point(pan("0.2 1", "level kg 50, salt kg 5, heat K 60"))
    point = operating_point(pan("0 1"), {"level": 50.0, "brine": 0.2, "heat": 110.0})
    assert point["feed"] == pytest.approx(0.02 / 0.75)


def test_what_is_not_given_rests_as_it_starts() -> None:
    """Of a dialysis machine that is asked for another temperature, the conductivity stays."""
    mixed = machine(
        lambda m: {
            "warm": 0.05 * m.u.heater - 0.01 * (m.x.warm - 288.0),
            "salt": 0.1 * m.u.pump * (1.0 - 1e-3 * (m.x.warm - 310.0)) - 0.2 * m.x.salt,
        },
        "warm K 310, salt mS/cm 14",
        "heater 1 0 10, pump ml/min 0 100",
        "warm K, salt mS/cm",
    )
    salt = mixed.initial_state()[1]
    for given in ({"warm": 312.0}, {"heater": 4.0}):
        assert operating_point(mixed, given)["salt"] == pytest.approx(salt)
    assert operating_point(mixed, {"warm": 312.0, "pump": 0.0})["salt"] == pytest.approx(0.0)
    # Nor does a loop of the other command let it fall.
    assert usual_inputs(mixed)["pump"] == operating_point(mixed)["pump"] > 0.0


def test_an_input_may_have_the_name_of_a_state_and_of_what_is_read() -> None:
    def equations(m: Any) -> Any:
        blade = m.x.pitch
        rates = {
            "pitch": (m.u.pitch - blade) / 0.3,
            "rotor": 0.2 * (m.u.wind - blade) - 0.1 * m.x.rotor,
        }
        return rates, {"rotor": m.x.rotor, "pitch": 100.0 * blade, "wind": 2.0 * m.x.rotor}

    mill = machine(
        equations,
        "pitch rad, rotor rad/s",
        "pitch rad 0 10 nominal=1, wind m/s 0 20 nominal=5 commanded=0",
        "rotor rad/s, pitch 1, wind 1",
    )
    usual = operating_point(mill)
    assert usual.u.tolist() == pytest.approx([1.0, 5.0]) and usual["rotor"] == pytest.approx(8.0)
    slow = operating_point(mill, {"rotor": 4.0})
    assert slow.u.tolist() == pytest.approx([3.0, 5.0])
    # What is read is meant by a name alone.
    assert operating_point(mill, {"pitch": 200.0}).u.tolist() == pytest.approx([2.0, 5.0])
    assert operating_point(mill, {"u.wind": 7.0})["rotor"] == pytest.approx(12.0)
    assert usual_inputs(mill) == pytest.approx({"pitch": 1.0, "wind": 5.0})
