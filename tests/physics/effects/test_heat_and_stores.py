"""Heat losses, stores of varying capacity, slack in a shaft, parameters that change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.machines import machine
from tests.physics.effects.bench import offered
from workbench.evaluation.foreign.newcomer import ROOM, circuit, crane, drive, tank
from workbench.evaluation.machines.plants import muscle
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts


def heat(model: Model, temperature: float) -> float:
    """Return the heat into the water, in W, with pump and heater off."""
    x = model.initial_state({"level": 0.2, "temperature": temperature})
    return model.signals(x, [0.0, 0.0])["water.heat"]


def test_radiation_is_the_fourth_power_law() -> None:
    area, sigma = 1.3, 5.670374e-8
    law = offered(tank(), "radiation_water")
    hot = tank().with_effect(law.at_size(4 * area * sigma * ROOM**3, {"ambient": ROOM}))
    for temperature in (ROOM, 320.0, 360.0):
        lost = heat(tank(), temperature) - heat(hot, temperature)
        assert lost == pytest.approx(area * sigma * (temperature**4 - ROOM**4), abs=1e-6)


def test_evaporation_goes_with_the_pressure_of_saturated_vapour() -> None:
    law = offered(tank(), "evaporation_water", ranges={"temperature": (290.0, 350.0)})
    wet = tank().with_effect(law.at_size(2.0, {"ambient": ROOM}))
    lost = {t: heat(tank(), t) - heat(wet, t) for t in (ROOM, 319.5, 320.5, 350.0, 353.15, 363.15)}
    assert lost[ROOM] == pytest.approx(0.0, abs=1e-9)
    # The size is the slope at the middle of what was seen; steam tables: 47.4 and 70.2 kPa.
    assert lost[320.5] - lost[319.5] == pytest.approx(2.0, rel=1e-3)
    dry = 2.0 * 2.34e3 / 536.0
    assert (lost[363.15] + dry) / (lost[353.15] + dry) == pytest.approx(70.2 / 47.4, rel=0.01)
    boiling = library(tank(), RecordedFacts(ranges={"temperature": (290.0, 400.0)}))
    assert "evaporation" not in {e.law for e in boiling}


@pytest.mark.parametrize(("sections", "shared"), [(3, True), (3, False), (2, True)])
def test_what_the_sections_of_a_kiln_radiate_is_one_effect(sections: int, shared: bool) -> None:
    def equations(m: Scope) -> Equations:
        names = [f"T{k}" for k in range(sections)]
        before = [m.u.feed, *(m.x[name] for name in names)]
        paces = [m.p.pace if shared or not k else 0.1 for k in range(sections)]
        rates = {n: a * (b - m.x[n]) for n, a, b in zip(names, paces, before, strict=False)}
        return rates, {"end": m.x[names[-1]]}

    kiln = machine(
        equations,
        ", ".join(f"T{k} K 400 scale=300" for k in range(sections)),
        "feed K scale=300",
        "end K scale=300",
        "pace 1/s 0.1 0.01 1",
    ).opened()
    found = {h.name: h for h in library(kiln) if h.law == "radiation"}
    one_by_one = {f"radiation_T{k}" for k in range(sections)}
    together = {"radiation"} if sections > 2 and shared else set()
    assert found.keys() == one_by_one | together
    if not together:
        return
    model = kiln.with_effect(found["radiation"].at_size(0.02, {"ambient": 300.0}))
    x, u = [400.0, 600.0, 900.0], [400.0]
    lost = kiln.rates(x, u) - model.rates(x, u)
    expected = 0.02 * 75.0 * ((np.array(x) / 300.0) ** 4 - 1.0)
    np.testing.assert_allclose(lost, expected)


def test_what_two_cells_of_one_capacity_lose_is_one_effect() -> None:
    def equations(m: Scope) -> Equations:
        warm, cool = m.p.conductance * (m.x.h1 - m.x.c2), m.p.conductance * (m.x.h2 - m.x.c1)
        rates = {
            "h1": (m.u.hot * (m.p.inlet - m.x.h1) - warm) / m.p.hot_side,
            "h2": (m.u.hot * (m.x.h1 - m.x.h2) - cool) / m.p.hot_side,
            "c1": (400.0 * (288.0 - m.x.c1) + cool) / m.p.cold_side,
            "c2": (400.0 * (m.x.c1 - m.x.c2) + warm) / m.p.cold_side,
        }
        return rates, {"outlet": m.x.h2}

    exchanger = machine(
        equations,
        ", ".join(f"{cell} K 300 scale=20" for cell in ("h1", "h2", "c1", "c2")),
        "hot W/K 0 2000 800 scale=400",
        "outlet K scale=20",
        "conductance W/K 400 50 2000, hot_side J/K 4e3 5e2 2e4, cold_side J/K 4e3, inlet K 353",
    ).opened()
    lossy = {h.name: h for h in library(exchanger) if h.law == "heat_loss"}
    one_by_one = {f"heat_loss_{cell}" for cell in ("h1", "h2", "c1", "c2")}
    # Four share the conductance, and two each capacity, whether it is refitted or not.
    assert lossy.keys() == one_by_one | {"heat_loss", "heat_loss_hot_side", "heat_loss_cold_side"}
    model = exchanger.with_effect(lossy["heat_loss_hot_side"].at_size(0.01, {"ambient": 293.0}))
    x = [340.0, 320.0, 300.0, 310.0]
    lost = exchanger.rates(x, [800.0]) - model.rates(x, [800.0])
    np.testing.assert_allclose(lost, [0.47, 0.27, 0.0, 0.0], atol=1e-9)


def test_heat_loss_is_linear() -> None:
    leaky = tank().with_effect(offered(tank(), "heat_loss_water").at_size(3.0, {"ambient": ROOM}))
    assert heat(leaky, ROOM + 20.0) == pytest.approx(heat(tank(), ROOM + 20.0) - 60.0)


def test_the_second_store_takes_no_heat_in_the_end() -> None:
    law = offered(tank(), "second_store_water")
    walled = tank().with_effect(law.at_size(10.0, {"time_constant": 50.0}))
    x = walled.initial_state({"level": 0.2, "temperature": 310.0})
    # What the water gives, 10 W/K, the wall of 10 W/K times 50 s stores.
    cold = x.copy()
    cold[-1] = 300.0
    given = walled.signals(x, [0, 0])["water.heat"] - walled.signals(cold, [0, 0])["water.heat"]
    assert given == pytest.approx(100.0)
    assert walled.rates(cold, [0, 0])[-1] * 10.0 * 50.0 == pytest.approx(given)
    assert walled.rates(x, [0, 0])[-1] == 0.0


def test_a_saturated_core_lets_the_current_rise_faster() -> None:
    model = circuit().with_effect(offered(circuit(), "saturating_inductance").at_size(2.0))
    for current in (0.0, 0.5, -0.5):
        ratio = model.rates([current, 1.0], [9.0])[0] / circuit().rates([current, 1.0], [9.0])[0]
        assert ratio == pytest.approx(1.0 + 2.0 * current**2)


def test_eddy_currents_let_a_coil_follow_more_quickly_at_first() -> None:
    # A turn of 3 ohm and 0.3 H beside it that takes a fifth of its flux.
    part, lag = 0.2, 0.3 / 3.0
    share = {"slow_part": 0.0, "time_constant": lag * (1.0 - part)}
    law = offered(circuit(), "eddy_currents")
    model = circuit().with_effect(law.at_size(part / (1.0 - part), share))
    assert "creep" not in {e.law for e in library(circuit())}
    trace, rest = model.exact, np.zeros(len(model.states))
    a, b = (
        np.asarray(trace.function("slopes", ca.jacobian(trace.rates, by))(rest, [0], model.values))
        for by in (trace.x, trace.u)
    )
    for w in (0.1 / lag, 1.0 / lag, 10.0 / lag):
        current = np.linalg.solve(1j * w * np.eye(len(a)) - a, b)[0, 0]
        p = {q.name: q.value for q in model.parameters}
        coil = 1j * w * p["inductance"] * (1.0 - part * 1j * w * lag / (1.0 + 1j * w * lag))
        rest_of_it = p["resistance"] + 1.0 / (1j * w * p["capacitance"])
        assert current == pytest.approx(1.0 / (coil + rest_of_it), rel=1e-9)


@pytest.mark.parametrize("growth", [0.01, -0.01, 5.0, -5.0])
def test_a_capacity_stays_positive_however_large_its_growth(growth: float) -> None:
    law = offered(circuit(), "varying_capacitance")
    size = replace(law.size, lower=-10.0, upper=10.0, value=growth)
    model = circuit().with_effect(replace(law.effect, parameters=(size,)))
    ratio = model.rates([0.5, 5.0], [0.0])[1] / circuit().rates([0.5, 5.0], [0.0])[1]
    assert ratio > 0.0
    if growth > 0.0:
        assert ratio == pytest.approx(1.0 / (1.0 + growth * 25.0))


def test_what_a_store_is_given_may_come_late() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        carried = 400.0 * (m.x.coil - m.x.room)
        cold = 180.0 * (m.x.room - 278.0)
        return {"coil": (m.u.heater - carried) / 2.5e4, "room": (carried - cold) / 2e5}

    duct = machine(equations, "coil K 310, room K 293", "heater W 0 1.5e4", "room K")
    law = offered(duct, "transport_delay_coil_room", sample_time=1.0)
    late = duct.with_effect(law.at_size(25.0))

    def slopes(of: str) -> np.ndarray:
        x, names = late.initial_state(), [q.name for q in late.states]
        moved = x.copy()
        moved[names.index(of)] += 1.0
        return late.rates(moved, [5e3]) - late.rates(x, [5e3])

    memory = slice(2, len(late.states))
    own = np.array([slopes(q.name)[memory] for q in late.states[memory]]).T
    read = np.array([slopes(q.name)[1] for q in late.states[memory]])
    for frequency in (0.01, 0.02, 0.04):
        answer = np.linalg.solve(1j * frequency * np.eye(len(own)) - own, slopes("coil")[memory])
        arrives = slopes("coil")[1] + read @ answer
        # What the coil gives off it loses at once.
        assert arrives == pytest.approx(400.0 / 2e5 * np.exp(-25j * frequency), rel=1e-3)
    assert slopes("coil")[0] == pytest.approx(-400.0 / 2.5e4)
    assert slopes("room")[0] == pytest.approx(400.0 / 2.5e4)


def test_slack_of_a_shaft_is_a_dead_zone_of_its_twist() -> None:
    law = offered(drive(), "elastic_play")
    assert (law.law, law.ports) == ("backlash", ("shaft.torque",))
    model = drive().with_effect(law.at_size(0.02))
    for twist, left in ((0.01, 0.0), (0.05, 0.03), (-0.05, -0.03)):
        torque = model.signals([twist, 0.0, 0.0], [0.0])["shaft.torque"]
        assert torque == pytest.approx(8.0 * left, abs=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_freewheel_takes_along_from_where_it_was_overtaken(side: float) -> None:
    law = offered(drive(), "freewheel")
    assert law.ports == ("shaft.torque",) and law.signed
    model = drive().with_effect(law.at_size(side))
    for twist, left in ((0.05, 0.05), (-0.3, 0.0), (-0.2, 0.1)):
        # The slip counts as the place that the torque raises: of the load over the motor.
        slip = {"freewheel.slip": side * (left - twist)}
        at = model.initial_state({"twist": side * twist, **slip})
        assert model.signals(at, [0.0])["shaft.torque"] == pytest.approx(side * 8.0 * left)
    far = model.initial_state({"twist": -0.3 * side})
    gone = model.rates(far, [0.0])[-1] * model.horizon / 500.0
    assert gone * side > 0.3 and model.signals(far, [0.0])["shaft.torque"] == 0.0


def test_what_joins_two_bodies_without_a_spring_may_pass_one_sign_only() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        passed = m.p.clutch * (m.x.motor - m.x.wheel)
        return {"motor": (m.u.torque - passed) / 0.1, "wheel": passed / m.p.inertia}

    model = machine(
        equations,
        "motor rad/s scale=10, wheel rad/s scale=10",
        "torque N m scale=5",
        "motor rad/s",
        "clutch N m s/rad 2, inertia kg m2 1",
    )
    law = offered(model, "rectification_motor_wheel_exchange")
    # What the motor is given from there is minus the torque: only less than nothing passes.
    driven = model.with_effect(law.at_size(-1.0))
    assert driven.rates([3.0, 2.0], [0.0]) == pytest.approx([-20.0, 2.0])
    assert driven.rates([2.0, 3.0], [0.0]) == pytest.approx([0.0, 0.0])


def test_friction_between_two_bodies_takes_energy() -> None:
    model = drive().with_effect(offered(drive(), "coulomb_friction_shaft").at_size(0.5))
    for motor, load in ((3.0, 1.0), (1.0, 3.0), (-2.0, 2.0)):
        change = model.rates([0.0, motor, load], [0.0]) - drive().rates([0.0, motor, load], [0.0])
        power = 0.01 * motor * change[1] + 0.03 * load * change[2]
        dry = 0.5 * np.tanh(abs(motor - load) / 0.4)
        assert power == pytest.approx(-dry * abs(motor - load))


def test_a_parameter_jumps_in_time() -> None:
    law = offered(crane(), "parameter_jump_drag", duration=40.0, sample_time=0.01)
    assert law.ports == ("cart.force",)
    assert [shape["time"] for shape in law.shapes] == [20.0, 12.0, 28.0, 6.0, 34.0]
    model = crane().with_effect(law.at_size(3.0, {"time": 20.0, "width": 0.1}))
    for clock, drag in ((10.0, 5.0), (30.0, 8.0)):
        changed = crane().with_parameters({"drag": drag})
        np.testing.assert_allclose(
            model.rates([0.1, 0.7, 0.2, 0.5, clock], [2.0])[:4],
            changed.rates([0.1, 0.7, 0.2, 0.5], [2.0]),
        )


def test_flattened_ends_contract_a_muscle_further() -> None:
    model = muscle().with_effect(offered(muscle(), "end_factor").at_size(0.2))

    def tension(of: Model, contraction: float) -> float:
        return of.signals([0.0], [3e5, contraction])["muscle.tension"]

    assert tension(model, 0.03) == pytest.approx(tension(muscle(), 0.036))
    walled = muscle().with_effect(offered(muscle(), "wall_term").at_size(80.0, {"reach": 1e-3}))
    assert tension(walled, 0.03) == pytest.approx(tension(muscle(), 0.03) - 80.0)


def outflow(model: Model, level: float) -> float:
    """Return what leaves the tank, in m3/s."""
    x = model.initial_state({"level": level, "temperature": ROOM})
    return model.signals(x, [0.0, 0.0])["tank.outflow"]


def test_an_outlet_below_the_zero_adds_its_height_to_the_level() -> None:
    model = tank().with_effect(offered(tank(), "outlet_head").at_size(0.05))
    for level in (0.02, 0.1, 0.4):
        assert outflow(model, level) == pytest.approx(outflow(tank(), level + 0.05), rel=1e-9)
    assert "outlet_head" not in {e.law for e in library(kiln())}


@pytest.mark.parametrize("exponent", [0.3, -0.15])
def test_the_exponent_of_an_outflow_is_the_slope_over_logarithms(exponent: float) -> None:
    model = tank().with_effect(offered(tank(), "outflow_exponent").at_size(exponent))
    levels = np.array([0.1, 0.2, 0.4])
    slopes = np.diff(np.log([outflow(model, h) for h in levels])) / np.diff(np.log(levels))
    # Torricelli's root has the exponent one half.
    np.testing.assert_allclose(slopes, 0.5 + exponent, atol=5e-3)


def test_an_outflow_saturates_and_is_half_at_the_half_level() -> None:
    law = offered(tank(), "saturating_outflow_tank")
    leaky = tank().with_effect(law.at_size(law.typical_size, {"half_level": 0.05}))

    def lost(level: float) -> float:
        start = {"level": level, "temperature": ROOM}
        rates = [m.rates(m.initial_state(start), [0.0, 0.0])[0] for m in (tank(), leaky)]
        return float(rates[0] - rates[1])

    # The ramp that keeps an empty store regular rounds within a hundredth of the typical level.
    assert lost(0.05) / lost(50.0) == pytest.approx(0.5, rel=0.02)
    assert lost(0.15) / lost(0.05) == pytest.approx(1.5, rel=0.02)
    assert lost(-0.1) == pytest.approx(0.0, abs=1e-3 * lost(50.0))


def test_what_crowds_is_lost_with_the_square_of_its_level() -> None:
    """Verhulst's growth r h (1 - h / K) is exponential growth beside a loss of r / K h^2."""
    hares = machine(
        lambda m: {"hares": 0.065 * m.x.hares}, "hares 1 scale=30", "", "hares 1"
    ).opened()
    crowded = hares.with_effect(offered(hares, "quadratic_outflow_hares").at_size(0.065 / 140.0))
    for count in (20.0, 70.0, 140.0):
        rate = crowded.rates([count], [])[0]
        assert rate == pytest.approx(0.065 * count * (1.0 - count / 140.0), abs=1e-3)


