"""What differs from recording to recording, and what ages on, beside an own Runge-Kutta."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.newcomers import levels, oscillator
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.selection import task
from workbench.diagnosis.selection.score import score_library
from workbench.diagnosis.verdict import Finding
from workbench.physics.library import Hypothesis, library
from workbench.recordings.recording import Recording, Signal

STEP, SAMPLES, INNER = 0.02, 500, 4
Force = Callable[[float, float, float], float]


def run(number: int, force: Force, mass: float = 1.2) -> Recording:
    """Return a recording of ``mass a = drive + force(t, x, v)``."""
    drive, h = levels(SAMPLES, number, 6.0, 15, 50), STEP / INNER
    x, t, seen = np.zeros(2), 0.0, np.empty(SAMPLES)

    def rates(t: float, x: np.ndarray, u: float) -> np.ndarray:
        return np.array([x[1], (u + force(t, *x)) / mass])

    for k, u in enumerate(drive):
        seen[k] = x[0]
        for _ in range(INNER):
            a = rates(t, x, u)
            b = rates(t + h / 2, x + h / 2 * a, u)
            c = rates(t + h / 2, x + h / 2 * b, u)
            d = rates(t + h, x + h * c, u)
            x, t = x + h / 6 * (a + 2 * b + 2 * c + d), t + h
    read = seen + 1e-3 * np.random.default_rng(number).normal(size=SAMPLES)
    signals = (Signal("drive", drive, "N", role="command"), Signal("position", read, "m"))
    return Recording(f"run {number}", STEP * np.arange(SAMPLES), signals)


def found(monkeypatch: pytest.MonkeyPatch, runs: list[Recording]) -> Finding:
    """Diagnose with what changes with time or from recording to recording."""

    def few(*given: Any, **known: Any) -> tuple[Hypothesis, ...]:
        laws = ("parameter_jump", "parameter_fade", "offset_jump", "creep", "constant_force")
        return tuple(
            e for e in library(*given, **known) if e.law in laws or e.law.endswith("_by_recording")
        )

    monkeypatch.setattr(task, "library", few)
    verdict = diagnose(oscillator(), runs[:2], runs[2:], jobs=1, advise=False).verdict
    assert verdict is not None
    (finding,) = verdict.findings
    assert verdict.fit["extended"]["position"] < 1.3e-3
    return finding


def test_a_load_that_was_changed_between_recordings_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    masses = 0.9, 1.5, 1.2
    runs = [run(i, lambda t, x, v: -30.0 * x - 0.6 * v, m) for i, m in enumerate(masses)]
    finding = found(monkeypatch, runs)
    assert finding.effect == "gain_by_recording_mass_force" and finding.belief == "sure"
    assert "in run 0" in finding.sentence and "in run 2" in finding.sentence


def test_a_damper_that_goes_on_ageing_is_no_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    def force(number: int) -> Force:
        # 0.6 N s/m, more by 2 % of that each second, over all three recordings.
        return lambda t, x, v: -30.0 * x - 0.6 * (1.0 + 0.02 * (t + 10.0 * number)) * v

    finding = found(monkeypatch, [run(i, force(i)) for i in range(3)])
    assert finding.effect == "parameter_fade_damping" and finding.belief == "sure"
    # Of recordings that follow one another each begins where the last one ended.
    assert finding.parameters["amount"].value == pytest.approx(0.12, rel=0.05)
    begins = [float(v) for v in re.findall(r"([0-9.]+) N s/m in run", finding.sentence)]
    assert begins == pytest.approx([0.6, 0.72, 0.84], rel=0.01)


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
