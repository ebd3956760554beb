"""Sensitivity peaks of a sampled controller on a linear model."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from controllers.guard import unguarded
from controllers.joint.model import OPENING
from controllers.linear_law import linear_law
from controllers.protocol import Controller
from controllers.valve_inverse import ValveInverse
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import check_choice
from workbench.linearisation import LinearModel
from workbench.linearisation.state_space import linear_model
from workbench.linearisation.time_scales import noise_of
from workbench.linearisation.transfer import transfer_function, with_modes, zeros_of
from workbench.linearisation.zero_order_hold import zero_order_hold
from workbench.model.quantities import of_names

_PURE_DELAY, _SLOWEST = 1e-6, 1e-9
"""Size of a mode of the sampled loop below which it is a delay; slowest one that is looked at, in
rad per sample."""


def peak_sensitivities(controller: Controller, linear: LinearModel) -> tuple[float, float]:
    """Compute Ms and Mt, ratios, of the loop opened at the measured first sensor.

    All other loops stay closed: for a cascade this is the outer loop. The plant is discretised with
    held inputs at the controller's sample time, so the delay of sampling is included. What the
    measurements do not show, such as an angle where a speed is controlled, or what the commands do
    not move and what does not grow, such as what hysteresis remembers, does not count. Both are
    infinite if the loop is not stable.

    Source:
        Åström and Hägglund, Advanced PID Control, 2006, section 4.6.
    """
    return peaks(controller, linear)[:2]


class Peaks(NamedTuple):
    """Peaks of a loop, infinite if it is not stable.

    Args:
        sensitivity: Ms, a ratio.
        complementary: Mt, a ratio.
        bandwidth: Largest |T| w, in rad per sample.
    """

    sensitivity: float
    complementary: float
    bandwidth: float


def peaks(controller: Controller, linear: LinearModel) -> Peaks:
    """Compute the peaks of a loop opened at its first sensor, down to its slowest mode."""
    loop = loop_matrices(controller, linear)
    return peaks_of(loop, down_to_slow(loop, frequencies()))


def peaks_of(loop_parts: LoopMatrices, angle: Matrix, sensor: int | None = 0) -> Peaks:
    """Compute the peaks of a loop opened at one sensor, or at the command (None).

    Frequencies have shape (n,), in rad per sample.
    """
    loop, stable = gain_of(loop_parts, angle, sensor)
    if not stable:
        return Peaks(math.inf, math.inf, math.inf)
    s, t = np.abs(1.0 / (1.0 + loop)), np.abs(loop / (1.0 + loop))
    return Peaks(float(s.max()), float(t.max()), float((t * angle).max()))


def frequencies(points: int = 300) -> Matrix:
    """Return frequencies from 1e-4 to nearly half of the sampling rate, in rad per sample."""
    return np.geomspace(2e-4 * np.pi, 0.98 * np.pi, points)


def down_to_slow(loop_parts: LoopMatrices, angle: Matrix) -> Matrix:
    """Return frequencies, in rad per sample, that begin well below the slowest mode of the loop.

    A loop that samples thousands of times faster than it moves has all of its margins below what
    the sampling alone would look at.
    """
    modes = np.linalg.eigvals(loop_parts.closed)
    speeds = np.abs(np.log(modes[np.abs(modes) > _PURE_DELAY].astype(complex)))
    lowest = 0.1 * float(np.min(speeds, initial=math.inf))
    more = math.log(angle[0] / max(lowest, _SLOWEST)) / math.log(angle[1] / angle[0])
    if more <= 0.0:
        return angle
    below = angle[0] * (angle[1] / angle[0]) ** -np.arange(math.ceil(more), 0.0, -1.0)
    return np.concatenate([below, angle])


def with_resonances(loop_parts: LoopMatrices, angle: Matrix) -> Matrix:
    """Return frequencies, in rad per sample, with more of them about lightly damped modes.

    Those of plant, law and closed loop are peaks of its gain and of its sensitivity, zeros of the
    plant are gaps.
    """
    A, B, C, F, *_ = loop_parts
    found = [s for own in (A, F, loop_parts.closed) for s in np.linalg.eigvals(own)]
    for k, row in itertools.product(range(B.shape[1]), C):
        found += [*zeros_of(A, B[:, k], row)]
    # What is a pure delay has no frequency.
    turning = np.array([z for z in found if abs(z) > _PURE_DELAY and z.imag > 0.0], dtype=complex)
    return with_modes(angle, np.log(turning))


def gain_of(
    loop_parts: LoopMatrices, angle: Matrix, sensor: int | None, command: int = 0
) -> tuple[Complex, bool]:
    """Return the gain of a loop opened at one sensor, or at a command (None), all others closed.

    Frequencies are in rad per sample.

    Args:
        command: Number of the command at which it is opened, if at one.

    Returns:
        Loop gain, shape (n,), dimensionless, negative feedback being L / (1 + L), and whether the
        closed loop is stable.
    """
    _, B, C, F, G, H, J = loop_parts
    closed = loop_parts.closed
    stable = bool(np.max(np.abs(np.linalg.eigvals(closed))) < 1.0)
    if sensor is None:
        b = np.vstack([B[:, [command]], np.zeros((len(F), 1))])
        c = np.hstack([J @ C, H])[[command]]
    else:
        b = np.vstack([B @ J[:, [sensor]], G[:, [sensor]]])
        c = np.hstack([C[[sensor]], np.zeros((1, len(F)))])
    # What was fed back there comes from outside, the others stay connected.
    gain = transfer_function(closed - b @ c, b, c, np.zeros((1, 1)), np.exp(1j * angle))
    return -gain[:, 0, 0], stable


def sensitivities_of(loop_parts: LoopMatrices, angle: Matrix) -> tuple[Complex, Complex]:
    """Return the sensitivities of a stable loop opened at all sensors, and at all commands.

    Frequencies have shape (n,), in rad per sample; the ratios shape (n, n_sensors, n_sensors) and
    (n, n_commands, n_commands).
    """
    A, B, C, F, G, H, J = loop_parts
    z = np.exp(1j * angle)
    P = transfer_function(A, B, C, np.zeros((len(C), B.shape[1])), z)
    K = -transfer_function(F, G, H, J, z)
    seen, given = np.eye(len(C)), np.eye(B.shape[1])
    both = np.linalg.inv(seen + P @ K), np.linalg.inv(given + K @ P)
    return both[0].astype(complex), both[1].astype(complex)


def least_gain(M: Any) -> Vector:
    """Return the largest singular value of matrices, shape (..., k, k), in the best of units.

    Those make it least: off-diagonal rows and columns of D M D^-1, D diagonal, have equal norms
    then, exactly so for two, nearly for more.

    Source: Osborne, On pre-conditioning of matrices, J. ACM 7, 1960.
    """
    k, size = M.shape[-1], np.abs(M) ** 2
    w = np.ones(M.shape[:-1])
    for i in [0] if k == 2 else [*range(k)] * 3:
        others = [j for j in range(k) if j != i]
        row = np.sum(size[..., i, others] / w[..., others], axis=-1) * w[..., i]
        column = np.sum(size[..., others, i] * w[..., others], axis=-1) / w[..., i]
        # What acts one way only is no loop: its unit is as far away as numbers bear.
        even = w[..., i] * np.sqrt((column + 1e-200) / (row + 1e-200))
        w[..., i] = np.clip(even, 1e-60, 1e60)
    if k == 2:
        total = np.sum(size * w[..., :, None] / w[..., None, :], axis=(-2, -1))
        product = 2.0 * np.abs(M[..., 0, 0] * M[..., 1, 1] - M[..., 0, 1] * M[..., 1, 0])
        return np.asarray(np.sqrt(0.5 * (total + np.sqrt(np.maximum(total**2 - product**2, 0.0)))))
    scaled = M * np.sqrt(w[..., :, None] / w[..., None, :])
    squares = scaled.conj().swapaxes(-1, -2) @ scaled
    return np.asarray(np.sqrt(np.linalg.eigvalsh(squares)[..., -1]))


class LoopMatrices(NamedTuple):
    """The sampled plant (A, B, C) and the law (F, G, H, J) of a loop around rest.

    All is in SI but the states of the plant, which count in their scales. Rows of C are the
    controller's sensors in their order.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    F: Matrix
    G: Matrix
    H: Matrix
    J: Matrix

    @property
    def closed(self) -> Matrix:
        """State matrix of the closed loop, states of the plant first."""
        A, B, C, F, G, H, J = self
        return np.block([[A + B @ J @ C, B @ H], [G @ C, F]])


