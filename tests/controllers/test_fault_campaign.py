"""Every fault, in every phase of a move, with every design: in the loop and in C.

The designs are those of the registry, with the specification that each has by itself, and those of
the study ``tolerant``. One that no C is written of, and that solves for a millisecond at each
sample, is tried in every fourth phase. `make fault-campaign` runs all of it; each design tells its
runs, touches of a stop and time.
"""

from __future__ import annotations

import functools
import math
import sys
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from controllers.design import DESIGNS, Design
from controllers.guard import Fault, Guarded
from tests.controllers.in_c import InC
from workbench.evaluation.tolerance import tolerant_study
from workbench.study.designs import ControllerRecipe
from workbench.study.plants import PlantRecipe
from workbench.study.read import shipped_study
from workbench.verification import (
    Change,
    Run,
    Scenario,
    SignalFault,
    Steps,
    guarded,
    step_scenario,
    verify,
)

DEG = math.pi / 180.0
SAMPLE = 0.002
PHASES = np.round(np.linspace(0.45, 0.85, 16), 3).tolist()
"""From rest through the move, which takes some 0.2 s from 0.5 s on, to rest."""


@dataclass(frozen=True)
class Bench:
    """A plant, and a move on it.

    Args:
        plant: Its recipe.
        at: Where designs start from and the guard's estimator, in SI.
        move: The move, without faults.
        output: What moves.
        size: Size of its faults, in SI; that of the angle is 1 rad.
        near: How far from its aim a move may end, in SI.
    """

    plant: PlantRecipe
    at: dict[str, float]
    move: Scenario
    output: str
    size: float
    near: float


ARM = Bench(
    PlantRecipe("arm", (("load", "3 kg"),)),
    {"angle": 30 * DEG},
    replace(step_scenario("angle", 20, 40, unit="deg", hold=0.8), settle=0.1),
    "angle",
    1.0,
    0.5 * DEG,
)
MEAN = {"mean_pressure": Steps((0.0,), (3e5,))}
TWO_VALVES = replace(
    ARM,
    plant=replace(ARM.plant, kind="two-valve-arm"),
    at={**ARM.at, "mean_pressure": 3e5},
    move=replace(ARM.move, references={**ARM.move.references, **MEAN}),
)
AXIS = Bench(
    PlantRecipe("servo-axis"),
    {"position": 0.0},
    replace(step_scenario("position", 0.0, 0.1, hold=2.5), settle=0.1),
    "position",
    0.3,
    0.005,
)


TOLERANT = replace(ARM, move=replace(ARM.move, duration=1.9))
"""With time for designs that move more slowly."""


def bench(design: Design) -> Bench:
    """Return the bench of a design: its arm, or the axis for those of any linear model."""
    if not design.sensors:
        return AXIS
    return TWO_VALVES if len(design.actuators) == 2 else ARM


def recipe(design: Design) -> ControllerRecipe:
    on = bench(design)
    return ControllerRecipe(design.name, design.name, on.plant, tuple(on.at.items()))


STUDY = tomllib.loads(shipped_study("tolerant").read_text(encoding="utf-8"))
NAMES = [*DESIGNS.names(), *(f"tolerant {n}" for n in STUDY["controllers"])]


@functools.cache
def laws() -> dict[str, ControllerRecipe]:
    """The laws by name; reading the study takes longer than a run."""
    tolerant = tolerant_study().controllers
    return {
        **{name: recipe(design) for name, design in DESIGNS.members().items()},
        **{f"tolerant {name}": found for name, found in tolerant.items()},
    }


def bench_of(name: str) -> Bench:
    return TOLERANT if name.startswith("tolerant") else bench(laws()[name].kind())


def phases(design: Design) -> list[float]:
    return PHASES if design.exports else PHASES[1::4]


@dataclass(frozen=True)
class Signal:
    """A fault of a signal.

    Args:
        level: Its level, in sizes of the bench or in Pa.
        last: How long it lasts, in s.
    """

    name: str
    kind: str
    level: float = 0.0
    last: float = math.inf


SHORT = {
    "output missing": Signal("output", "missing", last=SAMPLE),
    "output infinite": Signal("output", "value", math.inf, SAMPLE),
    "output spike": Signal("output", "offset", 0.5, SAMPLE),
    "output out of range": Signal("output", "value", -3.0, 2 * SAMPLE),
    "pressure missing": Signal("pressure_1", "missing", last=SAMPLE),
    "pressure spike": Signal("pressure_2", "offset", 4e5, SAMPLE),
    "reference missing": Signal("reference", "missing", last=0.3),
    "reference infinite": Signal("reference", "value", -math.inf, SAMPLE),
    "deadline missed": Signal("deadline", "missing", last=SAMPLE),
    "deadline missed thrice": Signal("deadline", "missing", last=3 * SAMPLE),
}
"""Faults after which every move ends where it should."""

LONG = {
    "output missing long": Signal("output", "missing", last=0.1),
    "output stuck": Signal("output", "stuck"),
    "output stuck for a while": Signal("output", "stuck", last=0.15),
    "output offset": Signal("output", "offset", 0.15),
    "pressure missing long": Signal("pressure_1", "missing", last=0.1),
    "pressure stuck": Signal("pressure_1", "stuck"),
    "pressure offset": Signal("pressure_2", "offset", 1.5e5),
    "deadline missed long": Signal("deadline", "missing", last=0.1),
    "reference below the stop": Signal("reference", "value", -0.35, 0.15),
    "reference far": Signal("reference", "value", 50.0, 0.05),
}
"""Faults that cost the move; nothing that is not finite, no command that stays at its end."""

