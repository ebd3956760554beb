"""Any transfer function as a controller, the textbook PID with gains by hand among them.

With r and y as deviations from rest, sample k, and the command u clipped to its ends:

    u[k]   = u0 + C z[k] + Dr r[k] - Dy y[k]
    z[k+1] = A z[k] + Br r[k] - By y[k] + L (u_clipped - u)[k]

L moves a mode of A that integrates, or nearly does, to the time constant Tt while the command is at
its end (anti-windup in observer form). A PID has the integral and the filtered derivative as z:

    u = u0 + Kp (beta r - y) + I + Kd (v - w) / (Tf + h)         v = c r - y
    I[k+1] = I[k] + h Ki (r - y) + (h / Tt) (u_clipped - u)
    w[k+1] = f w[k] + (1 - f) v                                  f = Tf / (Tf + h)

Units: SI.

Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, sections 8.5 (PID) and 9.4
(anti-windup); Åström and Hägglund, Advanced PID Control, 2006, section 13.3.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Told
from controllers.design import Design
from controllers.linear_law import LinearLaw
from controllers.plain.limits import Among, Answer, LoopLimits, answer
from controllers.plain.single_loop import LoopSpecification, PlainLaw
from controllers.sampling import Rows, anti_windup, rows, total
from workbench.errors import TIMES_S, WorkbenchError, check_range
from workbench.linearisation.transfer import transfer_function

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


@dataclass(frozen=True, kw_only=True, repr=False)
class TransferLaw(PlainLaw):
    """A sampled linear controller with two degrees of freedom, and anti-windup.

    Args:
        A: State matrix, shape (n, n), dimensionless.
        by_reference: Br, shape (n,), per SI of the output.
        by_output: By, shape (n,), per SI of the output.
        C: To the command, shape (n,), in SI of the command.
        reference_gain: Dr, in SI of the command per SI of the output.
        output_gain: Dy, in SI of the command per SI of the output.
        back: L, shape (n,), per SI of the command.
        at_rest: States at rest per deviation of the output, shape (n,), per SI of the output.
    """

    A: Rows
    by_reference: tuple[float, ...]
    by_output: tuple[float, ...]
    C: tuple[float, ...]
    reference_gain: float
    output_gain: float
    back: tuple[float, ...]
    at_rest: tuple[float, ...]

    def behind_lags(self, speed: float) -> TransferLaw:
        """Return the law with its reference behind two lags of a speed, in rad/s."""
        fresh, n = min(speed * self.sample_time, 1.0), len(self.A)
        A = np.zeros((n + 2, n + 2))
        A[:n, :n], A[:n, n + 1] = self.A, self.by_reference
        A[n:, n:] = [[1.0 - fresh, 0.0], [fresh, 1.0 - fresh]]
        return replace(
            self,
            A=rows(A),
            by_reference=(0.0,) * n + (fresh, 0.0),
            by_output=(*self.by_output, 0.0, 0.0),
            C=(*self.C, 0.0, self.reference_gain),
            reference_gain=0.0,
            back=(*self.back, 0.0, 0.0),
            at_rest=(*self.at_rest, 1.0, 1.0),
        )

    def initial_state(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> Numbers:
        """Return the state of a loop at rest where it is measured."""
        return tuple(gain * (measurement[0] - self.rest_output) for gain in self.at_rest)

    def law(
        self, state: Numbers, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, Any, Told]:
        y, r = measurement[0] - self.rest_output, reference[0] - self.rest_output
        start = self.rest + self.reference_gain * r - self.output_gain * y
        asked = total(start, self.C, state)
        command = arithmetic.clip(asked, self.lower, self.upper)
        missing = command - asked
        following = tuple(
            total(b * r - c * y + gain * missing, row, state)
            for row, b, c, gain in zip(
                self.A, self.by_reference, self.by_output, self.back, strict=True
            )
        )
        return (command,), following, {"asked": asked}


def pid_by_hand(
    proportional: float,
    integral: float = 0.0,
    derivative: float = 0.0,
    *,
    measured: str,
    actuator: str,
    filter_time: float = 0.0,
    setpoint_weight: float = 1.0,
    derivative_weight: float = 0.0,
    tracking_time: float | None = None,
    rest: float = 0.0,
    rest_output: float = 0.0,
    lower: float = -math.inf,
    upper: float = math.inf,
    sample_time: float = 0.002,
    name: str = "PID",
) -> TransferLaw:
    """Return a textbook P, PI, PD or PID with gains given by hand.

    Args:
        proportional: Kp, in SI of the command per SI of the output.
        integral: Ki, in SI of the command per SI of the output and s.
        derivative: Kd, in SI of the command per SI of the output, times s.
        filter_time: Time constant Tf of the derivative's filter, in s.
        setpoint_weight: Weight beta of the reference in the proportional part, dimensionless.
        derivative_weight: Weight c of the reference in the derivative part, dimensionless.
        tracking_time: Time constant Tt of the anti-windup, in s; Kp / Ki by default.

    Example:
        >>> pi = pid_by_hand(2.0, 10.0, measured="speed", actuator="voltage", upper=24.0)
        >>> pi.step(pi.initial_state((0.0,)), (0.0,), (3.0,))[0]
        (6.0,)
    """
    h = check_range("sample time", sample_time, *TIMES_S, "s")
    check_range("filter time", filter_time, 0.0, TIMES_S[1], "s")
    fade = filter_time / (filter_time + h)
    slope = derivative / (filter_time + h)
    if tracking_time is None:
        tracking_time = proportional / integral if proportional and integral else 50.0 * h
    tracking = max(check_range("tracking time", abs(tracking_time), 0.0, TIMES_S[1], "s"), 2.0 * h)
    return TransferLaw(
        A=((1.0, 0.0), (0.0, fade)),
        by_reference=(h * integral, (1.0 - fade) * derivative_weight),
        by_output=(h * integral, 1.0 - fade),
        C=(1.0, -slope),
        reference_gain=setpoint_weight * proportional + derivative_weight * slope,
        output_gain=proportional + slope,
        back=(h / tracking if integral else 0.0, 0.0),
        # With the reference at the output, the command starts from rest.
        at_rest=((1.0 - setpoint_weight) * proportional, derivative_weight - 1.0),
        rest_output=rest_output,
        sensors=(measured,),
        controlled=(measured,),
        actuators=(actuator,),
        rest=rest,
        lower=lower,
        upper=upper,
        sample_time=h,
        name=name,
    )


def transfer_controller(
    system: Any,
    *,
    measured: str,
    actuator: str,
    tracking_time: float | None = None,
    rest: float = 0.0,
    rest_output: float = 0.0,
    lower: float = -math.inf,
    upper: float = math.inf,
    sample_time: float = 0.002,
    name: str = "transfer function",
) -> TransferLaw:
    """Return a controller from error to command that is a python-control system.

    Args:
        system: ``control.TransferFunction`` or ``control.StateSpace`` with one input, the error,
            and one output, the command; proper. In continuous time it is sampled by Tustin's rule.
        tracking_time: Time constant Tt of the anti-windup, in s; 50 samples by default.

    Raises:
        WorkbenchError: If it has several inputs or outputs, or another sample time.

    Example:
        >>> import control
        >>> lead = control.tf([10.0, 20.0], [0.01, 1.0])
        >>> law = transfer_controller(lead, measured="angle", actuator="voltage")
        >>> len(law.A)
        1
    """
    import control as ct

    h = check_range("sample time", sample_time, *TIMES_S, "s")
    if system.ninputs != 1 or system.noutputs != 1:
        raise WorkbenchError(
            f"the controller has {system.ninputs} inputs and {system.noutputs} outputs; give one"
            " from the error to the command"
        )
    own = system.dt if system.isdtime(strict=True) and system.dt is not True else h
    if not math.isclose(own, h, rel_tol=1e-6):
        raise WorkbenchError(
            f"the controller has a sample time of {system.dt:g} s and shall step every {h:g} s;"
            " give sample_time, or the controller in continuous time"
        )
    sampled = ct.ss(system)
    if not system.isdtime(strict=True):
        sampled = ct.c2d(sampled, h, "bilinear")
    A, B, C, D = (np.asarray(m, dtype=float) for m in (sampled.A, sampled.B, sampled.C, sampled.D))
    if not len(A):
        # A gain: one state that nothing enters keeps the form of the law.
        A, B, C = np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1))
    b = tuple(B[:, 0].tolist())
    return TransferLaw(
        A=rows(A),
        by_reference=b,
        by_output=b,
        C=tuple(C[0].tolist()),
        reference_gain=float(D[0, 0]),
        output_gain=float(D[0, 0]),
        back=anti_windup(A, C, math.exp(-h / (tracking_time or 50.0 * h))),
        at_rest=(0.0,) * len(A),
        rest_output=rest_output,
        sensors=(measured,),
        controlled=(measured,),
        actuators=(actuator,),
        rest=rest,
        lower=lower,
        upper=upper,
        sample_time=h,
        name=name,
    )


ZEROS = (0.4, 1.0, 2.5, 6.0, 15.0)
"""Times of the integral that are tried, in time constants of the crossover."""

PHASE_MARGINS = (1.15, 0.95, 0.75, 0.55)
"""Phase margins that are tried, in rad."""

STEPS = (2.0, 1.5, 1.5, 1.5, 1.3, 1.3, 1.3, 1.15, 1.15, 1.15, 1.07, 1.07)
"""Factors by which each gain is changed, as long as that is better."""

WEIGHTS = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)
"""Weights of the reference that are tried, dimensionless."""


@dataclass(frozen=True)
class PlainPIDSpecification(LoopSpecification):
    """What a PID for any linear model is designed for.

    Args:
        bandwidth: Largest crossover frequency, in rad/s; by default (0) a tenth of the sampling's.
        error_scale: Smallest error for which all of the command may be used, in SI of the output;
            by default (0) noise alone limits the gain.
    """

    bandwidth: float = 0.0
    error_scale: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("bandwidth", self.bandwidth, 0.0, 1.0 / self.sample_time, "rad/s")
        check_range("error scale", self.error_scale, 0.0, 1e30)


def design_plain_pid(
    linear: LinearModel, specification: PlainPIDSpecification | None = None
) -> TransferLaw:
    """Design a PID between one command and one output of any linear model.

    At a crossover frequency w, a zero at a share of w integrates, a lead network gives the phase
    that is missing to a phase margin, and the gain is what is left. Of all w, shares and margins it
    is the best by `controllers.plain.limits`, the reference weighted by what lets a step overshoot
    no further than it may; its four gains are then changed one by one as long as that helps.

    Raises:
        WorkbenchError: If no such loop is stable, or a limit that was given is not held.

    Source:
        Loop shaping with lag and lead: Åström and Murray, Feedback Systems, 2008, section 11.4.
    """
    want = specification or PlainPIDSpecification()
    loop = want.loop(linear)
    own, h = loop.linear, want.sample_time
    largest = loop.command_scale / want.error_scale if want.error_scale else math.inf
    top = want.bandwidth or 0.1 * 2.0 * math.pi / h
    tried = np.geomspace(top, 1e-5 * top, 70)
    response = transfer_function(own.A, own.B, own.C, own.D, 1j * tried)[:, 0, 0]
    response = response * np.exp(-1j * tried * (0.5 * h + want.delay))
    limits = LoopLimits(loop, want)

    def made(gains: Gains) -> TransferLaw:
        kp, ki, kd, filter_time = gains
        own: dict[str, Any] = {"filter_time": filter_time, "tracking_time": abs(kp / ki)}
        return pid_by_hand(kp, ki, kd, sample_time=h, **own, **loop.ends)

    tries = [
        (gains, limits.judge(_around_rest(made(gains))))
        for w, plant in zip(tried.tolist(), response.tolist(), strict=True)
        for zero, margin in itertools.product(ZEROS, PHASE_MARGINS)
        for gains in _at_crossover(w, plant, zero / w, margin)
        if abs(made(gains).output_gain) <= largest
    ]
    found = [
        (gains, judged, *_weighed(limits, made(gains)))
        for gains, judged in limits.held(tries, "a PID")
    ]
    among = Among.of([(judged, reached) for _, judged, _, reached in found], want.overshoot)
    gains, judged, law, reached = min(found, key=lambda one: among.cost(one[1], one[3]))
    least = among.cost(judged, reached)
    for step in STEPS:
        for k, factor in itertools.product(range(4), (step, 1.0 / step)):
            changed = gains._replace(**{Gains._fields[k]: gains[k] * factor})
            other = made(changed)
            judged = limits.judge(_around_rest(other))
            if judged.excess > among.excess or abs(other.output_gain) > largest:
                continue
            other, reached = _weighed(limits, other)
            if (cost := among.cost(judged, reached)) < least:
                gains, law, least = changed, other, cost
    return law


class Gains(NamedTuple):
    """Kp, Ki, Kd and Tf of a PID, in SI."""

    proportional: float
    integral: float
    derivative: float
    filter_time: float


def _around_rest(law: TransferLaw) -> LinearLaw:
    """Return a PID from measurement, reference beside its weight, and reference by its weight."""
    kp, h_ki = law.reference_gain, law.by_reference[0]
    G = np.array([[-law.by_output[0], h_ki, 0.0], [-law.by_output[1], 0.0, 0.0]])
    return LinearLaw(np.array(law.A), G, np.array([law.C]), np.array([[-law.output_gain, 0.0, kp]]))


def _weighed(limits: LoopLimits, law: TransferLaw) -> tuple[TransferLaw, Answer]:
    """Return a PID with the largest weight that lets a step overshoot no further than it may."""
    time, seen = limits.steps(_around_rest(law))
    steps = seen[:, [0]] + seen[:, [1]] * np.array(WEIGHTS)
    over = steps.max(axis=0) - 1.0
    allowed = limits.want.overshoot
    k = next((k for k, top in enumerate(over) if top <= allowed), len(WEIGHTS) - 1)
    kp, weight = law.reference_gain, WEIGHTS[k]
    own = replace(law, reference_gain=weight * kp, at_rest=((1.0 - weight) * kp, -1.0))
    return own, answer(time, np.column_stack([steps[:, k], seen[:, 2]]))


def _at_crossover(w: float, plant: complex, integrating: float, margin: float) -> Iterator[Gains]:
    """Yield PIDs, of either sign, that give the loop a phase margin at a frequency, or more."""
    missing = -math.pi + margin - math.atan2(plant.imag, plant.real)
    missing += math.atan(1.0 / (w * integrating))
    for sign in (1.0, -1.0):
        lift = math.remainder(missing if sign > 0.0 else missing + math.pi, 2.0 * math.pi)
        if not plant or lift > 1.4:
            continue
        lift = max(lift, 0.2)
        ratio = (1.0 + math.sin(lift)) / (1.0 - math.sin(lift))
        lead, fast = math.sqrt(ratio) / w, 1.0 / (w * math.sqrt(ratio))
        shape = (1.0 + 1.0 / (1j * w * integrating)) * (1.0 + 1j * w * lead) / (1.0 + 1j * w * fast)
        gain = sign / abs(plant * shape)
        # (1 + 1 / Ti s) (1 + Td s) / (1 + Tf s) as a sum of its three parts.
        kp = gain * (integrating + lead - fast) / integrating
        yield Gains(kp, gain / integrating, gain * lead - kp * fast, fast)


PLAIN_PID = Design(
    name="plain-pid",
    family="PID",
    summary="PID of one output by one command, for any linear model",
    function=design_plain_pid,
    specification=PlainPIDSpecification,
)
