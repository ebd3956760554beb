"""Any transfer function as a controller, the textbook PID with gains by hand among them.

With r and y as deviations from rest, sample k, and the commands u clipped to their ends:

    u[k]   = u0 + C z[k] + Dr r[k] - Dy y[k]
    z[k+1] = A z[k] + Br r[k] - By y[k] + L (u_clipped - u)[k]

r may follow what is asked at a limited pace. L moves modes of A that integrate, or nearly do, to
the time constant Tt while a command is at its end (anti-windup in observer form). A PID has the
integral and the filtered derivative as z:

    u = u0 + Kp (beta r - y) + I + Kd (v - w) / (Tf + h)         v = c r - y
    I[k+1] = I[k] + h Ki (r - y) + (h / Tt) (u_clipped - u)
    w[k+1] = f w[k] + (1 - f) v                                  f = Tf / (Tf + h)

Units: SI.

Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, sections 8.5 (PID) and 9.4
(anti-windup); Åström and Hägglund, Advanced PID Control, 2006, section 13.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controllers.anti_windup import anti_windup
from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Rows, Told, product, rows
from controllers.linear_law import LinearLaw
from controllers.plain.loop import named
from controllers.plain.plain_law import PlainLaw
from workbench.arrays import Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_range
from workbench.model.linear_system import proper_system

Each = float | Sequence[float]


@dataclass(frozen=True, kw_only=True, repr=False)
class TransferLaw(PlainLaw):
    """A sampled linear controller with two degrees of freedom, and anti-windup.

    All is in SI, with n states, m commands, p outputs that are followed, and s that are measured,
    those first.

    Args:
        A: State matrix, shape (n, n), dimensionless.
        by_reference: Br, shape (n, p).
        by_output: By, shape (n, s).
        C: To the commands, shape (m, n).
        reference_gain: Dr, shape (m, p).
        output_gain: Dy, shape (m, s).
        back: L, shape (n, m).
        at_rest: States at rest per deviation of the followed outputs, shape (n, p).
    """

    A: Rows
    by_reference: Rows
    by_output: Rows
    C: Rows
    reference_gain: Rows
    output_gain: Rows
    back: Rows
    at_rest: Rows

    def behind_lags(self, speed: Sequence[float]) -> TransferLaw:
        """Return the law with each reference behind two lags of a speed, in rad/s."""
        n, p = len(self.A), len(self.controlled)
        fresh = np.diag(np.minimum(np.array(speed) * self.sample_time, 1.0))
        A, one, k = np.zeros((n + 2 * p, n + 2 * p)), np.eye(p), n + p
        A[:n, :n], A[:n, k:] = self.A, self.by_reference
        A[n:k, n:k], A[k:, n:k], A[k:, k:] = one - fresh, fresh, one - fresh
        none = np.zeros((2 * p, len(self.sensors)))
        return replace(
            self,
            A=rows(A),
            by_reference=rows(np.vstack([np.zeros((n, p)), fresh, np.zeros((p, p))])),
            by_output=rows(np.vstack([self.by_output, none])),
            C=rows(np.hstack([self.C, np.zeros((len(self.C), p)), self.reference_gain])),
            reference_gain=rows(np.zeros_like(self.reference_gain)),
            back=rows(np.vstack([self.back, np.zeros((2 * p, len(self.C)))])),
            at_rest=rows(np.vstack([self.at_rest, one, one])),
        )

    def referred(self, by_reference: Matrix, reference_gain: Matrix) -> TransferLaw:
        """Return the law with other entries of the references, of shapes (n, p) and (m, p), in SI.

        The outputs must arrive at the references with them.
        """
        p = len(self.controlled)
        entry = by_reference - np.array(self.by_output)[:, :p]
        gain = reference_gain - np.array(self.output_gain)[:, :p]
        # At rest where it is asked to be, the states stay and the commands are those of rest.
        table = np.vstack([np.eye(len(self.A)) - np.array(self.A), self.C])
        at_rest = np.linalg.lstsq(table, np.vstack([entry, -gain]), rcond=None)[0]
        return replace(
            self,
            by_reference=rows(by_reference),
            reference_gain=rows(reference_gain),
            at_rest=rows(at_rest),
        )

    def conditioned(self) -> TransferLaw:
        """Return the law whose states move as with references that ask for no more than there is.

        Where commands end, that is by L = Br Dr^-1.

        Source: Hanus, Kinnaert and Henrotte, Conditioning technique, a general anti-windup and
        bumpless transfer method, Automatica 23, 1987.
        """
        gain = np.array(self.reference_gain)
        # Each command and each output has a unit of its own.
        into = np.maximum(np.abs(gain).max(axis=1, keepdims=True), 1e-300)
        out = np.maximum(np.abs(gain / into).max(axis=0), 1e-300)
        inverse = np.linalg.pinv(gain / into / out, rcond=1e-6) / out[:, None] / into.T
        return replace(self, back=rows(np.array(self.by_reference) @ inverse))

    def initial_state(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> TransferState:
        y = self.deviations(measurement)[: len(self.controlled)]
        return TransferState(product(self.at_rest, y), self.resting(y), self.kept(None, self.rest))

    def law(
        self, state: TransferState, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, TransferState, Told]:
        y = self.deviations(measurement)
        r, paced = self.followed(state.paced, reference, arithmetic)
        asked = product(self.reference_gain, r, self.rest)
        # The same matrix of both sees their difference, as it does at rest.
        seen = product(self.output_gain, y)
        asked = tuple(u - v for u, v in zip(asked, seen, strict=True))
        asked = product(self.C, state.states, asked)
        command = self.applied(state.commands, asked, arithmetic)
        missing = tuple(u - v for u, v in zip(command, asked, strict=True))
        entering = product(self.back, missing, product(self.by_reference, r))
        left = product(self.by_output, y)
        entering = tuple(a - b for a, b in zip(entering, left, strict=True))
        states = product(self.A, state.states, entering)
        sent = self.sent(state.commands, command, arithmetic)
        kept = self.kept(state.commands, command)
        return sent, TransferState(states, paced, kept), self.told(asked)

    def around_rest(self) -> LinearLaw:
        entry = np.hstack([-np.array(self.by_output), self.by_reference])
        direct = np.hstack([-np.array(self.output_gain), self.reference_gain])
        return LinearLaw(np.array(self.A), entry, np.array(self.C), direct)


class TransferState(NamedTuple):
    """What a `TransferLaw` remembers.

    Args:
        paced: References at their pace, deviations in SI, and by how much they moved in the last
            sample; None without a pace.
        commands: Commands, in SI; None without a slew.
    """

    states: Numbers
    paced: Numbers | None = None
    commands: Numbers | None = None


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
    gains = np.array([[proportional, integral, derivative, filter_time]])
    ends = ends_of((measured,), (actuator,), rest, rest_output, lower, upper)
    return pids(
        gains,
        np.eye(1),
        np.array([setpoint_weight]),
        ends,
        derivative_weight=derivative_weight,
        tracking_time=tracking_time,
        sample_time=sample_time,
        name=name,
    )


def pids(
    gains: Matrix,
    mix: Matrix,
    weight: Vector,
    ends: dict[str, Any],
    *,
    derivative_weight: float = 0.0,
    tracking_time: float | None = None,
    sample_time: float,
    name: str = "PID",
) -> TransferLaw:
    """Return PIDs of Kp, Ki, Kd and Tf, one for each measurement, whose sums are the commands.

    Args:
        gains: Shape (p, 4), in SI.
        mix: What each PID adds to the commands, shape (m, p), in SI of the commands over that of
            the PID.
        weight: Weights of the references in the proportional parts, dimensionless, one for each
            followed output.
    """
    h, p = check_range("sample time", sample_time, *TIMES_S, "s"), len(gains)
    followed = len(weight)
    # What is measured and not followed has a reference of 0.
    weight = np.append(weight, np.zeros(p - followed))
    kp, ki, kd, filter_time = gains.T
    for value in filter_time:
        check_range("filter time", float(value), 0.0, TIMES_S[1], "s")
    fade, slope = filter_time / (filter_time + h), kd / (filter_time + h)
    A, one = np.zeros((2 * p, 2 * p)), np.eye(p)
    A[:followed, :followed], A[p:, p:] = np.eye(followed), np.diag(fade)
    with np.errstate(divide="ignore", invalid="ignore"):
        usual = np.where((kp != 0.0) & (ki != 0.0), np.abs(kp / ki), 50.0 * h)
    tracking = usual if tracking_time is None else np.full(p, tracking_time)
    for value in tracking:
        check_range("tracking time", abs(float(value)), 0.0, TIMES_S[1], "s")
    back = np.where(ki != 0.0, h / np.maximum(np.abs(tracking), 2.0 * h), 0.0)
    # With the references at the outputs, the commands start from rest.
    at_rest = np.vstack([np.diag((1.0 - weight) * kp), (derivative_weight - 1.0) * one])
    by_reference = np.vstack([np.diag(h * ki), np.diag((1.0 - fade) * derivative_weight)])
    missing = np.zeros((p, len(mix)))
    missing[:followed] = np.linalg.pinv(mix[:, :followed])
    return TransferLaw(
        A=rows(A),
        by_reference=rows(by_reference[:, :followed]),
        by_output=rows(np.vstack([np.diag(h * ki), np.diag(1.0 - fade)])),
        C=rows(mix @ np.hstack([one, -np.diag(slope)])),
        reference_gain=rows((mix @ np.diag(weight * kp + derivative_weight * slope))[:, :followed]),
        output_gain=rows(mix @ np.diag(kp + slope)),
        back=rows(np.vstack([back[:, None] * missing, np.zeros((p, len(mix)))])),
        at_rest=rows(at_rest[:, :followed]),
        sample_time=h,
        name=name,
        **ends,
    )


def transfer_controller(
    system: Any,
    *,
    measured: str | Sequence[str],
    actuator: str | Sequence[str],
    tracking_time: float | None = None,
    rest: Each = 0.0,
    rest_output: Each = 0.0,
    lower: Each = -math.inf,
    upper: Each = math.inf,
    sample_time: float = 0.002,
    name: str = "transfer function",
) -> TransferLaw:
    """Return a controller from errors to commands that is a python-control system.

    Args:
        system: ``control.TransferFunction`` or ``control.StateSpace``, or one of ``scipy.signal``,
            with an input for each error and an output for each command; proper. In continuous time
            it is sampled by Tustin's rule.
        measured: Name of the output, or several with commas between or in a list.
        actuator: Name of the command, or several.
        tracking_time: Time constant Tt of the anti-windup, in s; 50 samples by default.

    Raises:
        WorkbenchError: If it has more or fewer inputs or outputs, or another sample time.

    Example:
        >>> import control
        >>> lead = control.tf([10.0, 20.0], [0.01, 1.0])
        >>> law = transfer_controller(lead, measured="angle", actuator="voltage")
        >>> len(law.A)
        1
    """
    from scipy.signal import cont2discrete

    h = check_range("sample time", sample_time, *TIMES_S, "s")
    read, commanded = named(measured), named(actuator)
    system = proper_system(system, "the controller")
    if (system.ninputs, system.noutputs) != (len(read), len(commanded)):
        raise WorkbenchError(
            f"the controller has {system.ninputs} inputs and {system.noutputs} outputs; give one"
            f" from the errors of {', '.join(read)} to {', '.join(commanded)}"
        )
    own = system.dt if system.isdtime(strict=True) and system.dt is not True else h
    if not math.isclose(own, h, rel_tol=1e-6):
        raise WorkbenchError(
            f"the controller has a sample time of {system.dt:g} s and shall step every {h:g} s;"
            " give sample_time, or the controller in continuous time"
        )
    matrices = tuple(np.asarray(m, dtype=float) for m in (system.A, system.B, system.C, system.D))
    if not system.isdtime(strict=True):
        matrices = cont2discrete(matrices, h, "bilinear")[:4]
    return sampled_controller(
        matrices,
        ends_of(read, commanded, rest, rest_output, lower, upper),
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
    """Return a controller from errors to commands given by sampled matrices A, B, C and D, in SI.

    What is measured and not followed has a reference of 0.

    Args:
        ends: As `Loop.ends`, in SI.
        tracking_time: Time constant Tt of the anti-windup, in s.
    """
    A, B, C, D = system
    if not len(A):
        # A gain: one state that nothing enters keeps the form of the law.
        A, B, C = np.zeros((1, 1)), np.zeros((1, D.shape[1])), np.zeros((len(D), 1))
    p = len(ends["controlled"])
    return TransferLaw(
        A=rows(A),
        by_reference=rows(B[:, :p]),
        by_output=rows(B),
        C=rows(C),
        reference_gain=rows(D[:, :p]),
        output_gain=rows(D),
        back=rows(anti_windup(A, C, math.exp(-sample_time / tracking_time))),
        at_rest=rows(np.zeros((len(A), p))),
        sample_time=sample_time,
        name=name,
        **ends,
    )


def ends_of(
    measured: Sequence[str],
    actuators: Sequence[str],
    rest: Each,
    rest_output: Each,
    lower: Each,
    upper: Each,
) -> dict[str, Any]:
    """Return what a `PlainLaw` is told, as `Loop.ends`, of numbers for all or for each."""
    given = (rest, actuators), (rest_output, measured), (lower, actuators), (upper, actuators)
    numbers = [np.broadcast_to(np.asarray(each, dtype=float), len(of)) for each, of in given]
    told = dict(zip(("rest", "rest_output", "lower", "upper"), numbers, strict=True))
    names = {"sensors": measured, "controlled": measured, "actuators": actuators}
    return {key: tuple(each) for key, each in names.items()} | {
        key: tuple(each.tolist()) for key, each in told.items()
    }
