"""The designs of the comparison: one map of linear models per known load, one law per family."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.h_infinity.controller import design_h_infinity
from controllers.h_infinity.synthesis import Weights, has_slycot
from controllers.joint.schedule import JointSchedule, joint_schedule
from controllers.joint.tracking import joint_tracking
from controllers.largest_bandwidth import MarginedDesign, largest_bandwidth
from controllers.mpc.along_plan import design_scheduled_mpc
from controllers.nonlinear_mpc.controller import design_nonlinear_mpc
from controllers.nonlinear_mpc.specification import NonlinearMPCSpecification
from controllers.pid import design_scheduled_pid
from controllers.protocol import Controller
from controllers.sliding_mode import design_scheduled_sliding_mode
from controllers.state_feedback import design_state_feedback
from workbench.benchmark.cases import Case, nominal_plant
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import linearise
from workbench.linearisation.angle_map import angle_map
from workbench.operating_point import operating_point
from workbench.plants.arm.inertia import MAXIMUM_LOAD
from workbench.simulation.compiled import compiled

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

ANGLES_DEG = (1.0, 59.0, 13)
"""First and last angle of the map in °, and how many."""

MEAN_PRESSURES = (2.8e5, 3.6e5)
"""Mean gauge pressures of the map, Pa."""

FAMILIES = (
    "cascade PID",
    "sliding mode",
    "linear MPC",
    "nonlinear MPC",
    "state feedback",
    "H-infinity",
)
"""Families of controllers."""

HEAVIER = {
    "cascade PID": 0.6,
    "sliding mode": 0.6,
    "linear MPC": 0.8,
    "nonlinear MPC": 0.8,
    "state feedback": 0.65,
    "H-infinity": 0.8,
}
"""With a load, the feedback is designed for so much more than the known one, kg: it bears 1 kg
more."""

EMPTY_HEAVIER = {"nonlinear MPC": 0.5, "linear MPC": 0.7, "H-infinity": 0.7}
"""The same for the empty arm, whose inertia one kilogram makes 3.4 times as large."""

EMPTY_HEAVIER_OTHERS = 0.6
"""The same for all other families: between the inertias of no load and 1 kg."""

COMPENSATION = {
    "cascade PID": 0.7,
    "sliding mode": 0.5,
    "linear MPC": 0.5,
    "state feedback": 0.5,
    "H-infinity": 0.5,
}
"""With a load, share of the unexplained acceleration that is compensated at once: more takes
hysteresis out of small steps, and margin."""

EMPTY_COMPENSATION = {"H-infinity": 0.4, "sliding mode": 0.0}
EMPTY_COMPENSATION_OTHERS = 0.3
"""The same for the empty arm."""

SHARES = (1.0, 0.7, 0.4)
"""What is tried of these shares, until one is within the margins."""

LAYER_BANDWIDTH = 30.0
"""Pole inside the boundary layer of the sliding mode, rad/s: a wider layer allows a steeper surface
within the same margins."""

MODEL_ANGLES_DEG = (10.0, 30.0)
"""Angles at which the margins hold, °; those above 30° mirror them."""

PEAKS = (2.0, 1.9)
"""Limits on Ms and Mt at the known and at the changed load."""

EMPTY_PEAKS = (2.0, 2.2)
"""The same for the empty arm."""

LATE_PEAK = 4.0
"""Limit on Ms with every command one sample late."""

LAG = {True: 0.005, False: 0.0}
"""Lag of spool and sample in the feedback for the empty arm, s; with a load the loop is so slow
beside it that it is left to the margin."""

JERK_LIMIT = {True: 1300.0, False: 2800.0}
"""Largest planned jerk for the empty arm and with a load, rad/s3."""

EMPTY_NONLINEAR_JERK = 600.0
"""The same for the nonlinear MPC of the empty arm, which relies on its model, rad/s3."""

JERK_SHARE = 0.8
"""Share of the valve's opening that a planned move may use; the rest is for the feedback."""

FULL_LOAD, FULL_LOAD_SHARE = 7.0, 0.68
"""The same from this load on, kg: what the arm needs to hold and brake such a load leaves less of
the valve when the supply drops."""

VERTICAL_SHARE = 0.75
"""The same in the vertical plane, where gravity takes a part of it."""

LEAD = 0.0055
"""Lead of the feedforward's opening, s: the spool lags by 2.3 ms, a held command by half a sample,
1 ms, and the filter of the measured pressures by 2 ms."""

DISTURBANCE = {True: 3.0, False: 2.0}
"""Size of the disturbance in the H-infinity problem relative to a change of the reference, for the
empty arm, whose inertia is uncertain, and with a load."""

