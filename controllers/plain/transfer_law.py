"""Any transfer function as a controller, the textbook PID with gains by hand among them.

With r and y as deviations from rest, sample k, and the command u clipped to its ends:

    u[k]   = u0 + C z[k] + Dr r[k] - Dy y[k]
    z[k+1] = A z[k] + Br r[k] - By y[k] + L (u_clipped - u)[k]

r may follow what is asked at a limited pace. L moves a mode of A that integrates, or nearly does,
to the time constant Tt while the command is at its end (anti-windup in observer form). A PID has
the integral and the filtered derivative as z:

    u = u0 + Kp (beta r - y) + I + Kd (v - w) / (Tf + h)         v = c r - y
    I[k+1] = I[k] + h Ki (r - y) + (h / Tt) (u_clipped - u)
    w[k+1] = f w[k] + (1 - f) v                                  f = Tf / (Tf + h)

Units: SI.

Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, sections 8.5 (PID) and 9.4
(anti-windup); Åström and Hägglund, Advanced PID Control, 2006, section 13.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Told
from controllers.design import Design
from controllers.linear_law import LinearLaw
from controllers.plain.limits import Answer, LoopLimits, answer, cost
from controllers.plain.single_loop import LoopSpecification, PlainLaw
from controllers.sampling import Rows, anti_windup, rows, total, tustin
from workbench.arrays import Complex, Matrix, Vector
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
        y = measurement[0] - self.rest_output
        states = tuple(gain * y for gain in self.at_rest)
        return states if self.pace == math.inf else (*states, y)

    def law(
        self, state: Numbers, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, Any, Told]:
        y = measurement[0] - self.rest_output
        r = self.followed(state[-1], reference[0] - self.rest_output, arithmetic)
        kept = () if self.pace == math.inf else (r,)
        state = state[: len(self.A)]
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
        return (command,), following + kept, {"asked": asked}


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
    found = ct.ss(system)
    A, B, C, D = (np.asarray(m, dtype=float) for m in (found.A, found.B, found.C, found.D))
    return sampled_controller(
        (A, B, C, D) if system.isdtime(strict=True) else tustin(A, B, C, D, h),
        {
            "measured": measured,
            "actuator": actuator,
            "rest": rest,
            "rest_output": rest_output,
            "lower": lower,
            "upper": upper,
        },
        tracking_time=tracking_time or 50.0 * h,
        sample_time=h,
        name=name,
    )


def sampled_controller(
    system: tuple[Matrix, ...],
    ends: dict[str, Any],
    *,
    tracking_time: float,
    sample_time: float,
    name: str,
) -> TransferLaw:
    """Return a controller from error to command given by sampled matrices A, B, C and D, in SI.

    Args:
        ends: As `SingleLoop.ends`, in SI.
        tracking_time: Time constant Tt of the anti-windup, in s.
    """
    of_loop = dict(ends)
    measured, actuator = of_loop.pop("measured"), of_loop.pop("actuator")
    A, B, C, D = system
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
        back=anti_windup(A, C, math.exp(-sample_time / tracking_time)),
        at_rest=(0.0,) * len(A),
        sensors=(measured,),
        controlled=(measured,),
        actuators=(actuator,),
        sample_time=sample_time,
        name=name,
        **of_loop,
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

    tries = _at_crossover(tried, response)
    tries = tries[np.abs(tries[:, 0] + tries[:, 2] / (tries[:, 3] + h)) <= largest]
    judged = limits.judge(_around_rest(tries, h))
    held = limits.held(judged, "a PID")
    top = max(1.0, float(judged.excess[held].max()))
    weights, found = _weighed(limits, tries[held])
    least = found.errors.min(axis=0)
    errors = cost(found, least, want.overshoot)
    k = int(np.argmin(errors))
    gains, weight, error = tries[held][k], weights[k], errors[k]
    for step in STEPS:
        changes = np.kron(np.eye(4), [[step], [1.0 / step]])
        changes[changes == 0.0] = 1.0
        while len(changes):
            tries = gains * changes
            may = np.abs(tries[:, 0] + tries[:, 2] / (tries[:, 3] + h)) <= largest
            may &= limits.judge(_around_rest(tries, h)).excess <= top
            weights, found = _weighed(limits, tries[may])
            errors = cost(found, least, want.overshoot)
            better = np.flatnonzero(errors < error)
            if not len(better):
                break
            k = better[0]
            gains, weight, error = tries[may][k], weights[k], errors[k]
            changes = changes[np.flatnonzero(may)[k] + 1 :]
    kp, ki, kd, filter_time = gains.tolist()
    law = pid_by_hand(
        kp,
        ki,
        kd,
        filter_time=filter_time,
        setpoint_weight=float(weight),
        tracking_time=abs(kp / ki),
        sample_time=h,
        **loop.ends,
    )
    return limits.at_pace(law)


def _around_rest(gains: Matrix, sample_time: float) -> LinearLaw:
    """Return PIDs of Kp, Ki, Kd and Tf, shape (n, 4), in SI.

    From measurement, reference beside its weight, and reference by its weight.
    """
    kp, ki, kd, filter_time = gains.T
    fade, slope = filter_time / (filter_time + sample_time), kd / (filter_time + sample_time)
    F, G = np.zeros((len(gains), 2, 2)), np.zeros((len(gains), 2, 3))
    H, J = np.ones((len(gains), 1, 2)), np.zeros((len(gains), 1, 3))
    F[:, 0, 0], F[:, 1, 1] = 1.0, fade
    G[:, 0, 0], G[:, 0, 1], G[:, 1, 0] = -sample_time * ki, sample_time * ki, fade - 1.0
    H[:, 0, 1], J[:, 0, 0], J[:, 0, 2] = -slope, -kp - slope, kp
    return LinearLaw(F, G, H, J)


def _weighed(limits: LoopLimits, gains: Matrix) -> tuple[Vector, Answer]:
    """Return the largest weights that let a step overshoot no further than it may, and answers."""
    time, seen, going = limits.steps(_around_rest(gains, limits.want.sample_time))
    steps = seen[:, :, [0]] + seen[:, :, [1]] * np.array(WEIGHTS)
    fits = np.max(steps * going[:, :, None], axis=1) - 1.0 <= limits.want.overshoot
    fits[:, -1] = True
    k = np.argmax(fits, axis=1)
    chosen = np.take_along_axis(steps, k[:, None, None], axis=2)
    return np.array(WEIGHTS)[k], answer(time, np.dstack([chosen, seen[:, :, 2:]]), going)


def _at_crossover(speeds: Vector, plant: Complex) -> Matrix:
    """Return PIDs, of either sign, that give the loop a phase margin at a speed, or more.

    Returns:
        Kp, Ki, Kd and Tf, shape (n, 4), in SI.
    """
    grid = np.meshgrid(np.arange(len(speeds)), ZEROS, PHASE_MARGINS, (1.0, -1.0), indexing="ij")
    which, zero, margin, sign = (part.ravel() for part in grid)
    w, P = speeds[which.astype(int)], plant[which.astype(int)]
    missing = margin - np.pi - np.angle(P) + np.arctan(1.0 / zero) + np.where(sign < 0.0, np.pi, 0)
    lift = missing - 2.0 * np.pi * np.round(missing / (2.0 * np.pi))
    may = (P != 0.0) & (lift <= 1.4)
    w, P, zero, sign, lift = w[may], P[may], zero[may], sign[may], np.maximum(lift[may], 0.2)
    integrating = zero / w
    ratio = np.sqrt((1.0 + np.sin(lift)) / (1.0 - np.sin(lift)))
    lead, fast = ratio / w, 1.0 / (w * ratio)
    shape = (1.0 - 1j / zero) * (1.0 + 1j * ratio) / (1.0 + 1j / ratio)
    gain = sign / np.abs(P * shape)
    # (1 + 1 / Ti s) (1 + Td s) / (1 + Tf s) as a sum of its three parts.
    kp = gain * (integrating + lead - fast) / integrating
    return np.column_stack([kp, gain / integrating, gain * lead - kp * fast, fast])


PLAIN_PID = Design(
    name="plain-pid",
    family="PID",
    summary="PID of one output by one command, for any linear model",
    function=design_plain_pid,
    specification=PlainPIDSpecification,
)
