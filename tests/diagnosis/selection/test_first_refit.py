"""The first refit of a hypothesis: from which places it begins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tests.diagnosis.newcomers import oscillator
from tests.diagnosis.selection.candidates import entries, made_score
from workbench.diagnosis.selection import first_refit
from workbench.diagnosis.selection.refit_in_turn import Basis
from workbench.diagnosis.selection.score import Score
from workbench.physics.library import library


def test_shapes_that_no_refit_changes_are_tried_too() -> None:
    (other,) = first_refit.variants(entries()["sensor_lag_angle"])
    assert [q.value for q in other.effect.parameters if q.name == "sampled"] == [1.0]
    # A width that a refit changes is no other variant.
    assert first_refit.variants(entries()["lugre_friction"]) == []
    # A machine that sticks reverses within less than another law shows, and does not creep on.
    coulomb = next(e for e in library(oscillator()) if e.law == "coulomb_friction")
    for usual in (entries()["stribeck_friction"], coulomb):
        speeds = [
            next(q.value for q in e.effect.parameters if q.name == "transition_speed")
            for e in (usual, *first_refit.variants(usual))
        ]
        assert speeds == pytest.approx([speeds[0], speeds[0] / 40.0, speeds[0] / 1000.0])
    # Its speed is a guess, which the last refit tunes.
    assert first_refit.variants(entries()["stribeck_friction"], guessed=False) == []


def test_what_is_either_there_or_not_begins_at_the_priors_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[tuple[float, ...]] = []

    def refitted(_: Any, score: Score, way: Any, __: float) -> Any:
        begun.append(way.ladder)
        fit = SimpleNamespace(
            cost=-1.0, noise_scale=0.3, refit=SimpleNamespace(estimates=(), values={})
        )
        return score.entry, fit

    monkeypatch.setattr(first_refit, "_refitted", refitted)
    monkeypatch.setattr(first_refit, "variants", lambda _: [])
    monkeypatch.setattr(first_refit, "start_values", lambda *_: {})
    base: Any = SimpleNamespace(noise_scale=0.3, refit=SimpleNamespace(estimates=(), values={}))
    ways = {}
    basis = Basis(base, (), [], thorough=False)
    for name in ("silencers", "valve_offset"):
        first_refit.first_refit(basis, made_score(name, 90.0), 1.0)
        ways[name], begun = begun, []
    assert ways == {"silencers": [(0.3,), first_refit.STEEP], "valve_offset": [(0.3,)]}


def test_beside_what_explains_nearly_all_a_law_that_gains_little_is_tried_in_one_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[Any] = []

    def refitted(_: Any, score: Score, *given: Any) -> Any:
        tried.append(given[0])
        refit = SimpleNamespace(estimates=(), values={})
        return score.entry, SimpleNamespace(cost=90.0, noise_scale=1.0, refit=refit)

    monkeypatch.setattr(first_refit, "_refitted", refitted)
    monkeypatch.setattr(first_refit, "start_values", lambda *_: {})
    on_bound = SimpleNamespace(name="level", value=1.0, on_bound=True)
    base: Any = SimpleNamespace(
        noise_scale=1.0, refit=SimpleNamespace(estimates=(on_bound,), values={})
    )
    basis = Basis(base, (), [], thorough=False, costs=(100.0, 100.0))
    tilt, far = "tilt_gravity", next(e for e in entries().values() if e.far)
    for entry, least, once in (
        (tilt, 0.0, False),
        (tilt, 20.0, True),
        (tilt, 5.0, False),
        (far, 20.0, False),
    ):
        tried.clear()
        first_refit.first_refit(basis, made_score(entry, 9.0), 1.0, least=least)
        assert (len(tried) == 1) is once
