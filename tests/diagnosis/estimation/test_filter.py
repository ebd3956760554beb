"""How the filter carries a state along a sample: exponential steps, against SciPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.arrays import Vector
from workbench.computing.counted import done
from workbench.diagnosis.estimation.filter import Steps
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError
from workbench.model import Model, Scope

SAMPLE = 0.02
DRIVE = 3.0 * np.repeat(np.random.default_rng(0).uniform(-1.0, 1.0, 20), 15)


def _run(model: Model, parts: int = 1, **given: object) -> tuple[PredictionError, Observed]:
    """Return the filter of a model and a recording that does not correct it."""
    drive = np.repeat(DRIVE, parts)
    told = {"drive [1]": drive}, {f"{q.name} [1]": 0.0 * drive for q in model.outputs}
    seen = observe(model, recording("run", SAMPLE / parts, *told))
    seen = replace(seen, start=0.0 * seen.start, start_rms=0.0 * seen.start_rms)
    return PredictionError(model, seen, **given), seen  # type: ignore[arg-type]


def _lagging() -> Model:
    return machine(
        lambda m: {"slow": m.x.fast - m.x.slow, "fast": 1e6 * (m.u.drive - m.x.fast)},
        "slow 1, fast 1",
        "drive 1",
        "slow 1 1e-3",
        "idle 1",
    )


def test_a_lag_far_faster_than_the_samples_takes_one_step_of_each() -> None:
    model = _lagging()
    filter_, seen = _run(model, free=("idle",))
    before = done()["model_evaluations"]
    states = filter_.run(seen, model.values).states
    # Two for what is read and for noise, three for the step.
    assert done()["model_evaluations"] - before == 5 * len(DRIVE)
    slopes = np.array([[-1.0, 1.0, 0.0], [0.0, -1e6, 1e6], [0.0, 0.0, 0.0]])
    once, exact = expm(SAMPLE * slopes), np.zeros((len(DRIVE), 2))
    for i, drive in enumerate(DRIVE[:-1]):
        exact[i + 1] = (once @ [*exact[i], drive])[:2]
    np.testing.assert_allclose(states, exact, atol=1e-9)


def _by_scipy(rates: Callable[[Vector, float], list[Any]], method: str, tolerance: float) -> Vector:
    """Return the two states of a machine driven from zero, at each sample."""
    exact = np.zeros((len(DRIVE), 2))
    for i, drive in enumerate(DRIVE[:-1]):
        found = solve_ivp(
            lambda t, x, drive=drive: rates(x, drive), (0.0, SAMPLE), exact[i], method,
            rtol=tolerance, atol=tolerance,
        )  # fmt: skip
        exact[i + 1] = found.y[:, -1]
    return exact


def _hard(x: Vector, drive: float) -> list[float]:
    return [x[1], drive * 900.0 - 900.0 * x[0] - 50.0 * x[0] ** 3 - 2.0 * x[1]]


def _hardening() -> Model:
    def equations(m: Scope) -> dict[str, object]:
        rates = _hard([m.x.place, m.x.speed], m.u.drive)  # type: ignore[arg-type]
        return dict(zip(("place", "speed"), rates, strict=True))

    outputs, parameters = "place 1 1e-3", "idle 1"
    return machine(equations, "place 1, speed 1/s scale=30", "drive 1", outputs, parameters)


def test_steps_of_a_spring_that_hardens_are_of_fourth_order() -> None:
    model, exact = _hardening(), _by_scipy(_hard, "DOP853", 1e-12)
    errors = []
    for parts in (4, 8):
        filter_, seen = _run(model, parts, free=())
        filter_._steps = Steps(0, 1)
        away = filter_.run(seen, model.values).states[::parts] - exact
        errors.append(np.sqrt(np.mean((away / exact.std(axis=0)) ** 2)))
    # It turns by 0.6 to 1.1 rad in a sample.
    assert errors[0] < 1e-4 and errors[1] < errors[0] / 12.0


@pytest.mark.parametrize("pace", [1.0, 30.0])
def test_states_that_nothing_corrects_are_carried_too(pace: float) -> None:
    def equations(m: Scope) -> dict[str, object]:
        lag = pace * (m.u.drive - m.x.beside)
        return {"place": m.u.drive - m.x.place, "beside": lag}

    model = machine(equations, "place 1, beside 1", "drive 1", "place 1 1e-3", "idle 1")
    runs = []
    for certain in ((), ("beside",)):
        filter_, seen = _run(model, free=(), certain=certain)
        runs.append(filter_.run(seen, model.values).states)
    np.testing.assert_allclose(*runs, atol=1e-2 * np.ptp(DRIVE))


def _through(away: Any, m: ModuleType) -> Any:
    """Flow through an opening: a root of the difference, straight where that is small."""
    where, bend = getattr(m, "if_else", np.where), 5e-3
    root = m.sign(away) * m.sqrt(m.fmax(m.fabs(away), bend))
    return where(m.fabs(away) < bend, away / bend**0.5, root)


@pytest.mark.long
def test_a_narrow_tube_far_faster_than_the_finest_step_settles_and_is_cheap() -> None:
    # Runge-Kutta steps of 0.3 ms grow up to where the root is flat, and never come back to rest.
    def rates(m: ModuleType, tube: Any, chamber: Any, drive: Any) -> list[Any]:
        flow = _through(tube - chamber, m)
        return [2e4 * (0.1 * drive - flow), flow - 0.005 * chamber]

    model = machine(
        lambda m: dict(
            zip(("tube", "chamber"), rates(ca, m.x.tube, m.x.chamber, m.u.drive), strict=True)
        ),
        "tube 1, chamber 1",
        "drive 1",
        "chamber 1 1e-3",
        "idle 1",
    )
    exact = _by_scipy(lambda x, drive: rates(np, *x, drive), "Radau", 1e-10)
    filter_, seen = _run(model, free=())
    filter_._steps = Steps(3, 1)
    before = done()["model_evaluations"]
    states = filter_.run(seen, model.values).states
    assert done()["model_evaluations"] - before < 20 * len(DRIVE)
    np.testing.assert_allclose(states, exact, atol=1e-6 * np.ptp(exact[:, 1]))
