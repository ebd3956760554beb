"""The designs of the comparison: one map of linear models per known load, one law per family."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from controllers.largest_bandwidth import MarginedDesign, largest_bandwidth
from controllers.protocol import Controller
from controllers.scheduled import JointSchedule, joint_schedule
from controllers.scheduled_mpc import design_scheduled_mpc
from controllers.scheduled_pid import design_scheduled_pid
from controllers.scheduled_sliding_mode import design_scheduled_sliding_mode
from controllers.scheduled_state_feedback import design_scheduled_state_feedback
from workbench.benchmark.cases import Case, nominal_plant
from workbench.errors import check_choice
from workbench.linearisation import linearise
from workbench.linearisation.angle_map import angle_map
from workbench.operating_point import operating_point
from workbench.plants.arm.inertia import MAXIMUM_LOAD

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

ANGLES_DEG = (1.0, 59.0, 13)
"""First and last angle of the map in °, and how many."""

MEAN_PRESSURES = (2.8e5, 3.6e5)
"""Mean gauge pressures of the map, Pa."""

HEAVIER = {"cascade PID": 0.3, "sliding mode": 0.5, "linear MPC": 0.5, "state feedback": 0.6}
"""The feedback is designed for so much more than the known load, kg: it bears 1 kg more."""

MODEL_ANGLES_DEG = (10.0, 30.0)
"""Angles at which the margins hold, °; those above 30° mirror them."""

PEAKS = (2.0, 1.9)
"""Limits on Ms and Mt at the known and at the changed load."""

EMPTY_PEAKS = {"cascade PID": (2.0, 1.9), "linear MPC": (2.5, 2.1), "state feedback": (2.0, 1.9)}
"""The same for the empty arm, whose inertia one kilogram makes 3.4 times as large: the MPC meets
no tighter ones."""

JERK_LIMIT = {"cascade PID": 2400.0, "sliding mode": 1300.0, "linear MPC": 2400.0,
              "state feedback": 2400.0}  # fmt: skip
EMPTY_JERK_LIMIT = 1000.0
"""Largest planned jerk with a load and for the empty arm, rad/s3."""

SLOPES = {True: 18.0, False: 22.0}
"""Slope of the sliding surface for the empty arm and with a load, rad/s. Super-twisting has no
linear loop around rest, so that its margins are shown by runs only."""

FAMILIES = ("cascade PID", "sliding mode", "linear MPC", "state feedback")
"""Families of controllers."""

SPEEDS = tuple(float(v) for v in np.round(np.geomspace(50.0, 10.0, 25), 1))
"""Speeds that are tried, from fast to slow, rad/s."""


@lru_cache(maxsize=16)
def schedule(case: Case, heavier: float = 0.0) -> JointSchedule:
    """Build the schedule of a known load.

    Args:
        case: Load and plane.
        heavier: Additional load whose inertia the feedback is designed for, in kg.

    Returns:
        Joint models over angle and mean pressure.

    Example:
        >>> len(schedule(Case(3.0)).angles)
        13
    """
    own = _map(case)
    load = min(case.load + heavier, MAXIMUM_LOAD)
    return own if load == case.load else own.with_inertia_of(_map(Case(load, case.plane)))


@lru_cache(maxsize=16)
def _map(case: Case) -> JointSchedule:
    first, last, count = ANGLES_DEG
    found = angle_map(
        nominal_plant(case),
        np.radians(np.linspace(first, last, int(count))),
        mean_pressures=MEAN_PRESSURES,
    )
    return joint_schedule(found.models, found.angles, found.mean_pressures)


def linear_models(case: Case) -> list[LinearModel]:
    """Linearise the nominal plant at the known and at the changed load.

    Args:
        case: Load and plane.

    Returns:
        Models by the valve's opening, at the angles of the margins.

    Example:
        >>> len(linear_models(Case(3.0)))
        4
    """
    return [
        linearise(
            operating_point(nominal_plant(Case(load, case.plane)), {"angle": math.radians(angle)}),
            input="opening",
            verdict=False,
        )
        for load in (case.load, case.changed_load)
        for angle in MODEL_ANGLES_DEG
    ]


def design(family: str, case: Case) -> MarginedDesign[Controller]:
    """Design the fastest controller of a family for a known load, within limits on Ms and Mt.

    Args:
        family: One of `FAMILIES`.
        case: Load and plane.

    Returns:
        The controller, designed from linear models of the nominal plant, and its margins.

    Raises:
        WorkbenchError: If the family is unknown.

    Example:
        >>> design("cascade PID", Case(3.0)).sensitivity <= 2.0
        True
    """
    check_choice("family of controllers", family, FAMILIES)
    joint = schedule(case, HEAVIER[family])
    empty = case.load == 0.0
    jerk = EMPTY_JERK_LIMIT if empty else JERK_LIMIT[family]
    if family == "sliding mode":
        law = design_scheduled_sliding_mode(joint, slope=SLOPES[empty], jerk_limit=jerk)
        return MarginedDesign(law, law.slope, math.nan, math.nan)

    def make(speed: float) -> Controller:
        if family == "cascade PID":
            return design_scheduled_pid(
                joint, frequency=speed, compensation=0.3 if empty else 0.5, jerk_limit=jerk
            )
        if family == "linear MPC":
            return design_scheduled_mpc(joint, radius=speed, jerk_limit=jerk)
        return design_scheduled_state_feedback(joint, radius=speed, jerk_limit=jerk)

    ms, mt = EMPTY_PEAKS[family] if empty else PEAKS
    return largest_bandwidth(
        make, linear_models(case), SPEEDS, maximum_sensitivity=ms, maximum_complementary=mt
    )


def fast_design(case: Case) -> Controller:
    """Design state feedback for exactly the known load, planned at the valve's limit.

    Args:
        case: Load and plane.

    Returns:
        The controller: evidence of what tolerance of another load costs.

    Example:
        >>> fast_design(Case(0.0)).name
        'state feedback for the known load'
    """
    from dataclasses import replace

    law = design_scheduled_state_feedback(
        _map(case), integral=0.13, compensation=1.0, jerk_limit=1e5
    )
    return replace(law, name="state feedback for the known load")
