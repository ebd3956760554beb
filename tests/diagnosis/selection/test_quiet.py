"""What is refitted where nothing is left out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.diagnosis.newcomers import levels, oscillator, recorded
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.selection.search import score, search
from workbench.diagnosis.selection.task import Task
from workbench.physics.library import library


@pytest.mark.parametrize(("excess", "tried"), [(0.0, 0), (500.0, 3)])
def test_held_out_runs_a_little_off_by_chance_call_for_no_law_that_does_not_score(
    excess: float, tried: int
) -> None:
    model = oscillator()
    force = lambda x, v: -30.0 * x - 0.6 * v  # noqa: E731
    seen = [
        observe(model, recorded(1.2, force, levels(200, i, 6.0, 15, 40), 0.02, 1e-3, seed=i))
        for i in (1, 2)
    ]
    priors = default_priors(model)
    base = fit_with_process_noise(model, seen[:1], priors)
    laws = ("cubic_stiffness", "coulomb_friction", "quadratic_drag")
    few = tuple(e for e in library(model) if e.law in laws)
    task = Task(model, base, (seen[0],), (seen[1],), priors, entries=few, jobs=1)
    scored = replace(score(task), over_floor={"position": 1.15}, excess=excess)
    first = next(iter(search(task, scored)))
    assert len(first.rounds[0].candidates) == tried
    # However little a filter trusts equations that leave nothing out, they are complete.
    assert scored.near_noise(replace(base, noise_scale=0.3)) is (excess == 0.0)
    assert not first.accepted
