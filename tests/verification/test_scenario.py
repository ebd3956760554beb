"""Scenarios and reference signals as data."""

from __future__ import annotations

import math
import tomllib
from typing import Any

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.verification import (
    Change,
    Disturbance,
    Ramps,
    Scenario,
    Sine,
    Steps,
    scenario_from_table,
    signal_from_table,
    step_scenario,
)

STUDY = """
[scenarios.load]
duration = 4.0
settle = 0.2
references.angle = { kind = "steps", unit = "deg", times = [0, 1], values = [15, 45] }
changes = [{ time = 2.0, parameter = "load", value = 4.0 }]
disturbances = [{ time = 3.0, port = "joint.torque", level = 2.0 }]

[scenarios.sine]
duration = 2
references.angle = { kind = "sine", unit = "deg", mean = 30, amplitude = 15, frequency_Hz = 0.5 }
"""


def test_a_study_file_gives_the_scenarios() -> None:
    tables = tomllib.loads(STUDY)["scenarios"]
    load = scenario_from_table("load", tables["load"])
    assert load.references["angle"] == Steps((0.0, 1.0), (math.radians(15), math.radians(45)))
    assert load.changes == (Change(2.0, "load", 4.0),)
    assert load.disturbances == (Disturbance(3.0, "joint.torque", 2.0),)
    assert load.samples == 2000
    sine = scenario_from_table("sine", tables["sine"]).references["angle"]
    assert isinstance(sine, Sine)
    assert sine.sample(0.5) == pytest.approx(math.radians(45))


def test_steps_change_at_their_sample_whatever_the_rounding() -> None:
    steps = Steps((0.0, 0.3, 0.7), (1.0, 2.0, 1.5))
    time = 0.002 * np.arange(500)
    trajectory = steps.sample(time)
    assert np.flatnonzero(np.diff(trajectory)).tolist() == [149, 349]
    assert steps.changes == ((0.3, 1.0, 2.0), (0.7, 2.0, 1.5))


def test_ramps_and_sine() -> None:
    assert Ramps((1.0, 2.0), (0.0, 4.0)).sample([0.0, 1.5, 9.0]).tolist() == [0.0, 2.0, 4.0]
    sine = Sine(1.0, 0.5, 2.0, begin=1.0)
    assert sine.sample([0.5, 1.0, 1.125]).tolist() == pytest.approx([1.0, 1.0, 1.5])


def test_step_and_back() -> None:
    scenario = step_scenario("angle", 15, 45, unit="deg", back=True, hold=2.0)
    assert scenario.duration == 4.5
    assert len(scenario.references["angle"].changes) == 2


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"references": {}}, "no 'duration'"),
        ({"duration": 1.0}, "no 'references'"),
        ({"duration": 1.0, "references": {}}, "no reference"),
        ({"duration": 0.0, "references": {"angle": {"times": [0], "values": [1]}}}, "duration"),
        ({"duration": 1, "refernces": {}}, "did you mean"),
        ({"duration": 1, "references": {}, "changes": [{"time": 1}]}, "no 'parameter'"),
        ({"duration": 1, "references": {}, "changes": [{"tme": 1}]}, "did you mean 'time'"),
    ],
)
def test_mistakes_are_named(table: dict[str, Any], problem: str) -> None:
    with pytest.raises(WorkbenchError, match=problem):
        scenario_from_table("mistake", table)


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"kind": "stairs"}, "kind of reference"),
        ({"kind": "steps", "times": [0]}, "no 'values'"),
        ({"kind": "steps", "times": [0], "values": [1], "unit": "degr"}, "degr"),
        ({"kind": "steps", "times": [1, 0], "values": [1, 2]}, "start at 0"),
        ({"kind": "steps", "times": [0, 0], "values": [1, 2]}, "must increase"),
        ({"kind": "steps", "times": [0, 1], "values": [1]}, "one value per time"),
        ({"kind": "steps", "times": [0], "values": ["a"]}, "not a number"),
        ({"kind": "sine", "mean": 0, "amplitude": 1, "frequency_Hz": 0}, "frequency"),
        ({"kind": "sine", "mean": 0, "amplitude": math.inf, "frequency_Hz": 1}, "not finite"),
        ({"kind": "steps", "times": [0], "values": [1], "amplitude": 2}, "key of the steps"),
    ],
)
def test_bad_signals_are_refused(table: dict[str, Any], problem: str) -> None:
    with pytest.raises(WorkbenchError, match=problem):
        signal_from_table(table)


def test_a_disturbance_that_ends_before_it_begins_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="before it begins"):
        Disturbance(2.0, "joint.torque", 1.0, until=1.0)


def test_a_negative_time_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="valid range"):
        Change(-1.0, "load", 3.0)


def test_a_scenario_without_reference_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="no reference"):
        Scenario("empty", {}, 1.0)
