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
        scale: What an output of 1 means, in the unit of the port.
    """

    centre: Vector
    spread: Vector
    weights: Vector
    scale: float

    def parts(self) -> tuple[Vector, Vector, Vector, float]:
        """Return hidden weights (HIDDEN, n), hidden biases, output weights and output bias."""
        n = len(self.centre)
        w, b, v, c = np.split(self.weights, [HIDDEN * n, HIDDEN * (n + 1), HIDDEN * (n + 2)])
        return w.reshape(HIDDEN, n), b, v, float(c[0])

    def __call__(self, x: Vector) -> Vector:
        """Compute the output, shape (m,), in the unit of the port, of arguments (m, n), in SI."""
        w, b, v, c = self.parts()
        return np.asarray(self.scale * (np.tanh((x - self.centre) / self.spread @ w.T + b) @ v + c))

    def expression(self, arguments: Sequence[Expression]) -> Expression:
        """Return the output as an expression of its arguments."""
        w, b, v, c = self.parts()
        z = [(x - m) / s for x, m, s in zip(arguments, self.centre, self.spread, strict=True)]
        total: Expression = c
        for row, bias, out in zip(w, b, v, strict=True):
            inside = sum((float(k) * x for k, x in zip(row, z, strict=True)), float(bias))
            total = total + float(out) * ca.tanh(inside)
        return self.scale * total


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
    z, target = (x - centre) / spread, y / scale
    m, n = z.shape

    def cost(weights: Vector) -> tuple[float, Vector]:
        w, b, v, c = Network(centre, spread, weights, 1.0).parts()
        hidden = np.tanh(z @ w.T + b)
        error = (hidden @ v + c - target) / m
        back = np.outer(error, v) * (1.0 - hidden**2)
        slopes = [(back.T @ z).ravel(), back.sum(axis=0), hidden.T @ error, [error.sum()]]
        value = 0.5 * m * float(error @ error) + 0.5 * _DECAY * float(weights @ weights)
        return value, np.concatenate(slopes) + _DECAY * weights

    begin = np.random.default_rng(0).normal(scale=0.5, size=HIDDEN * (n + 2) + 1)
    found = minimize(cost, begin, jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
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
        return at.value + network.expression([at.known[name] for name in names])

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
