"""Linear MPC of one output by one command, for any linear model.

It is that of `controllers.mpc.whole_model`: the command takes the place of the opening, on a curve
that is a straight line through rest, fully open at the farther end of the command's range, and the
disturbance is one of the command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from controllers.joint.model import opening_input
from controllers.mpc.disturbance_observer import DisturbanceObserver
from controllers.mpc.whole_model import (
    LinearMPC,
    MPCSpecification,
    design_mpc,
    linear_mpc_design,
    observer_of,
    reference_path,
)
from controllers.plain.limits import LoopLimits
from controllers.plain.single_loop import LoopSpecification, SingleLoop, speeds
from controllers.valve_inverse import ValveInverse
from workbench.errors import check_range

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


FASTEST = 0.15
"""Largest speed of a reference that is tried, times the sample time: a horizon has its samples."""

DISTURBANCES = (1.0, 0.1, 0.01)
"""Disturbances of the command that are tried, as fractions of it."""

ERRORS = (0.1, 1.0)
"""Errors that are tried, over what the command moves the output by at the speed."""


ENDLESS = 10.0
"""Where a command without an end is taken to end, over what it may change by."""


@dataclass(frozen=True)
class PlainMPCSpecification(LoopSpecification):
    """What a linear MPC for any linear model is designed for.

    Args:
        speed: Speed of the reference's lags, in rad/s; the horizon is four of its time constants.
            By default (0) the horizon is that of the best loop within its limits, and the lags are
            what leads a step best.
        error_scale: Error that weighs as much as a third of the command, in SI of the output; by
            default (0) what makes the best loop.
        rate_time: Time in which the command may cross half of its range, in s; two prediction
            samples by default (0).
        disturbance: What the disturbance of the command is taken to walk by in ten time constants
            of the loop, rms, as a fraction of the command; what suits the loop by default (0).
    """

    speed: float = 0.0
    error_scale: float = 0.0
    rate_time: float = 0.0
    disturbance: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("speed", self.speed, 0.0, 0.5 / self.sample_time, "rad/s")
        for name in ("error_scale", "rate_time", "disturbance"):
            check_range(name.replace("_", " "), getattr(self, name), 0.0, 1e30)


def design_plain_mpc(
    linear: LinearModel, specification: PlainMPCSpecification | None = None
) -> LinearMPC:
    """Design a linear MPC without offset for any linear model.

    Raises:
        WorkbenchError: If the output cannot be led to a reference by the command, or a Riccati
            equation has no solution.
    """
    want = specification or PlainMPCSpecification()
    loop, h = want.loop(linear), want.sample_time
    # Over many time constants of an unstable mode no prediction has a meaning.
    growing = float(np.max(np.linalg.eigvals(loop.linear.A).real, initial=0.0))
    top = min(max(2.0 * growing, 0.02 / h) if growing > 1e-6 / h else FASTEST / h, 0.3 / h)
    low = min(growing, 0.5 * top)
    tried = [want.speed] if want.speed else [w for w in speeds(h, 16) if low <= w <= top]

    # The horizon does not depend on the disturbance, nor the observer on the error.
    @cache
    def horizon(speed: float, error: float) -> LinearMPC:
        own = _specified(loop, want, speed, DISTURBANCES[0], error, full)
        law = design_mpc(
            loop.linear,
            own,
            valve=curve,
            sensors=sensors,
            actuator=loop.actuator,
            opening_range=(-below / full, above / full),
        )
        return replace(law, name="linear MPC")

    @cache
    def observer(speed: float, disturbance: float) -> DisturbanceObserver:
        own = _specified(loop, want, speed, disturbance, loop.output_scale, full)
        return observer_of(
            loop.linear, own, sensors, opening_input(loop.linear, curve, loop.actuator)
        )

    def designed(speed: float, disturbance: float, error: float) -> LinearMPC:
        return replace(horizon(speed, error), observer=observer(speed, disturbance))

    below, above = (
        room if room < math.inf else ENDLESS * loop.command_scale
        for room in (loop.rest_command - loop.lower, loop.upper - loop.rest_command)
    )
    full = max(below, above)
    curve = ValveInverse((0.0, full), (0.0, 1.0), loop.rest_command)
    sensors = (loop.measured,)
    designs = [
        partial(designed, speed, disturbance, error)
        for speed in tried
        for disturbance in ([want.disturbance] if want.disturbance else DISTURBANCES)
        for error in (
            [want.error_scale]
            if want.error_scale
            else [share * loop.sizes([speed])[0] for share in ERRORS]
        )
    ]
    limits, family = LoopLimits(loop, want), "a linear MPC"
    law = limits.best(designs, family)
    if want.speed:
        return law

    def lagging(speed: float) -> LinearMPC:
        path = reference_path(speed * h, law.prediction.preview_index)
        return replace(law, reference_speed=speed, path=path)

    return limits.led(lagging, law.reference_speed, family)


def _specified(
    loop: SingleLoop,
    want: PlainMPCSpecification,
    speed: float,
    disturbance: float,
    error: float,
    full: float,
) -> MPCSpecification:
    """Return what an MPC is told, whose openings are fractions of a full one, in SI."""
    share = loop.command_scale / full
    own, h = loop.linear, want.sample_time
    step = h * max(1, round(0.1 / speed / h))
    entered = int(np.argmax(np.abs(own.B[:, 0]) / own.state_scales))
    # Over ten time constants.
    walking = math.sqrt(0.1 * speed)
    walk = disturbance * float(abs(own.B[entered, 0])) * loop.command_scale * walking
    return MPCSpecification(
        angle_scale=error,
        opening_scale=MPCSpecification.opening_scale * share,
        move_scale=MPCSpecification.move_scale * share,
        prediction_time=step,
        rate_limit=share / (want.rate_time or 2.0 * step),
        state_noise=MPCSpecification.state_noise * walking,
        disturbances={own.state_names[entered]: walk},
        sensor_noise=(want.loop_noise(loop),),
        reference_speed=min(speed, 0.5 / h),
        sample_time=h,
    )


PLAIN_MPC = linear_mpc_design(
    name="plain-mpc",
    summary="linear MPC without offset, for any linear model",
    function=design_plain_mpc,
    specification=PlainMPCSpecification,
)
