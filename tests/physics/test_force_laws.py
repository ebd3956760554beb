"""Force laws: printed defects and corrections, published figures, agreement of the forms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.physics.numbers_of import on_symbols
from workbench.errors import WorkbenchError
from workbench.model.regularisation import EXACT, REGULARISED
from workbench.physics.force_laws import (
    PHI_FLOOR,
    PHI_SWITCH,
    PHI_SWITCH_PRINTED,
    ForceLaw,
    PaperLaw,
    Petrovic,
    Sarosi,
    TonduLopez,
    pressure_gain,
    slack,
)

LAWS: dict[str, ForceLaw] = {
    "corrected": PaperLaw.variant("corrected"),
    "as_printed": PaperLaw.variant("as_printed"),
    "petrovic": Petrovic(),
    "tondu_1": TonduLopez(),
    "tondu_2": TonduLopez.constant_k(),
    "tondu_2_p": TonduLopez.pressure_dependent_k(),
    "sarosi": Sarosi(),
}


def test_printed_absolute_pressure_pulls_without_pressure() -> None:
    printed, corrected = PaperLaw.variant("as_printed"), PaperLaw.variant("corrected")
    assert float(printed.force(0.0, 0.0)) == pytest.approx(274.5, abs=0.5)  # "274 N"
    # 9.2 N below slack the rounding of the clamp still leaves 1/(4*9.2) N.
    assert float(corrected.force(0.0, 0.0)) == pytest.approx(0.027, abs=0.001)


def test_paper_law_against_sarosi_where_the_two_rigs_differ() -> None:
    contraction, pressure = np.meshgrid(np.linspace(20e-3, 30e-3, 11), np.linspace(4e5, 6e5, 9))
    excess = PaperLaw().tension(contraction, pressure) / Sarosi().tension(contraction, pressure) - 1
    assert excess.min() == pytest.approx(0.20, abs=0.01)
    assert excess.max() == pytest.approx(0.49, abs=0.01)


def test_tondu_lopez_follows_from_virtual_work_of_the_braid() -> None:
    # Independent route: volume of a cylinder whose fibre of fixed length makes a fixed number of
    # turns, differentiated numerically.
    length, angle, diameter, h = 0.2, np.radians(25.0), 0.02, 1e-6

    def volume(s: float) -> float:
        fibre2 = (length / np.cos(angle)) ** 2
        turns = length * np.tan(angle) / (np.pi * diameter)
        return s * (fibre2 - s * s) / (4 * np.pi * turns**2)

    for q in (0.0, 0.01, 0.03):
        s = length - q
        work = -(volume(s + h) - volume(s - h)) / (2 * h)
        # central difference of a cubic: error of order h^2
        assert float(TonduLopez().tension(q, 1.0)) == pytest.approx(work, rel=1e-6)


@pytest.mark.parametrize(("names", "law"), [(1, "tondu_2"), (2, "tondu_2_p")])
def test_shape_factors_are_the_least_squares_fit_they_are_said_to_be(names: int, law: str) -> None:
    q, p = np.meshgrid(np.linspace(0, 30e-3, 31), np.linspace(1e5, 6e5, 21))
    measured = PaperLaw().tension(q, p)
    pulls = measured > 0

    def residual(x: np.ndarray) -> np.ndarray:
        trial = TonduLopez(k_constant=x[0], k_exponential=x[1] if names == 2 else 0.0)
        return np.asarray((trial.tension(q, p) - measured)[pulls])

    shipped = LAWS[law]
    assert isinstance(shipped, TonduLopez)
    best = least_squares(residual, np.ones(names)).x
    assert shipped.k_constant == pytest.approx(best[0], rel=1e-3)
    if names == 2:
        assert shipped.k_exponential == pytest.approx(best[1], rel=1e-3)
    rms = float(np.sqrt(np.mean(residual(best) ** 2)))
    assert rms == pytest.approx({1: 105.7, 2: 38.7}[names], rel=0.01)


def test_petrovic_is_the_paper_law_without_phi() -> None:
    q, p = np.linspace(0, 0.03, 7), 4e5
    assert np.allclose(
        PaperLaw().tension(q, p) - Petrovic().tension(q, p), PaperLaw().phi(q), atol=1e-9
    )


def test_slack_is_a_rounded_clamp() -> None:
    tension = np.linspace(-500.0, 500.0, 1001)
    assert np.all(slack(tension) > 0)
    assert np.max(np.abs(slack(tension) - np.maximum(tension, 0))) == pytest.approx(0.5)
    far = np.abs(tension) > 25  # w^2/(4 T) = 10 mN
    assert np.max(np.abs(slack(tension) - np.maximum(tension, 0))[far]) < 0.01
    assert np.all(np.diff(slack(tension)) > 0)
    assert np.array_equal(slack(tension, width=0.0), np.maximum(tension, 0))


def test_slack_has_one_curvature_on_both_sides_of_zero() -> None:
    below, at, above = on_symbols(lambda x: ca.hessian(slack(x), x)[0], np.array([-1e-6, 0, 1e-6]))
    assert below == pytest.approx(above)
    assert at == pytest.approx(0.5)  # 1 / (2 w)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("form", [EXACT, REGULARISED], ids=["exact", "regularised"])
@pytest.mark.parametrize("kind", ["tension", "force"])
def test_arrays_and_expressions_agree(name: str, form: object, kind: str) -> None:
    law: Callable[..., Any] = partial(getattr(LAWS[name], kind), form=form)
    q, p = np.meshgrid(np.linspace(-0.5e-3, 33e-3, 68), np.linspace(0, 8e5, 9))
    array = law(q, p)
    assert np.shape(array) == q.shape
    # the same operations in another order of evaluation: rounding of a force of 2 kN
    assert np.allclose(on_symbols(law, q, p), array, rtol=0, atol=1e-9)
    assert float(law(float(q[3, 40]), float(p[3, 40]))) == pytest.approx(array[3, 40], abs=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_slope_is_finite_everywhere_in_range(name: str) -> None:
    q, p = ca.SX.sym("q"), ca.SX.sym("p")
    for form in (EXACT, REGULARISED):
        force = LAWS[name].force(q, p, form=form)
        slopes = ca.Function("s", [q, p], [ca.jacobian(force, ca.vertcat(q, p))])
        grid = np.array([slopes(a, b) for a in (-5e-4, 0.0, 1.6e-3, PHI_SWITCH, 0.033)
                         for b in (0.0, 1e5, 8e5)])  # fmt: skip
        assert np.all(np.isfinite(grid))


@pytest.mark.parametrize("name", ["corrected", "as_printed"])
def test_forms_differ_only_around_the_switch_of_phi(name: str) -> None:
    law = LAWS[name]
    assert isinstance(law, PaperLaw)
    q = np.linspace(0, 0.033, 33001)
    difference = np.abs(law.phi(q, form=REGULARISED) - law.phi(q, form=EXACT))
    near = np.abs(q - law.phi_switch) < 0.05e-3
    assert np.max(difference[~near]) < 1e-12
    # half of the printed jump; the corrected law has only a kink there
    assert np.max(difference[near]) == pytest.approx(
        {"corrected": 0.161, "as_printed": 2.94}[name], rel=0.1
    )


def test_identified_coefficients_make_a_new_law() -> None:
    law = PaperLaw(gain_bar_mm=(300.0, -2.0, 0.0), phi_mm=(0.0,), phi_floor=0.0, phi_switch=0.0)
    assert float(law.tension(0.01, 2e5)) == pytest.approx(560.0)


def test_unknown_variant_names_the_nearest() -> None:
    with pytest.raises(WorkbenchError, match="did you mean 'as_printed'"):
        PaperLaw.variant("as-printed")  # type: ignore[arg-type]


def jump(switch: float) -> float:
    """Step of phi across its switch, N."""
    law = PaperLaw(phi_switch=switch)
    return float(law.phi(switch + 1e-12) - law.phi(switch - 1e-12))


def test_printed_phi_jumps_at_its_switch_and_the_corrected_one_does_not() -> None:
    # At 1.6 mm the polynomial is still 5.88 N above the floor: the tension jumps by -5.88 N as
    # the muscle lengthens, by as much upwards as it shortens.
    assert jump(PHI_SWITCH_PRINTED) == pytest.approx(5.88, abs=0.005)
    assert jump(PHI_SWITCH) == pytest.approx(0.0, abs=1e-6)


def test_phi_needs_its_branch() -> None:
    # Without the branch the muscle would push with 61.6 N at no pressure and no contraction.
    assert float(PaperLaw(phi_switch=-1.0).phi(0.0)) == pytest.approx(61.62)
    assert float(PaperLaw().phi(0.0)) == PHI_FLOOR
    assert np.all(PaperLaw().phi(np.linspace(0.0, 33e-3, 3301)) <= PHI_FLOOR + 1e-9)


def test_gain_has_its_minimum_at_33_mm() -> None:
    q = np.linspace(0.0, 0.05, 50001)
    assert 1e3 * q[np.argmin(pressure_gain(q))] == pytest.approx(33.33, abs=0.01)
