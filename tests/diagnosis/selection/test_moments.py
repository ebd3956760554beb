"""Times of events that came together, beside SciPy."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.machine_data import held, recording
from tests.diagnosis.newcomers import levels
from tests.machines import machine
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.process_noise import extended_start, fit_with_process_noise
from workbench.diagnosis.selection.moments import moments, with_own_moments
from workbench.diagnosis.selection.scalar_search import between, least_between
from workbench.model import Model, Parameter, Scope
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.recordings.recording import Recording

STEP, SAMPLES = 0.02, 600


def driven() -> Model:
    """A damped oscillator with a drive of some gain."""

    def equations(m: Scope) -> dict[str, Any]:
        pull = m.p.gain * m.u.drive - m.p.stiffness * m.x.position - 0.6 * m.x.speed
        return {"position": m.x.speed, "speed": pull}

    return machine(
        equations,
        "position m, speed m/s",
        "drive N",
        "position m 1e-3",
        "gain 1/kg 1 0.1 5, stiffness 1/s2 30 5 90",
    )


def _changed(seed: int, when: float) -> Recording:
    """Return an oscillator that from a time on, in s, has half as much more spring and drive."""
    drive = levels(SAMPLES, seed, 30.0, 20, 80)
    more = np.where(STEP * np.arange(SAMPLES) >= when, 1.5, 1.0)

    def rates(_: float, x: np.ndarray, u: float, more: float) -> list[float]:
        return [x[1], more * (u - 30.0 * x[0]) - 0.6 * x[1]]

    place = held(rates, np.zeros(2), (drive, more), STEP)[:, 0]
    read = place + 1e-3 * np.random.default_rng(seed).normal(size=SAMPLES)
    return recording(f"run {seed}", STEP, {"drive [N]": drive}, {"position [m]": read})


def test_events_that_came_together_are_moved_together() -> None:
    """Alone one goes to another wrong time in the second recording: it needs the other."""
    plain = driven()
    seen = [observe(plain, _changed(1, 5.0)), observe(plain, _changed(2, 8.0))]
    laws = {
        h.name: h for h in library(plain, RecordedFacts(duration=SAMPLES * STEP, sample_time=STEP))
    }
    found = {"parameter_jump_gain": 0.5, "parameter_jump_stiffness": 15.0}
    events = []
    for name, amount in found.items():
        effect = laws[name].effect.with_parameters({"amount": amount, "time": 5.0, "width": 0.02})
        clock = next(q for q in effect.states if q.unit == "s")
        # At 3 s in the second one.
        states = tuple(
            replace(q, start_in=(("run 2", clock.initial + 2.0),)) if q is clock else q
            for q in effect.states
        )
        events.append(replace(effect, states=states))
    model = plain.with_effect(*events)
    fit = fit_with_process_noise(
        model, [extended_start(seen[0], plain, model)], (), noise_scale=0.01
    )
    alone = [with_own_moments([e], fit, plain, seen[:1], seen[1:])[0] for e in events]
    both = with_own_moments(events, fit, plain, seen[:1], seen[1:])
    assert abs(moments(model, alone[0], "run 2")[0] - 8.0) > 1.0
    for event in both:
        assert moments(model, event, "run 2")[0] == pytest.approx(8.0, abs=STEP)


def test_the_least_of_what_fails_somewhere_is_found_without_a_warning() -> None:
    def cost(value: float) -> float:
        return (value - 0.2) ** 2 if value < 0.5 else math.inf

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        where, least = least_between(cost, 0.0, 1.0, 60, 1e-4)
        nowhere = least_between(lambda _: math.inf, 0.0, 1.0, 20)
    assert where == pytest.approx(0.2, abs=1e-3) and least < 1e-5
    assert nowhere[1] == math.inf


def test_a_value_that_rounding_keeps_off_its_bound_has_nothing_between() -> None:
    time = Parameter("time", "s", value=1.0, lower=1.0 - 1e-16, upper=9.0)
    assert between(lambda t: (t - 2.0) ** 2, 1.0, time, 0.0) == 1.0
