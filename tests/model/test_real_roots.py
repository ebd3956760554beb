"""Roots of levels that fall to zero."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.machines import machine
from workbench.diagnosis.problem import Problem
from workbench.diagnosis.refit_report import run_refit
from workbench.model import Model, Output, Scope
from workbench.recordings.recording import Recording, Signal
from workbench.simulation import simulate


def tank(least: float | None = None) -> Model:
    """A tank with a free outflow, as everybody writes it first, or with a least level, in m."""

    def equations(m: Scope) -> dict[str, Any]:
        level = m.x.level if least is None else ca.fmax(m.x.level, least)
        outflow = m.p.orifice * ca.sqrt(2.0 * 9.81 * level)
        return {"level": (m.p.pump * m.u.voltage - outflow) / 1.5e-3}

    return machine(
        equations,
        "level m 0.1",
        "voltage V 0 10",
        "level m",
        "pump m3/(s V) 3e-6 5e-7 2e-5, orifice m2 8e-6 1e-6 1e-4",
    )


def emptied(seed: int) -> Recording:
    """Return a tank of 1e-5 m2 and 4e-6 m3/(s V), every 2 s, that runs empty between two fills."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(1.0, 6.0, 8) * np.tile([1.0, 0.0], 4), 75)
    x, levels = np.array([0.1]), []

    def rates(_: float, x: np.ndarray, u: float) -> list[float]:
        return [(4e-6 * u - 1e-5 * np.sqrt(2.0 * 9.81 * max(x[0], 0.0))) / 1.5e-3]

    for u in voltage:
        levels.append(x[0] + 1e-3 * rng.normal())
        x = solve_ivp(rates, (0.0, 2.0), x, args=(u,), max_step=0.2).y[:, -1]
    assert min(levels) < 0.0  # What is measured of an empty tank is noise about nothing.
    signals = (
        Signal("voltage", voltage, "V", role="command"),
        Signal("level", np.array(levels), "m"),
    )
    return Recording(f"tank {seed}", 2.0 * np.arange(len(voltage)), signals)


def test_an_empty_tank_stays_empty_until_it_is_filled() -> None:
    model = tank()
    assert model.rates([-1e-3], [0.0]) == pytest.approx([0.0])
    assert model.rates([-1e-3], [3.0]) == pytest.approx([3e-6 * 3.0 / 1.5e-3])
    voltage = np.repeat([0.0, 3.0], 150)[:, None]
    run = simulate(model, voltage, sample_time=2.0)
    level = run.states[:, 0]
    assert np.isfinite(level).all() and abs(level[149]) < 1e-3 and level[-1] > 0.05


def test_above_zero_nothing_changes() -> None:
    x = np.array([[0.02], [0.3]])
    for level in x:
        assert tank().rates(level, [2.0]) == pytest.approx(tank(1e-12).rates(level, [2.0]))


@pytest.mark.parametrize("least", [None, 0.0])
def test_recordings_of_a_tank_that_runs_empty_are_refitted(least: float | None) -> None:
    """Of a level that is cut off at zero the root has a value below, but no slope."""
    runs = [emptied(1), emptied(2)]
    model = replace(tank(least), outputs=(Output("level", "m", noise_rms=1e-3),))
    report = run_refit(Problem("tank", "a tank", model, fit=runs[:1], hold_out=runs[1:]))
    found = {e.name: e.value for e in report.refit.estimates}
    assert found == pytest.approx({"pump": 4e-6, "orifice": 1e-5}, rel=0.02)
