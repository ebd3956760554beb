"""What no refit changes in an effect, found in turn with its refit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.diagnosis.newcomers import damper, rubbed
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.selection import refit_in_turn
from workbench.physics.friction import coulomb_friction
from workbench.physics.hypothesis import Hypothesis


@pytest.mark.parametrize("guess", [2e-4, 0.03])
def test_a_guess_is_tuned_to_the_truth_from_a_plateau_too_on_every_recording(guess: float) -> None:
    friction = coulomb_friction("damper.force", level=4.0, transition_speed=guess, upper=20.0)
    model = damper().with_parameters({"damping": 2.0}).with_effect(friction)
    fit = cast(Any, SimpleNamespace(model=model, noise_scale=0.3))
    seen = [observe(model, run) for run in rubbed()]
    still = replace(seen[0], inputs=0.0 * seen[0].inputs, outputs=0.0 * seen[0].outputs)
    for recordings in (seen, [still, *seen], [*seen, still]):
        tuned = refit_in_turn.tuned(Hypothesis(friction, "level", 1.0), fit, recordings).effect
        (speed,) = (q.value for q in tuned.parameters if q.name == "transition_speed")
        # A reversal is sampled some ten times; the recordings round it over 0.05 m/s.
        assert speed == pytest.approx(0.05, rel=0.02)
