"""Refits of a motor by SciPy whose current tells its parameters and its state at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.machine_data import file, held, recording
from tests.machines import machine
from workbench.diagnosis.problem import Problem, problem_of_files
from workbench.diagnosis.refit_report import run_refit
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.model import Model, Scope
from workbench.model.trace import Named
from workbench.recordings.recording import Recording

K, RESISTANCE, DAMPING, INERTIA = 0.05, 1.2, 8e-4, 1.5e-3
TRUTH = {"k": K, "resistance": RESISTANCE, "damping": DAMPING, "inertia": INERTIA}


def _motor() -> Model:
    def equations(m: Scope) -> tuple[Named, Named]:
        p, speed = m.p, m.x.speed
        current = (m.u.voltage - p.k * speed) / p.resistance
        rates = {"speed": (p.k * current - p.damping * speed) / p.inertia, "angle": speed}
        return rates, {"speed": speed, "angle": m.x.angle, "current": current}

    return machine(
        equations,
        "speed rad/s scale=50, angle rad scale=10",
        "voltage V -24 24",
        "speed rad/s, angle rad, current A",
        "k N m/A 0.08 0.01 0.5, resistance ohm 2 0.2 20, damping N m s/rad 5e-4 0 0.02, "
        "inertia kg m2 1e-3 1e-4 0.05",
    )


def _driven(seed: int, speed: float, angle: bool) -> Recording:
    rng = np.random.default_rng(seed)
    volts = np.repeat(rng.uniform(-12.0, 12.0, 20), 50)

    def rates(t: float, x: list[float], u: float) -> list[float]:
        current = (u - K * x[0]) / RESISTANCE
        return [(K * current - DAMPING * x[0]) / INERTIA, x[0]]

    speeds, angles = held(rates, [speed, 0.0], [volts], 0.01).T
    read = {
        "speed [rad/s]": speeds + rng.normal(0.0, 0.3, 1000),
        "angle [rad]": angles + rng.normal(0.0, 0.005, 1000),
        "current [A]": (volts - K * speeds) / RESISTANCE + rng.normal(0.0, 0.02, 1000),
    }
    if not angle:
        del read["angle [rad]"]
    return recording(f"run {seed}", 0.01, {"voltage [V]": volts}, read)


@pytest.mark.parametrize("angle", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_motor_is_found_and_its_runs_begin_where_that_one_was(angle: bool, seed: int) -> None:
    runs = _driven(seed, 0.0, angle), _driven(seed + 10, 60.0, angle)
    model, _ = with_undeclared(_motor(), runs)
    report = run_refit(Problem("motor", "a motor", model, fit=runs[:1], hold_out=runs[1:]))
    apart = [(e.value - TRUTH[e.name]) / e.std for e in report.refit.estimates]
    assert max(map(abs, apart)) < 4.0
    assert max(e.std / TRUTH[e.name] for e in report.refit.estimates) < 0.01
    assert report.reaches_floor, str(report)


@pytest.mark.parametrize("late", [0, 1])
def test_a_command_that_was_written_late_is_told(late: int, tmp_path: Path) -> None:
    run = _driven(1, 0.0, angle=True)
    columns = {"time_s": run.time[late:], "voltage_V": run["voltage"][: len(run) - late]}
    columns |= {f"{n} [{run.signal(n).unit}]": run[n][late:] for n in ("speed", "angle", "current")}
    path = file(tmp_path / "a.csv", columns)
    notes = problem_of_files(_motor(), [path], []).notes
    assert any("written late" in note for note in notes) == bool(late)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"limited": 0.9}, "3.7 times the noise, the limit 3.3 times"),
        ({"limited": 1e5}, "parameters too uncertain to tell"),
        ({"limited": 0.5, "refitted": 0.3}, "at the noise"),
        ({"limited": 0.5, "noise": float("nan")}, "2 times the limit"),
    ],
)
def test_what_is_left_beside_the_noise_is_told(changed: dict[str, float], said: str) -> None:
    runs = _driven(1, 0.0, angle=True), _driven(11, 60.0, angle=True)
    model, _ = with_undeclared(_motor(), runs)
    report = run_refit(Problem("motor", "a motor", model, fit=runs[:1], hold_out=runs[1:]))
    known = {"spread": 100.0, "refitted": 1.0, "noise": 0.27} | changed
    told = replace(report, rows=(replace(report.rows[0], **known),))
    assert str(told).count(said) == 1 and "refitted: with the parameters above" in str(told)
    assert told.reaches_floor == (said == "at the noise")
