"""Starts that the first measurements do not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.diagnosis.machine_data import by_runge_kutta, held, recording
from tests.machines import machine
from workbench.diagnosis.estimation import start
from workbench.diagnosis.estimation.free_run import free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, perfect_cost
from workbench.diagnosis.estimation.simulated_recordings import simulated
from workbench.diagnosis.estimation.start import fit_with_likely_starts, fitted_start, likely_start
from workbench.diagnosis.estimation.windows import settled
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.plants.cascaded_tanks import cascaded_tanks
from workbench.simulation import simulate


def test_the_level_of_a_tank_that_is_not_read_is_found() -> None:
    tanks = cascaded_tanks()
    pump = 2.0 + np.sin(0.05 * np.arange(120))
    run = simulate(
        tanks, pump, sample_time=4.0, start={"upper_level": 9.0, "lower_level": 4.0}, check=False
    )
    noise = np.random.default_rng(0).normal(0.0, 0.03, 120)
    read = {"level [V]": run.outputs[:, 0] + noise}
    seen = observe(tanks, recording("tanks", 4.0, {"pump [V]": pump}, read))
    assert abs(seen.start[0] - 9.0) > 1.5  # the first measurement says nothing of it
    found = fitted_start(tanks, seen, samples=50)
    # 50 measurements with 0.03 V of noise, the effect of the start on them being of order one.
    assert found.start == pytest.approx([9.0, 4.0], abs=0.1)
    assert free_run(tanks, found).rmse["level"] < 0.035


def test_layers_that_nobody_reads_start_as_the_plant_says_where_few_samples_mislead() -> None:
    names = [f"layer_{i}" for i in range(6)]

    def heats(T: Any, pump: Any, draw: Any) -> list[Any]:
        """Return the heat into each layer, in W: drawn from below, conducted, lost, pumped in."""
        below = [283.0, *T[:-1]]
        heat = [4180.0 * draw * (b - t) - 0.45 * (t - 293.0) for b, t in zip(below, T, strict=True)]
        for i, (b, t) in enumerate(pairwise(T)):
            heat[i] += 4.5 * (t - b)
            heat[i + 1] -= 4.5 * (t - b)
        heat[1] += 2.7 * pump
        return heat

    tank = machine(
        lambda m: (
            {
                name: heat / m.p.capacity
                for name, heat in zip(
                    names, heats([m.x[n] for n in names], m.u.pump, m.u.draw), strict=True
                )
            },
            {"top": m.x.layer_5, "middle": m.x.layer_3},
        ),
        ", ".join(f"{name} K 318" for name in names),
        "pump W 0 2500, draw kg/s 0 0.3",
        "top K, middle K",
        "capacity J/K 1.05e5 1e4 1e6",
    )
    rng = np.random.default_rng(3)
    pump = np.repeat(np.clip(rng.uniform(-2000.0, 2500.0, 16), 0.0, None), 60)
    draw = np.repeat(np.clip(rng.uniform(-0.5, 0.12, 64), 0.0, None), 15)

    def rates(_: float, T: Any, u: float, v: float) -> Any:
        return [heat / 1.05e5 for heat in heats(list(T), u, v)]

    x = held(rates, [318.0] * 6, (pump, draw), 60.0)
    noise = rng.normal(0.0, 0.1, (960, 2))
    read = {"top [K]": x[:, 5] + noise[:, 0], "middle [K]": x[:, 3] + noise[:, 1]}
    runs = [recording("tank", 60.0, {"pump [W]": pump, "draw [kg/s]": draw}, read)]
    told, _ = with_undeclared(tank, runs)
    run = free_run(told, settled(told, told, observe(told, runs[0])))
    assert max(run.rmse.values()) < 0.12


def test_a_pipe_is_as_cold_as_what_flows_out_of_it_later_shows() -> None:
    cells = [f"cell_{i}" for i in range(6)]
    pipe = machine(
        lambda m: (
            {
                own: m.u.flow / (m.p.mass / 6.0) * (before - m.x[own])
                for before, own in zip(
                    [m.u.entering, *(m.x[n] for n in cells)], cells, strict=False
                )
            },
            {"leaving": m.x.cell_5},
        ),
        ", ".join(f"{name} K 353 scale=20" for name in cells),
        "entering K 273 400, flow kg/s 0 150",
        "leaving K 0.1 scale=20",
        "mass kg 225e3 1e5 4e5",
    )

    def rates(_: float, T: Any, entering: float, flow: float) -> Any:
        return flow / (225e3 / 6.0) * (np.append(entering, T[:-1]) - T)

    rng = np.random.default_rng(2)
    entering = np.repeat(rng.uniform(338.0, 368.0, 7), 90)[:600]
    flow = np.repeat(rng.uniform(30.0, 65.0, 5), 130)[:600]
    T = held(rates, np.full(6, 338.0), (entering, flow), 60.0)
    read = {"leaving [K]": T[:, 5] + rng.normal(0.0, 0.1, 600)}
    seen = recording("pipe", 60.0, {"entering [K]": entering, "flow [kg/s]": flow}, read)
    begun = settled(pipe, pipe, observe(pipe, seen))
    # A fortieth is 15 samples; what stood at the entrance leaves after 80.
    assert begun.start == pytest.approx(np.full(6, 338.0), abs=1.5)
    assert free_run(pipe, begun).rmse["leaving"] < 0.11


def test_a_start_that_is_known_stays() -> None:
    tanks = cascaded_tanks()
    seen = simulated(tanks, np.full(60, 3.0), sample_time=4.0)
    sure = fitted_start(tanks, seen, samples=20)
    assert sure.start[1] == pytest.approx(tanks.initial_state()[1], abs=0.05)
    assert np.array_equal(sure.start_rms, seen.start_rms)


def test_the_number_of_samples_has_a_range() -> None:
    tanks = cascaded_tanks()
    seen = simulated(tanks, np.full(60, 3.0), sample_time=4.0)
    with pytest.raises(WorkbenchError, match="samples is 61; the valid range is 2 to 60"):
        fitted_start(tanks, seen, samples=61)


def generator() -> Model:
    """A generator on a strong grid, of which power and frequency are read."""

    def equations(m):
        angle, slip, emf = m.x.angle, m.x.slip, m.x.emf
        reactance = 0.3 + m.p.line
        power = emf / reactance * ca.sin(angle)
        push = m.u.turbine - power - m.p.damping * slip / 314.0
        rates = {
            "angle": slip,
            "slip": 157.0 / m.p.inertia * push,
            "emf": (m.u.field - emf - 1.3 * (emf - ca.cos(angle)) / reactance) / m.p.field_time,
        }
        return rates, {"power": power, "frequency": 50.0 + slip / 6.2832}

    return machine(
        equations,
        "angle rad 0.8, slip rad/s, emf 1 1.1",
        "turbine 1 0 1 0.6, field 1 0 5 2",
        "power 1 1.5e-3, frequency Hz 2e-3",
        "inertia s 3 1 10, damping 1 5 0 60, line 1 0.4 0.1 1.5, field_time s 6 2 15",
    )


TRUE = {"inertia": 3.6, "damping": 12.0, "line": 0.5, "field_time": 5.0}


def of_generator() -> tuple[Model, Observed]:
    """Return the generator, its noise declared, and a recording of one with other parameters."""
    nominal = generator()
    machine = nominal.with_parameters(TRUE)
    rng = np.random.default_rng(1)
    steps = np.column_stack([rng.uniform(0.35, 0.85, 16), rng.uniform(1.8, 2.8, 16)])
    inputs = np.repeat(steps, 125, axis=0)
    run = simulate(
        machine,
        inputs,
        sample_time=0.02,
        start={"angle": 0.2, "slip": 0.0, "emf": 1.45},
        check=False,
    )
    read = run.outputs + np.array([1.5e-3, 2e-3]) * rng.normal(size=run.outputs.shape)
    told = recording(
        "grid",
        0.02,
        {"turbine [1]": inputs[:, 0], "field [1]": inputs[:, 1]},
        {"power [1]": read[:, 0], "frequency [Hz]": read[:, 1]},
    )
    nominal, _ = with_undeclared(nominal, [told])
    return nominal, observe(nominal, told)


def test_a_product_of_two_hidden_states_does_not_lead_the_filter_astray() -> None:
    nominal, seen = of_generator()
    assert abs(seen.start[2] - 1.45) > 0.4  # a frequency and a power say little of it
    found, (started,) = fit_with_likely_starts(nominal, [seen], default_priors(nominal))
    assert started.start == pytest.approx([0.2, 0.0, 1.45], abs=0.05)
    for name, value in TRUE.items():
        assert found.refit.estimate(name).value == pytest.approx(value, rel=0.02), name
    # Nothing is missing, and the filter needs nothing that takes up what is.
    assert found.noise_scale <= 0.03
    assert found.cost < perfect_cost(found.model, [started]) + 100.0


def test_equations_that_leave_something_out_make_no_start_surer_than_they_move_it() -> None:
    nominal, seen = of_generator()
    machine = nominal.with_parameters(TRUE)
    right, wrong = (likely_start(machine, seen, seen, scale) for scale in (0.0, 1.0))
    for started in (right, wrong):
        assert started.start[2] == pytest.approx(1.45, abs=0.1)
    moved = np.abs(wrong.start - seen.start)
    assert np.all(wrong.start_rms >= moved)
    assert right.start_rms[2] < moved[2]


def test_equations_that_leave_something_out_do_not_move_a_start_beyond_what_is_known_of_it() -> (
    None
):
    nominal = machine(
        lambda m: {"x": m.x.core - m.x.x + 0.1 * m.u.u, "core": -0.1 * m.x.core},
        "x K, core K start_rms=0.05",
        "u K -10 10",
        "x K 1e-3",
    )
    # In truth a sun shines on it, which a core of half a kelvin explains for a while.
    time = 0.05 * np.arange(400.0)
    noise = 1e-3 * np.random.default_rng(1).normal(size=time.shape)
    read = {"x [K]": 0.5 * (1.0 - np.exp(-time)) + noise}
    seen = observe(nominal, recording("sun", 0.05, {"u [K]": 0.0 * time}, read))
    assert likely_start(nominal, seen, seen).start[1] > 0.3
    assert likely_start(nominal, seen, seen, 1.0) is seen


def test_a_start_that_is_as_likely_as_any_stays() -> None:
    tanks = cascaded_tanks()
    seen = simulated(tanks, np.full(200, 3.0), sample_time=4.0)
    assert likely_start(tanks, seen, seen) is seen


def test_a_reading_tells_no_more_of_a_start_than_is_known_of_the_parameters_between() -> None:
    """A load on a rope, of which a load cell reads the force: how far it hangs, stiffness tells."""

    def equations(m):
        force = m.p.stiffness * (m.u.top - m.x.height) - m.p.damping * m.x.speed
        return {"height": m.x.speed, "speed": force / 800.0 - 9.81}, {"cell": force}

    nominal = machine(
        equations,
        "height m scale=1, speed m/s scale=0.5",
        "top m scale=1",
        "cell N 12 scale=8e3",
        "stiffness N/m 3e5 3e4 3e6, damping N s/m 1e3 0 1e4",
    )
    k, d = 4.1e5, 1.9e3
    rng = np.random.default_rng(0)
    top = np.cumsum(np.repeat(rng.uniform(-1.0, 1.0, 10), 30)) * 2e-4

    def rates(_: float, x: Sequence[float], u: float) -> tuple[float, float]:
        return x[1], (k * (u - x[0]) - d * x[1]) / 800.0 - 9.81

    x = by_runge_kutta(rates, (-800.0 * 9.81 / k, 0.0), top.tolist(), 0.01, 10)
    cell = k * (top - x[:, 0]) - d * x[:, 1] + rng.normal(0.0, 12.0, len(top))
    read = recording("rope", 0.01, {"top [m]": top}, {"cell [N]": cell})
    nominal, _ = with_undeclared(nominal, [read])
    found, _ = fit_with_likely_starts(nominal, [observe(nominal, read)], default_priors(nominal))
    assert found.refit.estimate("stiffness").value == pytest.approx(k, rel=2e-3)
    assert found.noise_scale <= 0.03


def test_parameters_that_went_astray_with_little_trust_are_refitted_from_their_priors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tanks = cascaded_tanks()
    seen = simulated(tanks, 2.0 + np.sin(0.05 * np.arange(120)), sample_time=4.0)
    whole = start.fit_with_process_noise

    def astray(*given: Any, noise_scale: float | None = None, **known: Any) -> ProcessNoiseFit:
        fit = whole(*given, noise_scale=noise_scale, **known)
        if noise_scale is None:
            at_bound = tuple(replace(e, on_bound=bound) for e in fit.refit.estimates)
            worse = replace(fit.refit, cost=fit.cost + 500.0, estimates=at_bound)
            fit = replace(fit, noise_scale=1.0, refit=worse)
        return fit

    monkeypatch.setattr(start, "fit_with_process_noise", astray)
    for bound in (False, True):
        found, _ = fit_with_likely_starts(tanks, [seen], default_priors(tanks))
        assert (found.noise_scale < 0.3) is bound
    # What is no likelier from there stays.
    monkeypatch.setattr(start, "_CLEARLY", 1e4)
    found, _ = fit_with_likely_starts(tanks, [seen], default_priors(tanks))
    assert found.noise_scale == 1.0


def test_a_start_is_found_along_a_bend() -> None:
    def cell(m: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        voltage = 3.0 + 0.75 * m.x.charge + 0.45 * (1.0 - np.exp(-14.0 * m.x.charge))
        return {"charge": -m.u.current / 1e4}, {"voltage": voltage - 0.02 * m.u.current}

    model = machine(
        cell, "charge 1 scale=1", "current A scale=1", "voltage V 1e-3 scale=1", name="cell"
    )
    rest = np.zeros(50)
    read = rest + 3.0 + 0.75 * 0.8 + 0.45
    seen = observe(model, recording("rest", 1.0, {"current [A]": rest}, {"voltage [V]": read}))
    # One update from an empty cell, about which the voltage is ten times as steep, leads to 0.15.
    assert seen.start[0] == pytest.approx(0.8, abs=3e-3)
    assert seen.start_rms[0] < 3e-3
