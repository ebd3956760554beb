"""Effects of air: choked leaks, conservation, droop, polytropic gas, shared lines, overflow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.physics.effects.bench import bench, read
from tests.physics.numbers_of import iso6358
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.physics.gas import GAS_CONSTANT, isothermal_gas, polytropic_exchange, polytropic_gas
from workbench.physics.leakage import (
    chamber_leakage,
    cross_leakage,
    edge_leakage,
    opening_leakage,
)
from workbench.physics.stores import overflow
from workbench.physics.supply import line, regulator_droop, silencer, supply_droop
from workbench.plants.arm import arm, pneumatic_muscle, servovalve
from workbench.plants.arm.laws import extra_heat_exchange, gas_energy_balance, heat_exchange

TANKS = ("upper_tank.flow", "lower_tank.flow")
GAS = ("pressure", "temperature", "ambient_pressure", "ambient_temperature")
AMBIENT = {"temperature": 293.15, "ambient_pressure": 1e5, "ambient_temperature": 293.15}

CHAMBERS = ("chamber_1.heat", "chamber_2.heat")


def test_a_leak_is_choked_at_high_pressure() -> None:
    model = bench(chamber_leakage("chamber_1.flow", conductance=1e-10), "kg/s", *GAS)
    high = [read(model, pressure=p, **AMBIENT) for p in (4e5, 6e5)]
    # Above 1 / 0.3 bar the flow is C rho0 p, whatever is behind the leak.
    assert high == pytest.approx([-1e-10 * 1.185 * p for p in (4e5, 6e5)], rel=1e-9)
    assert read(model, pressure=1e5, **AMBIENT) == 0.0
    assert 0.0 < -read(model, pressure=2e5, **AMBIENT) < 1e-10 * 1.185 * 2e5


def test_a_crack_opens_at_its_pressure() -> None:
    values = {"conductance": 1e-10, "threshold": 3e5, "width": 1e4}
    model = bench(opening_leakage("chamber_1.flow", **values), "kg/s", *GAS)
    lost = [-read(model, pressure=1e5 + gauge, **AMBIENT) for gauge in (2.9e5, 3.05e5, 3.2e5)]
    assert lost == pytest.approx([0.0, 0.5e-10 * 1.185 * 4.05e5, 1e-10 * 1.185 * 4.2e5], rel=1e-9)


def test_a_cross_leak_takes_from_one_what_it_gives_to_the_other() -> None:
    conductance = 8e-11
    base = arm(3.0)
    model = base.with_effect(cross_leakage(conductance=conductance))
    given = {"pressure_1": 6e5, "pressure_2": 1.5e5}
    before = base.signals(base.initial_state(given), [5.0])
    after = model.signals(model.initial_state(given), [5.0])
    lost = before["chamber_1.flow"] - after["chamber_1.flow"]
    gained = after["chamber_2.flow"] - before["chamber_2.flow"]
    assert lost == pytest.approx(gained)
    assert lost == pytest.approx(float(iso6358(6e5, 1.5e5, 293.15, conductance, 0.3)), rel=1e-9)


def test_an_edge_leak_opens_its_edge_only() -> None:
    base, model = servovalve(), servovalve().with_effect(edge_leakage("valve.exhaust_2"))
    u = [5.0, 4e5, 4e5]
    x = base.initial_state(u=u)
    before, after = base.read(x, u), model.read(x, u)
    assert after[0] == before[0]
    assert before[1] - after[1] == pytest.approx(
        float(iso6358(4e5, 101325.0, 293.15, 0.004 * 2.9e-8, 0.23)), rel=1e-9
    )


def settled(model: Model, u: list[float], end: float) -> np.ndarray:
    f, p = model.exact.rates_function, model.values
    result = solve_ivp(
        lambda t, x: np.asarray(f(x, u, p)).ravel(),
        (0.0, end),
        model.initial_state(u=u),
        method="LSODA",
        rtol=1e-8,
        atol=1e-8,
    )
    return result.y[:, -1]


@pytest.mark.parametrize("effect", [supply_droop(conductance=1e-8), regulator_droop()])
def test_a_settled_supply_feeds_what_is_drawn(effect) -> None:
    model = servovalve().with_effect(effect)
    u = [7.0, 3e5, 3e5]
    x = settled(model, u, 20.0)
    signals = model.signals(x, u)
    pressure, drawn = signals["supply.pressure"], signals["supply.flow"]
    assert pressure < 6.9e5
    if effect.name == "regulator_droop":
        assert pressure == pytest.approx(7.01325e5 - 1e7 * drawn, rel=1e-6)
    else:
        feed = float(iso6358(7.01325e5, pressure, 293.15, 1e-8, 0.3))
        assert feed == pytest.approx(drawn, rel=1e-6)


def test_a_settled_line_passes_on_what_it_gets() -> None:
    model = arm(3.0).with_effect(line([("line_1.pressure", "chamber_1.flow")], name="line_1"))
    x = model.initial_state({"pressure_1": 3e5, "spool": 1.0})
    names = [q.name for q in model.states]
    at = names.index("line_1.pressure")

    def rate(pressure: float) -> float:
        x[at] = pressure
        return float(model.rates(x, [6.0])[at])

    x[at] = brentq(rate, 3.0001e5, 6.9e5, xtol=1e-6)
    signals = model.signals(x, [6.0])
    assert signals["line_1.pressure"] == pytest.approx(x[at])
    assert signals["line_1.pressure"] > 3e5
    filling = signals["valve.supply_1"] * 2.9e-8
    venting = signals["valve.exhaust_1"] * 2.9e-8
    expected = float(iso6358(7.01325e5, x[at], 293.15, filling, 0.23)) - float(
        iso6358(x[at], 101325.0, 293.15, venting, 0.23)
    )
    assert signals["chamber_1.flow"] == pytest.approx(expected, rel=1e-6)


def test_a_tube_as_warm_as_its_wall_keeps_its_mass() -> None:
    model = arm(3.0).with_effect(line(volume=2e-5, conductance=2e-8, wall=1.0))
    names = [q.name for q in model.states]
    x = model.initial_state({"pressure_1": 3e5, "temperature_1": 320.0, "spool": -1.0})
    x[names.index("line.pressure_1")] = 2.5e5
    signals = model.signals(x, [4.0])
    assert signals["line_1.temperature"] == pytest.approx(293.15)
    vented = float(iso6358(2.5e5, 101325.0, 293.15, signals["valve.exhaust_1"] * 2.9e-8, 0.23))
    passed = float(iso6358(3e5, 2.5e5, 320.0, 2e-8, 0.3))
    filled = float(iso6358(7.01325e5, 2.5e5, 293.15, signals["valve.supply_1"] * 2.9e-8, 0.23))
    rate = model.rates(x, [4.0])[names.index("line.pressure_1")]
    stored = 2e-5 * rate / (GAS_CONSTANT * 293.15)
    assert stored == pytest.approx(passed + filled - vented, rel=1e-4)


def test_shared_lines_are_two_lines_of_equal_size() -> None:
    both = arm(3.0).with_effect(line(name="lines"))
    each = arm(3.0).with_effect(
        *(line([(f"line_{i}.pressure", f"chamber_{i}.flow")], name=f"line_{i}") for i in (1, 2))
    )
    given = {"pressure_1": 3e5, "spool": 1.0}
    x = each.initial_state(given)
    np.testing.assert_allclose(both.initial_state(given), x)
    x[-2:] += (2e4, -3e4)
    np.testing.assert_allclose(both.rates(x, [6.0]), each.rates(x, [6.0]), rtol=1e-12)


def test_an_effect_acts_once_on_a_port() -> None:
    with pytest.raises(WorkbenchError, match="acts twice"):
        silencer(("exhaust_1.pressure", "exhaust_1.pressure"))


@pytest.mark.parametrize("departure", [0.0, 0.2, 0.4])
def test_a_closed_chamber_follows_its_polytrope(departure: float) -> None:
    model = (
        pneumatic_muscle()
        .without("heat_exchange")
        .with_effect(polytropic_exchange(("chamber.heat",), departure=departure))
    )
    f, p = model.exact.rates_function, model.values
    speed, end = -0.02, 1.0

    def length(t: float) -> float:
        return 0.2 + speed * t

    def volume(x: np.ndarray, t: float) -> float:
        return model.signals(x, [length(t), speed, 0.0])["chamber.volume"]

    x0 = model.initial_state({"pressure": 4e5})
    result = solve_ivp(
        lambda t, x: np.asarray(f(x, [length(t), speed, 0.0], p)).ravel(),
        (0.0, end),
        x0,
        rtol=1e-9,
        atol=1e-6,
    )
    x1 = result.y[:, -1]
    exponent = 1.4 - departure
    assert x1[0] * volume(x1, end) ** exponent == pytest.approx(
        x0[0] * volume(x0, 0.0) ** exponent, rel=1e-6
    )
    if departure == 0.4:
        assert x1[1] == pytest.approx(x0[1], rel=1e-6)


@pytest.mark.parametrize("flow", [6e-4, -2e-4])
def test_polytropic_gas_keeps_what_a_mass_of_it_keeps(flow: float) -> None:
    """p (V/m)^n stays, however a moving chamber is filled or vented, as textbooks have it."""
    effect = polytropic_gas(("chamber.heat",), share=1.0, exponent=1.25)
    model = pneumatic_muscle().with_effect(effect)
    f, p = model.exact.rates_function, model.values

    def inputs(t: float) -> list[float]:
        return [0.2 - 0.02 * t, -0.02, flow]

    def kept(x: np.ndarray, t: float) -> float:
        volume = model.signals(x, inputs(t))["chamber.volume"]
        mass = x[0] * volume / (GAS_CONSTANT * x[1])
        return float(x[0] * (volume / mass) ** 1.25)

    x0 = model.initial_state({"pressure": 4e5})
    result = solve_ivp(
        lambda t, x: np.asarray(f(x, inputs(t), p)).ravel(), (0, 0.5), x0, rtol=1e-10, atol=1e-7
    )
    assert abs(result.y[0, -1] / x0[0] - 1.0) > 0.1
    assert kept(result.y[:, -1], 0.5) == pytest.approx(kept(x0, 0.0), rel=1e-6)


def test_extra_heat_exchange_adds_to_the_plants_own() -> None:
    extra = arm(3.0).with_effect(extra_heat_exchange(coefficient=100.0))
    direct = arm(3.0).without("heat_exchange").with_effect(heat_exchange(coefficient=250.0))
    x = direct.initial_state({"temperature_1": 280.0})
    np.testing.assert_allclose(extra.rates(x, [5.0]), direct.rates(x, [5.0]), rtol=1e-9)
    adiabatic = arm(3.0).with_effect(extra_heat_exchange(coefficient=-150.0))
    bare = arm(3.0).without("heat_exchange")
    np.testing.assert_allclose(adiabatic.rates(x, [5.0]), bare.rates(x, [5.0]), rtol=1e-9)


MOVING = {"temperature_1": 280.0, "spool": 0.6, "speed": 0.7, "pressure_2": 5e5}


def test_isothermal_gas_neither_warms_nor_cools() -> None:
    model = arm(3.0).with_effect(isothermal_gas(CHAMBERS))
    x = model.initial_state(MOVING | {"temperature_1": 293.15})
    rates = dict(zip((q.name for q in model.states), model.rates(x, [5.5]), strict=True))
    assert rates["temperature_1"] == pytest.approx(0.0, abs=1e-9)
    assert rates["temperature_2"] == pytest.approx(0.0, abs=1e-9)
    # p V = m R T with constant T: dp/dt = (R T dm/dt - p dV/dt) / V.
    signals = model.signals(x, [5.5])
    pressure = [q.name for q in model.states].index("pressure_1")
    late = x + 1e-6 * model.rates(x, [5.5])
    grown = model.signals(late, [5.5])["chamber_1.volume"] - signals["chamber_1.volume"]
    filled = 287.05 * 293.15 * signals["chamber_1.flow"]
    expected = (filled - x[pressure] * 1e6 * grown) / signals["chamber_1.volume"]
    assert rates["pressure_1"] == pytest.approx(expected, rel=1e-4)


def test_the_energy_balance_gives_back_what_isothermal_gas_leaves_out() -> None:
    whole = arm(3.0)
    restored = whole.with_effect(isothermal_gas(CHAMBERS)).with_effect(gas_energy_balance())
    x = whole.initial_state(MOVING)
    np.testing.assert_allclose(restored.rates(x, [5.5]), whole.rates(x, [5.5]), rtol=1e-9)


def test_what_runs_over_is_spilled_or_caught() -> None:
    effect = overflow([TANKS], coefficient=3.0, limit=10.0, caught=0.25)
    model = bench(effect, "m3/s", "level")
    u = [5.0, 12.0]
    x = model.initial_state(u=u)
    upper, lower = model.read(x, u)
    assert upper == pytest.approx(5.0 - 3.0 * 2.0)
    assert lower == pytest.approx(5.0 + 0.25 * 3.0 * 2.0)
    whole = bench(overflow([TANKS], coefficient=3.0, limit=10.0, caught=1.0), "m3/s", "level")
    assert sum(whole.read(x, u)) == pytest.approx(2 * 5.0)
    below = model.initial_state(u=[5.0, 9.0])
    assert model.read(below, [5.0, 9.0]).tolist() == [5.0, 5.0]
