"""Identification end to end: the truth of the simulated rig is inside the intervals."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.experiments import IsometricRecord, isometric_experiment, isometric_experiment_on_arm
from workbench.physics.force_laws import PaperLaw
from workbench.plants.arm import arm
from workbench.plants.arm.static_identification import StaticForceFit, identify_static_force

TRUTH = PaperLaw()


@pytest.fixture(scope="module")
def muscle_record() -> IsometricRecord:
    return isometric_experiment(seed=5)


@pytest.fixture(scope="module")
def arm_record() -> IsometricRecord:
    return isometric_experiment_on_arm(arm(3.0), seed=5)


def identify(record: IsometricRecord) -> StaticForceFit:
    # 99.9 %: nine numbers are asserted at once.
    return identify_static_force(
        record.pressure, record.contraction, record.force, confidence=0.999
    )


@pytest.mark.parametrize("name", ["muscle_record", "arm_record"])
def test_identification_returns_the_truth(name: str, request: pytest.FixtureRequest) -> None:
    fit = identify(request.getfixturevalue(name))
    assert fit.order == 4
    assert fit.has_switch
    truth = dict(zip(("D1", "D2", "D3"), TRUTH.gain_bar_mm, strict=True))
    truth |= {f"phi_{i}": c for i, c in enumerate(TRUTH.phi_mm)}
    truth["switch"] = 1e3 * TRUTH.phi_switch
    for key, value in truth.items():
        low, high = fit.interval(key)
        assert low <= value <= high, key
    # And the intervals are not vacuous: 1 N/bar of 280, 5 N of phi.
    assert np.diff(fit.interval("D1"))[0] < 1.0
    contraction = np.linspace(0.0, 0.03, 31)
    low, high = fit.phi_interval(contraction)
    assert np.all(high - low < 5.0)
    assert np.all((low <= TRUTH.phi(contraction)) & (TRUTH.phi(contraction) <= high))


def test_the_record_is_isometric_and_spans_the_pressures(muscle_record: IsometricRecord) -> None:
    for number in range(11):
        own = muscle_record.ramp == number
        assert np.ptp(muscle_record.contraction[own]) == 0.0
        assert muscle_record.pressure[own].max() == pytest.approx(6e5, abs=5e3)
        assert muscle_record.pressure[own].min() < 2e3


def test_without_noise_the_force_is_that_of_the_law() -> None:
    record = isometric_experiment(contractions=(0.0, 0.012), noise=0.0)
    force = TRUTH.force(record.contraction, record.pressure)
    assert record.force == pytest.approx(force, abs=1e-6)


def test_the_load_cell_route_gives_the_force_of_the_muscle() -> None:
    record = isometric_experiment_on_arm(arm(3.0), stop_angles=(0.0, 0.6), noise=0.0)
    force = TRUTH.force(record.contraction, record.pressure)
    # What is left is the rounded slack clamp of the vented muscle 1, 0.5 N at most.
    assert record.force == pytest.approx(force, abs=0.5)


def test_the_identified_law_drives_the_arm() -> None:
    fit = identify(isometric_experiment(seed=1))
    force = fit.law.force(0.01, 4e5)
    assert float(force) == pytest.approx(float(TRUTH.force(0.01, 4e5)), abs=0.5)


def test_the_weight_of_the_arm_would_spoil_the_experiment() -> None:
    record = isometric_experiment_on_arm(
        arm(3.0, plane="vertical"), stop_angles=(0.0,), noise=0.0, ramp_time=10.0
    )
    force = TRUTH.force(record.contraction, record.pressure)
    assert np.min(record.force - force) > 100.0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"contractions": ()}, "at least one"),
        ({"contractions": (10.0,)}, "1 mm is 0.001 m"),
        ({"ramp_time": float("inf")}, "ramp time is inf"),
        ({"noise": -1.0}, "sensor noise"),
    ],
)
def test_mistakes_are_clear(arguments: dict[str, object], text: str) -> None:
    with pytest.raises(WorkbenchError, match=text):
        isometric_experiment(**arguments)  # type: ignore[arg-type]
