"""What a linear model says about measurements that cannot be believed, and a law to come to rest.

The states x of a sampled linear model are joined by an offset d of each followed output, which
collects what the model leaves out. All are deviations from the operating point, S the measurements
that are believed, M_S the gain of the Kalman filter for them:

    y_hat = C x + D d                          what is expected of every measurement
    x, d  += M_S (y - y_hat)_S
    u     = K_r (r - d) - K x                  inner law: rest where the followed outputs are r
    x+    = F x + G u,   d+ = 0.9999 d

So the other measurements and the commands say what a missing or stuck one would read. Where the
plant declares curves of its actuators, u are the commands that do the same along straight lines.

Source: Simon, Optimal State Estimation, 2006, chapter 5 and section 10.1 (Kalman filter, sensors
that come and go); Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, section 6.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from controllers.riccati import regulator
from workbench.arrays import Matrix, product
from workbench.linearisation import LinearModel
from workbench.linearisation.zero_order_hold import zero_order_hold

MOST_SENSORS = 5
"""Every subset of the sensors has its gain; a controller that reads more has no estimator."""

FORGETTING = 0.9999
"""Pole of the offsets, so that they are estimated of plants that integrate too."""


@dataclass(frozen=True, eq=False)
class Estimator:
    """Estimator of a plant, with an inner law; n states and offsets.

    Args:
        F: Transition over a sample, shape (n, n), in SI.
        G: Effect of the commands, as they are entered, shape (n, n_commands), in SI.
        C: What is expected of the measurements, shape (n_sensors, n), in SI.
        M: Gains by the set of sensors that are believed, sensor i counting 2^i, shape
            (2^n_sensors, n, n_sensors), in SI.
        start: States at rest per deviation of the measurements, shape (n, n_sensors), in SI.
        K: Inner law, shape (n_commands, n), in SI; without rows if there is none.
        K_reference: The same per deviation of the followed outputs, shape (n_commands,
            n_followed), in SI.
        rest: Measurements at the operating point, shape (n_sensors,), in SI.
        rest_followed: Followed outputs there, shape (n_followed,), in SI.
        rest_command: Commands there, as they are entered, shape (n_commands,), in SI.
        weak: What friction may swallow of each command, as it is entered, shape (n_commands,), in
            SI.
        curve_commands: Commands at points of each actuator's curve, increasing, shape (n_commands,
            n_points), in SI; or none.
        curve_entered: Commands that do the same along straight lines, of the same shape, in SI.
    """

    F: Matrix
    G: Matrix
    C: Matrix
    M: Matrix
    start: Matrix
    K: Matrix
    K_reference: Matrix
    rest: Matrix
    rest_followed: Matrix
    rest_command: Matrix
    weak: Matrix
    curve_commands: Matrix
    curve_entered: Matrix

    def expected(self, z: Matrix) -> Matrix:
        """Return what every sensor should read by states and offsets, shape (n,), in SI."""
        return np.asarray(self.rest + product(self.C, z))

    def at_rest(self, measurement: tuple[float, ...]) -> Matrix:
        """Return states and offsets, shape (n,), that explain a measurement as rest, all in SI."""
        return product(self.start, np.array(measurement) - self.rest)

    def corrected(self, z: Matrix, residual: Matrix, believed: int) -> Matrix:
        """Return states and offsets, shape (n,), with believed measurements taken in, all in SI.

        The residual is measurements less what was expected; in the set of believed sensors,
        sensor i counts 2^i.
        """
        return np.asarray(z + product(self.M[believed], residual))

    def predicted(self, z: Matrix, command: tuple[float, ...]) -> Matrix:
        """Return states and offsets, shape (n,), a sample later under a command, all in SI."""
        u = self.entered(command) - self.rest_command
        return np.asarray(product(self.F, z) + product(self.G, u))

    def entered(self, command: tuple[float, ...]) -> Matrix:
        """Return commands as the model takes them, straightened where there are curves, in SI."""
        return _along(np.array(command), self.curve_commands, self.curve_entered)

    def strong(self, command: tuple[float, ...]) -> bool:
        """Tell whether a command, in SI, is more than friction may swallow."""
        return bool(np.any(np.abs(self.entered(command) - self.rest_command) > self.weak))

    def inner(self, z: Matrix, target: tuple[float, ...]) -> list[float]:
        """Return the command that brings the followed outputs to rest at a target, all in SI."""
        away = np.array(target) - self.rest_followed
        u = self.rest_command + product(self.K_reference, away) - product(self.K, z)
        return [float(v) for v in _along(u, self.curve_entered, self.curve_commands)]


def _along(values: Matrix, points: Matrix, then: Matrix) -> Matrix:
    """Return each value through a curve of its own, if there are curves, in SI."""
    if not points.size:
        return values
    return np.array([np.interp(*one) for one in zip(values, points, then, strict=True)])


def design_estimator(
    linear: LinearModel,
    *,
    sensors: tuple[str, ...],
    followed: tuple[str, ...],
    change: Matrix,
    noise: Matrix,
    tolerance: Matrix,
    reach: Matrix,
    curve: tuple[Matrix, Matrix],
    sample_time: float,
) -> Estimator:
    """Design the estimator of a plant from its linear model.

    Args:
        followed: Outputs that the plant follows, with an offset each.
        change: Fastest change of each state in a sample, shape (n_states,), in SI.
        noise: Noise rms of each sensor, shape (n_sensors,), in SI.
        tolerance: Error of each followed output that may stay, shape (n_followed,), in SI.
        reach: What the inner law may use of each command, shape (n_commands,), in SI.
        curve: Commands, and what does the same along straight lines, shape (n_commands, n_points),
            in SI; empty without.
        sample_time: Time between samples, in s.
    """
    A, B = np.asarray(linear.A), np.asarray(linear.B)
    n, m = len(A), len(followed)
    read = [linear.output_names.index(name) for name in sensors]
    led = [linear.output_names.index(name) for name in followed]
    outputs = np.asarray(linear.C)
    offsets = np.array([[float(i == j) for j in led] for i in read]).reshape(len(read), m)
    phi, gamma = zero_order_hold(A, B, sample_time)
    F = np.block([[phi, np.zeros((n, m))], [np.zeros((m, n)), FORGETTING * np.eye(m)]])
    C = np.hstack([outputs[read], offsets])
    own = linear.state_scales
    size = np.concatenate([own, tolerance])
    # In units of what is typical, so that rounding treats all alike.
    f, c = F * size[None, :] / size[:, None], C * size[None, :] / noise[:, None]
    walk = np.concatenate([WALK * change / own, np.full(m, np.sqrt(1.0 / OFFSET))])
    everything = np.arange(len(read))
    p = np.diag(walk**2)
    for _ in range(ITERATIONS):
        p = _filtered(f, c, everything, walk, p)[1]
    gains = []
    for believed in range(2 ** len(read)):
        chosen = np.array([i for i in everything if believed >> i & 1], dtype=int)
        gain, _ = _filtered(f, c, chosen, walk, p)
        gains.append(gain * size[:, None] / noise[None, :])
    K, K_reference = _inner(phi, gamma, outputs[led], own, tolerance, reach, A, B)
    held = np.block(
        [
            [A * own[None, :] / own[:, None], np.zeros((n, m))],
            [1e4 * C * size[None, :] / noise[:, None]],
            [1e-6 * np.eye(n + m)],
        ]
    )
    asked = np.pad(1e4 * np.diag(1.0 / noise), ((n, n + m), (0, 0)))
    y0 = np.asarray(linear.y0)
    return Estimator(
        F=F,
        G=np.vstack([gamma, np.zeros((m, gamma.shape[1]))]),
        C=C,
        M=np.array(gains),
        start=size[:, None] * np.linalg.lstsq(held, asked, rcond=None)[0],
        K=np.hstack([K, K_reference]) if len(K) else np.zeros((0, n + m)),
        K_reference=K_reference,
        rest=y0[read],
        rest_followed=y0[led],
        rest_command=np.asarray(linear.u0),
        weak=WEAK * reach,
        curve_commands=curve[0],
        curve_entered=curve[1],
    )


WEAK = 0.05
"""Share of a command that friction may swallow: up to it a plant that stays is no sign."""

WALK = 0.03
"""What the model leaves out of a change of a state, as a share of the fastest."""

OFFSET = 500.0
"""Samples in which an offset may walk by the tolerance of its output."""

ITERATIONS = 1500
"""Steps of the Riccati recursion until the gain is stationary."""


def _filtered(
    f: Matrix, c: Matrix, chosen: npt.NDArray[np.int_], walk: Matrix, p: Matrix
) -> tuple[Matrix, Matrix]:
    """Return the gain of a sample for some sensors, and the covariance of the next prediction."""
    gain = np.zeros((len(f), len(c)))
    if len(chosen):
        own = c[chosen]
        gain[:, chosen] = np.linalg.solve(own @ p @ own.T + np.eye(len(chosen)), own @ p).T
    left = np.eye(len(f)) - gain @ c
    p = left @ p @ left.T + gain @ gain.T
    return gain, f @ p @ f.T + np.diag(walk**2)


def _inner(
    phi: Matrix,
    gamma: Matrix,
    C: Matrix,
    own: Matrix,
    tolerance: Matrix,
    reach: Matrix,
    A: Matrix,
    B: Matrix,
) -> tuple[Matrix, Matrix]:
    """Return the gains of the inner law; none where there is no regulator."""
    n, commands = gamma.shape
    f, g = phi * own[None, :] / own[:, None], gamma * reach[None, :] / own[:, None]
    h = C * own[None, :] / (INNER * tolerance[:, None])
    try:
        gain, _ = regulator(f, g, h.T @ h + 1e-9 * np.eye(n), np.eye(commands))
    except ValueError:
        return np.zeros((0, n)), np.zeros((0, len(C)))
    gain = reach[:, None] * gain / own[None, :]
    # States and commands at which the followed outputs rest, in typical sizes.
    at_rest = np.block(
        [
            [A * own[None, :] / own[:, None], B * reach[None, :] / own[:, None]],
            [C * own[None, :] / tolerance[:, None], np.zeros((len(C), commands))],
        ]
    )
    asked = np.pad(np.diag(1.0 / tolerance), ((n, 0), (0, 0)))
    found = np.linalg.lstsq(at_rest, asked, rcond=None)[0]
    return gain, reach[:, None] * found[n:] + gain @ (own[:, None] * found[:n])


INNER = 20.0
"""Error, in tolerances, for which the inner law uses all of the commands."""
