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
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.arm import arm


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


@pytest.mark.parametrize(
    ("law", "parameter", "bound", "kept"),
    [
        ("end_stop", "stiffness", "upper", False),
        # What touches wherever the arm was seen is a spring, and what never does is not there.
        ("end_stop", "place", "lower", True),
        ("end_stop", "place", "upper", True),
        # A turn later it is where it was: less than a wave until then is a curve.
        ("ripple", "frequency", "lower", True),
        ("ripple", "amplitude", "upper", False),
    ],
)
def test_no_fit_goes_where_a_law_is_another_one(
    law: str, parameter: str, bound: str, kept: bool
) -> None:
    ranges = {"angle": (-0.2, 1.0)}
    entry = next(h for h in library(arm(3), RecordedFacts(ranges=ranges)) if h.name == law)
    (q,) = (q for q in entry.effect.parameters if q.name == parameter)
    ended = SimpleNamespace(
        name=f"{entry.effect.name}.{parameter}", value=getattr(q, bound), on_bound=True
    )
    fit = cast(Any, SimpleNamespace(refit=SimpleNamespace(estimates=[ended])))
    assert (refit_in_turn.widened(entry, fit, 0.002) is entry) == kept


def test_a_ripple_may_come_once_in_all_turns_that_were_seen() -> None:
    # Of a motor in front of a gear the wheel behind it turns less.
    ranges = {"angle": (0.0, 40.0)}
    tried = library(arm(3), RecordedFacts(ranges=ranges))
    (ripple,) = (h for h in tried if h.name == "ripple")
    (frequency,) = (q for q in ripple.effect.parameters if q.name == "frequency")
    assert 0.1 < frequency.lower < 2.0 * 3.14159 / 40.0
