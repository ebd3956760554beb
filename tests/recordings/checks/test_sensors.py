"""Frozen, clipped, constant and wrongly scaled sensors are found; sound ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.recordings import Recording, check_recording
from workbench.recordings.example import example_recording

TRIAL = example_recording(seconds=6.0)


def with_values(name: str, values: np.ndarray, **changes: str) -> Recording:
    return TRIAL.with_signal(replace(TRIAL.signal(name), values=values, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("closed", [False, True])
def test_sound_recordings_pass(seed: int, closed: bool) -> None:
    report = check_recording(example_recording(seconds=6.0, seed=seed, closed_loop=closed))
    assert report.result == "pass", str(report)


@pytest.mark.parametrize("name", ["angle", "pressure_1"])
@pytest.mark.parametrize("length", [40, 200])
def test_frozen_reading(name: str, length: int) -> None:
    values = TRIAL[name].copy()
    # Freeze where the signal moves, or nothing would be lost.
    start = 500 + int(np.argmax(np.abs(values[500 + length : 2500] - values[500 : 2500 - length])))
    values[start : start + length] = values[start]
    report = check_recording(with_values(name, values))
    check = report.check("stuck samples")
    assert check.result == "corrected", check.note
    bad = np.flatnonzero(~report.recording.valid(name))
    assert abs(bad[0] - start - 1) <= 1
    assert abs(len(bad) - (length - 1)) <= 1


def test_frozen_for_most_of_the_time_is_unfit() -> None:
    values = TRIAL["pressure_1"].copy()
    values[1500:] = values[1500]
    report = check_recording(with_values("pressure_1", values))
    assert report.check("stuck samples").result == "unfit"


@pytest.mark.parametrize("name", ["angle", "pressure_1"])
@pytest.mark.parametrize("quantile", [0.9, 0.98])
def test_clipped_sensor(name: str, quantile: float) -> None:
    limit = float(np.quantile(TRIAL[name], quantile))
    report = check_recording(with_values(name, np.minimum(TRIAL[name], limit)))
    check = report.check("clipping")
    assert check.result == "corrected", check.note
    assert check.values["limits"][name] == pytest.approx(limit)
    # The values stay, because the true ones lie beyond; the samples are excluded.
    lost = np.mean(~report.recording.valid(name))
    assert lost == pytest.approx(1 - quantile, abs=0.01)
    assert report.recording[name].max() == pytest.approx(limit)


def test_clipped_for_long_is_unfit() -> None:
    limit = float(np.median(TRIAL["pressure_2"]))
    clipped = with_values("pressure_2", np.maximum(TRIAL["pressure_2"], limit))
    check = check_recording(clipped).check("clipping")
    assert (check.result, "wider range" in check.note) == ("unfit", True)


@pytest.mark.parametrize("name", ["angle", "pressure_1", "valve"])
def test_constant_signal(name: str) -> None:
    report = check_recording(with_values(name, np.full(len(TRIAL), TRIAL[name][0])))
    check = report.check("constant signals")
    assert (check.result, name in check.note) == ("unfit", True)
    others = [n for n in TRIAL.names if n != name]
    assert (
        check_recording(with_values(name, np.full(len(TRIAL), TRIAL[name][0])), required=others)
        .check("constant signals")
        .result
        == "pass"
    )


def test_angle_in_degrees_called_radians() -> None:
    check = check_recording(with_values("angle", np.rad2deg(TRIAL["angle"]) + 40)).check("units")
    assert check.result == "unfit"
    assert "the numbers look like deg, not rad" in check.note


def test_pressure_in_bar_called_pascal() -> None:
    bar = with_values("pressure_1", TRIAL["pressure_1"] / 1e5)
    check = check_recording(bar).check("units")
    assert (check.result, "look like bar, not Pa" in check.note) == ("unfit", True)


def test_range_of_the_machine() -> None:
    ranges = {"angle": (0.0, 0.2)}
    check = check_recording(TRIAL, ranges=ranges).check("units")
    assert (check.result, "outside the plausible" in check.note) == ("unfit", True)


def test_absolute_pressures_become_gauge() -> None:
    # A trial in which a muscle is vented: it rests at ambient.
    vented = TRIAL
    for name in ("pressure_1", "pressure_2"):
        gauge = np.maximum(TRIAL[name] - 2.5e5, 0.0) + 600 * np.sin(np.arange(len(TRIAL)))
        vented = vented.with_signal(replace(TRIAL.signal(name), values=gauge * 2))
    assert check_recording(vented).check("gauge pressure").result == "pass"
    absolute = vented
    for name in ("pressure_1", "pressure_2"):
        absolute = absolute.with_signal(
            replace(vented.signal(name), values=vented[name] + 101325.0)
        )
    report = check_recording(absolute)
    assert report.check("gauge pressure").result == "corrected"
    assert np.allclose(report.recording["pressure_1"], vented["pressure_1"])


def test_pressure_above_the_supply() -> None:
    told = replace(TRIAL, metadata={"supply_bar": 6.0})
    assert check_recording(told).check("gauge pressure").result == "pass"
    low = replace(TRIAL, metadata={"supply_bar": 3.0})
    check = check_recording(low).check("gauge pressure")
    assert (check.result, "supply is 3 bar" in check.note) == ("unfit", True)


@pytest.mark.parametrize("closed", [False, True])
def test_reversed_angle(closed: bool) -> None:
    trial = example_recording(seconds=8.0, closed_loop=closed)
    turned = trial.with_signal(replace(trial.signal("angle"), values=-trial["angle"]))
    check = check_recording(turned).check("signs")
    assert (check.result, "angle is probably reversed" in check.note) == ("unfit", True)


def test_exchanged_pressures() -> None:
    trial = example_recording(seconds=8.0)
    one, two = trial.signal("pressure_1"), trial.signal("pressure_2")
    exchanged = trial.with_signal(replace(one, values=two.values)).with_signal(
        replace(two, values=one.values)
    )
    check = check_recording(exchanged).check("signs")
    assert (check.result, "exchanged" in check.note) == ("unfit", True)


def test_few_converter_steps() -> None:
    coarse = with_values("angle", np.round(TRIAL["angle"] / 0.08) * 0.08)
    check = check_recording(coarse).check("quantisation")
    assert (check.result, "converter steps only" in check.note) == ("unfit", True)


def test_still_machine() -> None:
    quiet = with_values("angle", 1e-3 * np.random.default_rng(0).normal(size=len(TRIAL)))
    check = check_recording(quiet).check("noise floor")
    assert (check.result, "no more than its noise" in check.note) == ("unfit", True)
