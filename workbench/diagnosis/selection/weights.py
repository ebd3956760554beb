"""How likely each of the sets of effects is that were compared: a bagged posterior.

A posterior over models trusts that one of them is right. None is, and the difference of two that
are wrong in different moments is large and of a sign that another hour of recording might turn. So
the blocks of time are drawn anew many times, and the posteriors of the draws are averaged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from workbench.arrays import Vector

_DRAWS = 400
_SEED = 20


class Compared(NamedTuple):
    """A set of effects whose refit was judged on all recordings.

    Args:
        effects: Names, in alphabetical order; empty for the refitted nominal model.
        blocks: Cost on the fitting and on the held-out recordings by block of time, shape
            (n_blocks,) each, dimensionless.
    """

    effects: tuple[str, ...]
    blocks: tuple[Vector, ...]


class Weighted(NamedTuple):
    """A set of effects with its weight.

    Args:
        weight: Weight among the sets that were compared, 0 to 1, dimensionless.
    """

    effects: tuple[str, ...]
    weight: float

    def __str__(self) -> str:
        return " + ".join(self.effects) or "nothing"


def set_weights(compared: Sequence[Compared], penalty: float) -> tuple[Weighted, ...]:
    """Return the weights of sets of effects, the likeliest first.

    ``w = mean over draws b of exp(-C_b - penalty n) / sum``, with the cost ``C_b`` of a set of n
    effects summed over blocks of time that are drawn with replacement.

    Args:
        compared: The sets; of several refits of one set the likeliest counts, and what has other
            blocks than the first is left out.
        penalty: Log likelihood that an effect must gain, dimensionless.

    Source:
        Huggins and Miller, Reproducible model selection using bagged posteriors, Bayesian
        Analysis 18 (2023); Buehlmann, Discussion of big Bayes stories, Statistical Science 29
        (2014).

    Example:
        >>> even, uneven = np.zeros(40), np.tile([-30.0, 30.0], 20)
        >>> sets = [Compared(("a",), (even, even)), Compared(("b",), (uneven, uneven))]
        >>> [round(weighted.weight, 1) for weighted in set_weights(sets, 20.0)]
        [0.5, 0.5]
    """
    costs: dict[tuple[str, ...], Vector] = {}
    shape: tuple[int, ...] = ()
    for effects, blocks in compared:
        shape = shape or tuple(len(part) for part in blocks)
        cost = np.concatenate(blocks)
        usable = tuple(len(part) for part in blocks) == shape and bool(np.isfinite(cost).all())
        if usable and not (effects in costs and costs[effects].sum() <= cost.sum()):
            costs[effects] = cost
    if not costs:
        return ()
    table = np.array(list(costs.values()))
    penalties = penalty * np.array([len(effects) for effects in costs])
    rng = np.random.default_rng(_SEED)
    count = table.shape[1]
    times = rng.multinomial(count, np.full(count, 1.0 / count), size=_DRAWS)
    total = times @ table.T + penalties
    likelihood = np.exp(total.min(axis=1, keepdims=True) - total)
    weights = (likelihood / likelihood.sum(axis=1, keepdims=True)).mean(axis=0)
    found = (Weighted(effects, float(w)) for effects, w in zip(costs, weights, strict=True))
    return tuple(sorted(found, key=lambda weighted: -weighted.weight))
