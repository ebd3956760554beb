"""Conservation along simulated runs: mass, energy, and the limits of the gas law.

Integrals are taken by the trapezoidal rule from recorded signals, independently of the integrator.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import trapezoid

from workbench.experiments import pulse_train
from workbench.model import Input, Model, Output, Scope
from workbench.model.trace import Equations
from workbench.plants.arm import arm, joint
from workbench.plants.arm.geometry import ArmGeometry
from workbench.plants.arm.joint import ArmBody
from workbench.plants.arm.laws import heat_exchange
from workbench.simulation import Trajectory, simulate

GAMMA, GAS_CONSTANT, AMBIENT = 1.4, 287.05, 293.15
C_V = GAS_CONSTANT / (GAMMA - 1)


def arm_joint(load_kg: float) -> Model:
    """The joint alone in the horizontal plane, without friction, pulled by prescribed forces."""
    geometry, body = ArmGeometry(), ArmBody()

    def equations(m: Scope) -> Equations:
        forces = (m.u.force_1, m.u.force_2)
        rates, load_cell = joint.joint(m, forces=forces, geometry=geometry, body=body)
        return rates, {"angle": m.x.angle, "load_cell": load_cell}

    return Model(
        "arm joint",
        equations,
        states=joint.STATES,
        inputs=tuple(Input(f"force_{i}", "N", 100.0) for i in (1, 2)),
        outputs=(Output("angle", "rad"), Output("load_cell", "N", 100.0)),
        parameters=joint.PARAMETERS,
    ).with_parameters({"load": load_kg})


@pytest.fixture(scope="module")
def cycles() -> Trajectory:
    """Two periods of the open-loop trial, finely sampled; the second one is periodic."""
    voltage = pulse_train(duration=8.0, sample_time=0.0005)
    return simulate(arm(3.0), voltage, sample_time=0.0005, check=False)


@pytest.mark.parametrize("k", [1, 2])
def test_mass_is_conserved(cycles: Trajectory, k: int) -> None:
    pressure, temperature = cycles.states[:, 2 * k], cycles.states[:, 2 * k + 1]
    mass = pressure * cycles[f"chamber_{k}.volume"] / (GAS_CONSTANT * temperature)
    flow = cycles[f"chamber_{k}.flow"]
    flowed = trapezoid(flow, cycles.time)
    throughput = trapezoid(np.abs(flow), cycles.time)
    # Spool steps of 2 ms within samples of 0.5 ms: the trapezoidal rule is good to 1e-4.
    assert mass[-1] - mass[0] == pytest.approx(flowed, abs=3e-4 * throughput)
    assert throughput > 2 * mass.max()


@pytest.mark.parametrize("k", [1, 2])
def test_first_law_holds_over_a_closed_cycle(cycles: Trajectory, k: int) -> None:
    last = slice(8000 - 1, None)
    time = cycles.time[last]
    pressure, temperature = cycles.states[last, 2 * k], cycles.states[last, 2 * k + 1]
    volume, flow = cycles[f"chamber_{k}.volume"][last], cycles[f"chamber_{k}.flow"][last]
    heat, carried = cycles[f"chamber_{k}.heat"][last], np.where(flow > 0, AMBIENT, temperature)
    energy = pressure * volume / (GAMMA - 1)
    enthalpy = trapezoid(GAMMA * C_V * flow * carried, time)
    work = trapezoid(pressure, volume)
    through = trapezoid(GAMMA * C_V * np.abs(flow) * carried, time)
    balance = enthalpy - work + trapezoid(heat, time) - (energy[-1] - energy[0])
    assert abs(balance) < 3e-4 * through
    # The cycle is closed, and the gas does positive work in it.
    assert energy[-1] == pytest.approx(energy[0], rel=2e-3)
    assert work > 0.5  # J, in each muscle


def test_work_of_torque_and_stops_is_kinetic_energy(cycles: Trajectory) -> None:
    inertia = cycles["joint.inertia"]
    torque = cycles["joint.torque"] + cycles["lower_stop.torque"] - cycles["upper_stop.torque"]
    free = (cycles["angle"] > 0.0) & (cycles["angle"] < np.radians(60.0))
    first = int(np.argmax(~free))  # until the first stop is touched
    assert first > 200
    kinetic = 0.5 * inertia * cycles["speed"] ** 2
    power = torque * cycles["speed"]
    work = trapezoid(power[:first], cycles.time[:first])
    assert kinetic[first - 1] - kinetic[0] == pytest.approx(work, abs=1e-4 * kinetic[:first].max())


def sealed(coefficient: float, **arguments: str) -> Trajectory:
    """The arm swings with both muscles sealed by the shut valve."""
    model = arm(3.0, **arguments).without("centre_leakage")
    model = model.without("heat_exchange")
    if coefficient:
        model = model.with_effect(heat_exchange(coefficient=coefficient))
    start = {"angle": np.radians(20.0)}
    return simulate(model, np.full(1000, 5.0), sample_time=0.001, start=start, tolerance=1e-9)


@pytest.mark.parametrize("k", [1, 2])
def test_sealed_gas_without_heat_is_adiabatic(k: int) -> None:
    run = sealed(0.0)
    invariant = run.states[:, 2 * k] * run[f"chamber_{k}.volume"] ** GAMMA
    assert invariant == pytest.approx(invariant[0], rel=1e-6)
    assert np.ptp(run.states[:, 2 * k + 1]) > 5.0


@pytest.mark.parametrize("k", [1, 2])
def test_sealed_gas_with_good_exchange_is_isothermal(k: int) -> None:
    run = sealed(1e5)
    invariant = run.states[:, 2 * k] * run[f"chamber_{k}.volume"]
    assert invariant == pytest.approx(invariant[0], rel=5e-4)
    assert np.ptp(run.states[:, 2 * k + 1]) < 0.2


def test_sealed_gas_as_printed_has_the_exponent_0_6() -> None:
    run = sealed(0.0, variant="as_printed")
    pressure, volume = run.states[:, 2], run["chamber_1.volume"]
    exponent = -np.polyfit(np.log(volume), np.log(pressure), 1)[0]
    assert exponent == pytest.approx(0.6, abs=1e-3)


@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_a_stop_takes_energy_and_gives_none(speed: float) -> None:
    model = arm_joint(3.0)
    stiffness = {q.name: q.value for q in model.parameters}["stop_stiffness"]
    start = {"angle": np.radians(59.9), "speed": speed}
    run = simulate(model, np.zeros((2000, 2)), sample_time=1e-4, start=start, tolerance=1e-9)
    depth = np.maximum(0.0, run["angle"] - np.radians(60.0))
    energy = 0.5 * run["joint.inertia"] * run["speed"] ** 2 + 0.5 * stiffness * depth**2
    assert run["upper_stop.torque"].min() >= 0.0, "a stop can only push"
    assert np.diff(energy).max() < 1e-6 * energy[0]
    assert 0.0 < run["speed"].min() * -1 < speed
    assert run["lower_stop.torque"].max() == 0.0


def test_restitution_of_a_stop_matches_a_damped_oscillator() -> None:
    # Contact of m x'' = -(c x' + k x), pushing only: it ends where c x' + k x crosses zero.
    model = arm_joint(3.0)
    p = {q.name: q.value for q in model.parameters}
    start = {"angle": np.radians(60.0), "speed": 2.0}
    run = simulate(model, np.zeros((1000, 2)), sample_time=1e-4, start=start, tolerance=1e-9)
    inertia = run["joint.inertia"][0]
    natural = np.sqrt(p["stop_stiffness"] / inertia)
    ratio = p["stop_damping"] / (2 * np.sqrt(p["stop_stiffness"] * inertia))
    damped = natural * np.sqrt(1 - ratio**2)
    t = np.linspace(0.0, np.pi / damped, 200_001)
    x = 2.0 / damped * np.exp(-ratio * natural * t) * np.sin(damped * t)
    v = np.gradient(x, t)
    end = int(np.argmax(p["stop_stiffness"] * x + p["stop_damping"] * v < 0.0))
    assert run["speed"][-1] == pytest.approx(v[end], rel=1e-3)