def test_limits_are_looked_for_where_the_recordings_have_their_ends() -> None:
    seen = {"level.reading": (0.1, 0.377), "pump.voltage": (0.0, 7.0), "level": (0.1, 0.5)}
    found = {h.name: h for h in library(tank(), RecordedFacts(ranges=seen))}
    assert found["sensor_clipping_level"].shapes[0] == {"limit": 0.377}
    assert all(0.0 < s["limit"] < 7.0 for s in found["saturation_pump_voltage"].shapes)
    assert all(0.1 < s["limit"] < 0.5 for s in found["overflow_tank"].shapes)


@pytest.mark.parametrize(
    "name",
    [
        "overflow_tank",
        "orifice_outflow_tank",
        "linear_outflow_tank",
        "saturating_outflow_tank",
        "quadratic_outflow_tank",
    ],
)
def test_what_a_tank_loses_leaves_as_warm_as_the_tank(name: str) -> None:
    law = offered(tank(), name)
    shape = {"limit": 0.15} if name == "overflow_tank" else {}
    leaky = tank().with_effect(law.at_size(law.typical_size, shape))
    whole, lossy = (
        m.exact.rates_function(
            m.initial_state({"level": 0.2, "temperature": 320.0}), [2.0, 0.0], m.values
        )
        for m in (tank(), leaky)
    )
    assert float(lossy[0]) < float(whole[0])
    assert float(lossy[1]) == float(whole[1])


