"""Sliding mode with boundary layer and integral for any linear model, on a Kalman filter.

Of one output by one command: s = 0 is the surface on which the model with its integral has given
poles (Ackermann and Utkin's formula); K, Kr and Kq keep the model on it
(`controllers.plain.observer_law`).

Units: SI.

Source: Ackermann and Utkin, Sliding mode control design based on Ackermann's formula, IEEE Trans.
AC-43, 1998.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from controllers.plain.limits import LoopLimits
from controllers.plain.loop import speeds
from controllers.plain.measured_outputs import designed_for
from controllers.plain.observer_law import (
    ObservedModel,
    ObserverLaw,
    ObserverSpecification,
    disturbances,
    doubts,
)
from controllers.plain.pace import at_pace
from controllers.plain.pairing import zeros
from controllers.plain.selection import best_of
from controllers.plain.state_feedback import reading_helps
from controllers.sliding_mode import sliding_design
from controllers.specification import number
from workbench.arrays import Matrix, Vector
from workbench.errors import WorkbenchError, check_range
from workbench.linearisation import LinearModel


@dataclass(frozen=True)
class PlainSlidingModeSpecification(ObserverSpecification):
    """What a sliding mode for any linear model is designed for.

    Args:
        slope: Speed of the poles on the surface, in rad/s; poles of the model that are faster stay.
            By default (0) the best loop within its limits.
        reach: What may lead to the surface, as a fraction of the command; more where a load of
            that size asks for more.
        layer_bandwidth: Pole inside the boundary layer, in rad/s; twice the slope by default (0).
    """

    slope: float = 0.0
    reach: float = number(0.5, 1e-6, 10.0, words="reach to the surface")
    layer_bandwidth: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("slope of the surface", self.slope, 0.0, self.turning(0.2), "rad/s")
        top = self.turning(0.5)
        check_range("bandwidth of the layer", self.layer_bandwidth, 0.0, top, "rad/s")


def design_plain_sliding_mode(
    linear: LinearModel, specification: PlainSlidingModeSpecification | None = None
) -> ObserverLaw:
    """Design a sliding mode with boundary layer and integral for any linear model.

    Raises:
        WorkbenchError: If the command does not reach all states, or several outputs are followed.
    """
    want = (specification or PlainSlidingModeSpecification()).sampled(linear)
    h = want.sample_time
    slopes = [want.slope] if want.slope else [w for w in speeds(h) if w <= 0.2 / h]

    def within(limits: LoopLimits) -> ObserverLaw:
        loop = limits.loop
        if len(loop.actuators) > 1 or len(loop.measured) > 1:
            raise WorkbenchError(
                f"a sliding mode of the workbench has one surface, and {loop.words} needs"
                f" {len(loop.actuators)}; follow one output by one command, or take another family,"
                " such as lqi"
            )
        model = ObservedModel(limits.predicted, want)
        sliding = cache(partial(_sliding, model, want))

        def designed(_: tuple[int, ...], at: tuple[float, float, float]) -> ObserverLaw:
            slope, disturbance, doubt = at
            return model.observed(sliding(slope), disturbance, slope, doubt)

        tried = itertools.product(slopes, disturbances(limits, want.disturbance), doubts(loop))
        law, _ = best_of(limits, designed, [((), at) for at in tried], "a sliding mode")
        law = _bearing(law, law.reach)
        return at_pace(limits.late, model.led(limits.late, law))

    def helps(limits: LoopLimits, wider: LoopLimits) -> bool:
        # What is refused need not be looked at.
        return limits.outputs == 1 and reading_helps(limits, wider)

    return designed_for(want, linear, within, helps)


def _sliding(
    model: ObservedModel, want: PlainSlidingModeSpecification, slope: float
) -> ObserverLaw:
    """Return a law that has no observer yet, whose surface has a slope in rad/s."""
    loop = model.loop
    A, B, C = loop.linear.A, loop.linear.B, loop.linear.C
    n = len(A)
    # With q' = -C x in the place of the error's integral, whose reference is at rest.
    joined = np.block([[A, np.zeros((n, 1))], [-C, np.zeros((1, 1))]])
    entry = np.vstack([B, [[0.0]]])
    sizes = sorted(max(abs(p), slope) for p in np.linalg.eigvals(A))
    # Behind zeros that are slower, no other poles keep a step from overshooting by far.
    slow = [z for z in zeros(loop) if z.real < 0.0 <= z.imag and abs(z) < slope]
    behind: list[complex] = []
    for z in sorted(slow, key=abs):
        own = [z, z.conjugate()] if z.imag else [z]
        if len(behind) + len(own) <= sizes.count(slope):
            behind += own
    poles = [*(-w for w in sizes[len(behind) :]), *behind]
    size = np.append(loop.linear.state_scales, loop.output_scale / slope)
    surface = _surface(joined, entry, poles, size, loop.actuators[0])
    kept = surface @ joined
    bandwidth = want.layer_bandwidth or 2.0 * slope
    reach = want.reach * float(loop.command_scale[0])
    told = {
        "name": "sliding mode",
        "surface": tuple(surface[:n].tolist()),
        "surface_integral": -float(surface[n]),
        "reach": reach,
        "reference_speed": (want.reference_speed or slope,),
        "layer": reach / bandwidth,
    }
    return model.law(kept[None, :n], -kept[None, n:], slope, told)


def _bearing(law: ObserverLaw, load: float) -> ObserverLaw:
    """Return a law that holds its reference under a load inside its layer, the same law there.

    A load that the filter does not know moves its estimate from the surface, far where what is
    foretold over a delay has large gains: what leads back must bear that too, or the integral,
    which stands beyond the layer, never takes over.

    Args:
        load: Constant load on the command, in SI.
    """
    own = (law.F, law.G, law.C, law.M, law.gain, law.integral_gain)
    F, G, C, M, K, Kq = (np.array(part) for part in own)
    S, steep = np.array(law.surface), law.reach / law.layer
    # At rest the command makes up for the load, and outputs and plant are where they were.
    predicted = np.linalg.solve(np.eye(len(F)) - F + F @ M @ C, -G[:, 0] * load)
    x = predicted - M @ (C @ predicted)
    q = (K[0] @ x + steep * S @ x - load) / (Kq[0, 0] + steep * law.surface_integral)
    beyond = abs(float(S @ x - law.surface_integral * q)) / law.layer
    return replace(law, reach=law.reach * max(beyond, 1.0), layer=law.layer * max(beyond, 1.0))


def _surface(A: Matrix, B: Matrix, poles: list[complex], size: Vector, actuator: str) -> Matrix:
    """Return S with S B = 1 such that the model has these poles on S x = 0.

    Where B is along the first axis and A an upper Hessenberg matrix, that is the last axis times
    (A - p) for each pole p: its powers need not be formed.

    Source: Ackermann and Utkin, 1998; Petkov, Christov and Konstantinov, Computational Methods for
    Linear Control Systems, 1991 (Hessenberg form).
    """
    from scipy.linalg import hessenberg

    n = len(A)
    a, b = A * size / size[:, None], B[:, 0] / size
    first = np.linalg.qr(np.column_stack([b, np.eye(n)]))[0]
    a, turned = hessenberg(first.T @ a @ first, calc_q=True)
    steps = np.abs(np.diag(a, -1))
    if not np.any(b) or np.any(steps <= 1e-14 * np.abs(a).max()):
        raise WorkbenchError(
            f"{actuator} does not reach all states of the linear model with the integral of the"
            " error; leave the others out of the model, or take a PID"
        )
    row = np.eye(n)[-1]
    for pole in (p for p in poles if p.imag >= 0.0):
        moved = row @ a - pole.real * row
        # A pole and its conjugate: (a - re)^2 + im^2.
        row = moved @ a - pole.real * moved + pole.imag**2 * row if pole.imag else moved
        row = row / np.abs(row).max()
    row = row @ (first @ turned).T / size
    return np.asarray(row / float((row @ B)[0]))


PLAIN_SLIDING_MODE = sliding_design(
    name="plain-sliding-mode",
    summary="sliding mode with boundary layer and integral, for any linear model",
    function=design_plain_sliding_mode,
    specification=PlainSlidingModeSpecification,
)
