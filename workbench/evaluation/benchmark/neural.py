"""Baseline: a small neural network at a port, after universal differential equations.

After Rackauckas and others (2020): what the equations leave out at a port is a network of the
states and inputs. The smoothed unknown input of each group of ports is its target; the group whose
signal it predicts best on blocks that it was not trained on gets the network as a part of the
equations. It improves predictions and names nothing.

Units: inputs and output of the network are scaled, dimensionless.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import free_run, rms_of
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, extended_start
from workbench.diagnosis.location.locate import groups_of
from workbench.diagnosis.location.unknown_input import unknown_input
from workbench.errors import NumericalError
from workbench.model import Effect, Model, PortView
from workbench.model.regularisation import Expression

HIDDEN = 8
"""Units of the hidden layer."""

LEAST_R2 = 0.3
"""Share of the signal's variance that must be predicted on blocks left out."""

_ROWS, _FOLDS, _DECAY, _STEPS = 1500, 4, 1e-3, 200


@dataclass(frozen=True)
class Network:
    """One hidden layer of tanh.

    Args:
        centre: Means of its arguments, shape (n,), in SI.
        spread: Their deviations, shape (n,), in SI.
        weights: Those of the hidden layer with its biases, and of the output with its bias.
        scale: What an output of 1 means, in the unit of the port.
    """

    centre: Vector
    spread: Vector
    weights: Vector
    scale: float

    def expression(self, arguments: Expression) -> Expression:
        """Return the output, in the unit of the port, for a column of arguments, in SI."""
        return self.scale * _output((arguments - self.centre) / self.spread, ca.DM(self.weights))

    def __call__(self, x: Vector) -> Vector:
        """Compute the output, shape (m,), in the unit of the port, of arguments (m, n), in SI."""
        column = ca.SX.sym("x", x.shape[1])
        of_one = ca.Function("network", [column], [self.expression(column)])
        return np.asarray(of_one(x.T), dtype=float).ravel()


def _output(z: Expression, weights: Expression) -> Expression:
    """Return a row of outputs for columns of scaled arguments."""
    n = z.shape[0]
    ends = [0, HIDDEN * n, HIDDEN * (n + 1), HIDDEN * (n + 2), HIDDEN * (n + 2) + 1]
    inside, biases, outside, bias = ca.vertsplit(weights, ends)
    hidden = ca.reshape(inside, n, HIDDEN).T @ z + ca.repmat(biases, 1, z.shape[1])
    return outside.T @ ca.tanh(hidden) + bias


def trained(x: Vector, y: Vector) -> Network:
    """Train a network by least squares with weight decay.

    Args:
        x: Arguments, shape (m, n), in SI.
        y: Targets, shape (m,), in the unit of the port.
    """
    from scipy.optimize import minimize

    centre, spread = x.mean(axis=0), x.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    scale = float(np.std(y)) or 1.0
    begin = np.random.default_rng(0).normal(scale=0.5, size=HIDDEN * (x.shape[1] + 2) + 1)
    weights = ca.MX.sym("weights", len(begin))
    error = _output(ca.DM((x - centre) / spread).T, weights) - ca.DM(y / scale).T
    value = 0.5 * ca.sumsqr(error) / len(y) + 0.5 * _DECAY * ca.sumsqr(weights)
    cost = ca.Function("cost", [weights], [value, ca.gradient(value, weights)])

    def told(at: Vector) -> tuple[float, Vector]:
        found, slope = cost(at)
        return float(found), np.asarray(slope).ravel()

    found = minimize(told, begin, jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
    return Network(centre, spread, np.asarray(found.x), scale)


def neural(
    base: ProcessNoiseFit, nominal: Model, fitting: Sequence[Observed], judging: Sequence[Observed]
) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Put a network where it predicts most of what is missing.

    Returns:
        Findings as a verdict has them, one without a name or none, and the errors of free runs with
        the network on the held-out recordings by output, in SI; nothing without a finding.
    """
    model, best = base.model, (LEAST_R2, "", np.empty((0, 0)), np.empty(0))
    started = [extended_start(seen, nominal, model) for seen in fitting]
    for ports in groups_of(model).values():
        try:
            parts = [unknown_input(model, seen, ports[:1]) for seen in started]
        except NumericalError:
            continue
        every = max(1, sum(len(part.time) for part in parts) // _ROWS)
        x = np.concatenate([np.hstack([q.states, q.inputs])[::every] for q in parts])
        y = np.concatenate([part.signal[::every, 0] for part in parts])
        share = _predicted(x, y)
        if share > best[0]:
            best = share, ports[0], x, y
    if not best[1]:
        return [], {}
    network = trained(best[2], best[3])
    names = [q.name for q in (*model.states, *model.inputs)]

    def transform(at: PortView) -> Expression:
        return at.value + network.expression(ca.vertcat(*(at.known[name] for name in names)))

    extended = model.with_effect(Effect("network", (best[1],), transform))
    runs = [free_run(extended, extended_start(seen, nominal, extended)).rmse for seen in judging]
    found = {"effect": "nonparametric", "where": [best[1]], "class": ["nonparametric"]}
    return [found | {"r2": best[0]}], rms_of(runs)


def _predicted(x: Vector, y: Vector) -> float:
    """Return the share of the variance that networks predict on blocks left out."""
    left = 0.0
    for fold in np.array_split(np.arange(len(y)), _FOLDS):
        others = np.setdiff1d(np.arange(len(y)), fold)
        left += float(np.sum((y[fold] - trained(x[others], y[others])(x[fold])) ** 2))
    return 1.0 - left / max(float(np.sum((y - y.mean()) ** 2)), 1e-300)
