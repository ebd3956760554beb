"""Lines, silencers and supply: wide and small they vanish, narrow they slow the arm down."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.experiments import pulse_train
from workbench.model import Effect, Model
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.physics.leakage import chamber_leakage
from workbench.physics.supply import line, silencer, supply_droop
from workbench.plants.arm import arm
from workbench.simulation import Trajectory, simulate

VOLTAGE = pulse_train(duration=2.8, period=2.8)


def swing(*effects: Effect, seconds: float = 2.8) -> Trajectory:
    model: Model = arm(3.0).with_effect(*effects)
    start = {"angle": np.radians(10.0), "pressure_1": 3.01325e5, "pressure_2": 5.01325e5}
    voltage = VOLTAGE[: round(seconds / 0.002)]
    return simulate(model, voltage, sample_time=0.002, start=start, check=False)


@pytest.fixture(scope="module")
def nominal() -> Trajectory:
    return swing()


def apart(run: Trajectory, other: Trajectory) -> float:
    return float(np.degrees(np.abs(run["angle"] - other["angle"])).max())


CASES = {
    "lines": lambda c: (line(volume=1e-6, conductance=c),),
    "silencers": lambda c: (silencer(volume=1e-6, conductance=c),),
    "supply": lambda c: (supply_droop(volume=2e-4, conductance=c),),
}


@pytest.mark.parametrize("case", CASES)
def test_wide_restrictions_vanish(case: str) -> None:
    # The first swing tells; the narrow time constants of a wide restriction take long to simulate.
    free = swing(seconds=0.8)
    narrow, medium, wide = (
        apart(swing(*CASES[case](c), seconds=0.8), free) for c in (2e-9, 2e-8, 4e-7)
    )
    assert narrow > medium > wide
    assert narrow > 1.0
    # What is left is the gas that even an open cubic centimetre holds.
    assert wide < 0.35


@pytest.mark.parametrize("case", CASES)
def test_narrow_restrictions_slow_the_arm_down(case: str, nominal: Trajectory) -> None:
    # At 0.9 V an edge opens to 1.6e-9 m3/(s Pa): the restriction is the narrower one.
    run = swing(*CASES[case](1e-9))
    assert np.abs(run["speed"]).max() < 0.95 * np.abs(nominal["speed"]).max()


def test_supply_pressure_droops_while_the_muscle_fills_and_recovers() -> None:
    run = swing(supply_droop(volume=5e-4, conductance=4e-9))
    supply = run["supply.pressure"]
    assert supply[0] == pytest.approx(7.01325e5, rel=1e-9)
    # 0.1 to 0.4 bar on rigs of this kind.
    assert 6.6e5 < supply.min() < 6.95e5
    assert supply[-1] > supply.min() + 1e3
    assert supply.max() <= 7.01325e5 * (1 + 1e-9)


def test_silencers_hold_a_back_pressure_only_while_air_is_vented() -> None:
    run = swing(silencer(conductance=1e-9))
    for k in (1, 2):
        pressure = run[f"exhaust_{k}.pressure"]
        assert pressure[0] == pytest.approx(1.01325e5)
        assert pressure.max() > 1.1e5
        assert pressure.min() > 1.01325e5 * (1 - 1e-6)


@pytest.mark.parametrize(
    "effect",
    [
        chamber_leakage("chamber_1.flow", conductance=0.0),
        muscle_hysteresis(level=0.0, level_per_pressure=0.0),
    ],
    ids=lambda e: e.name,
)
def test_an_effect_of_size_zero_is_none(effect: Effect, nominal: Trajectory) -> None:
    assert apart(swing(effect), nominal) < 1e-3


def test_hysteresis_takes_energy_out_of_a_free_swing() -> None:
    def decay(*effects: Effect) -> float:
        model = arm(3.0).without("centre_leakage", "bearing_friction").with_effect(*effects)
        run = simulate(
            model, np.full(1500, 5.0), sample_time=0.002, start={"angle": 0.6}, check=False
        )
        return float(np.ptp(run["angle"][1000:]))

    assert decay(muscle_hysteresis()) < 0.5 * decay()


def test_arm_with_everything_attached_starts_at_rest_and_simulates() -> None:
    model = arm(3.0, silencers=True, line_volumes=True, plane="vertical").with_effect(
        supply_droop(), muscle_hysteresis(), chamber_leakage("chamber_1.flow")
    )
    start = model.initial_state()
    values = dict(zip([q.name for q in model.states], start, strict=True))
    assert values["line_1.pressure"] == values["pressure_1"]
    assert values["silencer_2.pressure"] == pytest.approx(1.01325e5)
    assert values["supply_droop.pressure"] == pytest.approx(7.01325e5)
    run = simulate(model, VOLTAGE, sample_time=0.002)
    assert run.error < 1e-3
