"""Small diagnoses of a servo axis: of its dry friction, and two that end without a name."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated_recording
from workbench.diagnosis.selection.task import Task
from workbench.diagnosis.stages import Diagnosis
from workbench.model import Model
from workbench.physics.library import library
from workbench.physics.stiffness import linear_spring
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording, Signal

Given = tuple[Model, list[Recording], list[Recording], dict[str, Any]]
"""A model, recordings to fit on and to judge on, and options of a diagnosis."""


def axis_runs(truth: Model, samples: int) -> list[Recording]:
    """Two recordings of an axis that is pushed about, as it really is."""
    return [
        simulated_recording(
            truth,
            pushes(samples, largest=200.0, seed=seed),
            sample_time=0.01,
            name=f"axis {seed}",
        )
        for seed in (1, 2)
    ]


def _asked(model: Model, runs: list[Recording], *laws: str) -> Given:
    few = [e for e in library(model) if e.law in laws]
    return model, runs[:1], runs[1:], {"entries": few, "jobs": 1, "advise": False}


def rubbing_runs(samples: int = 300, *further: str) -> Given:
    """An axis without dry friction, recordings of one that has it, and a library of a few laws."""
    truth = servo_axis()
    runs = axis_runs(truth, samples)
    return _asked(truth.without("coulomb_friction"), runs, "coulomb_friction", *further)


@cache
def example_diagnosis() -> Diagnosis:
    """The diagnosis of it, which advises what to record next."""
    model, fit_on, hold_out, options = rubbing_runs(600, "linear_spring")
    return diagnose(model, fit_on, hold_out, **options | {"advise": True})


def example_task(**options: Any) -> Task:
    """Return what its search is given."""
    given = example_diagnosis()
    seen = given.prepared
    return Task(given.nominal, given.base, seen.fitting, seen.judging, seen.priors, **options)


def sprung_runs() -> Given:
    """An axis held by a spring, and a library that has friction only."""
    axis = servo_axis()
    spring = linear_spring("axis.force", stiffness=200.0, upper=1000.0)
    return _asked(axis, axis_runs(axis.with_effect(spring), 400), "stribeck_friction")


@cache
def sprung() -> Diagnosis:
    """The diagnosis of it."""
    axis, fit_on, hold_out, options = sprung_runs()
    return diagnose(axis, fit_on, hold_out, **options)


@cache
def shaken() -> Diagnosis:
    """An axis with an unmeasured random force that is a function of nothing."""
    axis, rng = servo_axis(), np.random.default_rng(5)
    runs = []
    for seed in (1, 2):
        push = pushes(400, largest=200.0, seed=seed)
        unseen = np.repeat(rng.normal(scale=60.0, size=40), 10)
        run = simulated_recording(axis, push + unseen, sample_time=0.01, name=f"axis {seed}")
        runs.append(run.with_signal(Signal("force", push, "N", role="command")))
    axis, fit_on, hold_out, options = _asked(axis, runs, "stribeck_friction")
    return diagnose(axis, fit_on, hold_out, **options)
