"""Playing an experiment: its file, its recording, and what is held out of it."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import pytest

from workbench.diagnosis.estimation.simulated_recordings import pushes
from workbench.diagnosis.experiment.menu import Experiment
from workbench.diagnosis.experiment.run_on_machine import (
    Machine,
    SimulatedMachine,
    plan_csv,
    with_experiment,
)
from workbench.errors import WorkbenchError
from workbench.evaluation.own_cases.experiments import RigMachine
from workbench.evaluation.rig.parameters import nominal
from workbench.physics.friction import viscous_friction
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording

AXIS = servo_axis()
# Nothing moves from 1.2 to 1.4 s, two fifths before the end or so.
FORCE = np.concatenate([pushes(110, largest=90.0, seed=3), np.zeros(30), pushes(60, largest=90.0)])
EXPERIMENT = Experiment("pushes", 0.01, FORCE[:, None])


def test_a_plan_holds_times_and_inputs_in_the_units_of_the_plant() -> None:
    rows = list(csv.reader(io.StringIO(plan_csv(AXIS, EXPERIMENT))))
    assert rows[0] == ["time_s", "force_N"] and len(rows) == 1 + len(FORCE)
    table = np.array(rows[1:], dtype=float)
    np.testing.assert_allclose(table[:, 0], 0.01 * np.arange(len(FORCE)), atol=1e-12)
    np.testing.assert_allclose(table[:, 1], FORCE, rtol=1e-8)


def test_a_plant_stands_for_a_machine_with_what_it_hides() -> None:
    stiff = AXIS.with_effect(viscous_friction("axis.force", coefficient=400.0, upper=1e3, name="x"))
    plain, braked = (SimulatedMachine(m).play(EXPERIMENT)["position"] for m in (AXIS, stiff))
    assert np.ptp(braked) < 0.7 * np.ptp(plain)
    # Its sensor has noise of its own at every call of another machine.
    other = SimulatedMachine(replace(AXIS, outputs=(replace(AXIS.outputs[0], noise_rms=1e-3),)))
    assert np.std(other.play(EXPERIMENT)["position"] - plain) == pytest.approx(1e-3, rel=0.3)


def test_a_part_is_held_out_where_the_machine_rests() -> None:
    whole, fit, hold_out = with_experiment(AXIS, EXPERIMENT, SimulatedMachine(AXIS), (), ())
    assert len(fit) == len(hold_out) == 1
    assert len(fit[0]) + len(hold_out[0]) == len(whole) == len(FORCE)
    np.testing.assert_array_equal(
        np.concatenate([fit[0]["position"], hold_out[0]["position"]]), whole["position"]
    )
    cut = len(fit[0])
    assert 0.5 * len(FORCE) <= cut <= 0.7 * len(FORCE)
    moved = np.abs(np.diff(whole["position"]))
    assert moved[cut - 5 : cut + 5].max() < np.median(moved)


@dataclass(frozen=True)
class _Other:
    made: Recording

    def play(self, experiment: Experiment) -> Recording:
        return self.made


def test_a_recording_that_cannot_be_used_is_refused() -> None:
    good = SimulatedMachine(AXIS).play(EXPERIMENT)
    for bad, said in (
        (good.select(["position"]), "recorded no 'force', an input"),
        (good.select(["force"]), "recorded no output"),
        (good.take(slice(0, 50)), "recorded 50 samples of 200"),
        (cast(Any, good["position"]), "returned a ndarray; return a Recording"),
    ):
        with pytest.raises(WorkbenchError, match=said):
            with_experiment(AXIS, EXPERIMENT, _Other(bad), (), ())


def test_the_rig_is_a_machine() -> None:
    rig = RigMachine(nominal({"load": 3.0}))
    assert isinstance(rig, Machine)
    volts = np.where(np.arange(250) < 100, 5.0, 5.8)[:, None]
    made = rig.play(Experiment("step", 0.002, volts))
    np.testing.assert_allclose(made["valve"], volts[:, 0], atol=0.01)
    # It rests at about 30 degrees before the valve opens, and moves after that.
    assert np.degrees(np.ptp(made["angle"][:100])) < 2.0 < np.degrees(np.ptp(made["angle"]))
    assert made["pressure_1"].max() < 8e5
    with pytest.raises(WorkbenchError, match="sample time"):
        rig.play(replace(EXPERIMENT, sample_time=0.01))
