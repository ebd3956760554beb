"""Angle and mean pressure at once on the arm with one valve per muscle."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.angle_stiffness import Air, AngleStiffness, design_angle_stiffness
from controllers.arithmetic import FLOATS
from controllers.guard import Guarded
from tests.controllers.families import moves
from tests.controllers.in_c import InC
from tests.controllers.test_fault_campaign import TWO_VALVES, check
from tests.machines import at_rest
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.physics.flow import orifice_flow
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.plants.arm.arm import two_valve_arm
from workbench.verification import (
    Run,
    SignalFault,
    Steps,
    guarded,
    metrics,
    verify,
)


@pytest.fixture(scope="module")
def two_valves() -> Model:
    return two_valve_arm(3)


@pytest.fixture(scope="module")
def linear_two(two_valves: Model) -> LinearModel:
    return at_rest(two_valves, **TWO_VALVES.at)


@pytest.fixture(scope="module")
def both(linear_two: LinearModel) -> AngleStiffness:
    return design_angle_stiffness(linear_two)


def run(
    controller: AngleStiffness, plant: Any, angles: tuple[float, ...], means: tuple[float, ...]
) -> Run:
    moved = moves((0.3, 1.5), *angles, duration=2.7)
    mean = Steps((0.0, 0.3, 1.5), tuple(1e5 * m for m in means))
    both = {**moved.references, "mean_pressure": mean}
    return verify(controller, plant, replace(moved, references=both))


@pytest.mark.parametrize("hysteresis", [False, True], ids=["nominal", "hysteresis"])
def test_the_mean_stays_while_the_angle_steps(
    both: AngleStiffness, two_valves: Model, hysteresis: bool
) -> None:
    plant = two_valves
    if hysteresis:
        plant = plant.with_effect(muscle_hysteresis(level=10.0, level_per_pressure=7e-5))
    done = run(both, plant, (20.0, 35.0, 20.0), (3.0, 3.0, 3.0))
    assert np.abs(done["mean_pressure"] - 3e5).max() < 0.1e5
    found = metrics(done)
    assert found["angle.settling_time"].value < 0.5
    assert found["angle.steady_error"].value < math.radians(0.05)
    assert found["angle.overshoot"].value < 0.05


def test_the_angle_stays_while_the_mean_steps(both: AngleStiffness, two_valves: Model) -> None:
    done = run(both, two_valves, (20.0, 20.0, 20.0), (2.5, 4.0, 3.0))
    assert np.abs(done["angle"] - math.radians(20.0)).max() < math.radians(0.5)
    found = metrics(done)
    assert found["mean_pressure.settling_time"].value < 0.6
    assert found["mean_pressure.steady_error"].value < 0.02e5


def test_stiffness_follows_the_mean(both: AngleStiffness, two_valves: Model) -> None:
    done = run(both, two_valves, (30.0, 30.0, 30.0), (2.5, 4.0, 4.0))
    found = metrics(done)
    # Stiffness of the paper's law is linear in the pressures: D'(q) p and phi'(q).
    assert found["stiffness_highest"].value > 1.3 * found["stiffness_lowest"].value


def test_where_both_cannot_be_had_the_angle_comes_first(
    both: AngleStiffness, two_valves: Model
) -> None:
    # 50 degrees needs a difference of some 3 bar: not with a mean of 5.5 bar below 5.8 bar.
    done = run(both, two_valves, (30.0, 50.0, 50.0), (3.0, 5.5, 5.5))
    assert metrics(done)["angle.steady_error"].value < math.radians(0.05)
    assert done["mean_pressure"][-1] < 5.2e5


def test_weights_are_those_of_iso_6358() -> None:
    air = Air(pressure=3e5, volume_slope=0.5)
    ambient, supply = air.ambient, air.supply + air.ambient

    def flows(gauge: float) -> tuple[float, float]:
        p = gauge + ambient
        one = orifice_flow(supply, p, 293.15, 293.15, 1e-8, air.critical_ratio)
        return float(one), float(orifice_flow(p, ambient, 293.15, 293.15, 1e-8, 0.23))

    usual = 0.5 * sum(flows(3e5))
    for gauge in (1e5, 2.7e5, 5e5):
        filling, venting = flows(gauge)
        got = air.weights(gauge, air.angle + 0.2, -1.0, FLOATS)
        np.testing.assert_allclose(got, (0.9 * usual / filling, 0.9 * usual / venting), rtol=1e-9)


def test_it_runs_on_the_linear_model(both: AngleStiffness, linear_two: LinearModel) -> None:
    found = metrics(run(both, linear_two, (30.0, 31.0, 31.0), (3.0, 3.1, 3.1)))
    assert found["angle.steady_error"].value < math.radians(0.02)
    assert found["mean_pressure.steady_error"].value < 0.02e5


def test_a_model_with_one_valve_is_refused(linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match="valve_1"):
        design_angle_stiffness(linear)


LATE = SignalFault(0.56, "deadline", "missing", until=0.66)


@pytest.mark.parametrize("begin", [0.56, 0.583, 0.61])
def test_deadlines_missed_in_a_move_end_before_the_stop(
    both: AngleStiffness, two_valves: Model, begin: float, tmp_path: Path
) -> None:
    law = guarded(both, two_valves, at=TWO_VALVES.at)
    late = replace(LATE, time=begin, until=begin + 0.1)
    done = verify(law, two_valves, replace(TWO_VALVES.move, faults=(late,)))
    assert done["angle"].max() < math.radians(55.0)
    assert done["angle"][-1] == pytest.approx(math.radians(40.0), abs=math.radians(0.1))
    assert done.infos[-1].get("guard", "clear") == "clear"
    check(done, law, InC(law, tmp_path))


def test_what_jumps_after_missed_deadlines_is_seen_by_each_valve_s_own_curve(
    both: AngleStiffness, two_valves: Model, tmp_path: Path
) -> None:
    law = guarded(both, two_valves, at=TWO_VALVES.at)
    own = law.guard.estimator
    assert own is not None
    # The shipped valves are alike; a second one of another gain is not.
    other = replace(own, curve_entered=own.curve_entered * [[1.0], [0.8]])
    law = Guarded(law.controller, replace(law.guard, estimator=other))
    spike = SignalFault(0.68, "angle", "offset", 0.5, until=0.682)
    done = verify(law, two_valves, replace(TWO_VALVES.move, faults=(LATE, spike)))
    assert "jump" in {str(info.get("guard")) for info in done.infos}
    check(done, law, InC(law, tmp_path))
