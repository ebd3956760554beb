"""What differs from recording to recording, and what ages on, beside an own Runge-Kutta."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.diagnosis.machine_data import by_runge_kutta, recording
from tests.diagnosis.newcomers import diagnosed, levels, oscillator
from workbench.diagnosis.doubts import still_missing
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.selection import score
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.decision import decided
from workbench.diagnosis.selection.held_out import RunErrors
from workbench.diagnosis.selection.moments import changed_values, level_everywhere
from workbench.diagnosis.selection.rules import Limits
from workbench.diagnosis.selection.score import score_library
from workbench.diagnosis.verdict import Finding
from workbench.physics.drift import from_first
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.recordings.recording import Recording

STEP, SAMPLES, INNER = 0.02, 500, 4
Force = Callable[[float, float, float], float]


def run(number: int, force: Force, mass: float = 1.2) -> Recording:
    """Return a recording of ``mass a = drive + force(t, x, v)``."""

    def rates(t: float, x: Sequence[float], u: float) -> tuple[float, float]:
        return x[1], (u + force(t, *x)) / mass

    drive = levels(SAMPLES, number, 6.0, 15, 50)
    place = by_runge_kutta(rates, (0.0, 0.0), drive.tolist(), STEP, INNER)[:, 0]
    read = place + 1e-3 * np.random.default_rng(number).normal(size=SAMPLES)
    return recording(f"run {number}", STEP, {"drive [N]": drive}, {"position [m]": read})


def found(runs: list[Recording]) -> Finding:
    """Diagnose with what changes with time or from recording to recording."""
    laws = "parameter_jump parameter_fade offset_jump creep constant_force *_by_recording"
    verdict = diagnosed(oscillator(), runs, laws, fit=2).verdict
    (finding,) = verdict.findings
    assert verdict.fit["extended"]["position"] < 1.3e-3
    return finding


@pytest.mark.long
def test_a_load_that_was_changed_between_recordings_is_named() -> None:
    masses = 0.9, 1.5, 1.2
    runs = [run(i, lambda t, x, v: -30.0 * x - 0.6 * v, m) for i, m in enumerate(masses)]
    finding = found(runs)
    assert finding.effect == "gain_by_recording_mass_force" and finding.belief == "sure"
    assert "in run 0" in finding.sentence and "in run 2" in finding.sentence


@pytest.mark.long
def test_a_damper_that_goes_on_ageing_is_no_jump() -> None:
    def force(number: int) -> Force:
        # 0.6 N s/m, more by 2 % of that each second, over all three recordings.
        return lambda t, x, v: -30.0 * x - 0.6 * (1.0 + 0.02 * (t + 10.0 * number)) * v

    finding = found([run(i, force(i)) for i in range(3)])
    assert finding.effect == "parameter_fade_damping" and finding.belief == "sure"
    # Of recordings that follow one another each begins where the last one ended.
    assert finding.parameters["amount"].value == pytest.approx(0.12, rel=0.05)
    begins = [float(v) for v in re.findall(r"([0-9.]+) N s/m in run", finding.sentence)]
    assert begins == pytest.approx([0.6, 0.72, 0.84], rel=0.01)


def test_what_ages_begins_at_what_the_first_recording_shows_as_reached() -> None:
    known = library(oscillator(), RecordedFacts(duration=10.0, sample_time=0.02))
    fade = next(e.effect for e in known if e.name == "parameter_fade_damping")
    fade = fade.with_parameters({"amount": 0.2, "rate_constant": 0.1, "lasting": 10.0})
    # Three amounts were reached as the first recording began: damping was 0.5 + 3 x 0.2 N s/m.
    factor, _ = from_first({"run 1": 3.0}, "run 1", 1.0 - math.exp(-1.0))
    begun = fade.with_parameters({"amount": factor * 0.2})
    changed = changed_values(oscillator().with_effect(fade), (fade,), (begun,))
    assert changed == pytest.approx({"damping": 1.1, "parameter_fade_damping.amount": factor * 0.2})
    # From beyond its range the next refit could not begin.
    free = oscillator()
    kept = [replace(q, upper=0.9) if q.name == "damping" else q for q in free.parameters]
    bounded = replace(free, parameters=tuple(kept)).with_effect(fade)
    assert changed_values(bounded, (fade,), (begun,))["damping"] == 0.9


@pytest.mark.long
@pytest.mark.parametrize("offset", [0.12, 0.3])
def test_an_offset_that_differs_is_found_however_much_is_left_out(offset: float) -> None:
    # The more there is, the less the equations are trusted when effects are scored.
    signed = offset, -offset, offset, -offset
    finding = found(
        [run(i, lambda t, x, v, o=o: o - 30.0 * x - 0.6 * v) for i, o in enumerate(signed)]
    )
    assert finding.effect == "offset_by_recording_mass_force" and finding.belief == "sure"
    assert finding.parameters["amount"].value == pytest.approx(offset, rel=0.01)


def test_what_differs_is_scored_by_its_size_in_each_recording() -> None:
    offsets = 0.5, -0.5, 0.5
    runs = [run(i, lambda t, x, v, o=o: o - 30.0 * x - 0.6 * v) for i, o in enumerate(offsets)]
    model = oscillator()
    for kept, offered in ((runs[:2], True), (runs[::2], False)):
        seen = [observe(model, r) for r in kept]
        priors = default_priors(model)
        fit = fit_with_process_noise(model, seen, priors)
        laws = [e for e in library(model) if e.law in ("offset_by_recording", "constant_force")]
        scores = score_library(fit.model, seen, priors, laws, noise_scale=fit.noise_scale)
        found = {s.entry.law: s for s in scores.scores}
        # The same everywhere, it does not differ.
        assert ("offset_by_recording" in found) is offered
        if offered:
            assert found["offset_by_recording"].size == pytest.approx(0.5, rel=0.1)
            assert found["offset_by_recording"].gain > 10.0 * found["constant_force"].gain


def test_of_what_may_differ_the_best_scores_are_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    # Load, spring, damper and tilt were changed, and something rubs.
    changed = (0.8, 24.0, 0.3, 0.5), (1.6, 36.0, 1.2, -0.5)
    runs = [
        run(i, lambda t, x, v, k=k, d=d, o=o: o - k * x - d * v - np.tanh(v / 0.01), m)
        for i, (m, k, d, o) in enumerate(changed)
    ]
    model = oscillator()
    seen, priors = [observe(model, r) for r in runs], default_priors(model)
    fit = fit_with_process_noise(model, seen, priors)
    laws = [e for e in library(model) if e.effect.about.level]
    known = []
    for most in (10, 1):
        monkeypatch.setattr(score, "_MOST_LEVELS", most)
        found = score_library(fit.model, seen, priors, laws, noise_scale=fit.noise_scale)
        known.append([s.entry.name for s in found.scores])
    assert len(known[0]) > 1 and known[1] == known[0][:1]


def test_a_size_in_each_recording_absorbs_a_part_of_anything() -> None:
    entries = {e.law: e for e in library(oscillator())}
    limits = Limits(20.0, least_gain=100.0, least_level=500.0)
    size = SimpleNamespace(value=1.0, std=1e-3, unit="N", prior=SimpleNamespace(upper=1e9))
    fit = SimpleNamespace(
        refit=SimpleNamespace(converged=True, estimate=lambda _: size, estimates=())
    )
    for law, gain, taken in (
        ("offset_by_recording", 400.0, False),
        ("offset_by_recording", 600.0, True),
        ("constant_force", 400.0, True),
    ):
        run = RunErrors(np.full((40, 1), 0.1), np.array([0.1]))
        before = RunErrors(np.ones((40, 1)), np.ones(1))
        blocks = (np.full(40, -gain / 40), np.full(40, -gain / 40))
        found = Candidate(
            entries[law], cast(Any, fit), gain, (gain, 0.9 * gain, gain), shift=5.0,
            blocks=blocks, run=run,
        )  # fmt: skip
        (one,) = decided([found], before, limits)
        assert (not one.refused) is taken


def test_what_acts_alike_in_all_recordings_does_not_differ() -> None:
    entry = next(e for e in library(oscillator()) if e.law == "offset_by_recording")
    (level,) = entry.effect.states
    for starts, same in (((1.0, 1.02, 0.95), 0.99), ((1.0, 0.4, 1.3), None)):
        known = tuple((f"run {i}", v) for i, v in enumerate(starts))
        effect = replace(entry.effect, states=(replace(level, start_in=known),))
        assert level_everywhere(effect) == (same and pytest.approx(same))


def test_beside_a_sensor_that_is_off_no_place_of_the_process_still_lacks_something() -> None:
    nothing, most = (Location({"core": gain}) for gain in (0.011, 1000.0))
    assert still_missing(nothing, nothing) == 0.0
    assert still_missing(most, Location({"core": 900.0})) == pytest.approx(0.9)
