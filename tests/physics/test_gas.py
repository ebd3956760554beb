"""Gas in a chamber: limits, conservation and the printed sign, by integration of the rates."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.physics.numbers_of import on_symbols
from workbench.model.regularisation import EXACT, REGULARISED
from workbench.physics.gas import (
    GAS_CONSTANT,
    HEAT_RATIO,
    chamber_rates,
    port_enthalpy_flow,
    wall_heat,
)

CV = GAS_CONSTANT / (HEAT_RATIO - 1)
"""Specific heat capacity of air at constant volume, J/(kg K)."""

AMBIENT = 293.15
AREA = 0.0126
V0 = 1e-4
PERIOD = 1.0

Inputs = Callable[[float, float, float], tuple[float, float, float]]


def chamber_mass(pressure: float, temperature: float, volume: float) -> float:
    """Mass of an ideal gas, equation (5) of the paper."""
    return pressure * volume / (GAS_CONSTANT * temperature)


def breathing_volume(t: float) -> tuple[float, float]:
    """Volume and its rate over a closed cycle between 1 and 1.6 times V0."""
    w = 2 * np.pi / PERIOD
    return V0 * (1.3 - 0.3 * np.cos(w * t)), V0 * 0.3 * w * np.sin(w * t)


def integrate(inputs: Inputs, *, p0: float = 4e5, end: float = PERIOD, printed: bool = False):  # type: ignore[no-untyped-def]
    """Integrate p, T, gas work, heat, mass and enthalpy through the port; return the end state.

    ``inputs(t, p, T)`` gives mass flow, enthalpy flow and heat.
    """

    def rates(t: float, y: np.ndarray) -> list[float]:
        p, T = y[:2]
        volume, volume_rate = breathing_volume(t)
        flow, enthalpy, heat = inputs(t, p, T)
        dp, dT = chamber_rates(
            p, T, volume, volume_rate, flow, enthalpy, heat, printed_work_sign=printed
        )
        return [dp, dT, p * volume_rate, heat, flow, HEAT_RATIO * CV * enthalpy]

    start = [p0, AMBIENT, 0.0, 0.0, 0.0, 0.0]
    result = solve_ivp(
        rates, (0.0, end), start, rtol=1e-10, atol=1e-12, method="LSODA", max_step=PERIOD / 200
    )
    assert result.success
    return result.y[:, -1]


def walled(coefficient: float) -> Inputs:
    """No flow, and heat through the wall."""
    return lambda t, p, T: (0.0, 0.0, wall_heat(T, AMBIENT, coefficient=coefficient, area=AREA))


CLOSED = walled(0.0)


def open_port(t: float, p: float, T: float) -> tuple[float, float, float]:
    """Flow in and out with its own temperature, and heat through the wall."""
    flow = 4e-4 * np.sin(2 * np.pi * t / PERIOD + 0.7)
    return (
        flow,
        float(port_enthalpy_flow(flow, 280.0, T)),
        wall_heat(T, AMBIENT, coefficient=150.0, area=AREA),
    )


def test_adiabatic_limit() -> None:
    end = integrate(CLOSED, end=PERIOD / 2)
    assert end[0] == pytest.approx(4e5 * 1.6**-1.4, rel=1e-8)
    assert end[1] == pytest.approx(AMBIENT * 1.6**-0.4, rel=1e-8)


def test_isothermal_limit() -> None:
    end = integrate(walled(1e7), end=PERIOD / 2)
    # the wall lags by the heat it has to carry over h S: p dV/dt / (h S) = 1e-3 K
    assert end[0] == pytest.approx(4e5 / 1.6, rel=1e-5)
    assert end[1] == pytest.approx(AMBIENT, abs=1e-2)


def test_polytropic_exponent_lies_between_the_limits() -> None:
    end = integrate(walled(150.0), end=PERIOD / 2)
    exponent = -np.log(end[0] / 4e5) / np.log(1.6)
    assert 1.0 < exponent < 1.4


def test_printed_sign_gives_the_exponent_0_6() -> None:
    printed = integrate(CLOSED, end=PERIOD / 2, printed=True)
    exponent = -np.log(printed[0] / 4e5) / np.log(1.6)
    assert exponent == pytest.approx(0.6, abs=1e-8)
    # expanding gas that heats up
    assert printed[1] > AMBIENT


def test_printed_sign_is_a_source_of_energy() -> None:
    # m c_v T gained + work given, with no heat and no flow, must be zero.
    for printed, balanced in ((False, True), (True, False)):
        p, T, work, *_ = integrate(CLOSED, end=PERIOD / 2, printed=printed)
        stored = CV * (chamber_mass(p, T, 1.6 * V0) * T - chamber_mass(4e5, AMBIENT, V0) * AMBIENT)
        created = stored + work
        assert bool(abs(created) < 1e-6 * work) is balanced
        if printed:
            assert created == pytest.approx(2 * work, rel=1e-6)


def test_energy_over_a_closed_cycle_with_flow_and_heat() -> None:
    p, _, work, heat, _, enthalpy = integrate(open_port)
    stored = CV / GAS_CONSTANT * V0 * (p - 4e5)  # m c_v T = p V c_v / R
    assert work != pytest.approx(0.0, abs=0.1)  # the cycle does something
    assert stored == pytest.approx(heat + enthalpy - work, abs=1e-6)


def test_energy_over_a_closed_cycle_without_flow() -> None:
    # Work in = heat out after the gas has come back to where it began, here after many cycles.
    before, after = (integrate(walled(600.0), end=n * PERIOD) for n in (12, 13))
    assert after[0] == pytest.approx(before[0], rel=1e-6)
    work, heat = (after - before)[2:4]
    assert heat == pytest.approx(work, rel=1e-4)
    assert work < 0  # a lagging temperature costs work on every cycle: the second law


def test_mass_is_conserved() -> None:
    p, T, _, _, entered, _ = integrate(open_port)
    gained = chamber_mass(p, T, V0) - chamber_mass(4e5, AMBIENT, V0)
    assert gained == pytest.approx(entered, abs=1e-11)


def test_two_flows_with_their_own_temperatures_enter_as_sums() -> None:
    one = chamber_rates(3e5, 300.0, V0, 0.0, 1e-3, 1e-3 * 290.0)
    two = chamber_rates(3e5, 300.0, V0, 0.0, -4e-4, -4e-4 * 300.0)
    both = chamber_rates(3e5, 300.0, V0, 0.0, 6e-4, 1e-3 * 290.0 - 4e-4 * 300.0)
    assert np.allclose(np.add(one, two), both)


def test_charging_from_vacuum_heats_by_gamma() -> None:
    # Classic result: a rigid adiabatic tank filled from nothing ends at gamma times the supply's
    # temperature. Starting at 1/1000 of the end pressure leaves 0.1 % of it.
    def rates(t: float, y: np.ndarray) -> list[float]:
        return list(chamber_rates(y[0], y[1], V0, 0.0, 1e-3, 1e-3 * AMBIENT))

    start = 1e3
    end_time = (1e6 - start) * V0 / (HEAT_RATIO * GAS_CONSTANT * 1e-3 * AMBIENT)
    final = solve_ivp(rates, (0, end_time), [start, AMBIENT], rtol=1e-9, atol=1e-6).y[:, -1]
    assert final[0] == pytest.approx(1e6, rel=1e-6)
    assert final[1] == pytest.approx(1.4 * AMBIENT, rel=2e-3)


def test_port_temperature_is_that_of_the_source() -> None:
    flow = np.array([-1e-2, 0.0, 1e-2])
    for form in (EXACT, REGULARISED):
        assert np.allclose(port_enthalpy_flow(flow, 290.0, 320.0, form=form), [-3.2, 0.0, 2.9])


@pytest.mark.parametrize("printed", [False, True])
def test_arrays_and_expressions_agree(printed: bool) -> None:
    rates = partial(chamber_rates, printed_work_sign=printed)
    rng = np.random.default_rng(1)
    low = np.array([1e5, 250.0, 5e-5, -1e-3, -1e-2, -3.0, -50.0])
    high = np.array([7e5, 350.0, 2e-4, 1e-3, 1e-2, 3.0, 50.0])
    values = list((low + (high - low) * rng.random((20, 7))).T)
    assert np.allclose(on_symbols(rates, *values), rates(*values), rtol=1e-12)
    out = np.linspace(-1e-5, 1e-5, 41)
    for form in (EXACT, REGULARISED):
        port = partial(
            port_enthalpy_flow, outside_temperature=290.0, chamber_temperature=320.0, form=form
        )
        assert np.allclose(on_symbols(port, out), port(out), rtol=1e-12, atol=1e-18)


def test_forms_of_the_port_differ_only_around_zero_flow() -> None:
    flow = np.linspace(-1e-4, 1e-4, 2001)
    difference = np.abs(
        port_enthalpy_flow(flow, 290.0, 320.0, form=REGULARISED)
        - port_enthalpy_flow(flow, 290.0, 320.0)
    )
    assert np.all(difference[np.abs(flow) > 1.01e-6] < 1e-15)
    assert difference.max() < 30.0 * 1e-6  # of 3 at full flow
