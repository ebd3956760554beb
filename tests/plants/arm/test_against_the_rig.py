"""The arm against a second implementation that shares no code with it: rates, then whole runs.

The rig keeps mass and internal energy of the gas where the arm keeps pressure and temperature, has
its own valve, muscle and geometry, and its own fixed-step integrator.
"""

from __future__ import annotations

import numpy as np
import pytest

from workbench.evaluation.rig import parameters, plant
from workbench.experiments import pulse_train
from workbench.model import Model
from workbench.plants.arm import arm
from workbench.simulation import simulate

GAMMA, GAS_CONSTANT = 1.4, 287.05
INDEX = plant.INDEX


def rig_state(x: np.ndarray, p: dict[str, float]) -> np.ndarray:
    """The rig's state for an arm's state (spool, spool speed, p1, T1, p2, T2, angle, speed)."""
    state = plant.initial(float(np.degrees(x[6])), (0.0, 0.0), p)
    space = plant.namespace(p)
    state[INDEX["spool"]], state[INDEX["spool_speed"]] = x[0], x[1]
    state[INDEX["speed"]] = x[7]
    for k, s in enumerate(plant.fibres(state, space)):
        volume = plant.volume(s) + p["dead_volume"]
        state[2 + 2 * k] = x[2 + 2 * k] * volume / (GAS_CONSTANT * x[3 + 2 * k])
        state[3 + 2 * k] = x[2 + 2 * k] * volume / (GAMMA - 1)
    return state


def rig_rates(x: np.ndarray, u: float, p: dict[str, float]) -> np.ndarray:
    """The rig's derivative, turned into the rates of the arm's states."""
    state = rig_state(x, p)
    space = plant.namespace(p)
    rate = plant.derivative(state, u, p)
    out = [rate[INDEX["spool"]], rate[INDEX["spool_speed"]]]
    slopes = plant.distance_slope(x[6]), -plant.distance_slope(plant.SPAN - x[6])
    for k, (s, slope) in enumerate(zip(plant.fibres(state, space), slopes, strict=True)):
        volume = plant.volume(s) + p["dead_volume"]
        growth = plant.volume_slope(s) * slope * x[7] / volume
        mass, energy = state[2 + 2 * k], state[3 + 2 * k]
        mass_rate, energy_rate = rate[2 + 2 * k], rate[3 + 2 * k]
        out += [
            x[2 + 2 * k] * (energy_rate / energy - growth),
            x[3 + 2 * k] * (energy_rate / energy - mass_rate / mass),
        ]
    return np.array([*out, rate[0], rate[1]])


def sampled_states(rng: np.random.Generator, count: int) -> np.ndarray:
    low = [-1.0, -100.0, 1.1e5, 260.0, 1.1e5, 260.0, np.radians(-0.1), -4.0]
    high = [1.0, 100.0, 6.9e5, 340.0, 6.9e5, 340.0, np.radians(60.1), 4.0]
    return rng.uniform(low, high, (count, 8))


@pytest.mark.parametrize(
    ("model", "changes"),
    [
        (arm(3.0), {"load": 3.0}),
        (arm(8.0, plane="vertical"), {"load": 8.0, "vertical": 1.0}),
        (arm(0.0, supply_bar=5.0), {"load": 0.0, "supply_pressure": 5e5}),
        (arm(3.0).without("centre_leakage"), {"load": 3.0, "centre_leakage": 0.0}),
        (arm(3.0).without("heat_exchange"), {"load": 3.0, "heat_transfer": 0.0}),
        (arm(3.0).without("damper"), {"load": 3.0, "viscous": 0.0}),
        (arm(3.0).without("bearing_friction"), {"load": 3.0, "coulomb": 0.0}),
    ],
    ids=["3 kg", "vertical", "5 bar", "no leakage", "adiabatic", "no damper", "no friction"],
)
def test_rates_agree(model: Model, changes: dict[str, float], rng: np.random.Generator) -> None:
    p = parameters.nominal(changes)
    scale = np.array([1.0, 600.0, 1e5, 10.0, 1e5, 10.0, 1.0, 1.0])
    for x in sampled_states(rng, 60):
        u = float(rng.uniform(3.0, 7.0))
        ours, theirs = model.rates(x, [u]) / scale, rig_rates(x, u, p) / scale
        # The rig's switch of phi, 1.757 mm, leaves a jump of 0.012 N: 1e-3 rad/s2 without load.
        assert ours == pytest.approx(theirs, rel=1e-6, abs=2e-3)


@pytest.mark.parametrize("load", [0.0, 3.0, 8.0])
def test_open_loop_runs_agree(load: float) -> None:
    voltage = pulse_train(duration=8.0)
    p = parameters.nominal({"load": load})
    state = plant.initial(30.0, (3.0, 3.0), p)
    finer = 40
    states, _ = plant.run(p, state, np.repeat(voltage, finer), step=0.002 / finer, keep=finer)
    run = simulate(arm(load), voltage, sample_time=0.002, tolerance=1e-8, check=False)
    apart = np.degrees(run["angle"] - states[:, 0])
    # Two integrators, two switches of phi (0.012 N apart): measured 0.0035 deg and 15 Pa at most,
    # after four stop contacts.
    assert np.abs(apart).max() < 0.01
    measured = np.array([plant.gauge(x, p) for x in states])
    for k in (0, 1):
        assert np.abs(run[f"pressure_{k + 1}"] - measured[:, k]).max() < 60.0
    # The comparison means something: the arm went from stop to stop.
    assert np.ptp(np.degrees(run["angle"])) > 59.9
