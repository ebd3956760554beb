"""What a search takes from its recordings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.diagnosis.estimation.made_up import made_up, pushes
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.selection.task import Task
from workbench.physics.stiffness import ripple
from workbench.plants.servo_axis import servo_axis


def test_a_ripple_is_tried_with_the_pitch_that_the_recordings_show() -> None:
    axis, pitch = servo_axis(), 0.0314
    magnets = ripple("axis.force", amplitude=30.0, frequency=2.0 * math.pi / pitch)
    # A slow sine there and back, and pushes that shake it.
    force = 150.0 * np.sin(2.0 * np.pi * np.arange(1200) / 600.0)
    force += pushes(1200, largest=60.0, seed=1)
    seen = [made_up(axis.with_effect(magnets), force, sample_time=0.01)]
    priors = default_priors(axis)
    base = fit_with_process_noise(axis, seen, priors)
    task = Task(axis, base, tuple(seen), (), priors)
    (tried,) = (h for h in task.tried(axis) if h.name == "ripple")
    (frequency,) = {shape["frequency"] for shape in tried.shapes}
    assert 2.0 * math.pi / frequency == pytest.approx(pitch, rel=0.02)
