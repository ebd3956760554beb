"""The reference over a horizon: two lags, or the planner's trajectory."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.arithmetic import FLOATS
from controllers.mpc.whole_model import lagged
from controllers.reference.horizon import ReferenceAhead
from controllers.reference.planned import Planner

H = 0.002


def test_lags_continue_as_they_will_go_on() -> None:
    ahead = ReferenceAhead((0.0, 0.02, 0.1), 40.0)
    state = ahead.start(0.1)
    for _ in range(3):
        path, state = ahead.follow(state, 0.4)
    # independent route: the same two lags, sample by sample in finer steps
    filtered, target = state
    for _ in range(20_000):
        filtered, target = lagged(filtered, target, 0.4, 40.0 * 0.02 / 20_000)
    assert path[1] == pytest.approx(target, abs=1e-5)
    assert path[0] == pytest.approx(state[1], abs=1e-12)


def test_a_planned_step_ends_where_it_is_wanted() -> None:
    planner = Planner(jerk=2000.0, acceleration=40.0, speed=10.0)
    ahead = ReferenceAhead(tuple(0.02 * j for j in range(21)), 40.0, planner)
    path, state = ahead.follow(ahead.start(0.1), 0.1)
    np.testing.assert_allclose(path, 0.1, atol=1e-12)
    path, state = ahead.follow(state, 0.4)
    assert path[0] == pytest.approx(0.1, abs=1e-12)
    assert np.all(np.diff(path) >= -1e-12)
    np.testing.assert_allclose(path[-1], 0.4, atol=1e-12)
    duration = planner._duration(0.3, 0.0, FLOATS)
    assert np.interp(duration / 2, ahead.times, path) == pytest.approx(0.25, abs=0.01)


def test_a_sine_is_wanted_where_it_goes() -> None:
    planner = Planner(jerk=2000.0, acceleration=40.0, speed=10.0)
    ahead = ReferenceAhead((0.0, 0.02, 0.1), 40.0, planner)
    lagging = ReferenceAhead((0.0, 0.02, 0.1), 40.0)
    states = [ahead.start(0.5), lagging.start(0.5)]
    time = np.arange(1000) * H
    for r in (0.5 + 0.26 * np.sin(2 * np.pi * time)).tolist():
        path, states[0] = ahead.follow(states[0], r)
        late, states[1] = lagging.follow(states[1], r)
    comes = 0.5 + 0.26 * np.sin(2 * np.pi * (time[-1] + np.array(ahead.times)))
    np.testing.assert_allclose(path, comes, atol=5e-3)
    assert abs(late[0] - comes[0]) > 0.05
