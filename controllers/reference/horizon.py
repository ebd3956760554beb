"""The reference over a horizon, where the future is not previewed.

Two ways to continue what has been seen, both smooth, so that a step asks for nothing impossible:

    lags       two lags of speed omega_r, which continue a step over the horizon exactly
    planned    that of `controllers.reference.planned`: a step becomes a move along its quintic, a
               smooth one goes on along its derivatives, so that a sine is followed without lag

Source: Rawlings, Mayne and Diehl, Model Predictive Control, 2017, section 1.5 (reference
trajectories).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.arithmetic import FLOATS, Number
from controllers.reference.planned import Planner, PlannerState
from workbench.arrays import Vector


@dataclass(frozen=True)
class ReferenceAhead:
    """Continue a reference over a horizon.

    Args:
        times: Times of the horizon, the first of them 0, shape (n,), in s.
        lag_speed: Speed omega_r of the lags, in rad/s.
        planner: Planner in place of the lags; None for the lags.
        sample_time: Time between samples, in s.
    """

    times: tuple[float, ...]
    lag_speed: float
    planner: Planner | None = None
    sample_time: float = 0.002

    def start(self, angle: float) -> tuple[float, ...]:
        """Return the state, in SI, of a reference at rest at an angle, in rad."""
        return (angle, angle) if self.planner is None else tuple(self.planner.start(angle))

    def follow(
        self, state: tuple[float, ...], reference: float
    ) -> tuple[Vector, tuple[float, ...]]:
        """Take in one sample of the reference, in rad, after the state before, in SI.

        Returns:
            Wanted angles over the horizon, shape (n,), in rad, and the next state.
        """
        if self.planner is None:
            fresh = self.lag_speed * self.sample_time
            filtered, target = lagged(state[0], state[1], reference, fresh)
            t = self.lag_speed * np.array(self.times)
            path = reference + (target - reference + (filtered - reference) * t) * np.exp(-t)
            return np.asarray(path), (filtered, target)
        plan, following = self.planner.plan(PlannerState(*state), reference, FLOATS)
        angles = [self.planner.ahead(following, plan, time, FLOATS).angle for time in self.times]
        return np.array(angles, dtype=float), tuple(following)


def lagged(
    filtered: Number, target: Number, reference: Number, fresh: Number
) -> tuple[Number, Number]:
    """Pass a reference, in rad, through two lags for one sample.

    ``filtered`` and ``target`` are behind the first and the second; ``fresh`` is the share
    omega_r h of the new value.
    """
    filtered = filtered + fresh * (reference - filtered)
    return filtered, target + fresh * (filtered - target)
