"""Exported C gives the numbers of the law over ten thousand steps of a run on the plant."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers import design_mpc, design_pid, design_sliding_mode
from controllers.c_export import export_c
from controllers.scheduled import JointSchedule
from controllers.scheduled_pid import design_scheduled_pid
from controllers.scheduled_sliding_mode import KINDS, design_scheduled_sliding_mode
from controllers.scheduled_state_feedback import design_scheduled_state_feedback
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.simulation.compiled import compiler

STEPS = 10_000


def compiled_library(controller: Any, folder: Path) -> ctypes.CDLL:
    found = compiler()
    if found is None:
        pytest.skip("no C compiler on this machine")
    exported = export_c(controller, folder, name="law")
    library = folder / "law.so"
    command = [found, "-O1", "-ffp-contract=off", "-Wall", "-Werror=implicit", "-shared", "-fPIC"]
    subprocess.run([*command, str(exported.source), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


LAWS = {
    "scheduled PID": lambda schedule, _: design_scheduled_pid(schedule),
    "state feedback": lambda schedule, _: design_scheduled_state_feedback(schedule),
    "fixed PID": lambda _, linear: design_pid(linear),
    "fixed sliding mode": lambda _, linear: design_sliding_mode(linear),
    **{
        kind: lambda schedule, _, kind=kind: design_scheduled_sliding_mode(schedule, kind=kind)
        for kind in KINDS
    },
}


@pytest.mark.parametrize("make", LAWS.values(), ids=LAWS.keys())
def test_c_agrees_over_ten_thousand_steps(
    make: Any, schedule: JointSchedule, linear: LinearModel, tmp_path: Path
) -> None:
    law = make(schedule, linear)
    library = compiled_library(law, tmp_path)
    # An angle that follows steps and a sine with noise, pressures that move about their rest: every
    # branch of planner, tables and limits is passed.
    rng = np.random.default_rng(2)
    time = law.sample_time * np.arange(STEPS)
    reference = 0.5 + 0.2 * np.sin(1.3 * time) + 0.13 * np.sign(np.sin(0.9 * time))
    angle = np.convolve(reference, np.ones(80) / 80, mode="same") + 1e-4 * rng.normal(size=STEPS)
    swing = 1.2e5 * np.sin(2.1 * time) + 8e2 * rng.normal(size=STEPS)
    readings = np.column_stack([angle, 3.6e5 + swing, 3.6e5 - swing])

    state = law.initial_state(tuple(readings[0].tolist()))
    count = len(state)
    c_state, c_command = (ctypes.c_double * count)(), (ctypes.c_double * 1)()
    first = (ctypes.c_double * 3)(*readings[0])
    assert library.law_start(first, c_state) == 0
    np.testing.assert_allclose(np.array(c_state), np.array(state), rtol=1e-12, atol=1e-12)
    worst = 0.0
    span = [np.inf, -np.inf]
    for row, wanted in zip(readings.tolist(), reference.tolist(), strict=True):
        (command,), state, _ = law.step(state, tuple(row), (wanted,))
        library.law_step(
            (ctypes.c_double * 3)(*row), (ctypes.c_double * 1)(wanted), c_state, c_command
        )
        worst = max(worst, abs(c_command[0] - command))
        # Each step is compared from the same state: the law alone is open loop and keeps whatever
        # rounding its integrals collect.
        c_state[:] = [float(value) for value in state]
        span = [min(span[0], command), max(span[1], command)]
    # relative to the full range of the valve, 10 V
    assert worst / 10.0 <= 1e-12
    assert span[1] - span[0] > 1.0


def test_header_documents_the_interface(schedule: JointSchedule, tmp_path: Path) -> None:
    exported = export_c(design_scheduled_pid(schedule), tmp_path, name="rig_pid")
    text = exported.header.read_text()
    for word in ("pressure_1, Pa, gauge", "wanted angle now, rad", "valve, V", "integral", "0.002"):
        assert word in text
    assert "#define RIG_PID_STATES 17" in text


def test_refusals(linear: LinearModel, schedule: JointSchedule, tmp_path: Path) -> None:
    with pytest.raises(WorkbenchError, match="no law in closed form"):
        export_c(design_mpc(linear), tmp_path)
    with pytest.raises(WorkbenchError, match="small letters"):
        export_c(design_scheduled_pid(schedule), tmp_path, name="My PID")
    assert not list(tmp_path.iterdir())
