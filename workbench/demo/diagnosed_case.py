"""A recorded case with its shipped verdict: before, named, after, and the better controller."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.data_folder import shipped_data
from workbench.demo.part import Part, section
from workbench.diagnosis.estimation.free_run import FreeRun, free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.start import fitted_start
from workbench.diagnosis.redesign import redesign
from workbench.diagnosis.verdict import upgraded
from workbench.model import Model
from workbench.plants.plant import Plant
from workbench.plants.registry import PLANTS
from workbench.recordings import read_case
from workbench.reports.figures.diagnosis import AFTER, BEFORE, as_read, run_pictures, sizes_as_read
from workbench.reports.page import Section
from workbench.reports.pictures import Picture
from workbench.reports.style import FURTHER, MEASURED, REFERENCE, key, label, new_figure
from workbench.reports.tables import Table, number, plain
from workbench.verification import Scenario, Sine, verify

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CASE = "practice-08"

DRAWN = "validate_closed"
"""The held-out recording that is drawn."""

DESIGN = "scheduled-pid"

WAVE = Scenario("sine", {"angle": Sine(math.radians(30.0), math.radians(15.0), 0.5)}, 5.0)
"""What both controllers follow, on the improved model."""

_SECONDS = 10.0
_SETTLED = 2.0
_WINDOW = (2.0, 6.0)
"""Time drawn on the first screen, in s of the recording."""


@dataclass(frozen=True)
class DiagnosedCase:
    """A recording beside the models before and after its diagnosis, and what designs gain by it.

    Args:
        runs: Free runs along the recording: ``"refitted"``, which is before, and ``"extended"``.
        time: Times of the tracking errors, shape (n,), in s.
        tracking: Tracking error on the improved model, shape (n,), in rad, by the model of design.
    """

    verdict: Mapping[str, Any]
    model: Model
    runs: Mapping[str, FreeRun]
    time: Vector
    tracking: Mapping[str, Vector]


def diagnosed_case() -> DiagnosedCase:
    """Read a shipped case with its verdict, run both models along it, and design on both.

    Nothing is fitted: effects and parameters are those of the shipped verdict.
    """
    path = shipped_data(CASE) / "verdict.json"
    verdict = upgraded(json.loads(path.read_text(encoding="utf-8")), f"verdict {str(path)!r}")
    case = read_case(shipped_data(CASE))
    plant: Plant = PLANTS.get(str(path))
    after = plant.model({})
    refitted = {name: row["value"] for name, row in verdict["parameters"].items()}
    before = case.model().with_parameters(refitted)
    recording = case.recordings[DRAWN].between(0.0, _SECONDS)
    time, tracking = np.zeros(0), {}
    for title, model in (("before", before), ("after", after)):
        run = verify(redesign(model, plant, DESIGN), after, WAVE)
        late = run.time > _SETTLED
        time = run.time[late]
        tracking[title] = (run.references["angle"] - run["angle"])[late]
    runs = {
        name: free_run(m, fitted_start(m, observe(m, recording), samples=plant.start_samples))
        for name, m in (("refitted", before), ("extended", after))
    }
    return DiagnosedCase(verdict, before, runs, time, tracking)


def diagnosed_case_part() -> Part:
    """Show a shipped case as its verdict left it."""
    found = diagnosed_case()
    tracked = {k: math.degrees(float(np.sqrt(np.mean(v**2)))) for k, v in found.tracking.items()}
    finding = found.verdict["findings"][0]
    name = plain(finding["effect"])
    of, size = next(iter(finding["parameters"].items()))
    judged = found.verdict["fit"]["held_out"]
    errors = {model: math.degrees(judged[model]["angle"]) for model in found.runs}
    results = {
        "verdict": found.verdict["verdict"],
        "effect": finding["effect"],
        "held_out_angle_rms_deg": errors,
        "drawn_angle_rms_deg": {m: math.degrees(r.rmse["angle"]) for m, r in found.runs.items()},
        "tracking_rms_deg": tracked,
    }
    before, after = (_between(run, *_WINDOW) for run in found.runs.values())
    tracking = {f"designed {k}": v for k, v in found.tracking.items()}
    first = Picture(
        "diagnosed",
        diagnosed(before, after, found.time, tracking),
        f"A recording diagnosed (by the shipped verdict): the refitted model missed the angle by"
        f" {number(errors['refitted'], 2)}° rms; what it lacked is {name}, {of}"
        f" {number(size['value'], 3)} {size['unit']}; with it the model misses by"
        f" {number(errors['extended'], 2)}°, and the controller designed on it follows a sine with"
        f" {number(tracked['after'], 2)}° in place of {number(tracked['before'], 2)}° (below).",
        "angle measured and simulated before and after, and the tracking error of two controllers",
    )
    return Part(_section(found), results, first)


def _between(run: FreeRun, start: float, stop: float) -> FreeRun:
    rows = (run.time >= start) & (run.time <= stop)
    time, measured, simulated = (of[rows] for of in (run.time, run.measured, run.simulated))
    return replace(run, time=time, measured=measured, simulated=simulated)


def _section(found: DiagnosedCase) -> Section:
    verdict = found.verdict
    model, held_out = found.model, verdict["fit"]["held_out"]
    rows = {name: sizes_as_read(model, row) for name, row in held_out.items()}
    files = "diagnosed-runs", "diagnosed-errors"
    floor = held_out["noise_floor"]
    drawn = run_pictures(model, found.runs, floor, plain(DRAWN), files)
    read = as_read(model, found.runs["refitted"], errors=True)
    blocks = (
        *drawn,
        Table(
            "Errors of free runs over all held-out recordings, rms",
            ("output", "unit", *(plain(model) for model in held_out)),
            tuple(
                (plain(name), unit, *(number(row[name]) for row in rows.values()))
                for name, unit in zip(read.used, read.units, strict=True)
            ),
        ),
    )
    told = {"case": CASE, "sentence": plain(verdict["sentence"]), "design": DESIGN}
    command = f"workbench diagnose {CASE} --out diagnosis"
    title = "A recording, diagnosed"
    return section("diagnosed", title, "diagnosed_case", blocks, command, told)


def diagnosed(
    before: FreeRun, after: FreeRun, time: npt.ArrayLike, errors: Mapping[str, npt.ArrayLike]
) -> Figure:
    """Draw free runs of two models along a recording, and tracking errors of two designs.

    Args:
        before: Free run of the refitted nominal model; its first output is the angle.
        time: Times of the tracking errors, shape (n,), in s.
        errors: Tracking error, shape (n,), in rad, by the name of the design.
    """
    figure, (angle, error, tracked) = new_figure([1.7, 1.0, 1.3], share_x=False)
    look: dict[str, Any] = {"color": MEASURED.light, "linewidth": 3.0, "alpha": 0.45}
    angle.plot(before.time, np.degrees(before.measured[:, 0]), label="measured", **look)
    for run, colour, name in ((before, BEFORE, "before"), (after, AFTER, "after")):
        dashes = "-" if run is before else (0, (4, 2))
        look = {"color": colour.light, "linewidth": 1.2, "linestyle": dashes, "label": name}
        angle.plot(run.time, np.degrees(run.simulated[:, 0]), **look)
        error.plot(run.time, np.degrees(run.error[:, 0]), color=colour.light, linewidth=1.1)
    for (name, values), shade in zip(errors.items(), (REFERENCE, FURTHER[0]), strict=True):
        tracked.plot(time, np.degrees(values), color=shade.light, linewidth=1.3, label=name)
    angle.tick_params(labelbottom=False)
    label(angle, y="angle in °")
    label(error, x="time in s", y="error in °")
    label(tracked, x="time in s", y="error in °")
    key(angle)
    key(tracked, columns=2)
    return figure
