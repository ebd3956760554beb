"""The functions that a nonlinear MPC evaluates: one stage of its prediction, one of its observer.

Both integrate dx/dt = f(x, u, theta + w_theta) + E w_x with the classical Runge-Kutta method in a
fixed number of steps, together with its derivatives (the variational equations of the same method,
so that they are those of the discrete map and not of another one). A stage is built once and mapped
over the horizon: the code stays small however long the horizon is.

States are counted in their scales, z = x / scale. States that settle at once, such as a spool much
faster than a stage, are left out of the prediction: with rates linear in them they are replaced by
the value at which they rest.

Source: Diehl et al., Real-time optimization and nonlinear model predictive control of processes
governed by differential-algebraic equations, Journal of Process Control 12, 2002 (multiple
shooting, derivatives of the discrete map).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from workbench.arrays import Matrix
from workbench.errors import WorkbenchError, check_choice
from workbench.model import Model

Compile = Callable[[ca.Function], ca.Function]
"""Turns a CasADi function into a faster one with the same results."""


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Rates of a model in scaled states, with derivatives.

    Args:
        function: (z, u, w) -> (dz/dt, its derivatives by z, by u and by w).
        scale: Scales of the states, shape (n,), in SI.
        unit: What 1 of each disturbance w is, shape (n_w,), in SI: of a state's rate or of a
            parameter.
    """

    function: ca.Function
    names: tuple[str, ...]
    scale: Matrix
    unit: Matrix

    @property
    def disturbances(self) -> int:
        """Number of disturbances w."""
        return len(self.unit)


def dynamics(
    model: Model,
    disturbed: tuple[str, ...],
    *,
    unknown: tuple[str, ...] = (),
    resting: tuple[str, ...] = (),
) -> Dynamics:
    """Write down the regularised rates of a model with its parameters put in.

    Args:
        disturbed: Names of the states whose rates are disturbed; w is in scales per second.
        unknown: Names of parameters that differ from their values by w, in scales, the last of w.
        resting: Names of states that are replaced by the value at which they rest.

    Raises:
        WorkbenchError: If a name is unknown, or the rates of the resting states are not linear in
            them.
    """
    traced = model.regularised
    names = [q.name for q in model.states]
    for name in (*disturbed, *resting):
        check_choice("state of the prediction model", name, names)
    size = np.array([q.scale for q in model.states])
    parameters = [q.name for q in model.parameters]
    for name in unknown:
        check_choice("unknown parameter of the prediction model", name, parameters)
    off = [parameters.index(name) for name in unknown]
    unit = np.array([model.parameters[i].scale for i in off])
    z, w = ca.SX.sym("z", len(names)), ca.SX.sym("w", len(disturbed) + len(unknown))
    values = ca.SX(ca.DM(model.values))
    values[off] += unit * w[len(disturbed) :]
    rates = ca.substitute(
        traced.rates / size, ca.vertcat(traced.x, traced.p), ca.vertcat(z * size, values)
    )
    fast = [names.index(name) for name in resting]
    slow = [i for i in range(len(names)) if i not in fast]
    if fast:
        at_rest = _solved(rates[fast], z[fast])
        rates = ca.substitute(rates[slow], z[fast], at_rest)
    kept = tuple(names[i] for i in slow)
    E = np.zeros((len(slow), len(disturbed)))
    for i, name in enumerate(disturbed):
        check_choice("disturbed state", name, kept)
        E[kept.index(name), i] = 1.0
    rates = rates + ca.DM(E) @ w[: len(disturbed)]
    outputs = [rates, *(ca.densify(ca.jacobian(rates, by)) for by in (z[slow], traced.u, w))]
    function = ca.Function("dynamics", [z[slow], traced.u, w], ca.cse(outputs))
    rows = size[[names.index(name) for name in disturbed]]
    return Dynamics(function, kept, size[slow], np.concatenate([rows, unit]))


def _solved(rates: ca.SX, states: ca.SX) -> ca.SX:
    slope = ca.jacobian(rates, states)
    if ca.depends_on(slope, states):
        raise WorkbenchError(
            "the rates of the states that are taken to rest are not linear in them; predict them"
            " like the others"
        )
    return -ca.solve(slope, ca.substitute(rates, states, ca.SX.zeros(states.numel())))


def discrete(rates: Dynamics, duration: float, steps: int, name: str) -> ca.Function:
    """Build the map over one stage of a duration in s and its derivatives.

    Source:
        Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.1.
    """
    f = rates.function
    n, n_u, n_w = len(rates.names), f.size1_in(1), rates.disturbances
    z, u, w = ca.MX.sym("z", n), ca.MX.sym("u", n_u), ca.MX.sym("w", n_w)
    h = duration / steps
    at = z
    # Derivatives by (z, u, w) side by side; u and w enter every rate directly as well.
    slope = ca.horzcat(ca.MX.eye(n), ca.MX.zeros(n, n_u + n_w))
    slope = ca.densify(slope)
    for _ in range(steps):
        rate, turn = ca.MX.zeros(n), ca.MX.zeros(n, n + n_u + n_w)
        k, d = ca.MX.zeros(n), ca.MX.zeros(n, n + n_u + n_w)
        for ahead, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            moved = slope + (ahead * h) * d
            k, by_z, by_u, by_w = f(at + (ahead * h) * k, u, w)
            d = by_z @ moved + ca.horzcat(ca.MX.zeros(n, n), by_u, by_w)
            rate, turn = rate + weight * k, turn + weight * d
        at, slope = at + (h / 6.0) * rate, slope + (h / 6.0) * turn
    parts = ca.horzsplit(slope, [0, n, n + n_u, n + n_u + n_w])
    return ca.Function(name, [z, u, w], [at, *parts])


def shooting(stage: ca.Function, stages: int) -> ca.Function:
    """Map a stage over a horizon: (Z, U, W), a column per stage -> the results side by side."""
    n, n_u, n_w = (stage.size1_in(i) for i in range(3))
    Z, U, W = (ca.MX.sym(name, rows, stages) for name, rows in (("Z", n), ("U", n_u), ("W", n_w)))
    result = stage.map(stages)(Z, U, W)
    return ca.Function("shooting", [Z, U, W], list(result[:3]))


def measurements(model: Model, sensors: tuple[str, ...]) -> ca.Function:
    """Build the function (z, u) -> regularised measurements in SI, and their derivatives by z."""
    outputs = [q.name for q in model.outputs]
    for name in sensors:
        check_choice("sensor", name, outputs)
    traced = model.regularised
    size = np.array([q.scale for q in model.states])
    z = ca.SX.sym("z", len(size))
    y = ca.substitute(
        traced.outputs[[outputs.index(name) for name in sensors]],
        ca.vertcat(traced.x, traced.p),
        ca.vertcat(z * size, ca.DM(model.values)),
    )
    return ca.Function("measurements", [z, traced.u], [y, ca.densify(ca.jacobian(y, z))])
