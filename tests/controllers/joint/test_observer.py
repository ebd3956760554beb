"""The joint observer finds speed and unexplained acceleration."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from controllers.joint.model import joint_model
from controllers.joint.observer import JointEstimate, design_joint_observer
from workbench.errors import WorkbenchError
from workbench.linearisation.zero_order_hold import zero_order_hold


def test_estimates_converge_to_a_disturbed_joint(third_order: Any) -> None:
    joint = joint_model(third_order)
    observer = design_joint_observer(joint, bandwidth=100.0, sample_time=0.002)
    # The true joint: the same equation with 20 rad/s2 that no model knows, 0.3 bar held.
    a = np.array([[0.0, 1.0], [-joint.a0, -joint.a1]])
    phi, gamma = zero_order_hold(a, np.array([[0.0], [1.0]]), 0.002)
    x = np.array([0.05, 0.0])
    estimate = JointEstimate(0.5, 0.0, 0.0)
    for _ in range(300):
        now = observer.correct(estimate, 0.5 + float(x[0]))
        estimate = observer.predict(now, 3e4)
        x = phi @ x + gamma[:, 0] * (joint.b * 3e4 + 20.0)
    # 0.6 s are 60 time constants of the observer.
    assert estimate.angle - 0.5 == pytest.approx(x[0], abs=1e-9)
    assert estimate.speed == pytest.approx(x[1], abs=1e-8)
    assert estimate.unexplained == pytest.approx(20.0, abs=1e-6)


def test_start_explains_rest(third_order: Any) -> None:
    joint = joint_model(third_order)
    observer = design_joint_observer(joint, bandwidth=100.0, sample_time=0.002)
    start = observer.start(joint, 0.7, 1e4)
    assert observer.predict(start, 1e4) == pytest.approx(start, abs=1e-9)


def test_held_is_the_closed_solution() -> None:
    phi, gamma = zero_order_hold(np.array([[-2.0]]), np.array([[3.0]]), 0.1)
    assert phi[0, 0] == pytest.approx(math.exp(-0.2))
    assert gamma[0, 0] == pytest.approx(1.5 * (1 - math.exp(-0.2)))


def test_too_fast_an_observer_is_refused(third_order: Any) -> None:
    with pytest.raises(WorkbenchError, match="bandwidth"):
        design_joint_observer(joint_model(third_order), bandwidth=5000.0, sample_time=0.002)
