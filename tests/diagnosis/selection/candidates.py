"""Scores and candidates of the arm's library, made up for tests."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.held_out import RunErrors
from workbench.diagnosis.selection.rules import Limits
from workbench.diagnosis.selection.score import Score
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.library import library
from workbench.plants.arm import arm


def made_score(entry: Hypothesis | str, gain: float, collinearity: float = 0.2) -> Score:
    entry = entries()[entry] if isinstance(entry, str) else entry
    return Score(entry, gain, 9.0, entry.typical_size, 0.1, collinearity, 0.01 * entry.largest_size)


@cache
def entries() -> dict[str, Hypothesis]:
    """Entries of the arm by name."""
    return {entry.name: entry for entry in library(arm(3))}


def run_of(error: float) -> RunErrors:
    """Return the errors of a free run, whose mean square is that of noise about them."""
    squares = error**2 * np.random.default_rng(0).uniform(0.8, 1.2, (40, 1))
    return RunErrors(squares, squares.mean(axis=0) / 40)


def estimated(value: float, std: float) -> SimpleNamespace:
    return SimpleNamespace(value=value, std=std, unit="s", prior=SimpleNamespace(upper=0.0))


def model_that(*misread: tuple[str, float]) -> SimpleNamespace:
    inputs = tuple(SimpleNamespace(name=name, unit="rad") for name, _ in misread)
    return SimpleNamespace(traits=SimpleNamespace(misread=misread), inputs=inputs)


def made_candidate(
    entry: Hypothesis | str,
    gain: float,
    error: float,
    *,
    unseen: float | None = None,
    uneven: float = 0.0,
    scale: float = 1.0,
    parameters: int | None = None,
    on_bound: str = "",
) -> Candidate:
    """Return a candidate whose free runs have an error; that without any is 1.

    Its costs go up and down by ``uneven`` from block to block, on unseen recordings too.
    """
    entry = entries()[entry] if isinstance(entry, str) else entry
    values = {q.name: q.value for q in entry.effect.parameters}
    values |= {entry.size_parameter: entry.typical_size}

    def estimate(name: str) -> Any:
        value = values[name.removeprefix(f"{entry.name}.")]
        return estimated(value, 1e-3 * value)

    own = [q.name for q in entry.effect.parameters if q.fitted]
    own = own if parameters is None else list(map(str, range(parameters)))
    estimates = [SimpleNamespace(name=f"{entry.name}.{n}", on_bound=n == on_bound) for n in own]
    refit = SimpleNamespace(converged=True, estimate=estimate, estimates=estimates)
    fit = cast(
        Any, SimpleNamespace(name=entry.name, refit=refit, noise_scale=scale, model=model_that())
    )
    later = gain if unseen is None else unseen
    blocks = tuple(np.tile([-uneven, uneven], 20) - g / 40 for g in (gain, later))
    held_out = (later, 0.8 * later, 1.2 * later)
    return Candidate(entry, fit, gain, held_out, shift=5.0, blocks=blocks, run=run_of(error))


def trusting(candidate: Candidate) -> Any:
    return SimpleNamespace(**{**vars(cast(Any, candidate.fit)), "noise_scale": 0.003})


def taken_of(candidates: tuple[Candidate, ...]) -> list[str]:
    return [c.entry.name for c in candidates if not c.refused]


WITHOUT = run_of(1.0)
ASKED = Limits(20.0, 100.0)
