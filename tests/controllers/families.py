"""Controllers of every family on the arm, by design and numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from controllers.design import DESIGNS
from controllers.h_infinity.synthesis import has_slycot
from controllers.joint.hysteresis_compensation import HysteresisCompensation
from controllers.joint.learning import MotionLearning
from controllers.joint.schedule import JointSchedule
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.verification import Scenario, Steps, metrics, verify

Make = Callable[[JointSchedule, LinearModel], Any]


def designed(name: str, source: Any, **numbers: Any) -> Any:
    """Return the controller of a design for a linear model, or what else it starts from."""
    design = DESIGNS.get(name)
    return design.controller(source, design.specified(numbers))


def family(name: str, **numbers: Any) -> Make:
    """Return what makes a controller from the schedule or from the linear model at one point."""

    def make(schedule: JointSchedule, linear: LinearModel) -> Any:
        source = schedule if DESIGNS.get(name).needs == "map" else linear
        return designed(name, source, **numbers)

    return make


def moves(times: tuple[float, ...], *angles: float, **told: Any) -> Scenario:
    """Return a staircase of the angle, in degrees, from 0 s and from each of some times."""
    steps = Steps((0.0, *times), tuple(math.radians(a) for a in angles))
    return Scenario("moves", {"angle": steps}, **told)


def assert_settles(law: Any, plant: Model, scenario: Scenario, within: float) -> None:
    """Assert that every step ends in time, with next to no overshoot, and at rest."""
    found = {name: each.value for name, each in metrics(verify(law, plant, scenario)).items()}
    assert found["settling_time"] < within
    assert found["overshoot"] < 0.05
    assert found["steady_error"] < math.radians(0.05)
    assert found["oscillation"] < math.radians(0.05)
    assert found["stop_impacts"] == 0.0
    assert found.get("fallbacks", 0.0) == 0.0


CLOSED_FORM: dict[str, Make] = {
    "PD on the angle": family("angle-pd", proportional=4.0, derivative=0.05),
    "fixed PID": family("pid"),
    "fixed sliding mode": family("sliding-mode"),
    "scheduled PID": family("scheduled-pid"),
    "tolerant PID": family(
        "scheduled-pid",
        frequency=28.0,
        inner_speed=4.0,
        latency=0.004,
        lead=0.0055,
        lag=0.005,
        sensor_lag=0.005,
        unexplained_bandwidth=10.0,
        rest_integration=5.0,
        centring=3.0,
        renewal=0.1,
        hysteresis=HysteresisCompensation(10.0, 7e-5, 5e-4, 0.0295, 7.6e-5),
        learning=MotionLearning(),
    ),
    "boundary layer": family("scheduled-sliding-mode", kind="boundary layer"),
    "integral": family("scheduled-sliding-mode", kind="integral"),
    "super-twisting": family("scheduled-sliding-mode", kind="super-twisting"),
    "state feedback": family("scheduled-state-feedback"),
    **({"H-infinity": family("scheduled-h-infinity")} if has_slycot() else {}),
}
"""Laws written once for floats and for symbols."""

MPCS: dict[str, Make] = {
    "scheduled MPC": family("scheduled-mpc", latency=0.004),
    "tolerant MPC": family("scheduled-mpc", rest_integration=5.0, centring=3.0, renewal=0.1),
    "linear MPC": family("mpc"),
    "linear MPC with preview": family("mpc", preview=True),
    "linear MPC with tight limits": family(
        "mpc", opening_limit=0.4, rate_limit=10.0, pressure_limits=(3e5, 4.5e5)
    ),
}
