"""Make a planned case, diagnose it, let the baselines answer, and keep all of it as data."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.stages import Diagnosis
from workbench.evaluation.benchmark.baselines import answers
from workbench.evaluation.kept_answers import diagnosed, version
from workbench.evaluation.own_cases.plan import Planned, plan
from workbench.evaluation.own_cases.statistics import ANSWERERS
from workbench.evaluation.rig import plant, simulate
from workbench.evaluation.rig.cases import make_case
from workbench.evaluation.rig.parameters import nominal
from workbench.files import picked
from workbench.recordings import read_case

_FIRST = 3
"""Measurements averaged for the start."""


def limited_errors(folder: Path) -> dict[str, float]:
    """Return the rms errors of the rig itself on held-out recordings, by output, in rad and Pa.

    The rig runs with its true parameters and without noise, from the true start except that the
    angle and the pressures are those read: what is left is the noise of the measurements and what
    it does to the start.

    Args:
        folder: A case as `workbench.evaluation.rig.cases.make_case` makes it, with its truth.
    """
    truth = json.loads((folder / "truth.json").read_text())
    quiet = {"pressure_noise": 0.0, "pressure_step": 0.0, "angle_step": 0.0, "torque_noise": 0.0}
    quiet |= {"pressure_burst": 0.0, "angle_dropout": 0.0}
    p = truth["parameters"] | quiet
    squares = []
    for path in sorted(folder.glob("validate_*.csv")):
        data = np.loadtxt(path, delimiter=",", skiprows=1)
        start = _read_start(np.array(truth["starts"][path.stem]), data, truth["parameters"])
        run = simulate.run(p, start, command=data[:, 1], seed=0).table()
        squares.append(np.mean((run[:, 2:] - data[:, 2:]) ** 2, axis=0))
    angle, first, second = np.sqrt(np.mean(squares, axis=0))
    return {
        "angle": float(np.radians(angle)),
        "pressure_1": float(1e5 * first),
        "pressure_2": float(1e5 * second),
    }


def _read_start(state: Vector, data: Vector, p: dict[str, float]) -> Vector:
    """Move a true start to what the first measurements say, as they stand beside what is true."""
    seen = data[:_FIRST].mean(axis=0)
    # The recording without noise from the true start says what the sensors make of it.
    quiet = p | {"pressure_noise": 0.0, "pressure_step": 0.0, "angle_step": 0.0}
    exact = simulate.run(quiet, state, command=data[:_FIRST, 1], seed=0).table().mean(axis=0)
    moved = state.copy()
    moved[0] += np.radians(seen[2] - exact[2])
    for k in (0, 1):
        before = plant.gauge(state, p)[k] + p["ambient_pressure"]
        gain = p[f"pressure_gain_{k + 1}"]
        factor = 1.0 + 1e5 * (seen[3 + k] - exact[3 + k]) / gain / before
        # The temperature stays as it was.
        for name in (f"mass_{k + 1}", f"energy_{k + 1}"):
            moved[plant.INDEX[name]] *= factor
    return moved


_BASELINES = [who for who in ANSWERERS if who != "tool"]


def made(case: Planned, folder: Path, *, seconds: float = 20.0) -> Path:
    """Write the recordings of a planned case, of this length in s; returns the folder."""
    return make_case(
        case.seed,
        list(case.effects),
        case.load,
        folder,
        sizes=case.changes,
        load_error=case.load_error,
        seconds=seconds,
        spread=case.spread,
        recorded=case.recorded,
    )


def cases(
    count: int | None, first_seed: int | None, only: Sequence[str] = ()
) -> tuple[Planned, ...]:
    """Return the first cases of the plan, all of it without a count or where some are named."""
    return plan(first_seed)[: None if only else count]


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a kept case."""
    found = ", ".join(f["effect"] or "?" for f in row["verdict"]["findings"]) or "-"
    said = row["verdict"]["verdict"]
    return f"{row['case']} {row['title']:<38} -> {said:<16} {found}  ({row['seconds']:.0f} s)"


def answer(case: Planned, jobs: int, *, baselines: bool = True) -> dict[str, Any]:
    """Diagnose one case and let baselines answer too, if asked; returns what is kept of it."""
    with tempfile.TemporaryDirectory() as place:
        folder = made(case, Path(place) / case.name)
        truth = json.loads((folder / "truth.json").read_text())
        row: dict[str, Any] = {
            "schema": "own_case/1",
            **picked(case, "case=name title kind load_kg=load factor recorded spread"),
            "effects": list(case.effects),
            "true": _changed(truth["parameters"]) | {"load_error": truth["load_error"]},
            "limit": limited_errors(folder),
            "version": version(),
            "baselines": {},
        }
        found = read_case(folder)
        fit_on, hold_out = list(found.fit.values()), list(found.hold_out.values())

        def more(diagnosis: Diagnosis) -> dict[str, Any]:
            scores = diagnosis.rounds[0][0].scores if diagnosis.rounds else ()
            given = answers(diagnosis, _BASELINES) if diagnosis.runs and baselines else {}
            smallest = [{"effect": s.entry.name, "smallest": s.smallest} for s in scores]
            return {"scores": smallest, "baselines": given}

        return diagnosed(row, found.model(), fit_on, hold_out, jobs=jobs, more=more)


def _changed(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the rig's parameters that differ from nominal ones, and those sizes refer to."""
    plain = nominal()
    always = ("load", "load_inertia_per_kg", "conductance")
    return {k: v for k, v in parameters.items() if v != plain[k] or k in always}
