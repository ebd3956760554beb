from dataclasses import replace

import numpy as np
import pytest

from tests.recordings.example import recorded
from workbench.errors import WorkbenchError
from workbench.recordings import resample
from workbench.recordings.resampling import at_one_pace, low_pass


def test_commands_are_held_and_measurements_interpolated() -> None:
    steps = np.repeat([1.0, 3.0, 2.0], 4)
    held = resample(recorded(0.1, {"x": steps}, {}), rate_Hz=40.0)
    assert set(held["x"]) == {1.0, 3.0, 2.0}
    assert held["x"][held.time < 0.39].max() == 1.0
    assert held["x"][np.searchsorted(held.time, 0.4 - 1e-9)] == 3.0
    line = resample(recorded(0.1, {}, {"x": np.arange(12.0)}), rate_Hz=40.0)
    assert np.allclose(line["x"], 10 * line.time)


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_a_lower_rate_keeps_slow_and_removes_fast(factor: int) -> None:
    dt, n = 0.002, 5000
    time = dt * np.arange(n)
    new_rate = 1 / (dt * factor)
    slow = np.sin(0.1 * 2 * np.pi * new_rate * time)
    fast = np.sin(0.8 * 2 * np.pi * new_rate * time)
    thin = resample(recorded(dt, {}, {"x": slow + fast}), times=time[::factor])
    inner = slice(20, -20)
    # Without the filter the fast sine would fold down to 0.2 of the rate with full amplitude; the
    # sinc with Hamming window suppresses it by more than 50 dB.
    assert np.allclose(thin["x"][inner], slow[::factor][inner], atol=5e-3)
    assert np.allclose(thin.time, time[::factor])


def test_even_steps_leave_the_noise_as_it_is() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.choice([0.5, 1.0, 1.5], 2000))
    noise = rng.normal(size=2000)
    recording = recorded(time, {}, {"x": 20 * np.sin(time / 10) + noise})
    even = resample(recording, times=np.linspace(time[0], time[-1], 2000))
    left = even["x"] - 20 * np.sin(even.time / 10)
    # Straight lines would leave two thirds of its power, and a third of that shared by neighbours.
    assert np.std(left) == pytest.approx(1.0, abs=0.08)
    assert abs(np.mean(left[1:] * left[:-1])) < 0.2


def test_recordings_of_several_rates_come_to_that_of_the_slowest() -> None:
    rng = np.random.default_rng(0)
    times = [np.arange(200) * 0.1, np.arange(80) * 0.25, np.cumsum(rng.choice([0.1, 0.2], 200))]
    made = [recorded(t, {}, {"x": np.sin(t)}) for t in times]
    for one in at_one_pace(made):
        assert np.allclose(np.diff(one.time), 0.25, atol=1e-9)
        assert np.allclose(one["x"], np.sin(one.time), atol=0.02)
    # A gap is no other rate.
    holed = recorded(np.delete(times[0], [50, 51]), {}, {"x": np.zeros(198)})
    assert at_one_pace([made[0], holed]) == [made[0], holed]


def test_clocks_that_hardly_differ_move_no_sample() -> None:
    noise = np.random.default_rng(0).normal(size=(2, 1000))
    times = 300.0 + np.arange(1000) * 0.02, np.arange(1000) * 0.02 * (1.0 + 1e-5)
    one, other = at_one_pace([recorded(times[k], {}, {"x": noise[k]}) for k in range(2)])
    assert one.sample_time == pytest.approx(other.sample_time, rel=1e-9)
    assert np.array_equal(one["x"], noise[0]) and np.array_equal(other["x"], noise[1])


def test_low_pass_has_no_delay_and_unit_gain() -> None:
    time = np.linspace(0.0, 1.0, 401)
    assert np.allclose(low_pass(3 * time + 1, 0.05), 3 * time + 1, atol=1e-9)
    pulse = np.exp(-(((time - 0.5) / 0.05) ** 2))
    assert abs(int(np.argmax(low_pass(pulse, 0.1))) - int(np.argmax(pulse))) == 0


def test_uneven_time_base_and_missing_samples() -> None:
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.5e-2, 1.5e-2, 500))
    values = np.sin(3 * time)
    values[100:103] = np.nan
    even = resample(recorded(time, {}, {"x": values}), times=np.linspace(time[0], time[-1], 500))
    # Straight lines over at most 60 ms of a 3 rad/s sine: (w h)^2 / 8.
    assert np.allclose(even["x"], np.sin(3 * even.time), atol=5e-3)


@pytest.mark.parametrize("rate", [99.99, 25.0])
def test_what_was_not_recorded_is_not_judged_at_another_rate(rate: float) -> None:
    time = np.arange(1000) * 0.01
    values, command = np.sin(time), np.sign(np.sin(time))
    values[400:500] = np.nan
    other = resample(recorded(time, {"u": command}, {"x": values}), rate_Hz=rate)
    gap = (other.time > 3.99) & (other.time < 5.0)
    away = np.minimum(np.abs(other.time - 3.99), np.abs(other.time - 5.0))
    clear = away > 0.5 / rate
    assert not other.valid("x")[gap & clear].any() and other.valid("x")[~gap & clear].all()
    assert np.isfinite(other["x"]).all() and other.valid("u").all()


@pytest.mark.parametrize("step", [0.7, 1.0, 3.0])
def test_what_a_command_did_between_uneven_samples_is_kept(step: float) -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.5, 2.0, 400))
    flow = np.repeat(rng.uniform(0.0, 1.0, 80), 5)
    level = np.concatenate([[0.0], np.cumsum(flow[:-1] * np.diff(time))])
    even = resample(recorded(time, {"flow": flow}, {}), times=np.arange(time[0], time[-1], step))
    filled = np.concatenate([[0.0], np.cumsum(even["flow"][:-1] * step)])
    assert np.allclose(filled, np.interp(even.time, time, level), atol=1e-9)
    # Where it stands still, it does so to the last digit.
    assert step > 2.0 or np.mean(np.diff(even["flow"]) == 0.0) > 0.5


def test_a_command_that_is_stamped_a_little_late_is_not_a_sample_late() -> None:
    rng = np.random.default_rng(0)
    late = 0.1 * np.arange(400) + rng.uniform(0.0, 0.004, 400)
    recording = recorded(late, {"u": rng.normal(size=400)}, {})
    even = resample(recording, times=np.linspace(late[0], late[-1], 400))
    assert np.allclose(even["u"], recording["u"], atol=0.2)


def test_a_clock_that_counts_since_1970_moves_no_command() -> None:
    time = 0.25 * np.arange(80)
    recording = recorded(time, {"u": time // 2.0}, {})
    there = resample(recording, rate_Hz=3.0)
    later = resample(replace(recording, time=time + 2.0**31), rate_Hz=3.0)
    assert np.allclose(later["u"], there["u"], atol=1e-5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: resample(r), "either rate_Hz or times"),
        (lambda r: resample(r, rate_Hz=10.0, times=[0.0, 1.0]), "either rate_Hz or times"),
        (lambda r: resample(r, rate_Hz=-1.0), "rate_Hz"),
        (lambda r: resample(r, times=[0.0, 99.0]), "choose instants inside"),
        (lambda r: resample(r, times=[0.5, 0.2]), "increasing instants"),
        (lambda r: resample(r.take(np.array([0, 2, 1])), rate_Hz=10.0), "does not increase"),
    ],
)
def test_mistakes(call: object, message: str) -> None:
    with pytest.raises(WorkbenchError, match=message):
        call(recorded(0.01, {}, {"x": np.arange(100.0)}))  # type: ignore[operator]