def test_no_bristle_is_faster_than_samples_show() -> None:
    slow, fast = (
        offered(crane(), "lugre_friction_cart", sample_time=h).effect.parameters
        for h in (0.02, 0.002)
    )
    floors = [next(q.value for q in own if q.name == "floor") for own in (slow, fast)]
    assert floors == pytest.approx([0.01, 0.001])


def reactor() -> Model:
    """Return a tank with one port, where the author counts the heat that it gives to a jacket."""

    def equations(m: Scope) -> dict[str, Any]:
        given = m.port("jacket.heat", 20.0 * (m.x.warmth - m.u.coolant), unit="W")
        return {"warmth": -given / 4e5}

    return machine(
        equations, "warmth K 340 scale=20", "coolant K scale=20 nominal=300", "warmth K scale=20"
    )


@pytest.mark.parametrize("law", ["heat_loss", "radiation", "second_store"])
def test_what_counts_heat_that_leaves_a_store_may_count_too_little(law: str) -> None:
    offer = offered(reactor(), f"{law}_jacket")
    lossy = reactor().with_effect(offer.at_size(3.0))
    # Warmer than what is around by 10 K the store gives 30 W more than the equations say.
    start = lossy.initial_state({"warmth": 340.0})
    start[0] += 10.0
    rate, told = lossy.rates(start, [300.0])[0], reactor().rates([350.0], [300.0])[0]
    assert rate - told == pytest.approx(-30.0 / 4e5, rel=0.06 if law == "radiation" else 1e-6)


