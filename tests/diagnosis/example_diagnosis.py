"""A small diagnosis for examples: a servo axis whose model lacks its dry friction."""

from __future__ import annotations

from functools import cache
from typing import Any

from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.made_up import made_up_recording, pushes
from workbench.diagnosis.selection.task import Task
from workbench.diagnosis.stages import Diagnosis
from workbench.model import Model
from workbench.physics.library import library
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording


def axis_runs(truth: Model, samples: int) -> list[Recording]:
    """Two recordings of an axis that is pushed about, as it really is."""
    return [
        made_up_recording(
            truth, pushes(samples, largest=200.0, seed=seed), sample_time=0.01, name=f"axis {seed}"
        )
        for seed in (1, 2)
    ]


@cache
def example_diagnosis() -> tuple[Diagnosis, tuple[Recording, ...]]:
    """Diagnose an axis without dry friction on recordings of one that has it."""
    truth = servo_axis()
    model, runs = truth.without("coulomb_friction"), axis_runs(truth, 600)
    few = [e for e in library(model) if e.law in ("coulomb_friction", "linear_spring")]
    return diagnose(model, runs[:1], runs[1:], entries=few, jobs=1), tuple(runs[1:])


def example_task(**options: Any) -> Task:
    """Return what its search is given."""
    given, _ = example_diagnosis()
    seen = given.prepared
    return Task(given.nominal, given.base, seen.fitting, seen.judging, seen.priors, **options)
