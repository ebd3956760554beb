"""Commands that were written beside measurements that already answer to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated_recording
from workbench.diagnosis.misrecorded_columns import with_commands_in_time
from workbench.physics.library import library
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording


def _run(seed: int, rows_late: int) -> Recording:
    force = np.r_[0.0, 0.0, pushes(800, largest=200.0, hold=5, seed=seed)]
    made = simulated_recording(
        servo_axis(), force[2:], sample_time=0.01, values={"mass": 104.0}, seed=seed, name=f"{seed}"
    )
    written = force[2 - rows_late :][:800]
    signals = (replace(s, values=written) if s.name == "force" else s for s in made.signals)
    return replace(made, signals=tuple(signals))


@pytest.mark.parametrize(("rows_late", "moved"), [(0, False), (1, True), (2, False)])
def test_a_command_that_is_written_a_row_late_is_moved_up(rows_late: int, moved: bool) -> None:
    runs = [_run(seed, rows_late) for seed in (1, 2)]
    found, rows = with_commands_in_time(servo_axis(), runs)
    assert bool(rows) is moved
    if moved:
        assert "force acted a row before being written: moved up by one, 10 ms" in rows[0]["note"]
        assert np.array_equal(found[1]["force"][:-1], _run(2, 0)["force"][:-1])


def test_a_diagnosis_finds_nothing_in_a_command_that_is_written_late() -> None:
    axis, said = servo_axis(), list[str]()
    few = [e for e in library(axis) if e.law in ("creep", "clock_shift")]
    runs = [_run(seed, 1) for seed in (1, 2)]
    verdict = diagnose(
        axis, runs[:1], runs[1:], entries=few, jobs=1, advise=False, progress=said.append
    ).verdict
    assert verdict.kind == "nothing_missing"
    assert any("acted a row before" in line for line in said)
    assert any(row["check"] == "rows" for row in verdict.data)
