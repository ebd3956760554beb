"""The runs of a study: one controller, one plant, one scenario, one seed."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from controllers.protocol import Controller
from workbench.errors import WorkbenchError
from workbench.study.designs import ControllerRecipe
from workbench.study.figures_of_merit import study_metrics
from workbench.study.plants import PlantRecipe
from workbench.study.study import NOMINAL, Study
from workbench.verification import Metric, Metrics, Run, Scenario, verify
from workbench.verification.each_step import StepSettling, settling_of_each_step
from workbench.verification.responses import Figure

TRACE_POINTS = 600
"""Samples kept of a run for pictures."""


@dataclass(frozen=True)
class Task:
    """One run that is to be done.

    Args:
        controller: The controller.
        variation: Name of the plant.
        plant: The plant.
        name: Name of the scenario in the study.
        scenario: What is asked.
        seed: Seed of the sensors' noise.
        traces: Whether the courses are kept for pictures.

    Example:
        >>> "seed" in Task.__dataclass_fields__
        True
    """

    controller: ControllerRecipe
    variation: str
    plant: PlantRecipe
    name: str
    scenario: Scenario
    seed: int
    traces: bool = False

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Controller, variation, scenario and seed."""
        return (self.controller.name, self.variation, self.name, self.seed)


@dataclass(frozen=True)
class Record:
    """One run that was done, or failed.

    Args:
        controller: Name of the controller.
        variation: Name of the variation.
        scenario: Name of the scenario.
        seed: Seed of the sensors' noise.
        reason: Why the run failed; empty if it did not.
        metrics: Its metrics; none if it failed.
        seconds: Time it took, in s.
        traces: Courses for pictures by name, in SI.
        steps: How long each step of the reference took; none if it failed.

    Example:
        >>> Record("pid", "nominal", "step", 1, "diverged at 0.2 s").failed
        True
    """

    controller: str
    variation: str
    scenario: str
    seed: int
    reason: str = ""
    metrics: Metrics | None = None
    seconds: float = 0.0
    traces: Mapping[str, Any] = field(default_factory=dict)
    steps: tuple[StepSettling, ...] = ()

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Controller, variation, scenario and seed."""
        return (self.controller, self.variation, self.scenario, self.seed)

    @property
    def failed(self) -> bool:
        """Whether the run gave no metrics."""
        return self.metrics is None

    def table(self) -> dict[str, Any]:
        """Return the record as plain numbers and words."""
        found = {
            "controller": self.controller,
            "variation": self.variation,
            "scenario": self.scenario,
            "seed": self.seed,
            "status": "failed" if self.failed else "done",
            "reason": self.reason,
            "seconds": self.seconds,
        }
        found["metrics"] = {
            m.name: {
                "value": None if math.isnan(m.value) else m.value,
                "unit": m.unit,
                "reason": m.reason,
                "display_unit": m.display_unit,
            }
            for m in (self.metrics.values if self.metrics else ())
        }
        found["steps"] = [
            {
                "output": s.output,
                "begin_s": s.begin,
                "from": s.initial,
                "to": s.final,
                "settling_s": None if math.isnan(s.settling.value) else s.settling.value,
                "reason": s.settling.reason,
            }
            for s in self.steps
        ]
        return found


def record_from_table(table: Mapping[str, Any]) -> Record:
    """Return the record that a table describes.

    Args:
        table: What `Record.table` returned, with ``traces`` if they were kept.

    Returns:
        The record.

    Raises:
        KeyError: If the table is incomplete.

    Example:
        >>> first = Record("pid", "nominal", "step", 1, "diverged")
        >>> record_from_table(first.table()) == first
        True
    """
    own = {key: table[key] for key in ("controller", "variation", "scenario", "seed", "reason")}
    metrics = None
    if table["status"] == "done":
        values = tuple(
            Metric(
                name,
                math.nan if m["value"] is None else float(m["value"]),
                m["unit"],
                m.get("reason", ""),
                m.get("display_unit", ""),
            )
            for name, m in table["metrics"].items()
        )
        metrics = Metrics(own["controller"], own["variation"], own["scenario"], values)
    return Record(
        **own,
        metrics=metrics,
        seconds=float(table.get("seconds", 0.0)),
        traces=table.get("traces", {}),
        steps=tuple(_step(row) for row in table.get("steps", ())),
    )


def _step(row: Mapping[str, Any]) -> StepSettling:
    seconds = row["settling_s"]
    settling = Figure(math.nan if seconds is None else float(seconds), row["reason"])
    return StepSettling(row["output"], row["begin_s"], row["from"], row["to"], settling)


def tasks(study: Study) -> tuple[Task, ...]:
    """List every run of a study, without those of its parameter box.

    Args:
        study: The study.

    Returns:
        Controller x variation x scenario x seed; plant by plant, so that a process that took one
        run has what the next needs.

    Example:
        >>> from workbench.study.schema import load_study
        >>> from workbench.study.shipped import shipped_study
        >>> len(tasks(load_study(shipped_study("arm")))) > 10
        True
    """
    return tuple(
        Task(
            controller,
            variation,
            plant,
            name,
            scenario,
            seed,
            traces=variation == NOMINAL and seed == study.seeds[0],
        )
        for variation, plant in study.variations.items()
        for controller in study.controllers.values()
        for name, scenario in study.scenarios.items()
        for seed in study.seeds
    )


def add_paths(paths: tuple[str, ...]) -> None:
    """Let this process import plants and designs of one's own.

    Args:
        paths: Folders that hold their modules.

    Example:
        >>> add_paths(())
    """
    sys.path += [path for path in paths if path not in sys.path]


def execute(task: Task, paths: tuple[str, ...] = ()) -> Record:
    """Do one run; whatever goes wrong becomes the record's reason.

    Args:
        task: The run.
        paths: Folders of plants and designs of one's own.

    Returns:
        The record.

    Example:
        >>> from workbench.verification import step_scenario
        >>> pid = ControllerRecipe("pid", "pid", PlantRecipe(), (("angle", 0.5),))
        >>> step = step_scenario(from_deg=25, to_deg=30, hold=0.5)
        >>> execute(Task(pid, "nominal", PlantRecipe(), "step", step, 1)).failed
        False
    """
    add_paths(paths)
    begin = time.perf_counter()
    # A run of a study never ends the study: what one's own code raises is a reason like any other.
    try:
        controller = task.controller.build()
        run = verify(
            controller,
            task.plant.build(),
            replace(task.scenario, name=task.name),
            seed=task.seed,
        )
        found = study_metrics(run, controller)
        traces = _traces(run, controller, task) if task.traces else {}
        steps = tuple(
            step
            for name in run.follows
            for step in settling_of_each_step(
                name, run.time, run[name], run.scenario.references[name].changes
            )
        )
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split()) or type(error).__name__
        if not isinstance(error, WorkbenchError):
            reason = f"{type(error).__name__}: {reason}"
        return Record(*task.key, reason=reason, seconds=time.perf_counter() - begin)
    seconds = time.perf_counter() - begin
    return Record(*task.key, metrics=found, seconds=seconds, traces=traces, steps=steps)


def _traces(run: Run, controller: Controller, task: Task) -> dict[str, Any]:
    """Return the courses that pictures show, thinned, on the full and on the linear model."""
    stride = max(1, math.ceil(len(run.time) / TRACE_POINTS))
    # A peak between two kept samples would vanish from the page, so times of solving keep theirs.
    found: dict[str, Any] = {"time": run.time[::stride]}
    for name in run.follows:
        found[f"reference.{name}"] = run.references[name][::stride]
        found[f"output.{name}"] = run[name][::stride]
    outputs = [q.name for q in run.output_quantities]
    for name in ("pressure_1", "pressure_2"):
        if name in outputs:
            found[name] = run[name][::stride]
    for q, column in zip(run.input_quantities, run.inputs.T, strict=True):
        found[f"input.{q.name}"] = column[::stride]
    first = run.infos[0] if run.infos else {}
    for name in ("surface", "speed"):
        if name in first:
            found[name] = run.info(name)[::stride]
    for name in ("layer", "slope"):
        if "surface" in first and hasattr(controller, name):
            found[name] = float(getattr(controller, name))
    if "solve_time" in first:
        seconds = run.info("solve_time")
        blocks = [seconds[i : i + stride].max() for i in range(0, len(seconds), stride)]
        found["solve_time"] = np.array(blocks)
        found["iterations"] = run.info("iterations")[::stride]
        status = [str(info.get("status", "")) for info in run.infos]
        found["statuses"] = {name: status.count(name) for name in sorted(set(status))}
    if not task.scenario.changes and not task.scenario.disturbances:
        ideal = task.scenario.without_imperfections()
        try:
            linear = verify(controller, task.controller.linear(), ideal)
        except WorkbenchError as error:
            found["linear_reason"] = str(error)
        else:
            for name in run.follows:
                found[f"linear.{name}"] = linear[name][::stride]
    # Six digits draw any picture, and files stay small.
    return {
        name: [float(f"{v:.6g}") for v in value] if isinstance(value, np.ndarray) else value
        for name, value in found.items()
    }
