"""Sensitivity peaks of a sampled controller on a linear model.

The controller is linearised around rest by differences of its own `step`, so that what is judged
is the law that runs, with its filters, its inner loops and its sample time, not a formula for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from controllers.joint.opening_input import OPENING
from controllers.protocol import Controller
from controllers.valve_inverse import ValveInverse
from workbench.errors import check_choice

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

Matrix = npt.NDArray[np.float64]


def controller_matrices(
    controller: Controller, measurement: tuple[float, ...], reference: tuple[float, ...]
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return the matrices of a controller around rest, from measurement to linear command.

    ``z[k+1] = F z[k] + G m[k], u[k] = H z[k] + J m[k]``. The law must be smooth around rest, with
    a state that is a tuple of floats.

    Args:
        controller: The controller.
        measurement: Readings of its sensors at rest, in SI.
        reference: References at which it is at rest, in SI.

    Returns:
        F, G, H and J, in SI.

    Example:
        >>> from controllers.pid import CascadePID
        >>> pid = CascadePID(6e5, 0.0, 0.0, inner=2e-6, pressure_filter=0.0)
        >>> F, G, H, J = controller_matrices(pid, (0.5, 3e5, 3e5), (0.5,))
        >>> J.round(6).tolist()
        [[-60.0, -0.0001, 0.0001]]
    """
    state = controller.initial_state(measurement)
    kind = type(state)
    z0 = np.array(state, dtype=float)

    def run(z: Matrix, m: Matrix) -> tuple[Matrix, Matrix]:
        packed: Any = kind(*z.tolist()) if hasattr(kind, "_fields") else tuple(z.tolist())
        command, following, _ = controller.step(packed, tuple(m.tolist()), reference)
        return np.array(following, dtype=float), np.array(controller.linear_command(command))

    m0 = np.array(measurement, dtype=float)
    stack = np.concatenate([z0, m0])
    columns = []
    for i, value in enumerate(stack):
        # Small beside the clipping limits and the corners of the valve curve, and symmetric.
        size = 1e-7 * max(abs(value), 1.0)
        ends = []
        for sign in (1.0, -1.0):
            moved = stack.copy()
            moved[i] += sign * size
            ends.append(np.concatenate(run(moved[: len(z0)], moved[len(z0) :])))
        columns.append((ends[0] - ends[1]) / (2.0 * size))
    table = np.array(columns).T
    n = len(z0)
    return table[:n, :n], table[:n, n:], table[n:, :n], table[n:, n:]


def peak_sensitivities(
    controller: Controller, linear: LinearModel, *, points: int = 300, late: int = 0
) -> tuple[float, float]:
    """Compute Ms and Mt of the loop opened at the measured first sensor.

    All other loops stay closed: for a cascade this is the outer loop. The plant is discretised
    with held inputs at the controller's sample time, so the delay of sampling is included.

    Args:
        controller: The controller.
        linear: Linear model with the controller's sensors and actuators.
        points: Number of frequencies between 0.05 Hz and 0.98 of the Nyquist frequency.
        late: Samples by which every command arrives late, as from a slow computer.

    Returns:
        Largest |1 / (1 + L)| and |L / (1 + L)| (ratios); both infinite if the loop is unstable.

    Source:
        Åström and Hägglund, Advanced PID Control, 2006, section 4.6.

    Example:
        >>> from controllers.pid import design_pid
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.arm import arm
        >>> point = operating_point(arm(3), {"angle": 0.5236})
        >>> linear = linearise(point, verdict=False)
        >>> ms, mt = peak_sensitivities(design_pid(linear), linear)
        >>> ms <= 2.0
        True
    """
    A, B, C, F, G, H, J = loop_matrices(controller, linear)
    for _ in range(late):
        n, m = B.shape
        A = np.block([[A, B], [np.zeros((m, n + m))]])
        B = np.vstack([np.zeros((n, m)), np.eye(m)])
        C = np.hstack([C, np.zeros((len(C), m))])
    closed = np.block([[A + B @ J @ C, B @ H], [G @ C, F]])
    if np.max(np.abs(np.linalg.eigvals(closed))) >= 1.0:
        return float("inf"), float("inf")
    # Opened at sensor 0: its reading comes from outside, the others stay connected.
    keep = np.ones(len(C))
    keep[0] = 0.0
    rest = np.diag(keep) @ C
    first = np.zeros((len(C), 1))
    first[0] = 1.0
    a = np.block([[A + B @ J @ rest, B @ H], [G @ rest, F]])
    b = np.vstack([B @ J @ first, G @ first])
    c = np.hstack([C[:1], np.zeros((1, len(F)))])
    h = controller.sample_time
    angle = np.geomspace(2 * np.pi * 0.05 * h, 0.98 * np.pi, points)
    values, vectors = np.linalg.eig(a)
    left = (c @ vectors).ravel()
    right = np.linalg.solve(vectors, b.astype(complex)).ravel()
    z = np.exp(1j * angle)
    loop = -((left * right) / (z[:, None] - values)).sum(axis=1)
    ms = float(np.max(np.abs(1.0 / (1.0 + loop))))
    mt = float(np.max(np.abs(loop / (1.0 + loop))))
    return ms, mt


def loop_matrices(
    controller: Controller, linear: LinearModel
) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Matrix, Matrix]:
    """Return the sampled plant (A, B, C) and the controller (F, G, H, J) of a loop around rest.

    Args:
        controller: The controller.
        linear: Linear model with the controller's sensors and actuators.

    Returns:
        A, B, C, F, G, H and J, in SI; rows of C are the controller's sensors in their order.

    Raises:
        WorkbenchError: If the linear model lacks a sensor or an actuator.

    Example:
        >>> loop_matrices.__name__
        'loop_matrices'
    """
    for name in (*controller.sensors, *controller.follows):
        check_choice("output of the linear model", name, linear.output_names)
    rows = [linear.output_names.index(name) for name in controller.sensors]
    A, B, C, _ = linear.discretise(controller.sample_time)
    valve = getattr(controller, "valve", None)
    if isinstance(valve, ValveInverse) and OPENING in linear.input_names:
        B = B[:, [linear.input_names.index(OPENING)]] * valve.gain_at_rest
    else:
        for name in controller.actuators:
            check_choice("input of the linear model", name, linear.input_names)
        B = B[:, [linear.input_names.index(name) for name in controller.actuators]]
    values = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    at_rest = tuple(values[name] for name in controller.sensors)
    wanted = tuple(values[name] for name in controller.follows)
    F, G, H, J = controller_matrices(controller, at_rest, wanted * (1 + controller.preview))
    moved = _moved_by_measurement(F, G)
    return A, B, C[rows], F[np.ix_(moved, moved)], G[moved], H[:, moved], J


def _moved_by_measurement(F: Matrix, G: Matrix) -> npt.NDArray[np.int64]:
    """Return the states that measurements reach.

    A planner of the reference may hold or integrate on its own; it is no part of the loop, and its
    eigenvalues of one say nothing about it.
    """
    size = np.maximum(np.max(np.abs(np.hstack([F, G])), axis=1, keepdims=True), 1e-300)
    link = np.abs(F) / size > 1e-9
    reached = np.any(np.abs(G) / size > 1e-9, axis=1)
    for _ in range(len(F)):
        reached |= link @ reached
    return np.flatnonzero(reached)
