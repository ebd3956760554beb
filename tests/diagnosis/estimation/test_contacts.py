"""Contacts that last a few samples are integrated as closely as what is read of them."""

from __future__ import annotations

import numpy as np

from tests.diagnosis.machine_data import recording
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import filter_of
from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations
from workbench.recordings.recording import Recording

SAMPLE, MASS, STIFFNESS, DAMPING, NOISE = 0.002, 0.7, 2e4, 60.0, 1e-6


def _push(position: float, speed: float) -> float:
    """Return the force of a stop at the origin, in N, on a mass behind it."""
    return max(0.0, -STIFFNESS * position - DAMPING * speed) if position < 0.0 else 0.0


def _recorded() -> Recording:
    """Let a mass fall on a stop again and again, by Heun's method in far finer steps."""
    rng = np.random.default_rng(3)
    n, parts = 3000, 200
    h, position, speed, read = SAMPLE / parts, 0.05, 0.0, []
    force = np.repeat(rng.uniform(-9.0, 5.0, n // 60), 60)

    def acceleration(at: float, moving: float, pushed: float) -> float:
        return (pushed - 2.0 * moving - 20.0 * (at - 0.02) + _push(at, moving)) / MASS

    for pushed in force.tolist():
        read.append(position)
        for _ in range(parts):
            first = acceleration(position, speed, pushed)
            second = acceleration(position + h * speed, speed + h * first, pushed)
            position += h * (speed + 0.5 * h * first)
            speed += 0.5 * h * (first + second)
    position = np.array(read) + NOISE * rng.normal(size=n)
    return recording("falling", SAMPLE, {"force [N]": force}, {"position [m]": position})


def _model() -> Model:
    def equations(m: Scope) -> Equations:
        x, p = m.x, m.p
        push = m.form.ramp(-p.stiffness * x.position - p.damping * x.speed, 1.0)
        touching = m.form.step(-x.position, 1e-6)
        stop = m.port("stop", touching * push, unit="N", scale=10.0, relative_disturbance=0.1)
        force = m.u.force - 2.0 * x.speed - 20.0 * (x.position - 0.02) + stop
        return {"position": x.speed, "speed": force / MASS}, {"position": x.position}

    return Model(
        "mass before a stop",
        equations,
        states=(State("position", "m", 0.05, initial=0.05), State("speed", "m/s", 1.0)),
        inputs=(Input("force", "N", 10.0),),
        outputs=(Output("position", "m", 0.05, noise_rms=NOISE),),
        parameters=(
            Parameter("stiffness", "N/m", value=STIFFNESS),
            Parameter("damping", "N s/m", value=DAMPING),
        ),
    )


def test_a_stop_that_is_met_between_samples_is_predicted_to_the_noise() -> None:
    model = _model()
    seen = observe(model, _recorded())
    errors = filter_of(model, seen, 0.003, ["stiffness"]).run(seen, model.values).whitened
    # An impact is an outlier of 5 standard deviations where steps do not end at the stop.
    assert np.abs(errors).max() < 4.5
    assert np.mean(errors**2) < 1.0
