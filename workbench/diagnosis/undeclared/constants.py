"""A constant that the author of a plant holds, and that is another in the machine."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.diagnosis.estimation.prediction_error import Observed, filter_of, stack
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    ProcessNoiseFit,
    fit_with_process_noise,
)
from workbench.diagnosis.selection.refit_in_turn import NEARER
from workbench.diagnosis.selection.rules import LEAST_GAIN
from workbench.errors import NumericalError
from workbench.model import Model, Parameter

_FAR = 3.0
"""By what a constant may be multiplied or divided: no drawing and no data sheet is further off."""

_TRIED = 3
"""Constants that are refitted, of those that promise most."""

_PROMISES = 0.3
"""Part of what a rival gains that the slopes of a constant promise at least."""


class Freed(NamedTuple):
    """A model of which one constant is refitted, as its traits tell.

    Args:
        cost: Minus the log likelihood with it, dimensionless.
    """

    model: Model
    cost: float


def freed(model: Model, name: str) -> Model:
    """Return a model of which a constant is refitted beside what its author has refitted."""
    changed = tuple(_free(q) if q.name == name else q for q in model.parameters)
    held = (*model.traits.held, (name, model.parameter(name).value))
    traits = replace(model.traits, held=held)
    return replace(model, parameters=changed, traits=traits)


def likeliest_freed(
    model: Model,
    base: ProcessNoiseFit,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    rival: float = 0.0,
    among: Collection[str] | None = None,
) -> Freed | None:
    """Return the model whose constant explains most of what its refitted parameters leave.

    Of all constants those are refitted whose slopes promise most. What scales with others, so that
    no recording tells it from them, is none of them.

    Args:
        base: The refit with all constants held.
        priors: Those of the parameters that were refitted.
        rival: Log likelihood that something else gains, dimensionless: of what promises much less
            nobody waits for a refit.
        among: Names of those that are tried; all by default.
    """
    names = [q.name for q in model.parameters if _held(q) and (among is None or q.name in among)]
    promised = _promised(base, recordings, priors, names) if names else []
    best: Freed | None = None
    for gain, name in sorted(promised, reverse=True)[:_TRIED]:
        if gain < max(LEAST_GAIN, _PROMISES * rival):
            break
        other = freed(model, name)
        with contextlib.suppress(NumericalError):
            fit = fit_with_process_noise(
                other,
                recordings,
                (*priors, *default_priors(other, [name])),
                start=base.refit.values,
                noise_scale=base.noise_scale,
                enough=NEARER,
            )
            if best is None or fit.cost < best.cost:
                best = Freed(other, fit.cost)
    return best


def _held(q: Parameter) -> bool:
    """Whether an author holds a parameter, of the plant itself, that may be another."""
    return not (q.fitted or q.fixed or "." in q.name or q.value == 0.0 or q.lower == q.upper)


def _free(q: Parameter) -> Parameter:
    ends = sorted((q.value / _FAR, q.value * _FAR))
    return replace(q, fitted=True, lower=max(q.lower, ends[0]), upper=min(q.upper, ends[1]))


def _promised(
    base: ProcessNoiseFit,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    names: Sequence[str],
) -> list[tuple[float, str]]:
    """Return what a step of each constant gains beside those of what is refitted already.

    Trusted as little as the base is, equations that a constant has bent show it least: the largest
    of the gains under this and under more trust counts.
    """
    known = [q.name for q in priors]
    scale = np.array([base.model.parameter(q.name).scale for q in priors])
    prior = np.diag((scale / np.array([q.std for q in priors])) ** 2)
    found: dict[str, float] = {}
    below = [level for level in LADDER if level < base.noise_scale]
    for level in (base.noise_scale, *below[-1:]):
        filter_ = filter_of(base.model, recordings[0], level, [*known, *names])
        with contextlib.suppress(NumericalError, np.linalg.LinAlgError):
            errors, rows = stack(filter_.along(recordings, base.model.values))
            own, other = rows[:, : len(known)], rows[:, len(known) :]
            inverse = np.linalg.inv(own.T @ own + prior)
            part = inverse @ (own.T @ np.column_stack([other, errors]))
            left = np.column_stack([other, errors]) - own @ part
            slope, size = other.T @ left[:, -1], np.sum(other * left[:, :-1], axis=0)
            gains = np.divide(0.5 * slope**2, size, out=np.zeros_like(size), where=size > 0.0)
            for name, gain in zip(names, gains.tolist(), strict=True):
                found[name] = max(gain, found.get(name, 0.0)) if math.isfinite(gain) else 0.0
    return [(gain, name) for name, gain in found.items()]
