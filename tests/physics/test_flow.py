"""ISO 6358 flow: choked limit, laminar end, oddness, ratings, distance of the forms."""

from __future__ import annotations

from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.physics.numbers_of import iso6358, on_symbols, slope_of
from workbench.model.regularisation import EXACT, REGULARISED, Form
from workbench.physics.flow import REFERENCE_DENSITY, flow_function, orifice_flow

C, B = 2.9e-8, 0.23
FORMS = pytest.mark.parametrize("form", [EXACT, REGULARISED], ids=["exact", "regularised"])


@FORMS
def test_choked_flow_does_not_feel_the_downstream_pressure(form: Form) -> None:
    flows = iso6358(7e5, np.array([0.0, 0.5e5, 1.0e5, 0.229 * 7e5]), 293.15, C, B, form=form)
    # C rho0 p1; the regularised form is (1 + e^2)^(-1/4) = 0.004 % below
    assert np.allclose(flows, C * 1.185 * 7e5, rtol=1e-12 if form is EXACT else 5e-5)
    assert np.ptp(flows) == pytest.approx(0.0, abs=1e-15)


def test_choked_flow_against_gas_dynamics() -> None:
    # Independent route: an ideal nozzle of area A passes A p1 sqrt(gamma/(R T)) (2/(g+1))^(3).
    # Its sonic conductance is that flow at T0, divided by rho0 p1.
    area, gamma, R, T0 = 1e-5, 1.4, 287.05, 293.15
    nozzle = area * 5e5 * np.sqrt(gamma / (R * 320.0)) * (2 / (gamma + 1)) ** 3
    conductance = area * np.sqrt(gamma / (R * T0)) * (2 / (gamma + 1)) ** 3 / 1.185
    assert float(iso6358(5e5, 1e5, 320.0, conductance, 0.528)) == pytest.approx(nozzle, rel=1e-12)


def test_subsonic_flow_of_an_ideal_nozzle_is_near_the_ellipse() -> None:
    # With b = 0.528 the ISO ellipse approximates Saint-Venant and Wantzel within 1 %.
    g = 1.4
    r = np.linspace(0.53, 0.99, 47)
    exact = np.sqrt(r ** (2 / g) - r ** ((g + 1) / g))
    critical = (2 / (g + 1)) ** (g / (g - 1))
    peak = np.sqrt(critical ** (2 / g) - critical ** ((g + 1) / g))
    assert np.allclose(flow_function(r, critical), exact / peak, rtol=0.015)


@FORMS
def test_flow_is_odd(form: Form) -> None:
    rng = np.random.default_rng(2)
    pa, pb = rng.uniform(1e5, 7e5, (2, 200))
    ta, tb = rng.uniform(260, 330, (2, 200))
    there = orifice_flow(pa, pb, ta, tb, C, B, form=form)
    assert np.allclose(there, -orifice_flow(pb, pa, tb, ta, C, B, form=form), rtol=1e-13)
    assert np.array_equal(np.sign(there), np.sign(pa - pb))


@FORMS
def test_flow_has_one_slope_at_zero(form: Form) -> None:
    def flow(pa: Any, pb: Any) -> Any:
        return orifice_flow(pa, pb, 293.15, 293.15, C, B, form=form)

    p, h = 3e5, 0.1
    forward, backward = float(flow(p + h, p)) / h, -float(flow(p - h, p)) / h
    assert forward == pytest.approx(backward, rel=1e-4)
    out, back = (slope_of(lambda x, k=k: flow(*(x, p)[::k]), p) for k in (1, -1))
    assert (float(out), float(back)) == pytest.approx((forward, -forward), rel=1e-4)


def test_both_forms_have_the_laminar_slope_at_equal_pressures() -> None:
    h = 1e-9
    exact = float(flow_function(1 - h, B)) / h
    smooth = float(flow_function(1 - h, B, form=REGULARISED)) / h
    assert exact == pytest.approx(22.75, abs=0.01)
    assert smooth == pytest.approx(exact, rel=1e-6)


def test_distance_of_the_forms() -> None:
    r = np.linspace(0.0, 0.999999, 200001)
    exact, smooth = flow_function(r, B), flow_function(r, B, form=REGULARISED)
    error = np.abs(smooth / exact - 1)
    assert error.max() == pytest.approx(0.16, abs=0.005)  # 1 - 2^(-1/4), at r = 0.995
    assert error[r < 0.958].max() < 0.005
    assert error[r < 0.91].max() < 0.0011
    assert np.abs(smooth - exact).max() < 0.019  # of the choked flow


@FORMS
def test_every_slope_is_finite(form: Form) -> None:
    def slopes(pa: Any, pb: Any) -> Any:
        flow = orifice_flow(pa, pb, 290.0, 300.0, C, B, form=form)
        return [ca.jacobian(flow, p) for p in (pa, pb)]

    pa = np.array([1e3, 1e5, B * 3e5, 2.985e5, 3e5, 3.015e5, 3e5 / B, 5e6])
    assert np.isfinite(on_symbols(slopes, pa, np.full(len(pa), 3e5))).all()


def test_hot_gas_flows_less() -> None:
    ratio = iso6358(5e5, 1e5, 400.0, C, B) / iso6358(5e5, 1e5, 293.15, C, B)
    assert float(ratio) == pytest.approx(np.sqrt(293.15 / 400.0))


def test_manufacturers_rating_gives_the_nominal_conductance() -> None:
    # 700 l/min +-10 % from 6 to 5 bar gauge: the nominal 2.9e-8 passes 707 l/min
    per_conductance = float(iso6358(7.01325e5, 6.01325e5, 293.15, 1.0, B))
    per_litre = REFERENCE_DENSITY / 60e3
    assert 700.0 * per_litre / per_conductance == pytest.approx(2.87e-8, abs=0.005e-8)
    assert C * per_conductance == pytest.approx(707.4 * per_litre, rel=1e-3)


@FORMS
def test_arrays_and_expressions_agree(form: Form) -> None:
    law = partial(orifice_flow, conductance=C, critical_ratio=B, form=form)
    rng = np.random.default_rng(3)
    pa = rng.uniform(0.9e5, 7e5, 300)
    pb = np.where(rng.random(300) < 0.3, pa * rng.uniform(0.99, 1.01, 300), pa[::-1])
    ta, tb = rng.uniform(260, 330, (2, 300))
    array = law(pa, pb, ta, tb)
    assert np.allclose(on_symbols(law, pa, pb, ta, tb), array, rtol=1e-11, atol=1e-18)
    scalar = law(float(pa[5]), float(pb[5]), float(ta[5]), float(tb[5]))
    assert float(scalar) == pytest.approx(array[5], rel=1e-12)