FASTEST_HIT = 100.0 * DEG
"""Largest speed with which a stop may be touched, in rad/s."""


def faulty(on: Bench, design: Design) -> Iterator[tuple[str, float, Scenario]]:
    """Yield every fault in every phase: its name, its time, and the move with it."""
    names = {"output": on.output, "reference": f"reference.{on.output}"}
    for t in phases(design):
        for what, fault in {**SHORT, **LONG}.items():
            if fault.name.startswith("pressure") and fault.name not in design.sensors:
                continue
            level = fault.level * (on.size if fault.name in names else 1.0)
            name = names.get(fault.name, fault.name)
            spoilt = SignalFault(t, name, fault.kind, level, t + fault.last)
            yield what, t, replace(on.move, faults=(spoilt,))
        if on is not AXIS:
            lost = (
                Change(t, "supply_pressure", 2.0e5),
                Change(t + 0.2, "supply_pressure", 7.01325e5),
            )
            yield "supply lost", t, replace(on.move, changes=lost)


def hit(run: Run) -> float:
    """Return the largest speed with which a stop was touched, in rad/s; 0 if none was."""
    speed, found = np.abs(run["speed"]), 0.0
    for name in {"lower_stop.torque", "upper_stop.torque"} & set(run.signal_names):
        touching = run[name] > 0.0
        for k in np.flatnonzero(touching[1:] & ~touching[:-1]).tolist():
            found = max(found, float(speed[max(0, k - 1) : k + 2].max()))
    return found


def check(run: Run, law: Guarded, in_c: InC | None) -> None:
    assert np.isfinite(run.inputs).all() and np.isfinite(run.outputs).all()
    # No rail for ever: by the end every command has left its ends.
    for quantity, values in zip(run.input_quantities, run.inputs[-100:].T, strict=True):
        assert ((values > quantity.lower) & (values < quantity.upper)).any()
    assert hit(run) < FASTEST_HIT
    if in_c is None:
        return
    # The same measurements in C: the same commands, and no status that Python did not tell.
    memory, own, commands = law.initial_state(tuple(run.measured[0].tolist())), [], []
    names, told = set(), set()
    in_c.start(run.measured[0])
    late = missed(run)
    for k, (row, asked) in enumerate(zip(run.measured.tolist(), asked_for(run), strict=True)):
        command, memory, info = (
            law.missed(memory) if late[k] else law.step(memory, tuple(row), asked)
        )
        own.append(command)
        names.add(str(info.get("guard", "clear")))
        status = in_c.missed() if late[k] else in_c.step(row, asked)
        told.add(Fault(status // 16).word)
        commands.append(tuple(in_c.command))
    assert told == names
    np.testing.assert_allclose(commands, own, atol=1e-8)


def missed(run: Run) -> list[bool]:
    """Return at which samples no step was done in time."""
    found = np.zeros(len(run.time), dtype=bool)
    for fault in run.scenario.faults:
        if fault.signal == "deadline":
            found |= (run.time >= fault.time - 1e-9) & (run.time < fault.until - 1e-9)
    return found.tolist()


def asked_for(run: Run) -> list[tuple[float, ...]]:
    """Return the references as the controller was given them, faults included."""
    found = {name: run.references[name].copy() for name in run.controlled}
    for fault in run.scenario.faults:
        kind, _, name = fault.signal.partition(".")
        if kind == "reference":
            at = (run.time >= fault.time - 1e-9) & (run.time < fault.until - 1e-9)
            found[name][at] = [fault.of(v, v) for v in found[name][at]]
    return list(zip(*(values.tolist() for values in found.values()), strict=True))


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_every_fault_in_every_phase(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = laws()[name]
    design = found.kind()
    if design.family == "H-infinity" and find_spec("slycot") is None:
        pytest.skip("needs slycot")
    on = bench_of(name)
    plant = on.plant.build()
    law = guarded(found.build(), plant, at=on.at)
    in_c = InC(law, tmp_path) if design.exports else None
    # A law that does not reach its aim without faults cannot do so with one.
    aim = float(on.move.references[on.output].values[-1])  # type: ignore[attr-defined]
    reaches = abs(verify(law, plant, on.move)[on.output][-1] - aim) < on.near
    began, fastest, runs, off = time.perf_counter(), 0.0, 0, []
    for what, t, scenario in faulty(on, design):
        run = verify(law, plant, scenario)
        runs += 1
        fastest = max(fastest, hit(run))
        try:
            check(run, law, in_c)
            if what in SHORT and reaches:
                assert abs(run[on.output][-1] - aim) < on.near
        except AssertionError as error:
            off.append(f"{what} at {t:g} s: {str(error).splitlines()[0]}")
    with capsys.disabled():
        sys.stdout.write(
            f"\n{name}: {runs} runs in Python{' and in C' if in_c else ''}, fastest touch of a stop"
            f" {fastest / DEG:.0f} deg/s, {time.perf_counter() - began:.0f} s"
            f"{'' if reaches else ', not at its aim without faults either'}\n"
        )
    assert not off, "\n".join(off)


def test_campaign_is_as_large_as_it_says() -> None:
    runs = {
        name: sum(1 for _ in faulty(bench_of(name), found.kind())) for name, found in laws().items()
    }
    assert list(runs) == NAMES
    assert {found.design for found in laws().values()} == set(DESIGNS.names())
    assert min(runs.values()) >= 80 and sum(runs.values()) >= 2500
