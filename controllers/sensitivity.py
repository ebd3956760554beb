"""Sensitivity peaks of a sampled controller on a linear model."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.guard import unguarded
from controllers.joint.model import OPENING
from controllers.linear_law import linear_law
from controllers.protocol import Controller
from controllers.valve_inverse import ValveInverse
from workbench.errors import check_choice

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

Matrix = npt.NDArray[np.float64]


def peak_sensitivities(
    controller: Controller, linear: LinearModel, *, points: int = 300, late: int = 0
) -> tuple[float, float]:
    """Compute Ms and Mt of the loop opened at the measured first sensor.

    All other loops stay closed: for a cascade this is the outer loop. The plant is discretised
    with held inputs at the controller's sample time, so the delay of sampling is included. What the
    measurements do not show, such as an angle where a speed is controlled, does not count.

    Returns:
        Both ratios, infinite if the loop is not stable.

    Source:
        Åström and Hägglund, Advanced PID Control, 2006, section 4.6.
    """
    return peaks_of(loop_matrices(controller, linear), controller.sample_time, points, late)


def peaks_of(
    loop_parts: LoopMatrices, sample_time: float, points: int = 300, late: int = 0
) -> tuple[float, float]:
    """Compute what `peak_sensitivities` does, ratios, from the matrices of a loop.

    Args:
        sample_time: Time between samples, in s.
        late: Samples by which every command arrives late.
    """
    A, B, C, F, G, H, J = loop_parts
    _, sizes, directions = np.linalg.svd(np.vstack([A - np.eye(len(A)), C]))
    if np.min(sizes) <= 1e-12 * np.max(sizes):
        shown = directions[sizes > 1e-12 * sizes.max()].T
        A, B, C = shown.T @ A @ shown, shown.T @ B, C @ shown
    for _ in range(late):
        n, m = B.shape
        A = np.block([[A, B], [np.zeros((m, n + m))]])
        B = np.vstack([np.zeros((n, m)), np.eye(m)])
        C = np.hstack([C, np.zeros((len(C), m))])
    closed = np.block([[A + B @ J @ C, B @ H], [G @ C, F]])
    if np.max(np.abs(np.linalg.eigvals(closed))) >= 1.0:
        return float("inf"), float("inf")
    # Opened at sensor 0: its measurement comes from outside, the others stay connected.
    keep = np.ones(len(C))
    keep[0] = 0.0
    rest = np.diag(keep) @ C
    first = np.zeros((len(C), 1))
    first[0] = 1.0
    a = np.block([[A + B @ J @ rest, B @ H], [G @ rest, F]])
    b = np.vstack([B @ J @ first, G @ first])
    c = np.hstack([C[:1], np.zeros((1, len(F)))])
    h = sample_time
    angle = np.geomspace(2 * np.pi * 0.05 * h, 0.98 * np.pi, points)
    values, vectors = np.linalg.eig(a)
    left = (c @ vectors).ravel()
    right = np.linalg.solve(vectors, b.astype(complex)).ravel()
    z = np.exp(1j * angle)
    loop = -((left * right) / (z[:, None] - values)).sum(axis=1)
    ms = float(np.max(np.abs(1.0 / (1.0 + loop))))
    mt = float(np.max(np.abs(loop / (1.0 + loop))))
    return ms, mt


class LoopMatrices(NamedTuple):
    """The sampled plant (A, B, C) and the law (F, G, H, J) of a loop around rest, in SI.

    Rows of C are the controller's sensors in their order.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    F: Matrix
    G: Matrix
    H: Matrix
    J: Matrix


def loop_matrices(controller: Controller, linear: LinearModel) -> LoopMatrices:
    """Return plant and law of a loop around rest.

    Raises:
        WorkbenchError: If the linear model lacks a sensor or an actuator.
    """
    for name in (*controller.sensors, *controller.controlled):
        check_choice("output of the linear model", name, linear.output_names)
    rows = [linear.output_names.index(name) for name in controller.sensors]
    A, B, C, _ = linear.discretise(controller.sample_time)
    valve = getattr(unguarded(controller), "valve", None)
    if isinstance(valve, ValveInverse) and OPENING in linear.input_names:
        B = B[:, [linear.input_names.index(OPENING)]] * valve.gain_at_rest
    else:
        for name in controller.actuators:
            check_choice("input of the linear model", name, linear.input_names)
        B = B[:, [linear.input_names.index(name) for name in controller.actuators]]
    values = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    at_rest = tuple(values[name] for name in controller.sensors)
    reference = tuple(values[name] for name in controller.controlled)
    law = linear_law(controller, at_rest, reference * (1 + controller.preview))
    return LoopMatrices(A, B, C[rows], *law)
