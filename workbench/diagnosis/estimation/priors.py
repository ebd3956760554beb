"""What is known of parameters before the data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.errors import WorkbenchError
from workbench.model import Model, Parameter
from workbench.model.model import index_of
from workbench.physics.hypothesis import Hypothesis

_WIDE = 100.0
"""Ratio of the bounds of a parameter beyond which its usual value is a guess only."""


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before the data: a normal distribution within bounds.

    Args:
        mean: Most likely value, in the parameter's SI unit.
        std: Standard deviation, in the parameter's SI unit.
        lower: Smallest value, in the parameter's SI unit.
        upper: Largest value, in the parameter's SI unit.
    """

    name: str
    mean: float
    std: float
    lower: float
    upper: float

    def is_bound(self, value: float) -> bool:
        """Say whether a value, in the parameter's SI unit, sits on a bound."""
        return min(value - self.lower, self.upper - value) < 1e-3 * (self.upper - self.lower)


def is_guess(q: Parameter) -> bool:
    """Say whether the value of a parameter is a guess only, which no refit changes."""
    return not q.fitted and 0.0 < q.lower <= q.upper / _WIDE


def default_priors(model: Model, names: Sequence[str] | None = None) -> tuple[Prior, ...]:
    """Return priors centred on a model's values, a quarter of the bounds wide.

    Args:
        names: Names of the free parameters; all that a refit may change by default.
    """
    chosen = [q.name for q in model.parameters if q.fitted] if names is None else list(names)
    priors = []
    for name in chosen:
        q = model.parameters[index_of("parameter", name, model.parameters)]
        if not (np.isfinite(q.lower) and np.isfinite(q.upper)):
            raise WorkbenchError(
                f"parameter {name} has the bounds {q.lower:g} to {q.upper:g} {q.unit}; a free"
                " parameter needs finite bounds: give Parameter(...) the lower and upper between"
                " which it surely lies"
            )
        priors.append(Prior(name, q.value, (q.upper - q.lower) / 4, q.lower, q.upper))
    return tuple(priors)


def guesses(model: Model, spread: float, far: float = math.inf) -> list[Prior]:
    """Return what no refit to prediction errors changes, such as the speed of a rounded reversal.

    Only laws of the model's effects guess.

    Args:
        spread: Standard deviation over the value, dimensionless.
        far: By what the value may be multiplied or divided within its bounds, dimensionless.
    """
    effects = {effect.name for effect in model.effects}
    return [
        Prior(
            q.name, q.value, spread * q.value, max(q.lower, q.value / far),
            min(q.upper, q.value * far),
        )
        for q in model.parameters
        if q.name.split(".")[0] in effects and is_guess(q)
    ]  # fmt: skip


def entry_priors(entry: Hypothesis) -> tuple[Prior, ...]:
    """Return the priors of an effect's own parameters: its size, and shapes that are refitted.

    The size of a law that is either there or not is fixed.
    """
    priors = []
    for q in entry.effect.parameters:
        name = f"{entry.name}.{q.name}"
        if q.name == entry.size_parameter and not entry.replaces:
            # A wide prior about zero: absence is as plausible as any size. What recordings were
            # moved ahead by leaves no less.
            low = q.lower + sum(entry.advanced.values())
            priors.append(Prior(name, 0.0, entry.largest_size, low, q.upper))
        elif q.fitted and np.isfinite(q.lower) and np.isfinite(q.upper):
            priors.append(Prior(name, q.value, (q.upper - q.lower) / 4, q.lower, q.upper))
    return tuple(priors)


def entry_start(entry: Hypothesis, size: float = 0.0) -> dict[str, float]:
    """Return where to start an effect's own parameters, by name, in SI: the library's shape.

    Args:
        size: Its expected size, in its unit.
    """
    own = {p.name: p for p in entry_priors(entry)}
    start = {name: p.mean for name, p in own.items()}
    if not entry.replaces:
        bounds = own[entry.size_name]
        start[entry.size_name] = float(np.clip(size, bounds.lower, bounds.upper))
    return start
