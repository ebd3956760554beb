"""Means of rows: where they tell as much, and where they do not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.machine_data import file, recording
from tests.machines import machine
from workbench.diagnosis.averaging import averaged
from workbench.diagnosis.problem import problem_of_files
from workbench.diagnosis.refit_report import run_refit
from workbench.model import Model
from workbench.model.trace import Equations
from workbench.recordings.checks.time_base import evened
from workbench.recordings.recording import Recording

GAIN, TIME_CONSTANT, NOISE = 2.0, 600.0, 0.05


def _oven(time_constant: float = TIME_CONSTANT, noise: float = 0.0) -> Model:
    def equations(m: Equations) -> dict[str, Any]:
        rise = (m.p.gain * m.u.heater - m.x.warmth) / time_constant
        return {"warmth": rise}

    return machine(
        equations,
        "warmth K scale=50",
        "heater W 0 200 scale=50",
        f"warmth K {noise} scale=50",
        "gain K/W 1.5 0.1 5",
    )


def _recorded(name: str, rows: int, seed: int, step: float = 0.0) -> Recording:
    """Return an oven that is read once a second, solved exactly from row to row."""
    random = np.random.default_rng(seed)
    heater = np.repeat(random.choice([0.0, 20.0, 50.0], rows // 1999 + 1), 1999)[:rows]
    warmth, left = np.zeros(rows), math.exp(-1.0 / TIME_CONSTANT)
    for k in range(rows - 1):
        warmth[k + 1] = left * warmth[k] + (1.0 - left) * GAIN * heater[k]
    read = warmth + random.normal(0.0, NOISE, rows)
    read = step * np.round(warmth / step) if step else read
    return recording(name, 1.0, {"heater [W]": heater}, {"warmth [K]": read})


LONG = [_recorded("a", 21_000, 1), _recorded("b", 12_000, 2)]


def test_means_of_rows_have_less_noise_and_leave_out_where_the_input_jumps() -> None:
    model, means, note = averaged(_oven(noise=NOISE), LONG, evened)
    assert "33000 rows, one every 1 s" in note and "means of 3 rows, one every 3 s" in note
    assert model.outputs[0].noise_rms == pytest.approx(NOISE / math.sqrt(3.0))
    assert [len(r) for r in means] == [7000, 4000]
    jumps = np.flatnonzero(np.diff(means[0]["heater"]))
    lost = np.flatnonzero(~np.isfinite(means[0]["warmth"]))
    assert 0 < len(lost) < 0.05 * 7000
    assert all(np.min(np.abs(jumps - k)) < 30 for k in lost)


@pytest.mark.long
def test_a_refit_on_means_is_as_sure_and_as_right(tmp_path: Path) -> None:
    for r in LONG:
        columns = {"t [s]": r.time, "heater [W]": r["heater"], "warmth [K]": r["warmth"]}
        file(tmp_path / f"{r.name}.csv", columns)
    problem = problem_of_files(_oven(), [tmp_path / "a.csv"], [tmp_path / "b.csv"])
    assert any("means of 3 rows" in note for note in problem.notes)
    assert problem.model.outputs[0].noise_rms == pytest.approx(NOISE / math.sqrt(3.0), rel=0.05)
    means = run_refit(problem).refit.estimate("gain")
    whole_model = replace(problem.model, outputs=_oven(noise=NOISE).outputs)
    every = replace(problem, model=whole_model, fit=(LONG[0],), hold_out=(LONG[1],))
    whole = run_refit(every).refit.estimate("gain")
    assert means.std == pytest.approx(whole.std, rel=0.05)
    assert means.value == pytest.approx(whole.value, abs=0.5 * whole.std)
    assert means.value == pytest.approx(GAIN, abs=4.0 * means.std)


def test_steps_that_hide_the_noise_are_read_in_the_middle() -> None:
    coarse = [_recorded("a", 21_000, 1, step=1.0), _recorded("b", 12_000, 2, step=1.0)]
    _, means, _ = averaged(_oven(), coarse, evened)
    read = means[0]["warmth"]
    told = np.isfinite(read)
    assert len(read) == 7000 and np.mean(told) > 0.95
    assert np.array_equal(read[told], np.round(read[told]))


def test_a_plant_that_moves_within_few_rows_keeps_them_all() -> None:
    assert averaged(_oven(time_constant=2.0), LONG, evened)[1] == LONG
    short = [replace(r[:4000], name=r.name) for r in LONG]
    assert averaged(_oven(), short, evened)[1:] == (short, "")
