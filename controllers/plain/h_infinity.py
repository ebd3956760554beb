"""H-infinity mixed sensitivity for any linear model, by the synthesis of the joint's controller.

Outputs count in what all commands make them swing by at the speed w of the weights, commands in
what they may change by, so that the plant is as large there as a double integrator and the weights
of `controllers.h_infinity.synthesis` mean the same for every plant; its disturbances enter with the
commands.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from controllers.design import Design
from controllers.h_infinity.synthesis import Weights, synthesise
from controllers.plain.limits import NEARLY, LoopLimits, LoopSpecification
from controllers.plain.loop import Loop
from controllers.plain.measured_outputs import designed_for
from controllers.plain.pace import at_pace, best_at_pace, swing
from controllers.plain.references import better, entering, lags, led, unexcited
from controllers.plain.selection import Place, best_of
from controllers.plain.state_feedback import reachable_speed, reading_helps
from controllers.plain.transfer_law import TransferLaw, sampled_controller
from workbench.errors import NumericalError, WorkbenchError, check_range
from workbench.linearisation import LinearModel


@dataclass(frozen=True)
class PlainHInfinitySpecification(LoopSpecification):
    """What an H-infinity controller for any linear model is designed for.

    Args:
        speed: Speed w below which the error is made small, in rad/s; by default (0) that of the
            best loop within its limits.
    """

    speed: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("speed", self.speed, 0.0, self.turning(0.5), "rad/s")


FACTORS = (0.15, 0.3, 0.5, 0.8, 1.2, 2.0)
"""Speeds that are tried, over that of a state feedback."""

PACES = tuple(2.0 ** (k / 2.0) for k in range(-8, 9))
"""Speeds of the errors of several outputs that are tried, over that of all."""

INPUT_SIZES = (8.0, 1.0, 0.4, 0.2)
CALM_SIZES = (0.05, 0.01)
"""Sizes of the command that are tried, over that at which the plant moves the output by itself; and
those where none of these is within limits. All are tried of a plant that is unstable, of which a
controller that takes little more than it must is stable by itself more often."""

BESIDES = (0.1, 0.01)
"""Errors of what nobody follows, over a change of a reference, ratios: the next where no controller
is stable by itself, as of a plant that grows. What is trusted more leaves more that are."""


def design_plain_h_infinity(
    linear: LinearModel, specification: PlainHInfinitySpecification | None = None
) -> TransferLaw:
    """Design an H-infinity controller between commands and outputs of any linear model.

    Raises:
        WorkbenchError: If slycot is not installed, or there is no such controller.
    """
    want = (specification or PlainHInfinitySpecification()).sampled(linear)
    return designed_for(want, linear, partial(_within, want), reading_helps)


def _within(want: PlainHInfinitySpecification, limits: LoopLimits) -> TransferLaw:
    loop = limits.loop
    made = cache(partial(_h_infinity, loop, want))

    def led_at(steps: tuple[int, ...], w: float) -> tuple[float, ...]:
        return tuple(w * PACES[k] for k in steps)

    def designed(steps: tuple[int, ...], at: tuple[float, float, float]) -> TransferLaw:
        return made(steps, *at).behind_lags(led_at(steps, at[0]))

    about = 0.0 if want.speed else reachable_speed(limits)
    tried = [about * factor for factor in FACTORS] if about else [want.speed]
    alike = (PACES.index(1.0),) * limits.outputs
    count = len(PACES) if limits.outputs > 1 and about else 0
    reason: WorkbenchError = NumericalError("")
    found: list[tuple[float, Place]] = []
    every = INPUT_SIZES + CALM_SIZES
    grids = [every] if limits.growing else [INPUT_SIZES, CALM_SIZES]
    for sizes, beside in itertools.product(grids, BESIDES if loop.read else BESIDES[:1]):
        places = [(alike, (w, size, beside)) for w in tried for size in sizes]
        try:
            designed_law, place = best_of(
                limits, designed, places, "an H-infinity controller", count
            )
        except WorkbenchError as error:
            reason = error
            continue
        found.append((limits.excess(designed_law), place))
        if found[-1][0] <= NEARLY or sizes is grids[-1]:
            break
    if not found:
        if want.speed or not isinstance(reason, NumericalError):
            raise reason
        raise WorkbenchError(
            f"no H-infinity controller of {loop.words} is found at any speed that was tried"
            f" ({str(reason).partition(';')[0]}); take another family, such as lqi"
        )
    _, (steps, at) = min(found, key=lambda each: each[0])
    law, speeds = made(steps, *at), led_at(steps, at[0])
    own, limits = law.around_rest(), limits.late
    mild = led(limits, law.behind_lags, lags(limits, speeds))
    others = [law.referred(*entry) for entry in unexcited(limits, own)]
    enter = entering(limits, own)

    def entered(reluctance: float, speeds: tuple[float, ...]) -> TransferLaw:
        return law.referred(*enter(speeds, reluctance))

    for by in (partial(entered, reluctance) for reluctance in RELUCTANCES):
        tried_lags = lags(limits, speeds)[FASTER:]
        if limits.growing:
            # Commands that are at their ends for a reference hold nothing that grows.
            most = max(SWING, swing(limits, mild))
            tried_lags = [each for each in tried_lags if swing(limits, by(each)) <= most]
        others += [led(limits, by, tried_lags)] if tried_lags else []
    if not others:
        return at_pace(limits, mild)
    eager = better(limits, others)
    if limits.growing:
        return at_pace(limits, better(limits, [mild, eager]))
    return best_at_pace(limits, [mild, eager, eager.conditioned(), others[-1]])


RELUCTANCES = (1e-3, 0.1)
"""What it may cost references to enter otherwise than by the error, ratios."""

SWING = 0.5
"""Largest swing of commands of a plant that grows, after a step of an output's scale, over theirs,
if it swings no further by the error alone."""

FASTER = 2
"""Lags of references that are too fast for what answers without a tail."""


def _h_infinity(
    loop: Loop,
    want: PlainHInfinitySpecification,
    steps: tuple[int, ...],
    w: float,
    input_size: float,
    beside: float,
) -> TransferLaw:
    own, h, paces = loop.linear, want.sample_time, tuple(PACES[k] for k in steps)
    # What nobody follows is as fast as all.
    at = w * np.append(paces, np.ones(len(loop.sensors) - len(paces)))
    swings = np.abs(loop.response(at, read=True)) * loop.command_scale
    read = np.linalg.norm(swings, axis=2).diagonal()
    # Time counts in 1 / w and states in scales, so that no machine is too slow or too small for the
    # numbers. The commands pass a delay (first-order Pade); disturbances enter beside it.
    states = own.state_scales
    B, C = own.B / states[:, None] * (loop.command_scale / w), loop.shown.C * states / read[:, None]
    # Neither what enters the states nor what is seen of them is lost beside the other.
    even = math.sqrt(np.linalg.norm(B) / np.linalg.norm(C))
    B, C = B / even, C * even
    p = 2.0 / (w * (want.delay + 1.5 * h))
    (n, m), sensors = own.B.shape, len(read)
    one, nothing = p * np.eye(m), np.zeros((m, m))
    A = np.block([[own.A * states / states[:, None] / w, 2.0 * B], [np.zeros((m, n)), -one]])
    entries = np.block([[B, -B], [nothing, one]])
    seen_with = np.hstack([C, np.zeros((sensors, m))])
    plant = A, entries, seen_with, np.zeros((sensors, 2 * m))
    found = synthesise(
        plant,
        Weights(1.0, input_size=input_size, beside=beside, paces=paces),
        followed=len(loop.measured),
        tolerance=0.3,
        closely=0.03,
        sample_time=h * w,
    )
    by = loop.command_scale[:, None]
    law = found.A, found.B / read, by * found.C, by * found.D / read
    return sampled_controller(
        law, loop.ends, tracking_time=1.0 / w, sample_time=h, name="H-infinity"
    )


PLAIN_H_INFINITY = Design(
    name="plain-h-infinity",
    family="H-infinity",
    summary="H-infinity mixed sensitivity for any linear model; needs slycot",
    function=design_plain_h_infinity,
    specification=PlainHInfinitySpecification,
)
