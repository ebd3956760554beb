"""A law without a name is found on data of other codes, and none where none is."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.axis_case import SAMPLE_TIME, excitation
from tests.diagnosis.machine_data import recording
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.nonparametric.curve_description import describing_terms
from workbench.diagnosis.nonparametric.dependence import loop_along, spread
from workbench.diagnosis.nonparametric.fit import drawn_values, nonparametric_term
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.evaluation.rig.cases import make_case
from workbench.model import Model
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.recordings import read_case
from workbench.recordings.recording import Recording


def made_up_law(x: float) -> float:
    """A force over position that no library has, in N."""
    return float(25.0 * np.sin(25.0 * x) / (1.0 + 20.0 * x * x))


def axis_recording(seed: int, *, hidden: bool) -> Observed:
    """The axis with a made-up force over its position, integrated here in small Euler steps."""
    n = 2400
    force = excitation(n, seed)
    x = v = 0.0
    positions = np.empty(n)
    substeps = 20
    h = SAMPLE_TIME / substeps
    for k in range(n):
        positions[k] = x
        # A loop keeps the axis in one range: nothing is known of the law outside.
        force[k] -= 800.0 * x
        push = float(force[k])
        for _ in range(substeps):
            friction = 200.0 * v + 20.0 * np.tanh(v / 1e-3)
            v += h * (push - friction + (made_up_law(x) if hidden else 0.0)) / 100.0
            x += h * v
    read = {"position [m]": 1e-6 * np.round(positions / 1e-6)}
    run = recording(f"axis-{seed}", SAMPLE_TIME, {"force [N]": force}, read)
    return observe(servo_axis(), run)


@lru_cache(maxsize=2)
def axis_term(hidden: bool) -> NonparametricTerm:
    """Fit a free-form term to the axis."""
    runs = [axis_recording(seed, hidden=hidden) for seed in (1, 2, 3)]
    priors = default_priors(servo_axis())
    base = fit_with_process_noise(servo_axis(), runs[:2], priors)
    return nonparametric_term(base, runs[:2], runs[2:], ["axis.force"], priors)


@dataclass(frozen=True)
class ArmCase:
    """A term fitted to the arm, and what the rig hid."""

    found: NonparametricTerm
    truth: dict[str, float]


@pytest.fixture(scope="module")
def cogging(tmp_path_factory: pytest.TempPathFactory) -> ArmCase:
    """The arm of the independent rig with a torque that is periodic in the angle."""
    folder = make_case(7, ["cogging"], 3.0, tmp_path_factory.mktemp("case"), seconds=6.0)
    case, model = read_case(folder), arm(3)
    seen = {k: _observed(model, r) for k, r in (*case.fit.items(), *case.hold_out.items())}
    fit_on = [seen[name] for name in case.fit]
    priors = default_priors(model)
    base = fit_with_process_noise(model, fit_on, priors)
    held = [seen[name] for name in case.hold_out]
    found = nonparametric_term(base, fit_on, held, ["joint.torque"], priors)
    truth = json.loads((Path(folder) / "truth.json").read_text())["parameters"]
    return ArmCase(found, truth)


def _observed(model: Model, recording: Recording) -> Observed:
    return observe(model, recording.with_roles({"valve": "command"}))


@pytest.mark.long
def test_a_made_up_law_of_the_axis_is_found_over_the_right_argument() -> None:
    found = axis_term(True)
    assert found.accepted, found.reason
    assert found.ports == ("axis.force",) and not found.relative and not found.loop
    assert [a.name for a in found.arguments] == ["position"]
    assert found.arguments[0].p_value <= 0.01
    assert found.held_out[1] > 0.0
    before, after = found.rmse["position"]
    assert after < 0.3 * before


def test_the_curve_is_the_law_but_for_constant_and_scale() -> None:
    found = axis_term(True)
    low, high = found.arguments[0].hull
    x = np.linspace(low, high, 200)[10:-10]
    law = np.array([made_up_law(value) for value in x])
    curve = found.curve(x)
    # The offset of the axis takes up a constant; the mass is estimated too and is not exact.
    error = (curve - curve.mean()) - (law - law.mean())
    assert np.std(error) < 0.1 * np.std(law)


def test_nothing_is_accepted_where_nothing_is_hidden() -> None:
    found = axis_term(False)
    assert not found.accepted and found.reason
    assert "nonparametric term" in str(found)


@pytest.mark.long
def test_cogging_of_the_arm_is_found_without_its_name(cogging: ArmCase) -> None:
    found, truth = cogging.found, cogging.truth
    assert found.accepted, found.reason
    assert found.ports == ("joint.torque",) and [a.name for a in found.arguments] == ["angle"]
    # The noise of the encoder is 1e-5 rad; what is left are small errors of the pressures.
    before, after = found.rmse["angle"]
    assert after < 0.5 * before
    low, high = found.arguments[0].hull
    x = np.linspace(low, high, 300)[15:-15]
    law = truth["cogging_torque"] * np.sin(truth["cogging_periods"] * x)
    curve = found.curve(x)
    assert np.std((curve - curve.mean()) - (law - law.mean())) < 0.25 * np.std(law)
    best = found.arguments[0].terms[0]
    assert best.name.startswith("sin(") and best.frequency > 0.8
    assert float(best.name[4:-3]) == pytest.approx(truth["cogging_periods"], rel=0.1)


def test_the_term_prints_ports_arguments_and_judgement() -> None:
    text = str(axis_term(True))
    for part in ("axis.force", "position", "p 0.01", "held-out", "m", "accepted"):
        assert part in text


def test_curves_are_drawn_as_far_apart_as_the_refit_knows_them() -> None:
    refit = axis_term(True).fit.refit
    # Its deviations have what correlated errors add.
    assert refit.inflations.max() > 1.05
    places = range(len(refit.estimates))
    drawn = np.concatenate(
        [drawn_values(refit, places, np.random.default_rng(seed)) for seed in range(40)]
    )
    assert drawn.std(axis=0) == pytest.approx([e.std for e in refit.estimates], rel=0.05)


def test_knots_over_a_rate_are_dense_about_zero() -> None:
    values = np.random.default_rng(0).uniform(-6.0, 6.0, 2000)
    knots = np.array(spread(values, "speed", "rad/s", 12).knots)
    assert np.min(np.abs(knots)) < 0.03
    assert np.allclose(knots, -knots[::-1])
    assert np.ptp(np.diff(spread(values, "angle", "rad", 6).knots)) < 1e-9


def test_a_loop_follows_dahls_equation() -> None:
    time = np.linspace(0.0, 6.0, 20001)
    x = np.sin(2.0 * time)[:, None]
    z = np.zeros(len(time))
    for k in range(1, len(time)):
        step = x[k, 0] - x[k - 1, 0]
        z[k] = z[k - 1] + (step - abs(step) * z[k - 1]) / 0.1
    memory = loop_along(x, np.zeros(len(time), dtype=int), 0.1)[:, 0]
    # The explicit steps above are first order in the step of x, which is 6e-4.
    assert np.max(np.abs(memory - z)) < 0.01


def test_terms_of_simple_curves() -> None:
    x = np.linspace(-2.0, 2.0, 60)
    scatter = 0.01 * np.random.default_rng(1).normal(size=(30, 60))
    for name, curve in {"x": 3.0 * x + 1.0, "|x|": np.abs(x), "sign x": np.sign(x)}.items():
        assert describing_terms(x, curve, curve + scatter)[0].name == name
