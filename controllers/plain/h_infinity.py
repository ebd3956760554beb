"""H-infinity mixed sensitivity for any linear model, by the synthesis of the joint's controller.

The command is counted in units of |P(iw)| w^2, w the speed of the weights, so that the plant is as
large there as a double integrator and the weights of `controllers.h_infinity.synthesis` mean the
same for every plant; its disturbance enters with the command.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from controllers.design import Design
from controllers.h_infinity.synthesis import Weights, synthesise
from controllers.plain.single_loop import SPEED, LoopSpecification
from controllers.plain.transfer_law import TransferLaw, transfer_controller
from workbench.errors import TIMES_S, check_range
from workbench.linearisation.transfer import transfer_function

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


@dataclass(frozen=True)
class PlainHInfinitySpecification(LoopSpecification):
    """What an H-infinity controller for any linear model is designed for.

    Args:
        speed: Speed w below which the error is made small, in rad/s; by default (0) a
            fiftieth of the sampling rate.
        delay: Delay of sample and converter, in s; one and a half samples by default (0).
    """

    speed: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("speed", self.speed, 0.0, 0.5 / self.sample_time, "rad/s")
        check_range("delay", self.delay, 0.0, TIMES_S[1], "s")


def design_plain_h_infinity(
    linear: LinearModel, specification: PlainHInfinitySpecification | None = None
) -> TransferLaw:
    """Design an H-infinity controller between one command and one output of any linear model.

    Raises:
        WorkbenchError: If slycot is not installed.
        NumericalError: If there is no such controller.
    """
    import control as ct

    want = specification or PlainHInfinitySpecification()
    loop = want.loop(linear)
    own, h = loop.linear, want.sample_time
    w = want.speed or SPEED / h
    size = abs(complex(transfer_function(own.A, own.B, own.C, own.D, np.array([1j * w]))[0, 0, 0]))
    unit = 1.0 / size
    # Time counts in 1 / w and states in scales, so that no machine is too slow or too small for the
    # numbers. The command passes a delay (first-order Pade); a disturbance enters beside it.
    states = own.state_scales / loop.output_scale
    p = 2.0 / (w * (want.delay or 1.5 * h))
    n = len(own.A)
    B = own.B / states[:, None] * (unit / w)
    A = np.block(
        [[own.A * states / states[:, None] / w, 2.0 * B], [np.zeros((1, n)), np.array([[-p]])]]
    )
    entries = np.block([[B, -B], [np.zeros((1, 1)), np.array([[p]])]])
    C = np.hstack([own.C * states, np.zeros((1, 1))])
    plant = A, entries, C, np.zeros((1, 2))
    found = synthesise(plant, Weights(1.0), tolerance=0.3, sample_time=h * w)
    law = ct.ss(found.A, found.B, unit * found.C, unit * found.D, h)
    return transfer_controller(
        law, tracking_time=1.0 / w, sample_time=h, name="H-infinity", **loop.ends
    )


PLAIN_H_INFINITY = Design(
    name="plain-h-infinity",
    family="H-infinity",
    summary="H-infinity mixed sensitivity for any linear model; needs slycot",
    function=design_plain_h_infinity,
    specification=PlainHInfinitySpecification,
)
