"""Noise of sensors that is correlated, against dense linear algebra and data from SciPy."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import expm, toeplitz
from scipy.signal import lfilter

from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.computing.machine_code import compiler
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.noise_colour import (
    Leftover,
    follows,
    leftovers,
    with_correlated_noise,
)
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import PredictionError
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.start import fit_with_likely_starts
from workbench.diagnosis.verdict import Verdict
from workbench.model import Model, Scope
from workbench.physics.library import library
from workbench.recordings.recording import Recording
from workbench.simulation.equations import _library as built_before

INTERVAL, SAMPLES = 0.02, 1500


def drum() -> Model:
    """A drum on a belt drive: two speeds, one torque, nothing declared of the sensors."""

    def equations(m: Scope) -> dict[str, Any]:
        belt = m.p.belt * (m.x.motor - m.x.drum)
        return {
            "motor": (m.u.torque - belt - m.p.drag * m.x.motor) / m.p.inertia,
            "drum": belt / 0.05,
        }

    return machine(
        equations,
        "motor rad/s scale=10, drum rad/s scale=10",
        "torque N m -5 5 scale=1",
        "motor rad/s, drum rad/s",
        "inertia kg m2 0.02 0.005 0.1, belt N m s/rad 0.1 0.01 1, drag N m s/rad 0.05 0.005 0.5",
    )


def _slow(n: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    return np.asarray(lfilter([1.0], [1.0, -0.97], rng.normal(size=n)))


def _recorded(name: str, seed: int, *, drag: float = 0.0, pulled: float = 0.0) -> Recording:
    """Return what SciPy gives, with noise of both sensors that is correlated over 0.1 s.

    Args:
        drag: Dry friction, in N m.
        pulled: Torque that nobody reads, rms of about four times it, in N m.
    """
    rng = np.random.default_rng(seed)
    unread = pulled * _slow(SAMPLES, np.random.default_rng(seed + 100))
    torque = np.repeat(rng.uniform(-3.0, 3.0, SAMPLES // 40 + 1), 40)[:SAMPLES]
    a = np.array([[-0.17 / 0.025, 0.13 / 0.025], [0.13 / 0.05, -0.13 / 0.05]])
    x, rows, parts = np.zeros(2), [], 10
    kept = expm(np.block([[a, np.eye(2)], [np.zeros((2, 4))]]) * INTERVAL / parts)
    for u in torque + unread:
        rows.append(x.copy())
        for _ in range(parts):
            rub = drag * np.tanh(x[0] / 0.05)
            x = kept[:2, :2] @ x + kept[:2, 2:] @ np.array([(u - rub) / 0.025, 0.0])
    fade = math.exp(-INTERVAL / 0.1)
    noise = [
        lfilter([1.0], [1.0, -fade], size * math.sqrt(1.0 - fade**2) * rng.normal(size=SAMPLES))
        for size in (0.5, 0.3)
    ]
    read = np.array(rows).T + noise + 0.05 * rng.normal(size=(2, SAMPLES))
    told = {"motor [rad/s]": read[0], "drum [rad/s]": read[1]}
    return recording(name, INTERVAL, {"torque [N m]": torque}, told)


def _diagnosed(drag: float, *laws: str) -> Verdict:
    fitting, judging = _recorded("fit", 1, drag=drag), _recorded("judge", 2, drag=drag)
    few = [h for h in library(drum()) if h.law in laws]
    found = diagnose(drum(), [fitting], [judging], entries=few, jobs=1, advise=False)
    return found.verdict


@pytest.mark.parametrize("compiled", [True, False])
def test_the_likelihood_is_that_of_the_joint_distribution(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if compiled and compiler() is None:
        pytest.skip("there is no C compiler")
    model = drum().with_parameters({"inertia": 0.025, "belt": 0.13, "drag": 0.04})
    white, rms, time = 0.05, (0.5, 0.3), 0.1
    model = replace(
        model,
        outputs=tuple(
            replace(q, noise_rms=white, correlated_noise_rms=r, noise_correlation_time=time)
            for q, r in zip(model.outputs, rms, strict=True)
        ),
    )
    seen = observe(model, _recorded("fit", 1))
    seen = replace(
        seen,
        inputs=seen.inputs[:120],
        outputs=seen.outputs[:120],
        start=np.zeros(2),
        start_rms=np.zeros(2),
    )
    if not compiled:
        monkeypatch.setenv("WORKBENCH_CC", "none")
        compiler.cache_clear()
        built_before.cache_clear()
    try:
        run = PredictionError(model, seen, ()).run(seen, model.values)
    finally:
        if not compiled:
            monkeypatch.undo()
            compiler.cache_clear()
            built_before.cache_clear()
    assert run.states.shape == (120, 2)
    # With a certain start and no disturbance the states are those of a simulation.
    expected = run.states
    cost = 0.0
    for k in range(2):
        fading = rms[k] ** 2 * np.exp(-INTERVAL * np.arange(120) / time)
        covariance = toeplitz(fading) + white**2 * np.eye(120)
        error = seen.outputs[:, k] - expected[:, k]
        cost += 0.5 * float(error @ np.linalg.solve(covariance, error))
        cost += 0.5 * float(np.linalg.slogdet(covariance)[1])
    scales = sum(math.log(q.scale) for q in model.outputs) * 120
    assert run.cost + scales == pytest.approx(cost, rel=1e-6)


@pytest.mark.long
def test_a_right_model_beside_correlated_noise_lacks_nothing() -> None:
    verdict = _diagnosed(0.0, "coulomb_friction", "sensor_lag", "quadratic_drag")
    assert verdict.kind == "nothing_missing"
    assert sum("is not white" in row["note"] for row in verdict.data) == 2
    assert "correlated from sample to sample, of motor (" in verdict.sentence
    # Sizes and times are those of the data: 0.5 and 0.3 rad/s over 0.1 s.
    floor = verdict.fit["noise_floor"]
    assert floor["motor"] == pytest.approx(0.502, rel=0.15)
    assert floor["drum"] == pytest.approx(0.304, rel=0.15)


@pytest.mark.long
def test_friction_is_found_beside_correlated_noise() -> None:
    verdict = _diagnosed(0.4, "coulomb_friction", "sensor_lag", "quadratic_drag", "offset")
    assert verdict.kind in ("named", "named_class")
    (finding,) = verdict.findings
    assert finding.effect == "coulomb_friction_motor", finding.sentence
    # 0.4 N m on 0.025 kg m2.
    level = finding.parameters["level"]
    assert level.value == pytest.approx(16.0, rel=0.1)


@pytest.mark.parametrize("drag", [0.06, 0.4])
def test_what_follows_the_input_is_no_noise(drag: float) -> None:
    model = drum()
    read = [_recorded("fit", 1, drag=drag), _recorded("judge", 2, drag=drag)]
    assert with_correlated_noise(model, read)[0] is model


def test_what_lasts_as_long_as_a_response_is_no_noise() -> None:
    model = drum()
    read = [_recorded("fit", 1, pulled=0.01), _recorded("judge", 2, pulled=0.01)]
    fit, seen = fit_with_likely_starts(
        model, [observe(model, r) for r in read], default_priors(model)
    )
    left = {n: replace(x, rest=x.errors) for n, x in leftovers(fit, model, seen).items()}
    assert with_correlated_noise(model, read, left)[0] is model


def test_what_lasts_a_fifth_of_a_recording_is_no_noise() -> None:
    tank = machine(
        lambda m: {"level": m.u.flow - m.x.level / m.p.time},
        "level m scale=1",
        "flow m/s scale=1e-2",
        "level m 0.1 scale=1",
        "time s 5e3 1e3 2e4",
    )
    rng, errors, read = np.random.default_rng(1), [], []
    for name in ("fit", "judge"):
        slow = lfilter([1.0], [1.0, -math.exp(-1.0 / 150.0)], 0.16 * rng.normal(size=500))
        errors.append(slow + 0.1 * rng.normal(size=500))
        still = {"flow [m/s]": np.zeros(500)}
        read.append(recording(name, 0.2, still, {"level [m]": errors[-1]}))
    # 20 s of 100 s, however slow the tank is.
    left = {"level": Leftover(errors, 0.5, errors)}
    assert with_correlated_noise(tank, read, left)[0] is tank


def test_errors_that_follow_a_signal_are_told_from_those_that_do_not() -> None:
    rng = np.random.default_rng(3)
    chances = []
    for _ in range(200):
        error = _slow(800, rng)
        regressors = np.column_stack([_slow(800, rng) for _ in range(12)])
        chances.append(follows([error], [regressors])[0])
    # Probabilities of what is there by chance are uniform, however slow the signals are.
    assert 0.35 < np.mean(chances) < 0.65
    assert np.mean(np.array(chances) < 0.05) < 0.12
    signal = _slow(800, rng)
    assert follows([_slow(800, rng) + 0.5 * signal], [signal[:, None]])[0] < 1e-6
