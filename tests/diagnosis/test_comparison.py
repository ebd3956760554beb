"""The unknown input and the proof: against a hidden force that is known here."""

from __future__ import annotations

import numpy as np
import pytest

from tests.diagnosis.axis_case import diagnosed, excitation, observed, positions, stribeck
from workbench.diagnosis.comparison import error_rows, located_ports, proof_of
from workbench.diagnosis.location.missing_signal import correlation_ratio
from workbench.diagnosis.location.unknown_input import unknown_input
from workbench.errors import WorkbenchError
from workbench.plants.servo_axis import servo_axis


def test_the_smoother_finds_the_hidden_force() -> None:
    model = servo_axis().with_parameters({"mass": 100.0})
    seen = observed(1, hidden=True)
    found = unknown_input(model, seen, ["axis.force"])
    speed = positions(excitation(len(seen.outputs), 1), hidden=True)[1]
    true = np.array([-stribeck(v) for v in speed])
    moving = found.std[:, 0] < 0.5 * true.std()
    error = (found.signal[:, 0] - true)[moving]
    assert np.mean(moving) > 0.3
    assert np.corrcoef(found.signal[moving, 0], true[moving])[0, 1] > 0.9
    # The band holds what it should: 95 % of a normal distribution, less for the kinks at rest.
    assert np.mean(np.abs(error) < 2 * found.std[moving, 0] + 1.0) > 0.8
    # Ten steps of the encoder; the first sample starts from what is known before the measurements.
    where = positions(excitation(len(seen.outputs), 1), hidden=True)[0]
    assert np.max(np.abs(found.states[1:, 0] - where[1:])) < 1e-5


def test_nothing_hidden_leaves_no_unknown_input() -> None:
    model = servo_axis().with_parameters({"mass": 100.0})
    quiet = unknown_input(model, observed(1, hidden=False), ["axis.force"])
    loud = unknown_input(model, observed(1, hidden=True), ["axis.force"])
    assert np.std(quiet.signal) < 0.2 * np.std(loud.signal)


def test_unknown_ports_are_refused() -> None:
    with pytest.raises(WorkbenchError, match=r"did you mean 'axis\.force'"):
        unknown_input(servo_axis(), observed(1, hidden=False, n=50), ["axis.forces"])


def test_the_law_lies_on_the_located_signal_of_held_out_recordings() -> None:
    found = diagnosed(True)
    proof = proof_of(found)
    (located,) = proof.located
    assert located.port == "axis.force" and located.argument.name == "speed"
    assert located.law is not None
    rows = located.known
    assert np.corrcoef(located.signal[rows], located.law[rows])[0, 1] > 0.8
    assert located.explained > 0.5
    # The effect opposes the motion.
    fast = rows & (np.abs(located.argument.values) > 0.005)
    assert np.mean(located.law[fast] * located.argument.values[fast]) < 0


def test_errors_are_those_of_the_verdict() -> None:
    found = diagnosed(True)
    (row,) = error_rows(found)
    assert row.unit == found.nominal.outputs[0].display_unit == "mm"
    for label in ("nominal", "refitted", "extended"):
        assert row.rmse[label] == pytest.approx(1e3 * found.verdict.fit[label]["position"])
    assert row.over_noise("refitted") == pytest.approx(row.rmse["refitted"] / row.noise)
    assert row.normalised("refitted") == pytest.approx(row.rmse["refitted"] / row.spread)


def test_nothing_is_shown_where_nothing_is_missing() -> None:
    found = diagnosed(False)
    assert located_ports(found) == ()
    assert proof_of(found).located == ()


def test_correlation_ratio_of_noise_is_small_and_of_a_function_large(
    rng: np.random.Generator,
) -> None:
    x = rng.normal(size=5000)
    assert correlation_ratio(x**2, x) > 0.8
    # 24 classes explain 24 of 5000 samples by chance.
    assert correlation_ratio(rng.normal(size=5000), x) < 0.02
