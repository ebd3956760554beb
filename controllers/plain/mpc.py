"""Linear MPC of one output by one command, for any linear model.

It is that of `controllers.mpc.whole_model`: the command's range takes the place of the opening, -1
to 1 about rest, on a curve that is a straight line, and the disturbance is one of the command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from controllers.mpc.whole_model import LinearMPC, MPCSpecification, design_mpc, linear_mpc_design
from controllers.plain.single_loop import DISTURBED, SPEED, LoopSpecification
from controllers.valve_inverse import ValveInverse
from workbench.errors import check_range

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


@dataclass(frozen=True)
class PlainMPCSpecification(LoopSpecification):
    """What a linear MPC for any linear model is designed for.

    Args:
        speed: Speed of the reference's lags, in rad/s; the horizon is four of its time constants.
            By default (0) a fiftieth of the sampling rate, or the fastest unstable mode's rate.
        error_scale: Error that weighs as much as a third of the command, in SI of the output; a
            hundredth of its scale by default (0).
        rate_time: Time in which the command may cross half of its range, in s; two prediction
            samples by default (0).
        noise: Noise rms of the measurement, in SI; by default what the sensor declares, and 1e-4
            of its scale at least (0).
    """

    speed: float = 0.0
    error_scale: float = 0.0
    rate_time: float = 0.0
    noise: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("speed", self.speed, 0.0, 0.5 / self.sample_time, "rad/s")
        for name in ("error_scale", "rate_time", "noise"):
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
    loop = want.loop(linear)
    own, h = loop.linear, want.sample_time
    # Over many time constants of an unstable mode no prediction has a meaning.
    growing = float(np.max(np.linalg.eigvals(own.A).real, initial=0.0))
    speed = want.speed or min(max(SPEED / h, growing), 0.5 / h)
    step = h * max(1, round(0.1 / speed / h))
    entered = int(np.argmax(np.abs(own.B[:, 0]) / loop.linear.state_scales))
    walking = 1.0 / math.sqrt(DISTURBED * h)
    walk = float(abs(own.B[entered, 0])) * loop.command_scale * walking
    plain = MPCSpecification(
        angle_scale=want.error_scale or 0.01 * loop.output_scale,
        prediction_time=step,
        rate_limit=1.0 / (want.rate_time or 2.0 * step),
        state_noise=MPCSpecification.state_noise * walking,
        disturbances={own.state_names[entered]: walk},
        sensor_noise=(want.noise or max(loop.noise, 1e-4 * loop.output_scale),),
        reference_speed=speed,
        sample_time=h,
    )
    straight = ValveInverse((0.0, loop.command_scale), (0.0, 1.0), loop.rest_command)
    law = design_mpc(own, plain, valve=straight, sensors=(loop.measured,), actuator=loop.actuator)
    return replace(law, name="linear MPC")


PLAIN_MPC = linear_mpc_design(
    name="plain-mpc",
    summary="linear MPC without offset, for any linear model",
    function=design_plain_mpc,
    specification=PlainMPCSpecification,
)
