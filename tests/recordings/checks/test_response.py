"""Recordings whose columns do not belong together, or whose time has another unit, do not pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from tests.machines import machine
from tests.recordings.example import recorded, with_values
from workbench.data_folder import shipped_folder
from workbench.plants.arm import arm
from workbench.recordings import Recording, read_recording
from workbench.recordings.checks import Expected, expectations
from workbench.recordings.checks.expected import sure_signs
from workbench.recordings.checks.response import check_response
from workbench.recordings.checks.time_base import check_time_base
from workbench.recordings.recording import Signal, Vector

LOOPS = ("identify_open", "identify_closed")


@pytest.fixture(scope="module", params=LOOPS)
def trial(request: pytest.FixtureRequest) -> Recording:
    """A recording of 20 s at 500 Hz."""
    return read_recording(shipped_folder() / "practice-07" / f"{request.param}.csv.gz")


@pytest.fixture(scope="module")
def expected() -> Expected:
    """What the arm says."""
    some = read_recording(shipped_folder() / "practice-07" / "identify_open.csv.gz")
    return expectations(some, model=arm(3.0), required=some.names)


def changed(trial: Recording, name: str, change: Callable[[Vector], Vector]) -> Recording:
    """Return the recording with one signal changed."""
    return with_values(trial, name, change(trial[name]))


def moved(values: Vector, by: int) -> Vector:
    """Return a signal that comes later by some samples, or earlier."""
    index = np.clip(np.arange(len(values)) - by, 0, len(values) - 1)
    return np.asarray(values[index])


def test_a_good_recording_passes(trial: Recording, expected: Expected) -> None:
    for known in (expected, Expected()):
        assert check_time_base(trial, known).result == "pass"
        found = check_response(trial, known)
        assert found.result == "pass" and "pressure_1 answers to valve" in found.note


COLUMNS: dict[str, tuple[Callable[[Vector], Vector], str]] = {
    "late by half a second": (lambda v: moved(v, 250), "s before valve does"),
    "late by a tenth": (lambda v: moved(v, 50), "s before valve does"),
    "early by half a second": (lambda v: moved(v, -250), "which the model does not"),
    "shuffled": (lambda v: np.random.default_rng(0).permutation(v), "nothing that is measured"),
    "of another experiment": (
        lambda v: 5.0 + np.random.default_rng(1).normal(size=len(v)), "nothing that is measured"),
}  # fmt: skip


@pytest.mark.parametrize("name", COLUMNS)
def test_a_command_that_does_not_belong_there_is_unfit(
    name: str, trial: Recording, expected: Expected
) -> None:
    change, why = COLUMNS[name]
    found = check_response(changed(trial, "valve", change), expected)
    assert found.result == "unfit" and why in found.note, found


def test_a_command_that_runs_backwards_does_not_pass(trial: Recording, expected: Expected) -> None:
    found = check_response(changed(trial, "valve", lambda v: v[::-1]), expected)
    assert found.result in ("unfit", "not checked")
    assert "no answer of" in found.note or "nothing that is measured answers" in found.note


def test_a_long_delay_without_a_model_is_left_open(trial: Recording) -> None:
    found = check_response(changed(trial, "valve", lambda v: moved(v, -250)), Expected())
    assert found.result != "unfit" and "only after 5" in found.note


def test_what_answers_to_the_last_change_of_a_square_wave_does_not_come_before_the_next(
    trial: Recording,
) -> None:
    time = np.arange(8000) * 0.002
    rng = np.random.default_rng(3)

    def square(late: float) -> Vector:
        noise = 1e-3 * rng.normal(size=len(time))
        return np.asarray(5.0 + np.sign(np.sin(0.5 * np.pi * (time - late + 1e-6))) + noise)

    wave = changed(trial[:8000], "valve", lambda _: square(0.0))
    for name, late in (("angle", 1.65), ("pressure_1", 0.01), ("pressure_2", 0.01)):
        wave = changed(wave, name, lambda _, late=late: square(late))  # type: ignore[misc]
    found = check_response(wave, Expected())
    assert found.result == "pass" and "no answer of angle to valve is seen" in found.note


def test_one_measurement_that_shows_nothing_is_told(trial: Recording) -> None:
    found = check_response(changed(trial, "angle", lambda v: v[::-1]), Expected())
    assert found.result == "pass" and "no answer of angle to valve is seen" in found.note


def test_beside_the_signals_of_a_model_others_need_no_answer(
    trial: Recording, expected: Expected
) -> None:
    oil = 0.1 * np.cumsum(np.random.default_rng(0).normal(size=len(trial)))
    told = check_response(trial.with_signal(Signal("oil", oil, "K")), expected)
    assert not told.doubt and "oil" not in told.note


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9, 1e-3, 1e-6])
def test_a_time_in_another_unit_is_unfit(
    factor: float, trial: Recording, expected: Expected
) -> None:
    found = check_time_base(replace(trial, time=factor * trial.time), expected)
    assert found.result == "unfit" and "give the unit of the time" in found.note


@pytest.mark.parametrize(("factor", "result"), [(1.0, "pass"), (1e-3, "unfit")])
def test_a_store_that_is_filled_moves_long_before_its_time_constant(
    factor: float, result: str
) -> None:
    boiler = machine(
        lambda m: ({"T": (m.u.heater - 2.0 * (m.x.T - 291.0)) / 3.3e5}, {"water": m.x.T}),
        "T K 323 scale=50",
        "heater W 0 scale=2000",
        "water K scale=50",
    )
    heater = np.where(np.arange(1500) % 300 < 60, 2000.0, 0.0)
    water = 323.0 + np.cumsum(20.0 * (heater - 60.0) / 3.3e5)
    seen = recorded(20.0 * factor, {"heater W": heater}, {"water K": water})
    assert check_time_base(seen, expectations(seen, model=boiler)).result == result


def test_an_empty_cone_has_no_slope_that_tells_of_signs() -> None:
    tanks = machine(
        lambda m: (
            {
                "upper": m.u.pump - 0.02 * ca.sqrt(m.x.upper),
                "lower": 0.02 * (ca.sqrt(m.x.upper) - ca.sqrt(m.x.lower)) / m.x.lower**2,
            },
            {"level": m.x.lower},
        ),
        "upper m 0.5, lower m 0.5",
        "pump m/s 0.01 scale=0.02",
        "level m scale=0.5",
    )
    level = np.where(np.arange(600) < 300, 0.0, 0.5)
    seen = recorded(1.0, {"pump m/s": np.full(600, 0.01)}, {"level m": level})
    assert sure_signs(tanks, seen) == {("pump", "level"): 1}


def test_weather_that_hardly_moves_a_room_is_no_reason_to_doubt() -> None:
    rng = np.random.default_rng(4)
    heat = np.repeat(rng.uniform(0.0, 1.0, 200), 20)
    weather = 1e-4 * np.cumsum(np.cumsum(rng.normal(size=4000)))
    room = np.convolve(heat, np.exp(-np.arange(100) / 20.0))[:4000] + 0.01 * rng.normal(size=4000)
    seen = recorded(60.0, {"heat W": heat, "weather K": weather}, {"room K": room})
    found = check_response(seen, Expected())
    assert "no answer of room to weather is seen" in found.note
    assert found.result == "pass" and not found.doubt


def test_a_smooth_command_leaves_it_open() -> None:
    time = np.arange(5000) * 0.002
    rng = np.random.default_rng(2)
    trial = read_recording(shipped_folder() / "practice-07" / "identify_open.csv.gz")[:5000]
    smooth = changed(trial, "valve", lambda _: 5.0 + np.sin(time))
    for name in ("angle", "pressure_1", "pressure_2"):
        noise = 1e-4 * np.ptp(trial[name]) * rng.normal(size=len(time))
        smooth = changed(smooth, name, lambda v, e=noise: np.ptp(v) * np.sin(time - 0.3) + e)  # type: ignore[misc]
    assert check_response(smooth, Expected()).result == "not checked"
