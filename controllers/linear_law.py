"""The law of a controller around rest: derivatives of its expressions, for margins.

A law that is written for symbols is differentiated as CasADi writes it, so that what is judged is
the law that runs, with its filters, its inner loops and its sample time, not a formula for it. A
controller says so with

    linear_law(state, measurement, reference, arithmetic, rest) -> (linear command, next state)

which a `controllers.law.ClosedForm` has, or, as an MPC within its limits, tells the matrices
with ``around_rest() -> LinearLaw``, from measurements and references. One that has neither, such as
one's own, is differenced.
"""

from __future__ import annotations

import numbers
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from controllers.arithmetic import SYMBOLS
from controllers.guard import unguarded
from controllers.named_state import flat, restored
from controllers.protocol import Controller
from workbench.arrays import Matrix
from workbench.errors import WorkbenchError

_SMALLEST = 1e-9
"""Smallest step of a difference as a share of a value, and smallest value that counts, in SI."""


class LinearLaw(NamedTuple):
    """``z[k+1] = F z[k] + G m[k], u[k] = H z[k] + J m[k]`` around rest, in SI.

    z are the entries of the state that measurements reach: a planner of the reference may hold or
    integrate on its own; it is no part of the loop.
    """

    F: Matrix
    G: Matrix
    H: Matrix
    J: Matrix


def linear_law(
    controller: Controller, measurement: tuple[float, ...], reference: tuple[float, ...]
) -> LinearLaw:
    """Linearise a controller from measurement to linear command around rest, given in SI.

    Its law must be smooth there.
    """
    controller = unguarded(controller)
    if rest := getattr(controller, "rest_output", ()):
        # What is linear between the ends of its commands may rest at one of them elsewhere.
        measurement = rest
        reference = rest[: len(controller.controlled)] * (1 + controller.preview)
    if hasattr(controller, "linear_law"):
        return _differentiated(controller, measurement, reference)
    if hasattr(controller, "around_rest"):
        F, G, H, J = controller.around_rest()
        measured = len(controller.sensors)
        return _of_measurements(F, G[:, :measured], H, J[:, :measured])
    return _differenced(controller, measurement, reference)


def to_system(
    controller: Controller, measurement: tuple[float, ...] = (), reference: tuple[float, ...] = ()
) -> Any:
    """Return a controller as a sampled ``control.StateSpace`` from measurements to commands.

    The sign is that of the law: with the plant it makes a loop of positive feedback.

    Args:
        measurement: Where it is linearised, in SI; by default at 0, or where it shall rest.
        reference: The reference there, in SI; what is measured there by default.

    Example:
        >>> from controllers.plain.transfer_law import pid_by_hand
        >>> pi = pid_by_hand(2.0, 10.0, measured="speed", actuator="voltage", sample_time=0.01)
        >>> K = to_system(pi)
        >>> K.input_labels, K.output_labels, K.dt
        (['speed'], ['voltage'], 0.01)
    """
    import control as ct

    at = measurement or (0.0,) * len(controller.sensors)
    places = [controller.sensors.index(name) for name in controller.controlled]
    wanted = reference or tuple(at[i] for i in places) * (1 + controller.preview)
    matrices = linear_law(controller, at, wanted)
    names = {"inputs": list(controller.sensors), "outputs": list(controller.actuators)}
    return ct.ss(*matrices, controller.sample_time, **names)


