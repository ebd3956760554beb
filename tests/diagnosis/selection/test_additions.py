"""Details of a law's shape, refitted as soon as the law was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.example_diagnosis import example_diagnosis
from tests.diagnosis.machine_data import held, recording
from tests.diagnosis.newcomers import levels, oscillator
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors, entry_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, fit_with_process_noise
from workbench.diagnosis.selection import additions
from workbench.diagnosis.selection.additions import shaped
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.task import Task
from workbench.physics.library import library
from workbench.recordings.recording import Recording

STEP, NOISE = 0.02, 1e-4


def sharp_loop(seed: int, exponent: float) -> Recording:
    """Integrate an oscillator of 1.2 kg with a loop of Bouc and Wen of 1.5 N."""

    def rates(_: float, s: np.ndarray, u: float) -> list[float]:
        x, v, z = s
        bends = abs(v) * abs(z) ** (exponent - 1.0) * z
        return [v, (u - 30.0 * x - 0.6 * v - 1.5 * z) / 1.2, (v - bends) / 0.02]

    drive = levels(400, seed, 6.0, 15, 40)
    place = held(rates, np.zeros(3), (drive,), STEP)[:, 0]
    read = place + NOISE * np.random.default_rng(seed).normal(size=len(place))
    return recording(f"run {seed}", STEP, {"drive [N]": drive}, {"position [m]": read})


@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_the_sharpness_of_a_loop_is_refitted_where_that_explains_more(exponent: float) -> None:
    nominal = oscillator(scale=5.0)
    fitting, judging = (
        (replace(observe(nominal, sharp_loop(i, exponent)), noise_rms=np.array([NOISE])),)
        for i in (1, 2)
    )
    priors = default_priors(nominal)
    base = fit_with_process_noise(nominal, fitting, priors)
    task = Task(nominal, base, fitting, judging, priors, jobs=1)
    entry = next(e for e in library(nominal) if e.name == "bouc_wen_hysteresis")
    free = (*priors, *entry_priors(entry))
    model = nominal.with_effect(entry.effect)
    seen = task.started(fitting, model)
    begin = {"bouc_wen_hysteresis.level": 1.5, "bouc_wen_hysteresis.breakaway": 0.02}
    fit = fit_with_process_noise(model, seen, free, start=begin, noise_scale=0.1)
    found, own = shaped(task, fit, entry, seen, free)
    if exponent == 1.0:
        # Nothing pays for one more parameter.
        assert (found, own) == (fit, free)
        return
    estimate = next(e for e in found.refit.estimates if e.name == "bouc_wen_hysteresis.exponent")
    assert len(own) == len(free) + 1
    assert found.cost < fit.cost - 20.0
    assert abs(estimate.value - exponent) < 3.0 * estimate.std < 1.5


def test_a_law_is_refitted_from_where_it_is_a_simpler_one_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nominal = oscillator(scale=5.0)
    creep = next(e for e in library(nominal) if e.name == "creep")
    ends = additions._ends(Candidate(creep, None, 0.0, (0.0, 0.0, 0.0)))
    assert ends == [{"creep.slow_part": 0.0}, {"creep.slow_part": 1.0}]
    given = example_diagnosis()
    begun = []

    def refitted(*_: object, start: dict[str, float], **__: object) -> ProcessNoiseFit:
        begun.append(start)
        cost = given.base.cost - 10.0 * start.get("creep.slow_part", 0.0)
        return replace(given.base, refit=replace(given.base.refit, cost=cost))

    monkeypatch.setattr(additions, "fit_with_process_noise", refitted)
    best = additions.polished(given.base, (), (), ends=ends)
    assert len(begun) == 3 and best.cost == given.base.cost - 10.0


def test_a_refit_along_a_bent_valley_goes_on_until_it_converges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = example_diagnosis()
    scales = []

    def refitted(*_: object, noise_scale: float, **__: object) -> ProcessNoiseFit:
        scales.append(noise_scale)
        left = 3 - len(scales)
        own = replace(given.base.refit, cost=given.base.cost + left, converged=not left)
        return replace(given.base, refit=own, noise_scale=0.01)

    monkeypatch.setattr(additions, "fit_with_process_noise", refitted)
    best = additions.polished(replace(given.base, noise_scale=0.1), (), ())
    assert scales == [0.1, 0.01, 0.01] and best.refit.converged