SPEEDS = tuple(float(v) for v in np.round(np.geomspace(50.0, 10.0, 25), 1))
"""Speeds that are tried, from fast to slow, rad/s."""

SYNTHESIS_SPEEDS = tuple(float(v) for v in np.round(np.geomspace(30.0, 10.0, 10), 1))
"""The same where every speed costs a synthesis, rad/s."""


def available_families() -> tuple[str, ...]:
    """Return the families that can be designed here: without slycot no H-infinity.

    Returns:
        Names from `FAMILIES`.

    Example:
        >>> "cascade PID" in available_families()
        True
    """
    return tuple(name for name in FAMILIES if name != "H-infinity" or has_slycot())


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
    empty = case.load == 0.0
    heavier = EMPTY_HEAVIER.get(family, EMPTY_HEAVIER_OTHERS) if empty else HEAVIER[family]
    if family == "nonlinear MPC":
        return MarginedDesign(_nonlinear(case, heavier), math.nan, math.nan, math.nan)
    joint, lag = schedule(case, heavier), LAG[empty]
    share = COMPENSATION[family]
    if empty:
        share = EMPTY_COMPENSATION.get(family, EMPTY_COMPENSATION_OTHERS)

    def make(speed: float, share: float) -> Controller:
        planned: Any = {"jerk_limit": JERK_LIMIT[empty], "jerk_share": _share(case), "lead": LEAD}
        if family == "cascade PID":
            return design_scheduled_pid(
                joint, frequency=speed, compensation=share, lag=lag, **planned
            )
        if family == "sliding mode":
            return design_scheduled_sliding_mode(
                joint,
                kind="integral",
                slope=speed,
                unexplained_share=0.5,
                layer_bandwidth=LAYER_BANDWIDTH,
                compensation=share,
                lag=lag,
                **planned,
            )
        if family == "linear MPC":
            return design_scheduled_mpc(
                joint, radius=speed, integral=0.2, compensation=share, lag=lag, **planned
            )
        if family == "H-infinity":
            # For the empty arm, slower pressures leave the spool out of the loop.
            return design_h_infinity(
                joint,
                weights=Weights(speed, disturbance=DISTURBANCE[empty]),
                inner_bandwidth=70.0 if empty else 120.0,
                delay=lag or 0.004,
                compensation=share,
                **planned,
            )
        return design_state_feedback(
            joint,
            radius=speed,
            integral=0.33 if empty else 0.2,
            compensation=share,
            lag=lag,
            **planned,
        )

    ms, mt = EMPTY_PEAKS if empty else PEAKS
    # A share that no speed bears within the margins is too large for this load.
    for reduced in SHARES[:-1]:
        try:
            return _fastest(family, partial(make, share=reduced * share), case, ms, mt)
        except WorkbenchError:
            continue
    return _fastest(family, partial(make, share=SHARES[-1] * share), case, ms, mt)


def _share(case: Case) -> float:
    if case.load >= FULL_LOAD:
        return FULL_LOAD_SHARE
    return VERTICAL_SHARE if case.plane == "vertical" else JERK_SHARE


def _fastest(
    family: str, make: Callable[[float], Controller], case: Case, ms: float, mt: float
) -> MarginedDesign[Controller]:
    return largest_bandwidth(
        make,
        linear_models(case),
        SYNTHESIS_SPEEDS if family == "H-infinity" else SPEEDS,
        maximum_sensitivity=ms,
        maximum_complementary=mt,
        late_sensitivity=LATE_PEAK,
    )


def _nonlinear(case: Case, heavier: float) -> Controller:
    """Design the nonlinear MPC on the smooth face of the plant without friction."""
    load = min(case.load + heavier, MAXIMUM_LOAD)
    model = nominal_plant(Case(load, case.plane)).without("bearing_friction")
    empty = case.load == 0.0
    front = joint_tracking(
        schedule(case, heavier),
        jerk_share=_share(case),
        jerk_limit=EMPTY_NONLINEAR_JERK if empty else JERK_LIMIT[empty],
    )
    want = NonlinearMPCSpecification(
        angle_scale=0.01 if empty else 0.003,
        speed_scale=0.1 if empty else 0.16,
        move_scale=0.1 if empty else 0.4,
        torque_walk=50.0 if empty else 70.0,
        planner=front.planner,
    )
    rest = operating_point(model, {"angle": math.radians(30.0)}).x
    return design_nonlinear_mpc(model, want, rest=rest, compile_function=compiled)


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

    law = design_state_feedback(
        _map(case),
        radius=60.0,
        integral=0.33,
        jerk_share=JERK_SHARE,
        jerk_limit=1e5,
        lead=LEAD,
        lag=LAG[True],
    )
    return replace(law, name="state feedback for the known load")
