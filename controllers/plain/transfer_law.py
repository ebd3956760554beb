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

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Told
from controllers.design import Design
from controllers.linear_law import LinearLaw
from controllers.plain.limits import (
    Answer,
    Judged,
    LoopLimits,
    ReadingSpecification,
    answer,
    cost,
    much_better,
)
from controllers.plain.loop import Loop, PlainLaw, loop_of, named
from controllers.plain.pairing import best_pairings, decoupled, paired
from controllers.sampling import Rows, anti_windup, product, rows, tustin
from controllers.specification import number
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.transfer import transfer_function
from workbench.model.linear_system import proper_system


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
        by_output, by_reference, Dy, Dr = (
            np.array(part)
            for part in (self.by_output, self.by_reference, self.output_gain, self.reference_gain)
        )
        entry, direct = np.hstack([-by_output, by_reference]), np.hstack([-Dy, Dr])
        return LinearLaw(np.array(self.A), entry, np.array(self.C), direct)


class TransferState(NamedTuple):
    """What a `TransferLaw` remembers.

    Args:
        states: States z, in SI.
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
    ends = _ends((measured,), (actuator,), rest, rest_output, lower, upper)
    return _pids(
        gains,
        np.eye(1),
        np.array([setpoint_weight]),
        ends,
        derivative_weight=derivative_weight,
        tracking_time=tracking_time,
        sample_time=sample_time,
        name=name,
    )


def _ends(
    measured: Sequence[str],
    actuators: Sequence[str],
    rest: Sequence[float] | float,
    rest_output: Sequence[float] | float,
    lower: Sequence[float] | float,
    upper: Sequence[float] | float,
) -> dict[str, Any]:
    """Return what a `PlainLaw` is told, as `Loop.ends`, of numbers for all or for each."""

    def each(value: Sequence[float] | float, names: Sequence[str]) -> tuple[float, ...]:
        return tuple(np.broadcast_to(np.asarray(value, dtype=float), len(names)).tolist())

    return {
        "sensors": tuple(measured),
        "controlled": tuple(measured),
        "actuators": tuple(actuators),
        "rest": each(rest, actuators),
        "rest_output": each(rest_output, measured),
        "lower": each(lower, actuators),
        "upper": each(upper, actuators),
    }


def _pids(
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
    rest: float | Sequence[float] = 0.0,
    rest_output: float | Sequence[float] = 0.0,
    lower: float | Sequence[float] = -math.inf,
    upper: float | Sequence[float] = math.inf,
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
    A, B, C, D = (np.asarray(m, dtype=float) for m in (system.A, system.B, system.C, system.D))
    return sampled_controller(
        (A, B, C, D) if system.isdtime(strict=True) else tustin(A, B, C, D, h),
        _ends(read, commanded, rest, rest_output, lower, upper),
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


ZEROS = (0.03, 0.15, 0.4, 1.0, 2.5, 6.0, 15.0)
"""Times of the integral that are tried, in time constants of the crossover."""

PHASE_MARGINS = (1.15, 0.95, 0.75, 0.55)
"""Phase margins that are tried, in rad."""

NEARLY_INTEGRALS = (0.03, 0.15)
"""Those among them that leave little but the integral, for a resonance; every third speed is tried
with them."""

LIFT = 1.4
"""Largest phase that a lead network gives, in rad."""

STEPS = (2.0, 1.5, 1.5, 1.5, 1.3, 1.3, 1.3, 1.15, 1.15, 1.15, 1.07, 1.07)
"""Factors by which each gain is changed, as long as that is better."""

WEIGHTS = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)
"""Weights of the reference that are tried, dimensionless."""


SLOWER = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05, 0.03, 0.02, 0.01)
"""Crossovers that are tried of several loops at once, over those of each alone."""


MUCH_BETTER, HOPELESS = 1.5, 20.0
"""What errors of PIDs that each act on one command may be over those of mixed ones, a ratio; and
what those of either may be before their gains are changed."""


SLOWEST = 0.03
"""Slowest crossover of a single loop that is tried, over that of the fastest within the limits."""


AT_ONCE, ALONE_AT_ONCE = 24, 256
"""PIDs of several loops, and of one, that are judged together."""


INNER_EVERY, OUTER = 4, (2, 6, 10, 15, 20)
"""Of the crossovers that are tried, every how many an inner loop is tried at; and how many places
slower the loop around it."""


TAKEN = (1.0, 0.75)
"""Shares of the limits that each of several loops alone may take."""


MOST_PIDS = 130
"""Most choices of speeds of several loops that are tried."""


@dataclass(frozen=True)
class PlainPIDSpecification(ReadingSpecification):
    """What a PID for any linear model is designed for.

    Args:
        bandwidth: Largest crossover frequency, in rad/s; by default (0) a tenth of the sampling's.
        error_scale: Smallest error for which all of the command may be used, in SI of the output;
            by default (0) noise alone limits the gain.
        decoupled: Whether the commands of several loops are mixed so that at rest, or at the speed
            of the loops, each moves its own output alone; by default where that makes a much
            better loop.
    """

    bandwidth: float = 0.0
    error_scale: float = number(0.0, 0.0, 1e30)
    decoupled: bool | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("bandwidth", self.bandwidth, 0.0, 1.0 / self.sample_time, "rad/s")


def design_plain_pid(
    linear: LinearModel, specification: PlainPIDSpecification | None = None
) -> TransferLaw:
    """Design a PID between commands and outputs of any linear model, one for each output.

    At a crossover frequency w, a zero at a share of w integrates, a lead network gives the phase
    that is missing to a phase margin, and the gain is what is left. Of all w, shares and margins it
    is the best by `controllers.plain.limits`, the reference weighted by what lets a step overshoot
    no further than it may; its four gains are then changed one by one as long as that helps.

    Several outputs are paired with commands (`controllers.plain.pairing`), or the commands mixed so
    that each PID moves its own output alone; of the best PIDs of each output alone, each at most so
    fast, those at the best share of their speeds are then changed gain by gain, in the loop of all.

    Raises:
        WorkbenchError: If no such loop is stable, no pairing can be, or a limit that was given is
            not held.

    Source:
        Loop shaping with lag and lead: Åström and Murray, Feedback Systems, 2008, section 11.4.
    """
    want = specification or PlainPIDSpecification()
    return want.designed(linear, partial(_within, linear, want), partial(_cascade_helps, want))


def _cascade_helps(want: PlainPIDSpecification, limits: LoopLimits, wider: LoopLimits) -> bool:
    """Tell whether a cascade within limits is much better than a PID of its output alone."""
    if limits.outputs > 1 or len(limits.loop.actuators) > 1:
        return False

    def answered(tried: LoopLimits) -> tuple[float, Answer]:
        best = _best([_tuned(tried, want, one) for one in _begun(tried, want)], want)
        return best.excess, best.answer

    return much_better(limits, wider, answered)


def _within(linear: LinearModel, want: PlainPIDSpecification, limits: LoopLimits) -> TransferLaw:
    loop, h, limits = limits.loop, want.sample_time, limits.late
    best = _best([_tuned(limits, want, one) for one in _begun(limits, want)], want)
    gains, mix, weight = best.gains, best.mix, best.weight
    moved, read = np.any(mix != 0.0, axis=1), np.any(gains[:, :3] != 0.0, axis=1)
    if not (moved.all() and read.all()):
        # What belongs to no output rests, and what nothing depends on is not read.
        taken = tuple(u for u, moves in zip(loop.actuators, moved, strict=True) if moves)
        also = tuple(y for y, used in zip(loop.sensors, read, strict=True) if used)
        loop = loop_of(linear, loop.measured, taken, also, want.sample_time)
        mix, gains = mix[moved][:, read], gains[read]
        limits = LoopLimits(loop, want).late
    cascade = "PID cascade" if len(gains) > limits.outputs else "PID"
    name = "decoupled PID" if best.mixed else cascade
    law = _pids(gains, mix, weight, loop.ends, sample_time=h, name=name)
    # What a command does slowly is no end: stopped by it, an integral is as slow.
    ended = [law.conditioned()] if np.isinf(loop.slew).all() else []
    return limits.best_at_pace([law, *ended])


class _PIDs(NamedTuple):
    """PIDs, one for each output.

    Args:
        mix: What each adds to the commands, shape (m, p), in SI of the commands over that of it.
        gains: Kp, Ki, Kd and Tf of each, shape (p, 4), in SI; of a cascade the outer one's first,
            with what is measured within, whose reference is the outer one's command.
        weight: Weights of the references, shape (p,), dimensionless.
        speed: Mean crossover of the best alone, in rad/s.
        excess: Largest ratio to a limit that a better one may have, 1 or more.
        least: Least errors of all that hold the limits, as of `Answer`.
        answer: What their loop answers.
    """

    mix: Matrix
    gains: Matrix
    weight: Vector
    speed: float
    excess: float
    least: Vector
    answer: Answer

    @property
    def mixed(self) -> bool:
        """Whether one of them acts on several commands."""
        return bool(np.any(np.count_nonzero(self.mix, axis=0) > 1))


def _badness(found: Sequence[_PIDs], want: PlainPIDSpecification) -> list[float]:
    """Return how bad PIDs are beside each other; those of several commands count as worse."""
    least = np.min([one.answer.errors[0] for one in found], axis=0)
    return [
        one.excess**4
        * float(cost(one.answer, least, want.overshoot)[0])
        * (MUCH_BETTER if one.mixed else 1.0)
        for one in found
    ]


def _best(found: Sequence[_PIDs], want: PlainPIDSpecification) -> _PIDs:
    return found[int(np.argmin(_badness(found, want)))]


def _begun(limits: LoopLimits, want: PlainPIDSpecification) -> list[_PIDs]:
    """Return PIDs to start from: the best of a command each, and the best of all commands."""
    loop = limits.loop
    if loop.read is not None:
        return [_cascade(limits, want)]
    if loop.linear.D.shape == (1, 1):
        return [_begun_by(limits, want, np.eye(1))]
    ways: list[Callable[[float], Matrix]] = []
    if not want.decoupled:
        ways.append(lambda w: paired(loop, best_pairings(loop, w)[-1]))
    if want.decoupled is not False:
        ways.append(partial(decoupled, loop))
    mixes: list[Matrix] = []
    found: list[_PIDs] = []
    refused: list[WorkbenchError] = []
    for at_speed in (False, True):
        speed = (found[0].speed if found else 0.01 / want.sample_time) if at_speed else 0.0
        for way in ways:
            try:
                mix = way(speed)
                if any(np.allclose(mix, known, rtol=0.02) for known in mixes):
                    continue
                mixes.append(mix)
                found.append(_begun_by(limits, want, mix))
            except WorkbenchError as error:
                refused.append(error)
    if not found:
        raise refused[0]
    kinds = [[one for one in found if one.mixed == mixed] for mixed in (False, True)]
    best = [_best(kind, want) for kind in kinds if kind]
    badness = _badness(best, want)
    return [one for one, bad in zip(best, badness, strict=True) if bad < HOPELESS * min(badness)]


def _tuned(limits: LoopLimits, want: PlainPIDSpecification, begun: _PIDs) -> _PIDs:
    """Return PIDs whose gains are changed as long as that makes the loop of all better."""
    loop, h, p, mix = limits.loop, want.sample_time, limits.outputs, begun.mix
    gains, weight, best, n = begun.gains, begun.weight, begun.answer, len(begun.gains)
    error = cost(best, begun.least, want.overshoot)[0]
    stuck = 0.0
    for step in STEPS:
        if step == stuck:
            continue
        stuck = step
        # Each gain, and all of a PID but its filter time together.
        which = np.vstack([np.eye(4 * n), np.kron(np.eye(n), [[1.0, 1.0, 1.0, 0.0]])])
        which = which[which @ np.abs(gains).ravel() > 0.0]
        changes = step ** np.kron(which, [[1.0], [-1.0]]).reshape(-1, n, 4)
        while len(changes):
            tries = gains * changes
            may = _small(tries, mix, loop, want) & limits.stable(_around_rest(tries, mix, h, p))
            weights, found = _weighed(limits, tries[may], mix)
            errors = cost(found, begun.least, want.overshoot)
            for k in np.flatnonzero(errors < error):
                own = _around_rest(tries[may][[k]], mix, h, p)
                if limits.judge(own).excess <= begun.excess:
                    stuck = 0.0
                    gains, weight, error = tries[may][k], weights[k], errors[k]
                    best = Answer(*(part[[k]] for part in found))
                    changes = changes[np.flatnonzero(may)[k] + 1 :]
                    break
            else:
                break
    return begun._replace(gains=gains, weight=weight, answer=best)


def _speeds(want: PlainPIDSpecification) -> Vector:
    """Return the crossovers that are tried, from fast to slow, in rad/s."""
    top = want.bandwidth or 0.1 * 2.0 * math.pi / want.sample_time
    return np.geomspace(top, 1e-5 * top, 70)


def _cascade(limits: LoopLimits, want: PlainPIDSpecification) -> _PIDs:
    """Return the best PID of one output around a PD of another that is measured.

    At each speed w the inner loop has a phase margin, alone; around it the outer loop is tried at
    shares of w. Which of them are stable together, however each is alone, is left to the limits.
    """
    loop, h = limits.loop, want.sample_time
    own, (sensors, m) = loop.linear, (len(loop.sensors), len(loop.actuators))
    if limits.outputs > 1 or m > 1:
        raise WorkbenchError(
            f"a PID cascade of the workbench follows one output by one command, not {loop.words};"
            " leave also_measured out, or take another family, such as lqi"
        )
    tried = _speeds(want)
    turned = np.exp(-1j * tried * (0.5 * h + want.delay))
    seen = transfer_function(own.A, own.B, loop.seen, np.zeros((sensors, 1)), 1j * tried)
    seen, found, speeds = seen[:, :, 0] * turned[:, None], [], []
    for k in range(1, sensors):
        within = np.arange(0, len(tried), INNER_EVERY)
        inner, crossed = _at_crossover(tried[within], seen[within, k], ZEROS[-1:])
        inner[:, 1] = 0.0
        for slower in OUTER:
            place = within[crossed] + slower
            kept = place < len(tried)
            place, pd = place[kept], inner[kept]
            kp, _, kd, fade = pd.T
            s = 1j * tried[place]
            through = seen[place, k] * (kp + kd * s / (fade * s + 1.0))
            plant = seen[place, 0] / (1.0 + through)
            outer, which = _at_crossover(tried[place], plant, ZEROS[-3:], PHASE_MARGINS[::2])
            both = np.zeros((len(outer), sensors, 4))
            both[:, 0], both[:, k] = outer, pd[which]
            found.append(both)
            speeds.append(tried[place[which]])
    tries, speed, mix = np.concatenate(found), np.concatenate(speeds), np.ones((1, sensors))
    may = _small(tries, mix, loop, want)
    may[may] = limits.stable(_around_rest(tries[may], mix, h, 1))
    tries, speed = tries[may], speed[may]
    judged = limits.judge(_around_rest(tries, mix, h, 1))
    held = limits.held(judged, "a PID cascade")
    return _best_of(limits, want, mix, tries[held], speed[held], judged.excess[held])


def _begun_by(limits: LoopLimits, want: PlainPIDSpecification, mix: Matrix) -> _PIDs:
    loop, h, p = limits.loop, want.sample_time, limits.outputs
    tried = _speeds(want)
    turned = np.exp(-1j * tried * (0.5 * h + want.delay))
    responses = loop.response(tried) @ mix * turned[:, None, None]
    if p == 1:
        tries, speed, judged = _alone(limits, want, mix, tried, responses[:, 0, 0], SLOWEST)
        held = limits.held(judged, "a PID")
    else:
        tries, speed = _slowed(loop, want, mix, tried, responses)
        may = _small(tries, mix, loop, want) & limits.stable(_around_rest(tries, mix, h, p))
        tries, speed = tries[may], speed[may]
        # Few of many need to be judged: the best first.
        found = _weighed(limits, tries, mix)[1]
        errors = cost(found, found.errors.min(axis=0, initial=math.inf), want.overshoot)
        order, parts = np.argsort(errors), [Judged(*np.zeros((3, 0)))]
        for k in range(0, len(order), AT_ONCE):
            parts.append(limits.judge(_around_rest(tries[order[k : k + AT_ONCE]], mix, h, p), 1.0))
            if parts[-1].excess.min() <= 1.0:
                break
        tries, speed = tries[order], speed[order]
        judged = Judged(*(np.concatenate(own) for own in zip(*parts, strict=True)))
        if judged.excess.min(initial=math.inf) > 1.0:
            judged = limits.judge(_around_rest(tries, mix, h, p))
        held = limits.held(judged, "a PID of each output")
    return _best_of(limits, want, mix, tries[held], speed[held], judged.excess[held])


def _best_of(
    limits: LoopLimits,
    want: PlainPIDSpecification,
    mix: Matrix,
    tries: Matrix,
    speed: Vector,
    excess: Vector,
) -> _PIDs:
    weights, found = _weighed(limits, tries, mix)
    least = found.errors.min(axis=0)
    k = int(np.argmin(cost(found, least, want.overshoot)))
    return _PIDs(
        mix,
        tries[k],
        weights[k],
        float(speed[k]),
        max(1.0, float(excess.max())),
        least,
        Answer(*(part[[k]] for part in found)),
    )


def _small(gains: Matrix, mix: Matrix, loop: Loop, want: PlainPIDSpecification) -> Any:
    """Tell which PIDs, shape (n, p, 4), ask for no more than an error of its scale may."""
    scale = np.abs(mix / loop.command_scale[:, None]).max(axis=0)
    largest = 1.0 / np.maximum(want.error_scale * scale, 1e-300)
    strongest = np.abs(gains[..., 0] + gains[..., 2] / (gains[..., 3] + want.sample_time))
    return (strongest <= largest).all(axis=-1)


def _alone(
    limits: LoopLimits,
    want: PlainPIDSpecification,
    mix: Matrix,
    speeds: Vector,
    plant: Complex,
    slowest: float,
) -> tuple[Matrix, Vector, Judged]:
    """Return PIDs of one output, shape (n, 1, 4), their crossovers in rad/s and what they reach.

    They are tried from fast to slow, up to a slowest over the fastest within the limits.
    """
    tries, which = _at_crossover(speeds, plant)
    tries, speed = tries[:, None], speeds[which]
    small = _small(tries, mix, limits.loop, want)
    tries, speed = tries[small], speed[small]
    parts, fastest, count = [Judged(*np.zeros((3, 0)))], 0.0, 0
    while count < len(speed) and speed[count] >= slowest * fastest:
        own = slice(count, count + ALONE_AT_ONCE)
        found = limits.judge(_around_rest(tries[own], mix, want.sample_time, 1), 1.0)
        fastest = max(fastest, speed[own][found.excess <= 1.0].max(initial=0.0))
        parts.append(found)
        count += len(found.excess)
    judged = Judged(*(np.concatenate(own) for own in zip(*parts, strict=True)))
    if not fastest:
        judged = limits.judge(_around_rest(tries, mix, want.sample_time, 1))
    return tries[:count], speed[:count], judged


def _slowed(
    loop: Loop, want: PlainPIDSpecification, mix: Matrix, speeds: Vector, plant: Complex
) -> tuple[Matrix, Vector]:
    """Return PIDs of all loops, shape (n, p, 4), of which each is the best alone that is so fast.

    A pair that is late, or answers the wrong way first, is slow by itself; what it is in the loop
    of all is left to the limits. Where a pair alone cannot be stable, such as one of two magnets
    under one beam, all loops cross at one speed, with one phase.

    Returns:
        The PIDs, and the mean crossover of the best alone, or of each, shape (n,), in rad/s.
    """
    p, single = plant.shape[1], np.eye(1)
    crossed: list[float] = []
    # By how much of the limits each may take, what others do to it takes the rest.
    best: dict[float, list[list[Vector]]] = {share: [] for share in TAKEN}
    for i in range(p):
        limits = LoopLimits(_pair(loop, mix, i), want)
        slowest = 0.5 * SLOWER[-1]
        tries, speed, judged = _alone(limits, want, single, speeds, plant[:, i, i], slowest)
        least = float(judged.excess.min(initial=math.inf))
        if not math.isfinite(least):
            each = [_at_crossover(speeds, plant[:, k, k]) for k in range(p)]
            return _together([(own, speeds[which]) for own, which in each])
        held = np.flatnonzero(judged.excess <= max(1.0, 1.05 * least))
        tries, speed, excess = tries[held], speed[held], judged.excess[held]
        reached = _weighed(limits, tries, single)[1]
        errors = cost(reached, reached.errors.min(axis=0), want.overshoot)
        crossed.append(float(speed[int(np.argmin(errors))]))
        for taken, every in best.items():
            quiet = excess <= max(taken, 1.05 * least)
            own = []
            for share in SLOWER:
                slow = np.flatnonzero(quiet & (speed <= 1.001 * share * crossed[-1]))
                if len(slow):
                    own.append(tries[slow[int(np.argmin(errors[slow]))], 0])
            every.append(own)
    found = []
    for every in best.values():
        most = max(map(len, every))
        whole = np.array([own + own[-1:] * (most - len(own)) for own in every])
        few = min(most, int(MOST_PIDS ** (1.0 / p)))
        steps = np.linspace(0.0, most - 1.0, few).round().astype(int).tolist()
        found += [whole[range(p), each] for each in itertools.product(steps, repeat=p)]
    return np.array(found), np.full(len(found), np.exp(np.mean(np.log(crossed))))


def _pair(loop: Loop, mix: Matrix, i: int) -> Loop:
    """Return the loop of one output and what its PID adds to the commands, all others open."""
    own, endless = loop.linear, np.array([math.inf])
    linear = replace(
        own,
        B=own.B @ mix[:, [i]],
        C=own.C[[i]],
        D=np.zeros((1, 1)),
        input_names=(f"PID of {loop.measured[i]}",),
        output_names=loop.measured[i : i + 1],
    )
    return Loop(
        linear.without_unseen().without_unreached(),
        loop.measured[i : i + 1],
        linear.input_names,
        loop.rest_output[[i]],
        np.zeros(1),
        -endless,
        endless,
        loop.output_scale[[i]],
        # What the PID may add to the commands, each of which it takes part of.
        np.array([1.0 / np.abs(mix[:, i] / loop.command_scale).max()]),
        loop.noise[[i]],
        endless,
        (None,),
        (0.0,),
    )


def _together(alone: Sequence[tuple[Matrix, Vector]]) -> tuple[Matrix, Vector]:
    """Return PIDs of all loops, shape (n, p, 4), of one crossover, with every choice of signs."""
    found: list[list[Vector]] = []
    speeds: list[float] = []
    for w in sorted(set.intersection(*(set(speed.tolist()) for _, speed in alone))):
        rows = [tries[speed == w] for tries, speed in alone]
        for signs in itertools.product((1.0, -1.0), repeat=len(rows)):
            own = [row[np.sign(row[:, 0]) == s] for row, s in zip(rows, signs, strict=True)]
            found += [[row[k] for row in own] for k in range(min(map(len, own)))]
            speeds += [w] * (len(found) - len(speeds))
    return np.array(found).reshape(-1, len(alone), 4), np.array(speeds)


def _around_rest(gains: Matrix, mix: Matrix, sample_time: float, followed: int) -> LinearLaw:
    """Return PIDs of Kp, Ki, Kd and Tf, shape (n, p, 4), in SI.

    From measurements, references beside their weights, and references by their weights, of those
    that are followed.
    """
    kp, ki, kd, filter_time = np.moveaxis(gains, 2, 0)
    fade, slope = filter_time / (filter_time + sample_time), kd / (filter_time + sample_time)
    (n, p), at = kp.shape, np.arange(kp.shape[1])
    F, G = np.zeros((n, 2 * p, 2 * p)), np.zeros((n, 2 * p, 3 * p))
    H, J = np.zeros((n, p, 2 * p)), np.zeros((n, p, 3 * p))
    F[:, at, at], F[:, p + at, p + at], H[:, at, at] = at < followed, fade, 1.0
    G[:, at, at], G[:, at, p + at] = -sample_time * ki, sample_time * ki
    G[:, p + at, at], H[:, at, p + at] = fade - 1.0, -slope
    J[:, at, at], J[:, at, 2 * p + at] = -kp - slope, kp
    kept = np.concatenate([at, p + at[:followed], 2 * p + at[:followed]])
    return LinearLaw(F, G[:, :, kept], mix @ H, mix @ J[:, :, kept])


def _weighed(limits: LoopLimits, gains: Matrix, mix: Matrix) -> tuple[Matrix, Answer]:
    """Return the largest weights that let steps overshoot no further than they may, and answers.

    The weight of a reference changes nothing but the steps of its own.
    """
    p = limits.outputs
    laws = _around_rest(gains, mix, limits.want.sample_time, p)
    time, seen, going = limits.steps(laws)
    kept, parts = np.full((len(seen), p), WEIGHTS[-1]), []
    for i in range(p):
        beside, by, left = seen[:, :, :, i], seen[:, :, :, p + i], np.arange(len(seen))
        own, more = beside[:, :, i] * going, by[:, :, i] * going
        for weight in WEIGHTS:
            fits = np.max(own + more * weight, axis=1) - 1.0 <= limits.want.overshoot
            kept[left[fits], i] = weight
            left, own, more = left[~fits], own[~fits], more[~fits]
        parts.append(beside + by * kept[:, [i], None])
    whole = np.concatenate([np.stack(parts, axis=3), seen[:, :, :, 2 * p :]], axis=3)
    return kept, answer(time, whole, going, limits.loop.output_scale)


def _at_crossover(
    speeds: Vector,
    plant: Complex,
    zeros: Sequence[float] = ZEROS,
    margins: Sequence[float] = PHASE_MARGINS,
) -> tuple[Matrix, npt.NDArray[np.int_]]:
    """Return PIDs, of either sign, that give the loop a phase margin at a speed, or more.

    Returns:
        Kp, Ki, Kd and Tf, shape (n, 4), in SI, and the places of their speeds, shape (n,).
    """
    grid = np.meshgrid(np.arange(len(speeds)), zeros, margins, (1.0, -1.0), indexing="ij")
    which, zero, margin, sign = (part.ravel() for part in grid)
    rare, which = np.isin(zero, NEARLY_INTEGRALS), which.astype(int)
    w, P = speeds[which], plant[which]
    missing = margin - np.pi - np.angle(P) + np.arctan(1.0 / zero) + np.where(sign < 0.0, np.pi, 0)
    lift = missing - 2.0 * np.pi * np.round(missing / (2.0 * np.pi))
    may = (P != 0.0) & (lift <= LIFT) & ~(rare & (which % 3 > 0))
    w, P, zero, sign, lift = w[may], P[may], zero[may], sign[may], np.maximum(lift[may], 0.2)
    integrating = zero / w
    ratio = np.sqrt((1.0 + np.sin(lift)) / (1.0 - np.sin(lift)))
    lead, fast = ratio / w, 1.0 / (w * ratio)
    shape = (1.0 - 1j / zero) * (1.0 + 1j * ratio) / (1.0 + 1j / ratio)
    gain = sign / np.abs(P * shape)
    # (1 + 1 / Ti s) (1 + Td s) / (1 + Tf s) as a sum of its three parts.
    kp = gain * (integrating + lead - fast) / integrating
    return np.column_stack([kp, gain / integrating, gain * lead - kp * fast, fast]), which[may]


PLAIN_PID = Design(
    name="plain-pid",
    family="PID",
    summary="PID of each followed output by a command of its own, for any linear model",
    function=design_plain_pid,
    specification=PlainPIDSpecification,
)
