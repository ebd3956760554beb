"""Small diagnoses that end without a name: a law outside the library, and mere noise."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from tests.diagnosis.example_diagnosis import axis_runs
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.made_up import made_up_recording, pushes
from workbench.diagnosis.stages import Diagnosis
from workbench.model import Model
from workbench.physics.library import library
from workbench.physics.stiffness import linear_spring
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording, Signal

SAMPLES = 400


def sprung_runs() -> tuple[Model, list[Recording], list[Recording], dict[str, Any]]:
    """An axis held by a spring, and a library that has friction only."""
    axis = servo_axis()
    spring = linear_spring("axis.force", stiffness=200.0, upper=1000.0)
    runs = axis_runs(axis.with_effect(spring), SAMPLES)
    return axis, runs[:1], runs[1:], _options(axis)


@cache
def sprung() -> tuple[Diagnosis, tuple[Recording, ...]]:
    """The diagnosis of it."""
    axis, fit_on, hold_out, options = sprung_runs()
    return diagnose(axis, fit_on, hold_out, **options), tuple(hold_out)


@cache
def shaken() -> tuple[Diagnosis, tuple[Recording, ...]]:
    """An axis with an unmeasured random force that is a function of nothing."""
    axis, rng = servo_axis(), np.random.default_rng(5)
    runs = []
    for seed in (1, 2):
        push = pushes(SAMPLES, largest=200.0, seed=seed)
        unseen = np.repeat(rng.normal(scale=60.0, size=SAMPLES // 10), 10)
        run = made_up_recording(axis, push + unseen, sample_time=0.01, name=f"axis {seed}")
        runs.append(run.with_signal(Signal("force", push, "N", role="command")))
    return diagnose(axis, runs[:1], runs[1:], **_options(axis)), tuple(runs[1:])


def _options(axis: Model) -> dict[str, Any]:
    few = [e for e in library(axis) if e.law == "stribeck_friction"]
    return {"entries": few, "jobs": 1, "advise": False}
