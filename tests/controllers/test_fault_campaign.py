"""Every fault, in every phase of a move, with every family: 2,000 runs in the loop and in C."""

from __future__ import annotations

import ctypes
import math
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers import design_mpc, design_pid, design_sliding_mode
from controllers.c_export import export_c
from controllers.guard import FAULTS, Guarded
from controllers.h_infinity.controller import design_h_infinity
from controllers.joint.schedule import JointSchedule
from controllers.mpc.along_plan import design_scheduled_mpc
from controllers.pid import design_scheduled_pid
from controllers.sliding_mode import design_scheduled_sliding_mode
from controllers.state_feedback import design_state_feedback
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.simulation.compiled import compiler
from workbench.verification import (
    Change,
    Run,
    Scenario,
    SignalFault,
    guarded,
    step_scenario,
    verify,
)

DEG = math.pi / 180.0
MOVE = replace(step_scenario("angle", 20, 40, unit="deg", hold=0.8), settle=0.1)
PHASES = np.round(np.linspace(0.45, 0.85, 16), 3).tolist()
"""From rest through the move, which takes some 0.2 s from 0.5 s on, to rest."""

FAMILIES: dict[str, Callable[[JointSchedule, LinearModel], Any]] = {
    "fixed PID": lambda _, linear: design_pid(linear),
    "scheduled PID": lambda schedule, _: design_scheduled_pid(schedule),
    "sliding mode": lambda _, linear: design_sliding_mode(linear),
    "super-twisting": lambda schedule, _: design_scheduled_sliding_mode(schedule),
    "state feedback": lambda schedule, _: design_state_feedback(schedule),
    "H-infinity": lambda schedule, _: design_h_infinity(schedule),
    "linear MPC": lambda _, linear: design_mpc(linear),
    "scheduled MPC": lambda schedule, _: design_scheduled_mpc(schedule),
}

Faulty = Callable[[float], Scenario]


def signal(name: str, kind: str, level: float = 0.0, last: float = math.inf) -> Faulty:
    return lambda t: replace(MOVE, faults=(SignalFault(t, name, kind, level, t + last),))


def supply(t: float) -> Scenario:
    lost = Change(t, "supply_pressure", 2.0e5), Change(t + 0.2, "supply_pressure", 7.01325e5)
    return replace(MOVE, changes=lost)


SAMPLE = MOVE.sample_time
SHORT: dict[str, Faulty] = {
    "angle missing": signal("angle", "missing", last=SAMPLE),
    "angle infinite": signal("angle", "value", math.inf, SAMPLE),
    "angle spike": signal("angle", "offset", 0.5, SAMPLE),
    "angle out of range": signal("angle", "value", -3.0, 2 * SAMPLE),
    "pressure missing": signal("pressure_1", "missing", last=SAMPLE),
    "pressure spike": signal("pressure_2", "offset", 4e5, SAMPLE),
    "reference missing": signal("reference.angle", "missing", last=0.3),
    "reference infinite": signal("reference.angle", "value", -math.inf, SAMPLE),
}
"""Faults after which every move ends where it should."""

LONG: dict[str, Faulty] = {
    "angle missing long": signal("angle", "missing", last=0.1),
    "angle stuck": signal("angle", "stuck"),
    "angle offset": signal("angle", "offset", 0.15),
    "pressure missing long": signal("pressure_1", "missing", last=0.1),
    "pressure stuck": signal("pressure_1", "stuck"),
    "reference below the stop": signal("reference.angle", "value", -0.35, 0.15),
    "reference far": signal("reference.angle", "value", 50.0, 0.05),
    "supply lost": supply,
}
"""Faults that cost the move; nothing that is not finite, no command that stays at its end."""


class InC:
    """An exported controller that is shown what one in the loop has seen."""

    def __init__(self, law: Guarded, folder: Path) -> None:
        found = compiler()
        if found is None:
            pytest.skip("no C compiler on this machine")
        exported = export_c(law, folder, name="law")
        path = folder / "law.so"
        flags = ["-O1", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-shared", "-fPIC"]
        subprocess.run([found, *flags, str(exported.source), "-o", str(path), "-lm"], check=True)
        self.library, self.states = ctypes.CDLL(str(path)), exported.states

    def replay(self, seen: Any, asked: Any) -> tuple[list[float], set[str]]:
        state, report = (ctypes.c_double * self.states)(), (ctypes.c_double * 4)()
        command, rows = (ctypes.c_double * 1)(), ctypes.c_double * seen.shape[1]
        self.library.law_start(rows(*seen[0]), state)
        commands, told = [], set()
        for row, reference in zip(seen.tolist(), asked, strict=True):
            status = self.library.law_step(
                rows(*row), (ctypes.c_double * 1)(reference), state, command, report
            )
            told.add(FAULTS[status // 16].name)
            commands.append(command[0])
        return commands, told


def check(run: Run, law: Guarded, in_c: InC, asked: Any) -> None:
    assert np.isfinite(run.inputs).all() and np.isfinite(run.outputs).all()
    valve = run["valve"]
    # No rail for ever: by the end the command has left its ends.
    assert ((valve[-100:] > 0.0) & (valve[-100:] < 10.0)).any()
    # The same measurements in C: the same commands, and no status that Python did not tell.
    memory, own = law.initial_state(tuple(run.measured[0].tolist())), []
    names = set()
    for row, reference in zip(run.measured.tolist(), asked, strict=True):
        (command,), memory, info = law.step(memory, tuple(row), (reference,))
        own.append(command)
        names.add(str(info.get("guard", "clear")))
    commands, told = in_c.replay(run.measured, asked)
    assert told == names
    np.testing.assert_allclose(commands, own, atol=1e-8)


def asked_for(run: Run) -> list[float]:
    """Return the references as the controller was given them, faults included."""
    found = run.references["angle"].copy()
    for fault in run.scenario.faults:
        if fault.signal == "reference.angle":
            at = (run.time >= fault.time - 1e-9) & (run.time < fault.until - 1e-9)
            found[at] = [fault.of(v, v) for v in found[at]]
    return [float(v) for v in found]


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_every_fault_in_every_phase(
    name: str, schedule: JointSchedule, linear: LinearModel, plant: Model, tmp_path: Path
) -> None:
    law = guarded(FAMILIES[name](schedule, linear), plant, at={"angle": 30 * DEG})
    in_c = InC(law, tmp_path)
    for what, fault in {**SHORT, **LONG}.items():
        for phase in PHASES:
            run = verify(law, plant, fault(phase))
            check(run, law, in_c, asked_for(run))
            if what in SHORT:
                assert abs(run["angle"][-1] - 40 * DEG) < 0.5 * DEG, (what, phase)


def test_campaign_is_as_large_as_it_says() -> None:
    assert len(FAMILIES) * (len(SHORT) + len(LONG)) * len(PHASES) >= 2000
