"""Baseline: unknown inputs and parameters as random walks, the most significant names the group.

After Kristensen, Madsen and Jorgensen (2004), who let parameters and inputs of a stochastic state
space model walk at random, estimate the intensities by maximum likelihood, and take a significant
one as the mark of the deficient equation; a person names what is wrong there. The augmented filter
is that of Friedland (1969): the innovations of the filter without the walk, regressed on their own
derivative by a constant offset, by a second filter over blocks of time.

Units: log likelihoods are dimensionless.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, extended_start
from workbench.diagnosis.location.locate import groups_of
from workbench.model import Effect, Model, Parameter

SIGNIFICANT = 30.0
"""Gain of log likelihood from which a walk counts as significant."""

BLOCK_S, BLOCK_SAMPLES = 0.05, 5
"""Time over which a walk is held, and the fewest samples of that."""

_INTENSITIES = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Deviation that a walk gathers in 1 s, over the size that is expected of it."""


def random_walk(
    base: ProcessNoiseFit, nominal: Model, recordings: Sequence[Observed]
) -> list[dict[str, Any]]:
    """Locate what is missing by the most significant random walk.

    Returns:
        Findings as a verdict has them: the ports of one group without a name, or nothing.
    """
    gains = walk_gains(base, nominal, recordings)
    best = max(gains, key=gains.__getitem__)
    if gains[best] < SIGNIFICANT:
        return []
    return [
        {"effect": None, "where": list(groups_of(base.model)[best]), "class": [], "gains": gains}
    ]


def walk_gains(
    base: ProcessNoiseFit, nominal: Model, recordings: Sequence[Observed]
) -> dict[str, float]:
    """Return the log likelihood that the best walk gains, by group of ports."""
    groups = {port: group for group, ports in groups_of(base.model).items() for port in ports}
    offsets = {f"walk_{i + 1}": port for i, port in enumerate(groups)}
    model = base.model.with_effect(*(_offset(base.model, *item) for item in offsets.items()))
    free = [f"{name}.amount" for name in offsets] + [e.name for e in base.refit.estimates]
    expected = [q.disturbance for q in base.model.ports if q.name in groups]
    expected += [0.1 * e.prior.std for e in base.refit.estimates]
    placed = [groups[port] for port in offsets.values()]
    placed += [_group_of(base.model, e.name, groups) for e in base.refit.estimates]
    first = recordings[0]
    filter_ = filter_of(model, first, base.noise_scale, free)
    length = max(BLOCK_SAMPLES, round(BLOCK_S / first.sample_time))
    told = []
    for seen in recordings:
        run = filter_.run(extended_start(seen, nominal, model), model.values)
        told.append(_blocks(run.whitened, run.jacobian, length))
    gains = {group: 0.0 for group in placed if group}
    for i, group in enumerate(placed):
        if not group:
            continue
        # The derivatives are by scaled parameters.
        size = (expected[i] or 1.0) / filter_.free_scale[i]
        for intensity in _INTENSITIES:
            step = size * intensity * np.sqrt(length * first.sample_time)
            total = sum(
                _gain(information[:, i], score[:, i], size, step) for information, score in told
            )
            gains[group] = max(gains[group], total)
    return gains


def _offset(model: Model, name: str, port: str) -> Effect:
    q = next(q for q in model.ports if q.name == port)
    return Effect(
        name,
        (port,),
        lambda at: at.value + at.p.amount,
        parameters=(Parameter("amount", q.unit, q.scale, "", 0.0),),
    )


def _group_of(model: Model, parameter: str, groups: dict[str, str]) -> str:
    """Return the group of the first port through which a parameter acts; empty for none."""
    trace = model.exact
    column = [q.name for q in model.parameters].index(parameter)
    by_port = ca.DM(ca.jacobian(trace.signals, trace.p[column]).sparsity(), 1).full()
    rows = {name: bool(row.any()) for name, row in zip(trace.signal_names, by_port, strict=True)}
    return next((group for port, group in groups.items() if rows.get(port)), "")


def _blocks(whitened: Vector, jacobian: Vector, length: int) -> tuple[Vector, Vector]:
    """Return information and score of a constant offset in each block, shape (n_blocks, n_free)."""
    used = np.isfinite(whitened)
    errors = np.where(used, whitened, 0.0)
    rows = np.where(used[:, :, None], jacobian, 0.0)
    edges = np.arange(0, len(errors), length)
    information = np.add.reduceat(np.sum(rows**2, axis=1), edges, axis=0)
    score = np.add.reduceat(-np.einsum("nu,nuf->nf", errors, rows), edges, axis=0)
    return information, score


def _gain(information: Vector, score: Vector, start: float, step: float) -> float:
    """Return the log likelihood that a walk gains over none.

    Args:
        start: Its deviation at the start, in scaled units.
        step: Its deviation gathered in a block, in scaled units.
    """
    mean, variance, gain = 0.0, start**2, 0.0
    for known, slope in zip(information.tolist(), score.tolist(), strict=True):
        left = slope - known * mean
        spread = 1.0 + variance * known
        gain += slope * mean - 0.5 * known * mean**2
        gain += 0.5 * left**2 * variance / spread - 0.5 * float(np.log(spread))
        mean += variance * left / spread
        variance = variance / spread + step**2
    return gain