def test_what_is_around_a_lossy_store_is_refitted() -> None:
    around = next(q for q in offered(reactor(), "heat_loss_jacket").effect.parameters[1:])
    assert around.name == "ambient" and around.fitted
    assert around.lower == pytest.approx(140.0) and around.upper == pytest.approx(540.0)


def element() -> Model:
    """Return a heating element of a current, with weather that its author recorded and left out."""

    def equations(m: Scope) -> dict[str, Any]:
        drop = m.u.voltage - m.p.resistance * m.x.current
        return {"current": drop / m.p.inductance, "warmth": m.p.heat * m.x.current}

    return machine(
        equations,
        "current A scale=1, warmth K 300 scale=50",
        "voltage V scale=10, outside K scale=20 nominal=290, sun W/m2 scale=500",
        "warmth K scale=20",
        "resistance ohm 2 0.1 9, inductance H 0.1, heat K/(A s) 0.1 0 1",
    )


def test_a_winding_warms_with_the_square_of_its_current() -> None:
    law = offered(element(), "own_warming_resistance", ranges={"current": (-3.0, 4.0)})
    shape = {"time_constant": 50.0}
    warm, cold = element().with_effect(law.at_size(1.5, shape)), element()
    x = warm.initial_state({"current": -2.0})
    assert warm.rates(x, [0.0, 290.0, 0.0])[-1] == pytest.approx((2.0 / 4.0) ** 2 / 50.0)
    x[-1] = 0.4
    drop = cold.rates(x[:2], [0.0, 290.0, 0.0])[0] - warm.rates(x, [0.0, 290.0, 0.0])[0]
    assert drop == pytest.approx(0.4 * 1.5 * -2.0 / 0.1)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("resistive_heat_warmth_current", (2.0 / 4.0) ** 2),
        ("exchange_with_input_warmth_outside", 290.0 - 310.0),
        ("unused_input_sun_warmth_rate", 700.0),
    ],
)
def test_what_warms_a_store_beside_what_the_equations_know(name: str, given: float) -> None:
    law = offered(element(), name, ranges={"current": (-3.0, 4.0)})
    x, u = element().initial_state({"current": -2.0}), [0.0, 290.0, 700.0]
    x[1] = 310.0
    size = 1e-2 * law.typical_size
    more = element().with_effect(law.at_size(size)).rates(x, u)[1] - element().rates(x, u)[1]
    assert more == pytest.approx(given * size)


