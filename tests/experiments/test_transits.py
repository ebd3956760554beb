"""Transit figures on curves whose figures are known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.experiments import measure_transits

STEP = 0.002


def rippled(frequency: float, depth: float, duration: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """A ramp from 0 to 60 deg whose speed swings about its mean by a share ``depth``."""
    time = np.arange(0.0, duration + 2.0, STEP)
    moving = np.clip(time - 1.0, 0.0, duration)
    mean = np.radians(60.0) / duration
    omega = 2 * np.pi * frequency
    angle = mean * (moving - depth / omega * np.sin(omega * moving))
    return time, angle


def test_ripple_frequency_and_dips_of_a_rippled_ramp() -> None:
    time, angle = rippled(2.0, 0.6)
    figures = measure_transits(time, angle)
    # Three swings fit in: maxima at 0.25, 0.75 and 1.25 s, and so two dips between them.
    assert figures.dips == 2
    assert figures.ripple_frequency == pytest.approx(2.0, rel=0.02)


def test_a_shallow_wobble_is_no_dip() -> None:
    assert measure_transits(*rippled(2.0, 0.01)).dips == 0


def test_noise_and_quantisation_leave_the_figures(rng: np.random.Generator) -> None:
    time, angle = rippled(2.3, 0.6)
    count = math.radians(0.002)
    noisy = np.round((angle + rng.normal(0.0, count, angle.size)) / count) * count
    clean, read = measure_transits(time, angle), measure_transits(time, noisy)
    assert read.dips == clean.dips
    assert read.transit_time == pytest.approx(clean.transit_time, abs=STEP)
    assert read.ripple_frequency == pytest.approx(clean.ripple_frequency, rel=0.03)


def test_a_fall_is_measured_like_a_rise() -> None:
    time, angle = rippled(2.0, 0.6)
    up, down = measure_transits(time, angle), measure_transits(time, np.radians(60.0) - angle)
    assert down.transits[0].direction == -1
    assert down.transit_time == pytest.approx(up.transit_time, abs=1e-9)
    assert down.dips == up.dips


def test_touch_speed_of_a_braking_arm() -> None:
    time = np.arange(0.0, 2.0, STEP)
    run = np.maximum(time - 0.5, 0.0)
    angle = np.radians(np.minimum(100.0 * run - 30.0 * run**2, 60.0))
    t = (100 - math.sqrt(100**2 - 4 * 30 * 60)) / 60
    touch = math.degrees(measure_transits(time, angle).touch_speed)
    assert touch == pytest.approx(100 - 60 * t, abs=0.5)


@pytest.mark.parametrize(
    ("angle_deg", "reason"),
    [(np.full(1000, 30.0), "never goes"), (np.linspace(-5, 58, 1000), "no stop is touched")],
)
def test_missing_figures_are_nan_with_a_reason(angle_deg: np.ndarray, reason: str) -> None:
    figures = measure_transits(STEP * np.arange(1000), np.radians(angle_deg))
    assert math.isnan(figures.touch_speed)
    assert reason in figures.reason


def test_a_turn_in_mid_travel_is_no_transit() -> None:
    time = np.arange(0.0, 4.0, STEP)
    figures = measure_transits(time, np.radians(25.0 * (1 - np.cos(np.pi * time))))  # 0..50 deg
    assert figures.transits == ()


@pytest.mark.parametrize(
    ("time", "angle", "text"),
    [
        (np.arange(10.0), np.zeros(10), "20 or more"),
        (np.arange(100.0), np.zeros(99), "as many of both"),
        (np.arange(100.0) ** 2, np.zeros(100), "evenly spaced"),
        (np.arange(100.0), np.full(100, np.nan), "not finite"),
        (np.arange(100.0), np.zeros(100), "sample time is 1 s"),
    ],
)
def test_unfit_arrays_are_refused(time: np.ndarray, angle: np.ndarray, text: str) -> None:
    with pytest.raises(WorkbenchError, match=text):
        measure_transits(time, angle)