def _differentiated(
    controller: Any, measurement: tuple[float, ...], reference: tuple[float, ...]
) -> LinearLaw:
    example = controller.initial_state(measurement)
    z0 = np.array(flat(example), dtype=float)
    z, m = ca.SX.sym("z", len(z0)), ca.SX.sym("m", len(measurement))
    command, following = controller.linear_law(
        restored(example, ca.vertsplit(z)), tuple(ca.vertsplit(m)), reference, SYMBOLS, measurement
    )
    u, after = ca.vcat(command), ca.vcat(flat(following))
    # By the structure of the law.
    link, first = (ca.DM(ca.jacobian_sparsity(after, source), 1.0).full() > 0 for source in (z, m))
    moved = reached(first.any(axis=1), link)
    by = ca.vertcat(z[moved], m)
    slopes = ca.Function("slopes", [z, m], [ca.jacobian(ca.vertcat(after[moved], u), by)])
    # Tables have corners: there the mean of the slopes on both sides.
    sides = [slopes(z0, (1.0 + sign * 1e-9) * np.array(measurement)) for sign in (1.0, -1.0)]
    table = 0.5 * sum(side.full() for side in sides)
    n = len(moved)
    # What stands still at rest, such as an integration that is switched off, is no part of it.
    return _of_measurements(table[:n, :n], table[:n, n:], table[n:, :n], table[n:, n:])


def _of_measurements(F: Matrix, G: Matrix, H: Matrix, J: Matrix) -> LinearLaw:
    """Return the law of the entries of the state that measurements reach."""
    live = reached(np.any(G != 0.0, axis=1), F != 0.0)
    return LinearLaw(F[np.ix_(live, live)], G[live], H[:, live], J)


def reached(first: npt.NDArray[np.bool_], link: npt.NDArray[np.bool_]) -> list[int]:
    """Return the entries of the state that measurements reach, at once or over other entries."""
    found = first
    for _ in range(len(link)):
        found = found | (link @ found)
    return np.flatnonzero(found).tolist()


def _differenced(
    controller: Controller, measurement: tuple[float, ...], reference: tuple[float, ...]
) -> LinearLaw:
    example = controller.initial_state(measurement)
    if odd := [v for v in flat(example) if not isinstance(v, numbers.Real)]:
        raise WorkbenchError(
            f"{controller.name} keeps {type(odd[0]).__name__} in its state, where only numbers,"
            " alone or in tuples, have slopes and so margins"
        )
    z0, m0 = np.array(flat(example), dtype=float), np.array(measurement, dtype=float)
    n, stack = len(z0), np.concatenate([z0, m0])

    def run(values: Matrix) -> Matrix:
        state = restored(example, values[:n].tolist())
        command, following, _ = controller.step(state, tuple(values[n:].tolist()), reference)
        return np.array([*flat(following), *controller.linear_command(command)], dtype=float)

    def slope(i: int, size: float) -> Matrix:
        step = np.zeros(len(stack))
        step[i] = size
        return np.asarray((run(stack + step) - run(stack - step)) / (2.0 * size))

    beside = stack + 1e-3 * np.maximum(np.abs(stack), 1.0)
    if not np.allclose(run(beside), run(beside), rtol=1e-6, atol=0.0):
        raise WorkbenchError(
            f"{controller.name} answers the same state and measurement otherwise the second time,"
            " so it remembers something in itself; let step return it as the state, or there are no"
            " margins"
        )
    columns = []
    for i, value in enumerate(stack):
        # Small beside the clipping limits and the corners of the valve curve, whatever the unit: a
        # step is too large where a smaller one shows another slope.
        size = 1e-7 * max(abs(value), 1.0)
        found = slope(i, size)
        while size > _SMALLEST * max(abs(value), _SMALLEST):
            size *= 1e-2
            finer = slope(i, size)
            if np.allclose(found, finer, rtol=1e-3, atol=1e-6 * float(np.abs(finer).max())):
                break
            found = finer
        columns.append(found)
    table = np.array(columns).T
    F, G, H, J = table[:n, :n], table[:n, n:], table[n:, :n], table[n:, n:]
    size = np.maximum(np.max(np.abs(np.hstack([F, G])), axis=1, keepdims=True), 1e-300)
    moved = reached(np.any(np.abs(G) / size > 1e-9, axis=1), np.abs(F) / size > 1e-9)
    return LinearLaw(F[np.ix_(moved, moved)], G[moved], H[:, moved], J)
