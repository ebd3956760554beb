"""Three controllers, designed from one linear model, on the linear and on the full plant."""

from __future__ import annotations

import tempfile
from dataclasses import replace

from workbench.demo.part import Part, words
from workbench.model.units import with_unit
from workbench.reports.figures.tracking import steady_limit, tracked
from workbench.reports.metrics_table import metric_methods, metrics_table
from workbench.reports.page import Block, Commands, Method, Section
from workbench.reports.pictures import Picture
from workbench.reports.tables import number
from workbench.study.read import load_study, shipped_study
from workbench.study.result import StudyResult, run_study
from workbench.verification import Metrics
from workbench.verification.metrics import columns

WINDOWS = {"up": (0.4, 1.6), "down": (2.4, 3.6)}
"""Times drawn around each step, in s: the whole run would hide how the curves differ."""

FIRST = "steps-with-muscle-hysteresis-up"
"""The picture of the first screen."""


def closed_loop_part() -> Part:
    """Run the shipped study of steps: three controllers, two plants.

    Example:
        >>> closed_loop_part().marks  # three controllers, two plants, five requirements
        {'met': 30, 'missed': 0, 'open': 0}
    """
    study = load_study(shipped_study("steps"))
    with tempfile.TemporaryDirectory() as folder:
        result = run_study(study, folder)
    measured: dict[tuple[str, ...], Metrics] = {
        (r.controller, r.variation): r.metrics for r in result.records if r.metrics is not None
    }
    numbers: dict[str, dict[str, dict[str, float]]] = {}
    for (controller, plant), found in measured.items():
        numbers.setdefault(plant, {})[controller] = _numbers(found)
    pictures = {p.name: p for plant in numbers for p in _pictures(result, plant)}
    slowest = max(float(m["settling_time"].value) for m in measured.values())
    first = replace(
        pictures.pop(FIRST),
        caption=f"Three controllers, designed from one linear model (dashed: on that model), bring"
        " the full plant with a muscle hysteresis that no design knew of to rest within"
        f" {number(slowest, 2)} s of a step of 30°.",
    )
    title, required = "Steps between 15° and 45° on the full plant", study.demands
    met = metrics_table(
        title, ("controller", "plant"), measured, columns("page"), [d.requirement for d in required]
    )
    methods = Method(metric_methods(measured.values()))
    command = Commands(("workbench compare steps --out steps",))
    blocks: tuple[Block, ...] = (words("closed_loop"), *pictures.values(), met, methods, command)
    title = "Three controllers on the linear and the full model"
    return Part(Section("controllers", title, blocks), numbers, first)


def _pictures(result: StudyResult, plant: str) -> list[Picture]:
    scenario = next(iter(result.study.scenarios))
    runs = {r.controller: r for r in result.records if r.variation == plant}
    limit = with_unit(f"{steady_limit(result.study, scenario, 'angle'):g}", "deg")
    return [
        Picture(
            f"steps-{plant.replace(' ', '-')}-{way}",
            tracked(result.study, scenario, runs, window=window),
            f"Step {way}, full plant {plant}: angle, error (dotted: ± {limit}) and "
            "valve voltage. Dashed: the same controller on its linear model, ideal sensors.",
            f"step {way} between 15 and 45 degrees; all controllers settle in half a second",
        )
        for way, window in WINDOWS.items()
    ]


def _numbers(found: Metrics) -> dict[str, float]:
    numbers = {}
    for metric in found.values:
        value, unit = metric.shown()
        suffix = unit.replace("%", "percent").replace("/", "_per_").replace(" ", "_")
        numbers[f"{metric.name}_{suffix}" if unit != "1" else metric.name] = value
    return numbers
