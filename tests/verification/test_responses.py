"""Figures of merit against analytic responses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.verification import responses

T = np.arange(0.0, 12.0, 1e-4)


def second_order(damping: float, frequency: float = 3.0) -> np.ndarray:
    """Step response of w^2 / (s^2 + 2 z w s + w^2)."""
    wd = frequency * math.sqrt(1 - damping**2)
    envelope = np.exp(-damping * frequency * T)
    return 1 - envelope * (np.cos(wd * T) + damping * frequency / wd * np.sin(wd * T))


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.7])
@pytest.mark.parametrize(("initial", "final"), [(0.0, 1.0), (0.8, 0.3)])
def test_overshoot_of_a_second_order_step(damping: float, initial: float, final: float) -> None:
    trajectory = initial + (final - initial) * second_order(damping)
    expected = math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    found = responses.overshoot(trajectory, initial=initial, final=final)
    # Samples 0.1 ms apart miss the top of a 3 rad/s swing by 1e-8.
    assert found.value == pytest.approx(expected, rel=1e-5)


def test_undershoot_is_what_goes_the_wrong_way_from_the_start() -> None:
    step = np.array([0.8, 0.9, 0.7, 0.3, 0.2])
    assert responses.undershoot(step, initial=0.8, final=0.3).value == pytest.approx(0.2)
    assert responses.undershoot(step[2:], initial=0.8, final=0.3).value == 0.0


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.7])
def test_settling_of_a_second_order_step(damping: float) -> None:
    trajectory = second_order(damping)
    found = responses.settling_time(T, trajectory, initial=0.0, final=1.0).value
    # By definition: at that time the trajectory crosses the band, and it stays inside afterwards.
    at = round(found / 1e-4)
    assert abs(trajectory[at - 1] - 1) > 0.02 >= np.abs(trajectory[at:] - 1).max()
    # and before the envelope exp(-z w t) / sqrt(1 - z^2) enters it
    assert found <= -math.log(0.02 * math.sqrt(1 - damping**2)) / (damping * 3.0) + 1e-3


def test_settling_and_rise_of_a_first_order_step() -> None:
    trajectory = 2.0 - 1.0 * np.exp(-T / 0.5)
    settle = responses.settling_time(T, trajectory, initial=1.0, final=2.0).value
    assert settle == pytest.approx(0.5 * math.log(50), abs=2e-4)
    rise = responses.rise_time(T, trajectory, initial=1.0, final=2.0).value
    assert rise == pytest.approx(0.5 * math.log(9), abs=2e-4)


def test_what_does_not_settle_has_no_settling_time() -> None:
    for off, said in ((0.05 * np.sin(20 * T), "swings by more than 2 %"), (0.05, "not within 2 %")):
        found = responses.settling_time(T, np.ones_like(T) + off, initial=0.0, final=1.0)
        assert math.isnan(found.value) and found.reason.startswith(said)


def test_what_settles_too_late_to_be_seen_has_none() -> None:
    trajectory = np.where(T < 11.5, 0.0, 1.0)
    assert math.isnan(responses.settling_time(T, trajectory, initial=0.0, final=1.0).value)


def test_no_step_no_figures() -> None:
    flat = np.ones_like(T)
    for found in (
        responses.settling_time(T, flat, initial=1.0, final=1.0),
        responses.rise_time(T, flat, initial=1.0, final=1.0),
        responses.overshoot(flat, initial=1.0, final=1.0),
    ):
        assert math.isnan(found.value)
        assert found.reason == "the reference does not step"


def test_rise_that_is_not_reached() -> None:
    found = responses.rise_time(T, 0.5 * second_order(0.7), initial=0.0, final=1.0)
    assert math.isnan(found.value)
    assert "90 %" in found.reason


def test_limit_cycle_is_told_from_drift_and_offset() -> None:
    cycle = 0.3 * np.sin(2 * math.pi * 5 * T)
    drift = 0.1 + 0.05 * T
    # The fitted line still follows a trace of the five periods.
    assert responses.oscillation(T, cycle + drift).value == pytest.approx(0.3, rel=0.03)
    assert responses.oscillation(T, drift).value == pytest.approx(0.0, abs=1e-12)
    assert responses.steady_error(T, np.full_like(T, -0.2) + cycle).value == pytest.approx(
        0.2, abs=1e-4
    )


def test_few_samples_have_no_steady_error() -> None:
    found = responses.steady_error(T[:5], T[:5])
    assert math.isnan(found.value)
    assert found.reason == "fewer than 10 samples"


def test_integrals() -> None:
    sine = np.sin(2 * math.pi * T)
    # Over 12 whole periods: rms 1/sqrt 2, mean magnitude 2/pi, four amplitudes per period.
    assert responses.rms(sine).value == pytest.approx(1 / math.sqrt(2), rel=1e-6)
    assert responses.integral_absolute_error(T, sine).value == pytest.approx(
        12 * 2 / math.pi, rel=1e-4
    )
    assert responses.variation_rate(T, sine).value == pytest.approx(4.0, rel=1e-3)
