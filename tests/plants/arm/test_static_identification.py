"""Identification of the static law from arrays: coverage, order, censoring, mistakes."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.physics.force_laws import PaperLaw, Petrovic
from workbench.plants.arm.static_identification import identify_static_force

TRUTH = PaperLaw()
CONTRACTIONS = np.array([0.0, 1.0, 2.0, 4.0, 7.0, 10.0, 14.0, 18.0, 22.0, 26.0, 30.0]) * 1e-3


def grid(points: int = 40) -> tuple[np.ndarray, np.ndarray]:
    q, p = np.meshgrid(CONTRACTIONS, np.linspace(0.0, 6e5, points))
    return p, q


def test_intervals_hold_the_truth_as_often_as_they_say(rng: np.random.Generator) -> None:
    p, q = grid()
    force = TRUTH.force(q, p)
    inside = []
    for _ in range(60):
        fit = identify_static_force(p, q, force + rng.normal(0.0, 1.0, q.shape), orders=(4,))
        truth = [*TRUTH.gain_bar_mm, *TRUTH.phi_mm, 1e3 * TRUTH.phi_switch]
        ends = [fit.interval(name) for name in fit.names]
        inside.append([a <= v <= b for v, (a, b) in zip(truth, ends, strict=True)])
    # 60 draws of 95 %: below 85 % with a probability of 0.2 % for each number.
    assert np.mean(inside, axis=0).min() > 0.85
    assert np.mean(inside) > 0.90


def test_exact_data_return_the_coefficients() -> None:
    p, q = grid()
    fit = identify_static_force(p, q, TRUTH.force(q, p))
    assert fit.values[:3] == pytest.approx(TRUTH.gain_bar_mm, rel=1e-6)
    assert fit.law.phi_mm == pytest.approx(TRUTH.phi_mm, rel=1e-5)
    assert fit.law.phi_floor == pytest.approx(-9.2101, abs=1e-4)
    assert fit.law.phi_switch == pytest.approx(TRUTH.phi_switch, abs=1e-8)


def test_the_order_is_found_by_held_out_contractions(rng: np.random.Generator) -> None:
    p, q = grid()
    for order, coefficients in ((1, (-10.0, -12.0)), (2, (-10.0, -12.0, -0.2))):
        law = PaperLaw(phi_mm=coefficients, phi_floor=1e6, phi_switch=-1.0)
        fit = identify_static_force(p, q, law.force(q, p) + rng.normal(0.0, 0.5, q.shape))
        assert fit.order == order
        assert not fit.has_switch


def test_without_phi_a_constant_of_zero_is_found(rng: np.random.Generator) -> None:
    p, q = grid()
    force = Petrovic().force(q, p) + rng.normal(0.0, 0.5, q.shape)
    fit = identify_static_force(p, q, force, orders=(0, 1, 2, 3))
    assert fit.order == 0
    low, high = fit.interval("phi_0")
    assert low - 0.1 < 0.0 < high + 0.1


def test_slack_points_are_left_out_and_counted() -> None:
    p, q = grid()
    force = TRUTH.force(q, p)
    fit = identify_static_force(p, q, force, orders=(4,))
    assert fit.slack == int((force < 5.0).sum())
    assert fit.used + fit.slack == q.size
    # Taking the slack points as they are bends every line.
    gain = np.polyfit(p[:, -1] / 1e5, force[:, -1], 1)[0]
    lines = fit.values[:3] @ np.array([1.0, 30.0, 900.0])
    assert gain < 0.85 * float(lines)


def test_a_wrong_law_shows_in_the_held_out_error(rng: np.random.Generator) -> None:
    p, q = grid()
    force = TRUTH.force(q, p) * (1 + 0.3 * (p / 6e5) * (q / 0.03) ** 2)
    fit = identify_static_force(p, q, force + rng.normal(0.0, 0.5, q.shape))
    assert fit.residual_rms > 2.0
    assert min(fit.held_out.values()) > 2.0


def test_data_that_start_above_the_switch_have_none(rng: np.random.Generator) -> None:
    p, q = grid()
    p, q = p[:, 3:], q[:, 3:]
    fit = identify_static_force(
        p, q, TRUTH.force(q, p) + rng.normal(0.0, 0.5, q.shape), orders=(4,)
    )
    assert not fit.has_switch
    assert fit.law.phi_switch == pytest.approx(4e-3)


def test_it_prints_itself() -> None:
    p, q = grid()
    text = str(identify_static_force(p, q, TRUTH.force(q, p)))
    for word in ("D1", "phi_4", "N/mm4", "switch", "held out", "95 %", "slack"):
        assert word in text


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda p, q, f: (p[:5], q, f), "must be the same"),
        (lambda p, q, f: (p * np.nan, q, f), "not finite"),
        (lambda p, q, f: (p / 1e5, q, f), "gauge pressures in Pa"),
        (lambda p, q, f: (p, q * 1e3, f), "contractions in m"),
        (lambda p, q, f: (p, q, 0 * f), "slack in every point"),
        (lambda p, q, f: (p[:2, :3], q[:2, :3], f[:2, :3]), "needs 20 or more"),
        (lambda p, q, f: (p[:, :2], q[:, :2], f[:, :2]), "2 contraction"),
    ],
)
def test_unfit_data_are_refused(change: object, text: str) -> None:
    p, q = grid()
    with pytest.raises(WorkbenchError, match=text) as caught:
        identify_static_force(*change(p, q, TRUTH.force(q, p)))  # type: ignore[operator]
    assert "\n" not in str(caught.value)


def test_an_unknown_number_is_named() -> None:
    p, q = grid()
    fit = identify_static_force(p, q, TRUTH.force(q, p), orders=(4,))
    with pytest.raises(WorkbenchError, match="there are D1, D2"):
        fit.interval("D4")