def loop_matrices(controller: Controller, linear: LinearModel) -> LoopMatrices:
    """Return plant and law of a loop around rest."""
    return loops_at(controller, linear, ((0.0, 0.0),))[0]


def loops_at(
    controller: Controller, linear: LinearModel, corners: Sequence[tuple[float, float]]
) -> tuple[LoopMatrices, ...]:
    """Return plant and law of a loop around rest that is late and sees with a lag.

    Args:
        corners: Pairs of the time by which every command is late and of the time constant of
            every sensor with noise of its own, in s.
    """
    linear = linear_model(linear)
    for name in (*controller.sensors, *controller.controlled):
        check_choice("output of the linear model", name, linear.output_names)
    valve = getattr(unguarded(controller), "valve", None)
    by_opening = OPENING in linear.input_names and OPENING not in controller.actuators
    if isinstance(valve, ValveInverse) and by_opening:
        columns, gain = [linear.input_names.index(OPENING)], np.array([valve.gain_at_rest])
    else:
        for name in controller.actuators:
            check_choice("input of the linear model", name, linear.input_names)
        columns = [linear.input_names.index(name) for name in controller.actuators]
        # Elsewhere than at rest the inverse of a curve is as steep as the curve is not.
        curves = getattr(unguarded(controller), "curves", None) or [None] * len(columns)
        pairs = zip(curves, linear.u0[columns].tolist(), strict=True)
        gain = np.array([1.0 if c is None else c.steepness(u) for c, u in pairs])
    inputs = [linear.input_names[k] for k in columns]
    own = linear.select(inputs=inputs, outputs=controller.sensors).without_unseen()
    own = own.read_after_holding(controller.sample_time).without_unreached()
    size = own.state_scales
    A, B, C = own.A * size / size[:, None], gain * own.B / size[:, None], own.C * size
    values = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    at_rest = tuple(values[name] for name in controller.sensors)
    reference = tuple(values[name] for name in controller.controlled)
    law = linear_law(controller, at_rest, reference * (1 + controller.preview))
    noisy = {q.name for q in linear.operating_point.model.outputs if q.noise_rms > 0.0}
    lagging = [name in noisy for name in controller.sensors]
    sampled = sampled_at(A, B, C, lagging, corners, controller.sample_time)
    return tuple(LoopMatrices(*plant, *law) for plant in sampled)


