"""The last refit of a hypothesis that is followed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.diagnosis.selection import final_refit
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.refit_in_turn import Basis
from workbench.physics.drift import offset_jump
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.survey import Survey
from workbench.plants.arm import arm


@pytest.mark.parametrize(("gained", "searches"), [(0.0, 1), (20.0, 2)])
def test_times_of_an_event_that_gain_nothing_are_searched_once(
    monkeypatch: pytest.MonkeyPatch, gained: float, searches: int
) -> None:
    survey = Survey(arm(3), RecordedFacts(duration=20.0))
    (jump,) = [h for h in offset_jump.hypotheses(survey) if h.ports == ("joint.torque",)]
    costs = [-100.0 - gained * k for k in range(3)]
    told = []

    def fitted(cost: float) -> Any:
        refit = SimpleNamespace(estimates=(), values={}, converged=True)
        model = SimpleNamespace(effects=[jump.effect])
        return SimpleNamespace(cost=cost, noise_scale=1.0, refit=refit, model=model)

    def own_starts(effects: Any, *_: Any) -> Any:
        told.append(effects)
        return (replace(effects[0], states=effects[0].states[:]),)

    monkeypatch.setattr(
        final_refit, "in_turn", lambda _, entry, *__, **___: (entry, fitted(costs.pop(0)), [])
    )
    monkeypatch.setattr(final_refit, "with_own_starts", own_starts)
    monkeypatch.setattr(final_refit, "changed_values", lambda *_: {})
    monkeypatch.setattr(final_refit, "level_everywhere", lambda _: None)
    monkeypatch.setattr(final_refit, "blocks_of_cost", lambda *_: np.zeros(1))
    monkeypatch.setattr(final_refit, "closest_errors", lambda *_: None)
    first = Candidate(jump, fitted(0.0), 100.0)
    base: Any = SimpleNamespace(cost=0.0, model=None)
    final_refit._judged_on(Basis(base, (), ()), first, (), None)
    assert len(told) == searches
