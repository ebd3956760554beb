"""What a search takes from its recordings."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.selected import Accepted, Selected
from workbench.diagnosis.selection.task import Task
from workbench.physics.drift import offset_pulse
from workbench.physics.library import library
from workbench.physics.stiffness import linear_spring, ripple
from workbench.plants.servo_axis import servo_axis


def test_a_ripple_is_tried_with_the_pitch_that_the_recordings_show() -> None:
    axis, pitch = servo_axis(), 0.0314
    magnets = ripple("axis.force", amplitude=30.0, frequency=2.0 * math.pi / pitch)
    # A slow sine there and back, and pushes that shake it.
    force = 150.0 * np.sin(2.0 * np.pi * np.arange(1200) / 600.0)
    force += pushes(1200, largest=60.0, seed=1)
    seen = [simulated(axis.with_effect(magnets), force, sample_time=0.01)]
    priors = default_priors(axis)
    base = fit_with_process_noise(axis, seen, priors)
    task = Task(axis, base, tuple(seen), (), priors)
    (tried,) = (h for h in task.tried(axis) if h.name == "ripple")
    (frequency,) = {shape["frequency"] for shape in tried.shapes}
    assert 2.0 * math.pi / frequency == pytest.approx(pitch, rel=0.02)


def test_an_episode_is_looked_for_beside_parameters_off_their_bounds() -> None:
    axis = servo_axis()
    truth = axis.with_effect(
        offset_pulse("axis.force", amount=-100.0, time=4.0, duration=2.5, width=0.02, floor=0.005)
    )
    seen = simulated(truth, pushes(1000, largest=300.0, seed=1), sample_time=0.01)
    seen = replace(seen, start=seen.start[:2], start_rms=seen.start_rms[:2])
    priors = default_priors(axis)
    base = fit_with_process_noise(axis, [seen], priors)
    # The friction has gone to zero where the push helps against it.
    assert base.refit.estimate("coulomb_friction.level").on_bound
    task = Task(axis, base, (seen,), (), priors)
    assert task.off_bounds.parameter("coulomb_friction.level").value == 20.0
    (pulse,) = (h for h in task.tried(axis) if h.name == "offset_pulse_axis_force")
    began, lasted = (q.value for q in pulse.effect.parameters if q.name in ("time", "duration"))
    assert began == pytest.approx(4.0, abs=0.2) and lasted == pytest.approx(2.5, abs=0.2)


def test_without_an_effect_the_others_begin_where_they_came_to_with_it() -> None:
    axis, frequency = servo_axis(), 2.0 * math.pi / 0.0314
    magnets = ripple("axis.force", amplitude=30.0, frequency=frequency)
    seen = simulated(
        axis.with_effect(magnets), pushes(600, largest=200.0, seed=1), sample_time=0.01
    )
    model = axis.with_effect(magnets).with_effect(linear_spring("axis.force", stiffness=0.0))
    fit = partial(fit_with_process_noise, model, [seen], default_priors(model), noise_scale=1.0)
    far = fit(start={"ripple.frequency": 1.3 * frequency}, follow=False)
    full = replace(fit(start={"ripple.frequency": frequency}), passed=far)
    (spring,) = (h for h in library(axis) if h.name == "linear_spring")
    found = Accepted(Candidate(spring, full, 0.0, (0.0, 0.0, 0.0)), ())
    state = Selected(accepted=(found,), extended=full, fits=(full,), free=default_priors(model))
    without = Task(axis, full, (seen,), (), default_priors(axis)).without(state, found)
    assert without is not None
    # From values before it the pitch of the magnets is not found: 3,000 of log likelihood.
    assert without[0].cost < full.cost + 5.0
    assert without[0].refit.estimate("ripple.frequency").value == pytest.approx(frequency, rel=0.01)
