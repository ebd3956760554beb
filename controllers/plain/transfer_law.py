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

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Told
from controllers.design import Design
from controllers.plain.single_loop import LoopSpecification, PlainLaw, SingleLoop
from controllers.sampling import Rows, anti_windup, rows, total
from controllers.sensitivity import peak_sensitivities
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


@dataclass(frozen=True)
class PlainPIDSpecification(LoopSpecification):
    """What a PID for any linear model is designed for.

    Args:
        bandwidth: Largest crossover frequency, in rad/s; by default a tenth of the sampling's.
        phase_margin: Phase margin aimed at, in rad.
        error_scale: Smallest error for which all of the command may be used, in SI of the output; a
            tenth of its scale by default (0).
        maximum_sensitivity: Limit on Ms, the peak of the sensitivity (ratio).
        maximum_complementary: Limit on Mt, the peak of the complementary sensitivity (ratio).
        delay: Delay beside that of sampling that the loop must have in its phase, in s.
    """

    bandwidth: float = 0.0
    phase_margin: float = 1.05
    error_scale: float = 0.0
    maximum_sensitivity: float = 1.8
    maximum_complementary: float = 1.6
    delay: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("bandwidth", self.bandwidth, 0.0, 1.0 / self.sample_time, "rad/s")
        check_range("phase margin", self.phase_margin, 0.2, 1.5, "rad")
        check_range("limit on Ms", self.maximum_sensitivity, 1.05, 10.0)
        check_range("limit on Mt", self.maximum_complementary, 1.0, 10.0)
        check_range("delay", self.delay, 0.0, TIMES_S[1], "s")


def design_plain_pid(
    linear: LinearModel, specification: PlainPIDSpecification | None = None
) -> TransferLaw:
    """Design a PID between one command and one output of any linear model.

    At a crossover frequency w, a zero at w / 4 integrates, a lead network gives the phase that is
    missing, and the gain is what is left; w is lowered from ``bandwidth`` until Ms and Mt of the
    sampled loop are within their limits and the gain within the command's.

    Raises:
        WorkbenchError: If no crossover frequency meets the limits.

    Source:
        Loop shaping with lag and lead: Åström and Murray, Feedback Systems, 2008, section 11.4.
    """
    want = specification or PlainPIDSpecification()
    loop = want.loop(linear)
    own, h = loop.linear, want.sample_time
    fastest = want.bandwidth or 0.1 * 2.0 * math.pi / h
    error = want.error_scale or 0.1 * loop.output_scale
    largest = loop.command_scale / error
    tried = np.geomspace(fastest, 1e-4 * fastest, 120)
    response = transfer_function(own.A, own.B, own.C, own.D, 1j * tried)[:, 0, 0]
    response = response * np.exp(-1j * tried * (0.5 * h + want.delay))
    pairs = zip(tried.tolist(), response.tolist(), strict=True)
    found = [_at_crossover(loop, want, w, plant) for w, plant in pairs]
    laws = [law for law in found if law is not None]
    for law in (law for law in laws if abs(law.output_gain) <= 4.0 * largest):
        ms, mt = peak_sensitivities(law, loop.linear)
        if ms <= want.maximum_sensitivity and mt <= want.maximum_complementary:
            return law
    if not any(math.isfinite(peak_sensitivities(law, loop.linear)[0]) for law in laws):
        raise WorkbenchError(
            f"a PID makes no stable loop of {loop.measured} by {loop.actuator} at any crossover"
            f" from {tried[-1]:.3g} to {tried[0]:.3g} rad/s; take a state feedback, such as lqi"
        )
    raise WorkbenchError(
        f"no crossover from {tried[-1]:.3g} to {tried[0]:.3g} rad/s gives {loop.measured} a PID"
        f" with Ms <= {want.maximum_sensitivity:g} and Mt <= {want.maximum_complementary:g}; allow"
        f" larger peaks or a smaller error_scale than {error:.3g} (left out, a tenth of the scale"
        f" of {loop.measured}, which is {loop.output_scale:g}), or take a state feedback"
    )


def _at_crossover(
    loop: SingleLoop, want: PlainPIDSpecification, w: float, plant: complex
) -> TransferLaw | None:
    """Return the PID that gives the loop its phase margin at a frequency, or None."""
    if not plant:
        return None
    integrating = 4.0 / w
    # Up to the sign of the plant, the phase of the controller lies between lag and lead.
    missing = -math.pi + want.phase_margin - math.atan2(plant.imag, plant.real)
    missing += math.atan(1.0 / (w * integrating))
    missing = math.remainder(missing, 2.0 * math.pi)
    sign = 1.0
    if not -1.8 <= missing <= 1.2:
        missing, sign = math.remainder(missing + math.pi, 2.0 * math.pi), -1.0
        if not -1.8 <= missing <= 1.2:
            return None
    if missing < -0.6:
        # A plant that hardly lags there: the integral is what lags.
        integrating = 1.0 / (w * math.tan(min(math.atan(0.25) - missing, 1.5)))
    lead = fast = 0.0
    if missing > 0.0:
        ratio = (1.0 + math.sin(missing)) / (1.0 - math.sin(missing))
        lead, fast = math.sqrt(ratio) / w, 1.0 / (w * math.sqrt(ratio))
    shape = (1.0 + 1.0 / (1j * w * integrating)) * (1.0 + 1j * w * lead) / (1.0 + 1j * w * fast)
    gain = sign / abs(plant * shape)
    # (1 + 1 / Ti s) (1 + Td s) / (1 + Tf s) as a sum of its three parts.
    kp = gain * (integrating + lead - fast) / integrating
    return pid_by_hand(
        kp,
        gain / integrating,
        gain * lead - kp * fast,
        filter_time=fast,
        setpoint_weight=0.6,
        tracking_time=integrating,
        sample_time=want.sample_time,
        **loop.ends,
    )


PLAIN_PID = Design(
    name="plain-pid",
    family="PID",
    summary="PID of one output by one command, for any linear model",
    function=design_plain_pid,
    specification=PlainPIDSpecification,
)
