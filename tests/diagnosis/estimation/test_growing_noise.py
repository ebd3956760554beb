"""Noise that grows with what a sensor reads, against plain sums and data from SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.machine_data import held, recording
from tests.machines import machine
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import PredictionError
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.recordings.checks.noise import growing_rms
from workbench.recordings.recording import Recording

HOUR, SAMPLES = 3600.0, 600


def culture() -> Model:
    """Cells that grow in light and die, counted."""

    def equations(m: Scope) -> Equations:
        cells = m.x.cells
        return {"cells": (m.p.growth * m.u.light - m.p.death) * cells}, {"cells": cells}

    return machine(
        equations,
        "cells 1 50 lower=0",
        "light 1 0 1",
        "cells 1",
        "growth 1/s 3e-5 1e-6 1e-3, death 1/s 1.2e-5 1e-6 1e-3",
    )


def _counted(name: str, seed: int, *, sick: float = 0.0) -> Recording:
    rng = np.random.default_rng(seed)
    light = np.repeat(rng.uniform(0.0, 1.0, SAMPLES // 30 + 1), 30)[:SAMPLES]
    growth = 3.6e-5 * light - 1.5e-5 - np.where(np.arange(SAMPLES) >= 300, sick, 0.0)
    cells = np.exp(held(lambda t, x, rate: [rate], [4.0], (growth,), HOUR)[:, 0])
    read = cells * (1.0 + 0.02 * rng.normal(size=SAMPLES))
    return recording(name, HOUR, {"light [1]": light}, {"cells [1]": read})


def test_the_noise_of_every_sample_weighs_it() -> None:
    run = _counted("fit", 1)
    model, notes = with_undeclared(culture(), [run])
    assert model.outputs[0].relative_noise_rms == pytest.approx(0.02, rel=0.15)
    assert "% of what it reads" in notes[0]
    true = model.with_parameters({"growth": 3.6e-5, "death": 1.5e-5})
    seen = observe(true, run)
    seen = replace(seen, start=np.exp([4.0]), start_rms=np.zeros(1))
    filtered = PredictionError(true, seen, ()).run(seen, true.values)
    deviation = np.hypot(seen.noise_rms, model.outputs[0].relative_noise_rms * seen.outputs)
    error = seen.outputs - filtered.states
    cost = float(np.sum(0.5 * (error / deviation) ** 2 + np.log(deviation)))
    assert filtered.cost + SAMPLES * np.log(model.outputs[0].scale) == pytest.approx(cost, rel=1e-9)


@pytest.mark.long
def test_a_right_model_lacks_nothing_and_a_disease_is_found_on_its_day() -> None:
    few = [
        h
        for h in library(culture(), RecordedFacts(duration=SAMPLES * HOUR))
        if h.law == "parameter_jump"
    ]
    assert {h.name for h in few} == {"parameter_jump_growth", "parameter_jump_death"}
    right, sick = (
        diagnose(culture(), [a], [b], entries=few, jobs=1, advise=False)
        for a, b in ((_counted("a", 1, sick=s), _counted("b", 2, sick=s)) for s in (0.0, 8e-6))
    )
    assert right.verdict.kind == "nothing_missing"
    (finding,) = sick.verdict.findings
    assert finding.effect == "parameter_jump_death" and finding.belief == "sure"
    assert finding.parameters["amount"].value == pytest.approx(8e-6, rel=0.05)
    assert finding.parameters["time"].value == pytest.approx(300 * HOUR, rel=0.02)


def test_noise_that_does_not_grow_and_motion_are_not_taken_for_it() -> None:
    rng, t = np.random.default_rng(4), np.arange(2000) * 0.01
    swing = np.exp(-0.2 * t) * np.sin(3.0 * t)
    assert growing_rms([swing + 0.01 * rng.normal(size=2000)])[1] == 0.0
    square = np.where(np.sin(2.0 * t) > 0.0, 1.0, 0.1) + 0.001 * rng.normal(size=2000)
    assert growing_rms([square])[1] == 0.0
    growing = np.exp(0.3 * t) * (1.0 + 0.03 * rng.normal(size=2000))
    assert growing_rms([growing])[1] == pytest.approx(0.03, rel=0.1)


@pytest.mark.parametrize("step", [0.5, 50.0])
def test_noise_grows_also_where_a_logger_rounds_it(step: float) -> None:
    run = _counted("fit", 1)
    cells = replace(run.signal("cells"), values=step * np.round(run["cells"] / step))
    model, _ = with_undeclared(culture(), [run.with_signal(cells)])
    assert model.outputs[0].resolution == pytest.approx(step)
    assert model.outputs[0].relative_noise_rms == pytest.approx(0.02, rel=0.2)
