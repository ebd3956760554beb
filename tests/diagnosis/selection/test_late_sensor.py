"""A position that is read late, by whole and half samples, of what meets walls: data from SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from casadi import fmax
from pytest import approx

from tests.diagnosis.machine_data import held, recording
from tests.diagnosis.newcomers import diagnosed, levels, named
from tests.machines import machine
from workbench.arrays import Vector
from workbench.model import Model, Scope
from workbench.recordings.recording import Recording

STEP, WALL, STIFFNESS = 0.02, 0.4, 2000.0


def cart() -> Model:
    """A cart of which a force throws one way and the other against elastic walls."""

    def equations(m: Scope) -> dict[str, object]:
        x, v = m.x.position, m.x.speed
        walls = STIFFNESS * (fmax(0.0, -WALL - x) - fmax(0.0, x - WALL))
        return {"position": v, "speed": (m.u.drive - m.p.damping * v + walls) / m.p.mass}

    return machine(
        equations,
        "position m scale=0.5, speed m/s",
        "drive N -10 10",
        "position m 1e-4, speed m/s 1e-3",
        "mass kg 1.1 0.3 3, damping N s/m 2.2 0.1 20",
    )


def _thrown(seed: int, late: float) -> Recording:
    drive = levels(500, seed, 8.0, 10, 30)

    def rates(_: float, x: Vector, force: float) -> list[float]:
        wall = STIFFNESS * (max(0.0, -WALL - x[0]) - max(0.0, x[0] - WALL))
        return [x[1], force - 2.0 * x[1] + wall]

    # Half steps, so that a reading may be late by half a sample.
    x = held(rates, [0.0, 0.0], [np.repeat(drive, 2)], STEP / 2)
    rows = np.arange(0, 1000, 2)
    then = np.maximum(rows - round(2 * late / STEP), 0)
    noise = np.random.default_rng(seed).normal(size=(2, 500))
    read = {
        "position [m]": x[then, 0] + 1e-4 * noise[0],
        "speed [m/s]": x[rows, 1] + 1e-3 * noise[1],
    }
    return recording(f"run {seed}", STEP, {"drive [N]": drive}, read)


@pytest.mark.long
@pytest.mark.parametrize("late", [0.14, 0.15, 0.17])
def test_what_is_read_late_is_told_to_a_part_of_a_sample_though_it_meets_walls(
    late: float,
) -> None:
    runs = [_thrown(seed, late) for seed in (1, 2)]
    found = diagnosed(cart(), runs, "sensor_delay sensor_lag maxwell_element delay drive_lag")
    named(found, "sensor_delay_position", time=approx(late, abs=0.1 * STEP), noise=3.0)
    # The improved model reads late by itself, without a recording that is moved for it.
    # What it adds there is the whole of it, not what was left to the equations.
    assert found.verdict.findings[0].occurrence is not None
    assert found.verdict.findings[0].occurrence.rms > 0.03
    (advance,) = (q for q in found.verdict.model.parameters if q.name.endswith("advance"))
    assert advance.value == 0.0
