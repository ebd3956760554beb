"""The sliding mode: on its own model the surface decays as designed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from controllers import SlidingModeSpecification, design_sliding_mode
from controllers.joint.observer import JointEstimate
from tests.controllers.conftest import TRUTH
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.linearisation.zero_order_hold import zero_order_hold


def run(law: Any, model: Any, x: np.ndarray[Any, Any], wanted: float, n: int) -> Any:
    """Run on the bare matrices, in openings, without valve curve."""
    phi, gamma = zero_order_hold(model.A, model.B, law.sample_time)
    state = law.initial_state(tuple(model.C @ x + model.y0))
    trajectories = []
    for _ in range(n):
        measured = tuple(float(v) for v in model.C @ x + model.y0)
        _, state, info = law.step(state, measured, (wanted,))
        trajectories.append((measured[0], info["surface"], info["opening"]))
        x = phi @ x + gamma[:, 0] * info["opening"]
    return np.array(trajectories)


@pytest.mark.parametrize("share", [-3.0, -0.4, 0.5, 2.0])
def test_surface_moves_at_the_reaching_rate(third_order: Any, share: float) -> None:
    law = design_sliding_mode(third_order)
    lam = law.slope
    # A moving joint whose state the observer knows, the reference at rest where the arm is: then
    # s = -theta'' - 2 lambda theta', here `share` of the layer.
    angle, speed = 0.55, 0.2
    acceleration = -2 * lam * speed - share * law.layer
    b, a1, a0, g, e, d = (TRUTH[k] for k in ("b", "a1", "a0", "g", "e", "d"))
    dp = (acceleration + a1 * speed + a0 * (angle - 0.5)) / b
    state = law.initial_state((angle, 4e5, 4e5))
    estimate = JointEstimate(angle, speed, 0.0)
    front = state.tracking._replace(estimate=estimate, difference=dp)
    state = state._replace(tracking=front)
    _, _, info = law.step(state, (angle, 4e5 + dp / 2, 4e5 - dp / 2), (angle,))
    difference_rate = g * info["opening"] - e * speed - d * dp
    jerk = b * difference_rate - a1 * acceleration - a0 * speed
    surface_rate = -jerk - 2 * lam * acceleration - lam**2 * speed
    assert info["surface"] == pytest.approx(share * law.layer, rel=1e-6)
    saturated = max(-1.0, min(1.0, share))
    assert surface_rate == pytest.approx(-2000.0 * saturated, rel=1e-6)


def test_errors_vanish_and_the_surface_is_kept(third_order: Any) -> None:
    law = design_sliding_mode(third_order)
    trajectories = run(law, third_order, np.zeros(4), 0.6, 500)
    assert abs(trajectories[-1, 0] - 0.6) < 1e-4
    assert abs(trajectories[-1, 1]) < law.layer
    assert trajectories[:, 0].max() < 0.6 + 0.02 * 0.1


def test_layer_width_follows_the_bound(linear: LinearModel) -> None:
    law = design_sliding_mode(linear, SlidingModeSpecification(layer_bandwidth=70.0))
    assert law.jerk_bound / law.layer == pytest.approx(70.0)
    assert law.jerk_bound == 2000.0


def test_rest_needs_no_opening(third_order: Any) -> None:
    law = design_sliding_mode(third_order)
    state = law.initial_state((0.62, 4.4e5, 3.7e5))
    (command,), _, info = law.step(state, (0.62, 4.4e5, 3.7e5), (0.62,))
    # Only the leak of the pressure difference is made up for, d dp / g.
    assert info["opening"] == pytest.approx(0.8 * 7e4 / 3.6e7, rel=1e-3)
    assert math.isfinite(command)


def test_a_bound_beyond_the_valve_is_refused(linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match="fully open valve"):
        design_sliding_mode(linear, SlidingModeSpecification(jerk_bound=1e6))
