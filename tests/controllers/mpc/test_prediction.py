"""The condensed problem of a linear MPC, where the plant is slower than the horizon."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from controllers.mpc.along_plan import ScheduledMPCSpecification
from controllers.mpc.prediction import condense
from controllers.mpc.whole_model import MPCSpecification
from controllers.nonlinear_mpc.controller import NonlinearMPCSpecification

INDUCTANCE, RESISTANCE, CONSTANT = 0.02, 2.0, 15.0
MASS, STIFFNESS, DRAG = 2.0, 900.0, 12.0


def test_a_quick_output_leaves_the_slow_states_of_its_plant_alone() -> None:
    # A current, led over 4 ms, of a motor whose slide needs 0.2 s to where that holds it.
    A = np.array(
        [
            [0.0, 1.0, 0.0],
            [-STIFFNESS / MASS, -DRAG / MASS, CONSTANT / MASS],
            [0.0, -CONSTANT / INDUCTANCE, -RESISTANCE / INDUCTANCE],
        ]
    )
    B = np.array([[0.0], [0.0], [20.0 / INDUCTANCE]])
    problem = condense(
        A,
        B,
        B,
        np.array([[0.0, 0.0, 1.0]]),
        weights=(1.0, 10.0, 1.0),
        prediction_time=1e-4,
        sample_time=1e-4,
        blocks=(1,) * 10 + (3,) * 10,
        opening_limits=(-1.0, 1.0),
        move_limit=1.0,
        output_limits=(),
        softness=1.0,
    )
    # 2 V hold 1 A at rest; what it takes on the way there is at most ten times that.
    (opening,) = problem.regulator(np.zeros(4), np.ones(1))
    assert 0.1 < opening < 1.0
    # What costs nothing is not led anywhere: 17 mm of the slide are worth less than 1 V.
    place, *_ = problem.gain[0]
    assert abs(place) * CONSTANT / STIFFNESS < 0.05


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (MPCSpecification, "prediction_time"),
        (ScheduledMPCSpecification, "prediction_time"),
        (NonlinearMPCSpecification, "stage_time"),
    ],
)
def test_predictions_go_in_whole_samples_of_the_loop(kind: Any, name: str) -> None:
    # The usual times are no multiples of 3 ms.
    for told in ({}, {name: 0.0101}):
        samples = getattr(kind(sample_time=0.003, **told), name) / 0.003
        assert samples == pytest.approx(round(samples), abs=1e-9)
        assert samples > 0.5
