"""Simple terms that describe a curve, with how often they are chosen when its ordinates scatter."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from workbench.arrays import Vector

_MOST = 3
_ENOUGH = 0.98
_FREQUENCIES = 40


@dataclass(frozen=True)
class Term:
    """A term that describes part of a curve.

    Args:
        name: The term, such as ``"x^3"`` or ``"sin(20.1 x)"``; that of a frequency stands for the
            sine and cosine.
        frequency: Share of the drawn curves in whose description it is, 0 to 1, dimensionless.
    """

    name: str
    frequency: float

    def __str__(self) -> str:
        return f"{self.name} ({100 * self.frequency:.0f} %)"


def describing_terms(x: Vector, curve: Vector, draws: Vector) -> tuple[Term, ...]:
    """Describe a curve by a constant and up to three of x, x^2, x^3, |x|, sign x and a frequency.

    For every drawn curve the term that takes away most of what is left is added until 98 % of the
    variation is described.

    Args:
        x: Abscissae, shape (n,), in SI.
        curve: The curve there, shape (n,), in any unit.
        draws: The same for curves with scattered ordinates, shape (n_draws, n), in that unit.

    Returns:
        Terms by falling frequency, those of at least one draw in ten.
    """
    # A sine that does not complete a period on the data is no sine but a slope.
    span = float(x[-1] - x[0])
    waves = np.pi / span * np.geomspace(2.0, len(x) / 4, _FREQUENCIES)
    size = float(np.abs(x).max()) or 1.0
    columns: dict[str, Vector] = {
        "x": (x / size)[:, None],
        "x^2": (x / size)[:, None] ** 2,
        "x^3": (x / size)[:, None] ** 3,
    }
    if x[0] < -0.1 * span and x[-1] > 0.1 * span:
        columns |= {"|x|": np.abs(x / size)[:, None], "sign x": np.sign(x)[:, None]}
    for k in waves:
        columns[f"sin({k:.3g} x)"] = np.column_stack([np.sin(k * x), np.cos(k * x)])
    count: Counter[str] = Counter()
    best = _chosen(columns, curve)
    wave = next((name for name in best if name.startswith("sin")), "sin")
    for drawn in draws:
        names = {wave if n.startswith("sin") else n for n in _chosen(columns, drawn)}
        count.update(names)
    return tuple(
        Term(name, number / len(draws))
        for name, number in count.most_common()
        if number >= 0.1 * len(draws)
    )


def _chosen(columns: dict[str, Vector], curve: Vector) -> list[str]:
    whole = float(np.sum((curve - curve.mean()) ** 2))
    names: list[str] = []

    def left(trial: list[str]) -> float:
        matrix = np.column_stack([np.ones(len(curve)), *(columns[name] for name in trial)])
        answer = np.linalg.lstsq(matrix, curve, rcond=None)[0]
        # A frequency has two coefficients and a choice of its own: it must be worth two terms.
        penalty = 1.0 + 0.5 * sum(name.startswith("sin") for name in trial)
        return penalty * float(np.sum((curve - matrix @ answer) ** 2))

    while len(names) < _MOST:
        rest = {n: left([*names, n]) for n in columns if n not in names}
        best = min(rest, key=rest.__getitem__)
        names.append(best)
        if rest[best] < (1.0 - _ENOUGH) * whole:
            break
    return names