def kiln() -> Model:
    """A heater and what it heats, as a newcomer writes them: no port is declared."""

    def equations(m: Scope) -> dict[str, Any]:
        given = m.p.exchange * (m.x.heater - m.x.load)
        return {"heater": (m.u.power - given) / m.p.c_heater, "load": given / m.p.c_load}

    return machine(
        equations,
        "heater K scale=500, load K scale=500",
        "power W scale=1000",
        "load K scale=500",
        "exchange W/K 20 2 200, c_heater J/K 2000, c_load J/K 2e4",
    )


def test_two_bodies_radiate_to_one_another_by_the_fourth_power() -> None:
    area, sigma, usual = 0.12, 5.670374e-8, 800.0
    law = offered(kiln(), "radiant_exchange_heater_load")
    per_heater = 4.0 * area * sigma * usual**3 / 2000.0
    hot = kiln().with_effect(law.at_size(per_heater, {"usual": usual, "zero": 0.0}))
    for heater, load in ((1200.0, 900.0), (700.0, 900.0)):
        more = hot.rates([heater, load], [0.0]) - kiln().rates([heater, load], [0.0])
        passed = area * sigma * (heater**4 - load**4)
        assert more == pytest.approx([-passed / 2000.0, passed / 20000.0])


def test_the_exponent_between_two_stores_is_that_of_their_difference() -> None:
    law = offered(kiln(), "outflow_exponent")
    model = kiln().with_effect(law.at_size(0.25, {"level_scale": 10.0}))
    given = [model.rates([500.0 + d, 500.0], [0.0])[1] for d in (20.0, 40.0, -40.0)]
    assert np.log2(given[1] / given[0]) == pytest.approx(1.25, abs=1e-3)
    assert given[2] == pytest.approx(-given[1])


def test_a_converter_takes_more_current_where_the_voltage_falls() -> None:
    bus = machine(
        lambda m: ({"v": (m.u.source - m.x.v / m.p.R) / m.p.C}, {"bus": m.x.v}),
        "v V 48 scale=48",
        "source A 10 lower=0 upper=20",
        "bus V",
        "R ohm 10 1 100, C F 1e-3",
    )
    assert "constant_power_outflow" not in {h.law for h in library(tank())}
    law = next(h for h in library(bus) if h.law == "constant_power_outflow")
    loaded = bus.with_effect(law.at_size(1000.0, {"level_scale": 48.0}))

    def taken(volts: float) -> float:
        rates = [m.rates(m.initial_state({"v": volts}), [5.0])[0] for m in (bus, loaded)]
        return float(rates[0] - rates[1])

    powers = [volts * taken(volts) for volts in (30.0, 40.0, 48.0)]
    assert powers == pytest.approx([48.0 * 1000.0] * 3, rel=3e-3)
    assert taken(0.0) == 0.0
