"""Every fault, in every phase of a move, with every family: in the loop and in C.

`make fault-campaign` runs all of it; each family tells its runs, touches of a stop and time.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.guard import FAULTS, Guarded
from controllers.joint.schedule import JointSchedule
from tests.controllers.families import family
from tests.controllers.in_c import InC
from workbench.linearisation import LinearModel
from workbench.model import Model
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

FAMILIES = {
    "fixed PID": family("pid"),
    "scheduled PID": family("scheduled-pid"),
    "sliding mode": family("sliding-mode"),
    "super-twisting": family("scheduled-sliding-mode"),
    "state feedback": family("scheduled-state-feedback"),
    "H-infinity": family("scheduled-h-infinity"),
    "linear MPC": family("mpc"),
    "scheduled MPC": family("scheduled-mpc"),
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
    "deadline missed": signal("deadline", "missing", last=SAMPLE),
    "deadline missed thrice": signal("deadline", "missing", last=3 * SAMPLE),
}
"""Faults after which every move ends where it should."""

LONG: dict[str, Faulty] = {
    "angle missing long": signal("angle", "missing", last=0.1),
    "angle stuck": signal("angle", "stuck"),
    "angle stuck for a while": signal("angle", "stuck", last=0.15),
    "angle offset": signal("angle", "offset", 0.15),
    "pressure missing long": signal("pressure_1", "missing", last=0.1),
    "pressure stuck": signal("pressure_1", "stuck"),
    "pressure offset": signal("pressure_2", "offset", 1.5e5),
    "deadline missed long": signal("deadline", "missing", last=0.1),
    "reference below the stop": signal("reference.angle", "value", -0.35, 0.15),
    "reference far": signal("reference.angle", "value", 50.0, 0.05),
    "supply lost": supply,
}
"""Faults that cost the move; nothing that is not finite, no command that stays at its end."""

FASTEST_HIT = 100.0 * DEG
"""Largest speed with which a stop may be touched, in rad/s."""


def hit(run: Run) -> float:
    """Return the largest speed with which a stop was touched, in rad/s; 0 if none was."""
    speed, found = np.abs(run["speed"]), 0.0
    for name in ("lower_stop.torque", "upper_stop.torque"):
        touching = run[name] > 0.0
        for k in np.flatnonzero(touching[1:] & ~touching[:-1]).tolist():
            found = max(found, float(speed[max(0, k - 1) : k + 2].max()))
    return found


def check(run: Run, law: Guarded, in_c: InC, asked: Any) -> None:
    assert np.isfinite(run.inputs).all() and np.isfinite(run.outputs).all()
    valve = run["valve"]
    # No rail for ever: by the end the command has left its ends.
    assert ((valve[-100:] > 0.0) & (valve[-100:] < 10.0)).any()
    assert hit(run) < FASTEST_HIT
    # The same measurements in C: the same commands, and no status that Python did not tell.
    memory, own = law.initial_state(tuple(run.measured[0].tolist())), []
    names = set()
    late = missed(run)
    for k, (row, reference) in enumerate(zip(run.measured.tolist(), asked, strict=True)):
        (command,), memory, info = (
            law.missed(memory) if late[k] else law.step(memory, tuple(row), (reference,))
        )
        own.append(command)
        names.add(str(info.get("guard", "clear")))
    in_c.start(run.measured[0])
    commands, told = [], set()
    for k, (row, reference) in enumerate(zip(run.measured.tolist(), asked, strict=True)):
        status = in_c.missed() if late[k] else in_c.step(row, [reference])
        told.add(FAULTS[status // 16].name)
        commands.append(in_c.command[0])
    assert told == names
    np.testing.assert_allclose(commands, own, atol=1e-8)


def missed(run: Run) -> list[bool]:
    """Return at which samples no step was done in time."""
    found = np.zeros(len(run.time), dtype=bool)
    for fault in run.scenario.faults:
        if fault.signal == "deadline":
            found |= (run.time >= fault.time - 1e-9) & (run.time < fault.until - 1e-9)
    return found.tolist()


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
    name: str,
    schedule: JointSchedule,
    linear: LinearModel,
    plant: Model,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    law = guarded(FAMILIES[name](schedule, linear), plant, at={"angle": 30 * DEG})
    in_c = InC(law, tmp_path)
    began, fastest, runs, off = time.perf_counter(), 0.0, 0, []
    for what, fault in {**SHORT, **LONG}.items():
        for phase in PHASES:
            run = verify(law, plant, fault(phase))
            runs += 1
            fastest = max(fastest, hit(run))
            try:
                check(run, law, in_c, asked_for(run))
                if what in SHORT:
                    assert abs(run["angle"][-1] - 40 * DEG) < 0.5 * DEG
            except AssertionError as error:
                off.append(f"{what} at {phase:g} s: {str(error).splitlines()[0]}")
    with capsys.disabled():
        sys.stdout.write(
            f"\n{name}: {runs} runs in Python and in C, fastest touch of a stop"
            f" {fastest / DEG:.0f} deg/s, {time.perf_counter() - began:.0f} s\n"
        )
    assert not off, "\n".join(off)


def test_campaign_is_as_large_as_it_says() -> None:
    assert len(FAMILIES) * (len(SHORT) + len(LONG)) * len(PHASES) >= 2500
