"""Steps one by one: each ends where the next begins, and the worst is what the metrics say."""

from __future__ import annotations

import numpy as np
import pytest

from tests.verification.scripted import Scripted
from workbench.plants.servo_axis import servo_axis
from workbench.verification import Scenario, Steps, metrics, verify
from workbench.verification.each_step import each_step, step_responses

TIME = np.arange(1500) * 0.002
CHANGES = ((0.5, 0.0, 1.0), (1.2, 1.0, 3.0), (2.0, 3.0, 2.0))


def lagging(constants: tuple[float, ...]) -> np.ndarray:
    """Return a trajectory that follows the steps with a lag of its own per step, in s."""
    trajectory = np.zeros_like(TIME)
    for (begin, initial, final), lag in zip(CHANGES, constants, strict=True):
        late = begin - 1e-9 <= TIME
        trajectory[late] = final + (initial - final) * np.exp(-(TIME[late] - begin) / lag)
    return trajectory


def test_every_sample_after_the_first_step_belongs_to_one_step() -> None:
    parts = each_step(TIME, CHANGES)
    samples = np.concatenate([np.arange(len(TIME))[p.part] for p in parts])
    assert samples.tolist() == list(range(250, 1500))
    assert [round(float(TIME[p.part][0]), 9) for p in parts] == [0.5, 1.2, 2.0]


def test_each_step_has_its_own_settling_time() -> None:
    lags = (0.02, 0.04, 0.08)
    found = step_responses("angle", TIME, lagging(lags), CHANGES)
    # A first-order lag is within 2 % after ln 50 time constants; a sample is 2 ms.
    for step, lag, change in zip(found, lags, CHANGES, strict=True):
        assert step.settling.value == pytest.approx(np.log(50.0) * lag, abs=0.0021)
        assert (step.begin, step.initial, step.final) == change


def test_a_step_that_is_cut_short_did_not_settle() -> None:
    found = step_responses("angle", TIME, lagging((0.5, 0.02, 0.02)), CHANGES)
    assert np.isnan(found[0].settling.value) and "not within 2 %" in found[0].settling.reason
    assert found[1].settling.value < 0.1


def test_a_step_after_the_end_is_none() -> None:
    assert len(each_step(TIME, (*CHANGES, (3.5, 2.0, 0.0)))) == 3
    assert each_step(TIME, ()) == ()


def test_the_worst_step_is_the_metric() -> None:
    steps = Steps((0.0, 0.1, 0.3), (0.0, 0.001, 0.0))
    scenario = Scenario("up and down", {"position": steps}, 0.6, settle=0.0)
    held = Scripted((0.0,), actuators=("force",), controlled=("position",))
    run = verify(held, servo_axis(), scenario)
    found = step_responses("position", run.time, run["position"], steps.changes)
    assert len(found) == 2
    # The axis never moves, so the step up is missed and the step back is met at once.
    assert np.isnan(metrics(run)["settling_time"].value) and np.isnan(found[0].settling.value)
    assert found[1].settling.value == 0.0
