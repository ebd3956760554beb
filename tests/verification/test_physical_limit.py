"""The time-optimal move against closed forms, a torque bound and the exact plant."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.machines import machine
from tests.model.test_sizes import UNITS, stage
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.plants.arm import arm
from workbench.verification.physical_limit import physical_limit, shown_state


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("WORKBENCH_CACHE", str(tmp_path))
    return tmp_path / "workbench"


def double_integrator() -> Model:
    return machine(
        lambda m: (
            {"angle": m.x.speed, "speed": m.x.pull, "pull": 200 * (m.u.force - m.x.pull)},
            {"measurement": m.x.angle},
        ),
        "angle rad, speed rad/s, pull rad/s2",
        "force rad/s2 -1 1",
        "measurement rad",
    )


def test_double_integrator_takes_the_time_of_bang_bang() -> None:
    # From rest to the far edge of the band with bang-bang, seen when it passes the near edge: the
    # last 0.04 take sqrt(2 * 0.04). The lag of 5 ms and inputs held over an interval cost about two
    # intervals.
    ideal = 2 * math.sqrt(1.02) - math.sqrt(2 * 0.04)
    for intervals in (20, 50):
        limit = physical_limit(double_integrator(), 0.0, 1.0, intervals=intervals, degree=2)
        assert ideal - 1e-3 < limit.seconds < ideal * (1 + 2.5 / intervals)
        assert limit.end_error < 1e-4
        inside = np.abs(limit.states[intervals:, 0] - 1.0)
        assert inside.max() <= 0.02 + 1e-6


def test_the_arm_is_slower_than_its_torque_allows_and_the_exact_plant_follows() -> None:
    plant = arm(8.0)
    start, end = math.radians(15.0), math.radians(45.0)
    limit = physical_limit(plant, start, end, intervals=48, degree=2)
    assert limit.status == "Solve_Succeeded"
    bound = torque_limited_time(plant, start, end + limit.band, until=end - limit.band)
    # Muscles cannot be filled at once, so the bound is missed by some 10 ms at least.
    assert bound + 0.005 < limit.seconds < 1.4 * bound
    # 48 intervals of some 4 ms; regularised, flow next to equal pressures is up to 16 % less.
    assert limit.position_error < math.radians(0.5)
    assert limit.end_speed < math.radians(5.0)
    assert np.all((limit.inputs >= -1e-6) & (limit.inputs <= 10.0 + 1e-6))


def torque_limited_time(plant: Model, start: float, end: float, *, until: float) -> float:
    """Time until an angle is passed if each muscle could be full or empty at any moment."""
    values = {q.name: q.value for q in plant.parameters}
    low = values["ambient_pressure"]
    high = low + values["supply_pressure"]
    angles = np.linspace(start, end, 201)

    def acceleration(angle: float, one: float, two: float) -> float:
        x = plant.initial_state({"angle": angle, "pressure_1": one, "pressure_2": two})
        return float(plant.rates(x, plant.nominal_input)[-1])

    names = [q.name for q in plant.states]
    assert names[-1] == "speed"
    step = angles[1] - angles[0]
    gained = np.cumsum([2 * step * acceleration(a, high, low) for a in angles[:-1]])
    lost = np.cumsum([-2 * step * acceleration(a, low, high) for a in angles[:0:-1]])[::-1]
    speed = np.sqrt(np.minimum(gained, lost))
    ends = np.concatenate([[0.0], speed])
    return float(np.sum((2 * step / (ends[1:] + ends[:-1]))[angles[1:] <= until]))


@pytest.mark.parametrize(("pace", "length", "voltage"), UNITS)
def test_the_limit_follows_the_units(pace: float, length: float, voltage: float) -> None:
    usual = physical_limit(stage(1.0, 1.0, 1.0), 0.0, 0.4, intervals=24, degree=2)
    other = physical_limit(stage(pace, length, voltage), 0.0, 0.4 * length, intervals=24, degree=2)
    # The solver stops at 1e-6 of its own scaled program.
    assert other.seconds / pace == pytest.approx(usual.seconds, rel=1e-4)


def test_a_found_limit_is_kept_and_a_damaged_file_is_not_believed(own_cache: Path) -> None:
    first = physical_limit(double_integrator(), 0.0, 1.0, intervals=8, degree=2)
    (kept,) = own_cache.glob("limit-*.npz")
    when = kept.stat().st_mtime_ns
    again = physical_limit(double_integrator(), 0.0, 1.0, intervals=8, degree=2)
    assert again.seconds == first.seconds and kept.stat().st_mtime_ns == when
    physical_limit(double_integrator(), 0.0, 0.9, intervals=8, degree=2)
    assert len(list(own_cache.glob("limit-*.npz"))) == 2
    kept.write_bytes(b"half a file")
    assert physical_limit(double_integrator(), 0.0, 1.0, intervals=8, degree=2).seconds == (
        pytest.approx(first.seconds, rel=1e-9)
    )


def test_an_output_stands_for_the_state_that_it_shows() -> None:
    plant = stage(1.0, 1.0, 1.0)
    assert shown_state(plant, "position") == "x" and shown_state(plant, "v") == "v"
    by_output = physical_limit(plant, 0.0, 0.4, intervals=8, degree=2, coordinate="position")
    assert by_output.seconds == physical_limit(plant, 0.0, 0.4, intervals=8, degree=2).seconds


def test_wrong_arguments_are_named() -> None:
    with pytest.raises(WorkbenchError, match="goes nowhere"):
        physical_limit(double_integrator(), 0.5, 0.5)
    with pytest.raises(WorkbenchError, match="coordinate is 'elbow'"):
        physical_limit(double_integrator(), 0.0, 0.5, coordinate="elbow")
