"""Diagnose real machines, each from its first model, and hold the result against what is known.

Units: SI.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from workbench.diagnosis.estimation.free_run import free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.stages import Diagnosis
from workbench.evaluation.blind_round import names_of
from workbench.evaluation.kept_answers import diagnosed, version
from workbench.evaluation.machines.plants import muscle
from workbench.model import Model
from workbench.model.units import from_si, quantity, to_si
from workbench.recordings import Recording, Signal, read_table
from workbench.recordings.case import read_case
from workbench.recordings.public_data import public_file

HERE = Path(__file__).parent
HOLD_S, SAMPLE_S = 0.4, 0.1
"""How long a point of a force map is held, and the sample time."""


@dataclass(frozen=True)
class Task:
    """A first model with recordings to fit on and to judge on; in a loop, those that judge it."""

    model: Model
    fit: tuple[Recording, ...]
    hold_out: tuple[Recording, ...]
    in_loop: tuple[tuple[Model, Recording], ...] = ()


@cache
def table() -> dict[str, dict[str, Any]]:
    """Return what the table says of each machine."""
    return tomllib.loads((HERE / "table.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Machine:
    """A machine of the table.

    Args:
        data: Folder with the recordings; None reads ``WORKBENCH_DATA``, and what it does not hold
            is fetched from the publishers.
    """

    name: str
    data: Path | None = None


def task_of(name: str, data: Path | None = None) -> Task:
    """Return the model and the recordings of a machine."""
    entry = table()[name]
    if "map" in entry:
        file = public_file(f"martens2017-festo-force-maps/{entry['map']}", data=data)
        model = muscle(entry["length"], entry["radius"])
        return Task(model, *_map_recordings(file, entry["length"]))
    case = read_case(HERE / entry["case"], data=data)
    return Task(
        case.model(),
        tuple(case.fit.values()),
        tuple(case.hold_out.values()),
        tuple((case.loops[n].model(), r) for n, r in case.used("in_loop").items()),
    )


def _map_recordings(
    file: Path, nominal: float
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Make a recording of a force map: each point is held; every second inner length is judged on.

    Points without force are left out: the muscle was slack there.
    """
    points = read_table(file)
    pressure, length, force = (np.asarray(points[n]) for n in ("pressure", "length", "force"))
    lengths = np.unique(length[force > 0.0])
    judged = np.isin(length, lengths[1:-1:2])

    def recording(name: str, rows: Any) -> Recording:
        held = round(HOLD_S / SAMPLE_S)
        at = np.repeat(np.flatnonzero(rows & (force > 0.0)), held)
        return Recording(
            name,
            SAMPLE_S * np.arange(len(at), dtype=np.float64),
            (
                Signal("pressure", pressure[at], "Pa", kind="gauge pressure", role="command"),
                Signal("contraction", nominal - length[at], "m", role="command"),
                # The load cell shows a point at the end of each step.
                Signal("force", np.concatenate([force[at][:1], force[at][:-1]]), "N"),
            ),
        )

    return (recording("lengths fitted", ~judged),), (recording("lengths held out", judged),)


def answer(machine: Machine, jobs: int) -> dict[str, Any]:
    """Diagnose one machine."""
    name = machine.name
    task, entry = task_of(name, machine.data), table()[name]
    row = {"schema": "machine/1", "machine": name, "version": version(), "held_out": {}}

    def held_out(found: Diagnosis) -> dict[str, Any]:
        models = {"refitted": found.base.model, "extended": found.verdict.model}
        if entry.get("in_loop"):
            return {"held_out": {k: _in_loop(m, task, entry["output"]) for k, m in models.items()}}
        return {"held_out": {k: found.verdict.fit[k][entry["output"]] for k in models}}

    return diagnosed(row, task.model, task.fit, task.hold_out, jobs=jobs, more=held_out)


def _in_loop(model: Model, task: Task, output: str) -> float:
    """Return the error of a model that runs in the machine's loop."""
    squares = []
    for loop, recording in task.in_loop:
        driven = replace(model, equations=loop.equations, inputs=loop.inputs)
        squares.append(free_run(driven, observe(driven, recording)).rmse[output] ** 2)
    return math.sqrt(sum(squares) / len(squares))


def shortfalls(row: Mapping[str, Any]) -> list[str]:
    """Return what a result lacks against the table."""
    entry, names = table()[row["machine"]], names_of(row["verdict"])
    lacking = [
        f"no {' or '.join(group)}"
        for group in entry.get("named", ())
        if not any(name.startswith(tuple(group)) for name in names)
    ]
    wrong = tuple(entry.get("not_named", ()))
    lacking += [f"{name} named" for name in names if wrong and name.startswith(wrong)]
    alone = tuple(entry.get("not_alone", ()))
    if len(names) == 1 and alone and names[0].startswith(alone):
        lacking.append(f"{names[0]} named alone")
    if "bar" in entry:
        value, bar = row["held_out"].get("extended"), entry["bar"]
        unit = bar.split()[1]
        if value is None or value > to_si(quantity("bar", bar, unit), unit):
            lacking.append(f"more than {bar}")
    return lacking


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a machine."""
    entry, verdict = table()[row["machine"]], row["verdict"]
    bar = entry.get("bar", "")
    unit = bar.split()[1] if bar else "N"

    def shown(which: str) -> str:
        value = row["held_out"].get(which)
        return "-" if value is None else f"{float(from_si(value, unit)):.3g}"

    lacking = "; ".join([*shortfalls(row), verdict.get("failure", "")]).strip("; ")
    return (
        f"{row['machine']:<9} {verdict['verdict']:<16} {', '.join(names_of(verdict)) or '-':<46}"
        f" {shown('refitted')} -> {shown('extended')} {unit}, bar {bar or 'none'};"
        f" {lacking or 'reached'} ({row['seconds']:.0f} s)"
    )
