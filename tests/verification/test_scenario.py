"""Scenarios and reference signals as data."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.verification.scripted import Scripted
from workbench.errors import WorkbenchError
from workbench.plants.arm import arm
from workbench.verification import (
    Change,
    Disturbance,
    Ramps,
    Recorded,
    Scenario,
    SignalFault,
    Sine,
    Steps,
    signal_from_table,
    step_scenario,
    verify,
)


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


def test_a_scenario_without_reference_or_duration_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="no reference"):
        Scenario("empty", {}, 1.0)
    with pytest.raises(WorkbenchError, match="duration"):
        Scenario("short", {"angle": Steps((0.0,), (1.0,))}, 0.0)


def test_a_recorded_reference_is_played_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "held.csv").write_text("time,angle\n0,30\n0.01,30.5\n0.03,29\n")
    table = {"kind": "recorded", "unit": "deg", "file": "held.csv", "column": "angle"}
    signal = signal_from_table(table, folder=tmp_path)
    assert np.degrees(signal.sample(np.array([0.0, 0.009, 0.01, 0.02, 9.0]))) == pytest.approx(
        [30.0, 30.0, 30.5, 30.5, 29.0]
    )
    # Its steps are none whose response is measured.
    assert signal.changes == ()
    given = {"kind": "recorded", "unit": "deg", "times": [0.0, 1.0], "values": [30.0, 31.0]}
    assert signal_from_table(given) == Recorded((0.0, 1.0), tuple(np.radians([30.0, 31.0])))
    # With units in the header, and the only column.
    (tmp_path / "ms.csv").write_text("time [ms],angle [deg]\n0, 30\n10, 30.5\n\n")
    named = {"kind": "recorded", "file": "ms.csv"}
    assert signal_from_table(named, folder=tmp_path).times == (0.0, 0.01)
    assert signal_from_table(named, folder=tmp_path).values[1] == pytest.approx(np.radians(30.5))
    with pytest.raises(
        WorkbenchError, match=r"angle of .* is in 'deg'; give it in a unit like 'm'"
    ):
        signal_from_table({**named, "unit": "m"}, folder=tmp_path)
    (tmp_path / "ms.csv").write_text("time,angle,speed\n0,30,1\n1,2,3\n")
    with pytest.raises(WorkbenchError, match=r"columns angle, speed; say which"):
        signal_from_table(named, folder=tmp_path)
    for text, told in (
        ("time,angle\n0,here\n", "cannot be read"),
        ("time,speed\n0,1\n", "column of .*'angle'"),
        ("time,angle\n1,1\n0,2\n", "times must increase"),
    ):
        (tmp_path / "held.csv").write_text(text)
        with pytest.raises(WorkbenchError, match=told):
            signal_from_table(table, folder=tmp_path)


def test_faults_that_cannot_be_are_refused() -> None:
    for kind, until, told in (
        ("odd", math.inf, "kind of the fault"),
        ("stuck", 0.0, "before it begins"),
    ):
        with pytest.raises(WorkbenchError, match=told):
            SignalFault(0.1, "angle", kind, until=until)
    fault = SignalFault(0.1, "angle", "stuck", until=0.2)
    scenario = Scenario("f", {"angle": Steps((0.0,), (0.5,))}, 1.0, faults=(fault,))
    controller = Scripted((5.0,), sensors=("pressure_1",))
    with pytest.raises(WorkbenchError, match="faulty signal"):
        verify(controller, arm(3), scenario)