def stirred(controller: Controller, linear: LinearModel, delay: float = 0.0) -> dict[str, float]:
    """Return what noise of the sensors moves followed outputs by, rms, in SI, by name.

    With the loop's states x' = M x + N n, their covariance is P = M P M^T + N N^T, by doubling
    (Smith, Matrix equation XA + BX = C, SIAM J. Appl. Math. 16, 1968). There is none of a loop that
    is not stable, nor of a law whose motion around rest nobody tells.
    """
    if not hasattr(controller, "around_rest"):
        return {}
    loop = loops_at(controller, linear, ((delay, 0.0),))[0]
    M, C = loop.closed, loop.C
    if np.abs(np.linalg.eigvals(M)).max(initial=0.0) >= 1.0 - 1e-9:
        return {}
    read = of_names(linear.operating_point.model.outputs, controller.sensors)
    N = np.vstack([loop.B @ loop.J, loop.G]) * [noise_of(q) for q in read]
    P = N @ N.T
    while np.abs(M).max() > 1e-12:
        P, M = P + M @ P @ M.T, M @ M
    n = C.shape[1]
    seen = C @ P[:n, :n] @ C.T
    rms = np.sqrt(np.maximum(np.diag(seen), 0.0)).tolist()
    return dict(zip(controller.controlled, rms, strict=False))


def sampled_at(
    A: Matrix,
    B: Matrix,
    C: Matrix,
    lagging: Sequence[bool],
    corners: Sequence[tuple[float, float]],
    sample_time: float,
) -> list[tuple[Matrix, Matrix, Matrix]]:
    """Return a plant with held inputs, late and seen with a lag, at each corner.

    Args:
        lagging: The outputs, one for each row of C, that a lag is put behind.
        corners: Pairs of delay and time constant, in s.
        sample_time: Time between samples, in s.
    """
    return [
        _late(*(_lagging(A, B, C, lagging, lag) if lag > 0.0 else (A, B, C)), delay, sample_time)
        for delay, lag in corners
    ]


def _lagging(
    A: Matrix, B: Matrix, C: Matrix, which: Sequence[bool], lag: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Put a first-order lag behind some outputs."""
    slow = np.flatnonzero(which)
    n, k = len(A), len(slow)
    behind = np.block([[A, np.zeros((n, k))], [C[slow] / lag, -np.eye(k) / lag]])
    shown = np.hstack([np.where(np.array(which)[:, None], 0.0, C), np.zeros((len(C), k))])
    shown[slow, n + np.arange(k)] = 1.0
    return behind, np.vstack([B, np.zeros((k, B.shape[1]))]), shown


def _late(
    A: Matrix, B: Matrix, C: Matrix, delay: float, sample_time: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Discretise for held inputs that come late, by whole samples and a part of one.

    Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, section 2.3 (time delay).
    """
    a, b = zero_order_hold(A, B, sample_time)
    count = math.ceil(delay / sample_time - 1e-9)
    if not count:
        return a, b, C
    # The oldest command holds on for a part of the sample, the one after it takes the rest.
    part = delay - (count - 1) * sample_time
    rest, after = zero_order_hold(A, B, sample_time - part)
    before = rest @ zero_order_hold(A, B, part)[1]
    n, m = b.shape
    sent = np.hstack([before, after, np.zeros((n, (count - 1) * m))])
    chain = np.eye((count + 1) * m)[m:]
    F = np.block([[a, sent], [np.zeros((count * m, n)), chain]])
    columns = n + count * m
    return F[:, :columns], F[:, columns:], np.hstack([C, np.zeros((len(C), count * m))])
