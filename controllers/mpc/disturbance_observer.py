"""Observer of a linear model with constant disturbances, for control without offset.

The state x of a linear model is joined by disturbances w that push on the rates of some states:

    dx/dt = A x + B u + E w,    dw/dt = 0,    y = C x

The last of them may be offsets of the last measurements instead. With as many disturbances as
measurements, and the joined system observable, the estimate at rest agrees with every measurement
whatever the plant does, so that a controller that leads the *model* to its reference leads the
plant there too.

Sample k, with z = (x, w) and matrices for held inputs:

    z[k]   = zp[k] + M (y[k] - C zp[k])
    zp[k+1] = F z[k] + G u[k]

M is the stationary Kalman gain.

Source: Pannocchia and Rawlings, Disturbance models for offset-free model-predictive control,
AIChE Journal 49, 2003; Rawlings, Mayne and Diehl, Model Predictive Control, 2017, section 1.5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from controllers.riccati import kalman_gain
from workbench.arrays import Matrix, product
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import LinearModel
from workbench.linearisation.zero_order_hold import zero_order_hold


@dataclass(frozen=True, eq=False)
class DisturbanceObserver:
    """Observer of states and constant disturbances, as deviations from an operating point.

    Args:
        F: Transition of (x, w), shape (n, n), in SI.
        G: Effect of the input, shape (n, n_inputs), in SI.
        C: Measurement, shape (n_sensors, n), in SI.
        M: Gain, shape (n, n_sensors), in SI.
        rest: Measurements at the operating point, shape (n_sensors,), in SI.
        disturbances: Number of disturbances, the last entries of the state.
    """

    F: Matrix
    G: Matrix
    C: Matrix
    M: Matrix
    rest: Matrix
    disturbances: int

    def correct(self, predicted: Matrix, measurement: npt.ArrayLike) -> Matrix:
        """Return predictions of (x, w), shape (n,) or (n, k), corrected by measurements, in SI."""
        residual = (np.asarray(measurement).T - self.rest).T - product(self.C, predicted)
        return np.asarray(predicted + product(self.M, residual))

    def predict(self, estimate: Matrix, u: Matrix) -> Matrix:
        """Predict (x, w) of the next sample under held inputs u, deviations, in SI."""
        return np.asarray(product(self.F, estimate) + product(self.G, u))

    def at_rest(self, measurement: tuple[float, ...], A: Matrix, E: Matrix) -> Matrix:
        """Return the smallest (x, w), in SI, that explains a measurement as rest without input.

        A is the continuous dynamics, E the effect of the disturbances on the rates.
        """
        n = len(A)
        rows = np.block([[A, E], [self.C]])
        size = np.max(np.abs(rows), axis=1, keepdims=True)
        target = np.concatenate([np.zeros(n), np.array(measurement) - self.rest])[:, None]
        return np.asarray(np.linalg.lstsq(rows / size, target / size, rcond=None)[0].ravel())


def design_disturbance_observer(
    linear: LinearModel,
    *,
    sensors: tuple[str, ...],
    actuators: tuple[str, ...],
    disturbances: Mapping[str, float] | tuple[Matrix, float],
    sensor_noise: tuple[float, ...],
    state_noise: float | Matrix,
    sample_time: float,
    offsets: tuple[float, ...] = (),
) -> DisturbanceObserver:
    """Design the observer as a stationary Kalman filter.

    Args:
        disturbances: States whose rates are disturbed, each with the random walk of its
            disturbance: rms change over one second, in the state's SI unit per second. Or E, shape
            (n_states, n_disturbances), in SI, and the random walk of its disturbances.
        sensor_noise: Noise rms of each sensor, in SI.
        state_noise: Random walk of every state over one second, as a fraction of its scale; or what
            white noise walks the states by over one second, shape (n_states, n_noises), in SI.
        sample_time: Time between samples, in s.
        offsets: Random walks of the offsets of the last sensors, rms change over one second, in SI;
            they are disturbances too, behind the others.

    Raises:
        WorkbenchError: If a name is unknown, or the disturbances cannot be told apart from the
            measurements.

    Source:
        Pannocchia and Rawlings 2003, proposition 1 (observability of the joined system).
    """
    A, B, E, walk, said = continuous_matrices(linear, actuators, disturbances)
    rows = [linear.output_names.index(name) for name in sensors]
    E = np.hstack([E, np.zeros((len(E), len(offsets)))])
    walk, said = np.append(walk, offsets), (*said, *sensors[len(sensors) - len(offsets) :])
    n, w = E.shape
    joined = np.block([[A, E], [np.zeros((w, n + w))]])
    F, G = zero_order_hold(joined, np.vstack([B, np.zeros((w, B.shape[1]))]), sample_time)
    C = np.hstack([np.asarray(linear.C)[rows], np.eye(len(rows), w, w - len(rows))])
    C[: len(rows) - len(offsets), n:] = 0.0
    scale = linear.state_scales
    size = np.concatenate([scale, walk])
    _check_told_apart(A, E, C, size, np.array(sensor_noise), said)
    walks = np.asarray(state_noise)
    walks = walks if walks.ndim else np.diag(float(walks) * scale)
    entry = np.zeros((n + w, walks.shape[1] + w))
    entry[:n, :-w], entry[n:, -w:] = walks, np.diag(walk)
    gain = _kalman_gain(F, C, entry * math.sqrt(sample_time), np.array(sensor_noise) ** 2, size)
    rest = np.array(linear.y0)[rows]
    return DisturbanceObserver(F, G, C, gain, rest, w)


def continuous_matrices(
    linear: LinearModel,
    actuators: tuple[str, ...],
    disturbed: Mapping[str, float] | tuple[Matrix, float],
) -> tuple[Matrix, Matrix, Matrix, Matrix, tuple[str, ...]]:
    """Return A, columns of B, and E of disturbances, in SI; their walks, and what they are called.

    Args:
        disturbed: As `design_disturbance_observer` takes it, in SI.
    """
    columns = [linear.input_names.index(name) for name in actuators]
    A, B = np.asarray(linear.A, dtype=float), np.asarray(linear.B, dtype=float)[:, columns]
    if not isinstance(disturbed, Mapping):
        said = tuple(f"of {name}" for name in actuators)
        E, walk = disturbed
        return A, B, E, np.full(E.shape[1], walk), said
    E = np.zeros((len(A), len(disturbed)))
    for i, name in enumerate(disturbed):
        check_choice("disturbed state", name, linear.state_names)
        E[linear.state_names.index(name), i] = 1.0
    return A, B, E, np.array(list(disturbed.values())), tuple(disturbed)


def _check_told_apart(
    A: Matrix, E: Matrix, C: Matrix, size: Matrix, noise: Matrix, names: tuple[str, ...]
) -> None:
    """Refuse disturbances that constant measurements cannot tell apart.

    A constant disturbance shows in the measurements at rest if and only if
    ``rank [[A, E], [C, offsets]] = n_x + n_w``. Whether a Riccati solver fails instead depends on
    rounding.
    """
    n, w = E.shape
    # Rates per scale and second, and measurements per standard deviation of their noise.
    matrix = np.block([[A, E], [C]]) * size[None, :]
    matrix /= np.concatenate([size[:n], noise])[:, None]
    for axis in (1, 0) * 3:
        # What a slow or a small part adds shows beside what is large.
        matrix /= np.maximum(np.max(np.abs(matrix), axis=axis, keepdims=True), 1e-300)
    values = np.linalg.svd(matrix, compute_uv=False)
    rank = int(np.count_nonzero(values > 1e-10 * values[0]))
    if rank < n + w:
        raise WorkbenchError(
            f"{w} disturbances ({', '.join(names)}) cannot be told apart from {len(C)}"
            f" measurements: only {rank - n} of them show; use at most one disturbance per sensor,"
            " on states that the sensors see"
        )


def _kalman_gain(F: Matrix, C: Matrix, noise: Matrix, sensor: Matrix, size: Matrix) -> Matrix:
    """Return the stationary gain, solved in scaled states for conditioning."""
    f = F * size[None, :] / size[:, None]
    level = np.sqrt(sensor)
    c = C * size[None, :] / level[:, None]
    entered = noise / size[:, None]
    try:
        gain = kalman_gain(f, c, entered @ entered.T, np.eye(len(level)))
    except ValueError as error:
        raise WorkbenchError(
            "the disturbances cannot be told apart from the measurements"
            f" ({str(error).rstrip('.')}); use at most one disturbance per sensor, on states that"
            " the sensors see"
        ) from None
    return np.asarray(size[:, None] * gain / level[None, :])
