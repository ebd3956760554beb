"""The runs of a study: one controller, one plant, one scenario, one seed."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from workbench.checked_json import (
    TableShape,
    anything,
    listed,
    named,
    number,
    one_of,
    optional,
    text,
    whole,
)
from workbench.errors import WorkbenchError
from workbench.files import picked
from workbench.registry import user_code
from workbench.study.dependencies import watched
from workbench.study.designs import ControllerRecipe, with_plan
from workbench.study.study import Study, Variation, load_metrics
from workbench.verification import Metrics, MetricValue, Run, Scenario, metrics, verify
from workbench.verification.each_step import (
    EventResponse,
    StepResponse,
    response_to_each_event,
    response_to_each_step,
)
from workbench.verification.responses import Value

TRACE_POINTS = 600
"""Samples kept of a run for pictures."""


@dataclass(frozen=True)
class Task:
    """One run that is to be done."""

    controller: ControllerRecipe
    variation: Variation
    scenario: Scenario
    seed: int
    own_metrics: tuple[str, ...] = ()
    traces: bool = False

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Controller, variation, scenario and seed."""
        return (self.controller.name, self.variation.name, self.scenario.name, self.seed)


@dataclass(frozen=True)
class Record:
    """One run that was done, or failed.

    Args:
        seconds: Time it took, in s.
        traces: Trajectories for pictures by name, in SI.
        steps: How each step of the reference was followed; none if the run failed.
        margins: Speed in rad/s and peaks of the sensitivities (ratios) of a design that was
            searched, by name.
    """

    controller: str
    variation: str
    scenario: str
    seed: int
    reason: str = ""
    metrics: Metrics | None = None
    seconds: float = 0.0
    traces: Mapping[str, Any] = field(default_factory=dict)
    steps: tuple[StepResponse, ...] = ()
    events: tuple[EventResponse, ...] = ()
    margins: Mapping[str, float] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Controller, variation, scenario and seed."""
        return (self.controller, self.variation, self.scenario, self.seed)

    @property
    def failed(self) -> bool:
        """Whether the run gave no metrics."""
        return self.metrics is None

    def values_of_steps(self, metric: str, size: float) -> list[Value]:
        """Return the settling time or overshoot of every step of a size, in SI."""
        own = [s for s in self.steps if math.isclose(abs(s.final - s.initial), size, rel_tol=1e-6)]
        if not own:
            return [Value(math.nan, "the reference has no step of that size")]
        if metric == "overshoot":
            return [Value(s.overshoot) for s in own]
        return [s.settling for s in own]

    def table(self) -> dict[str, Any]:
        """Return the record as plain numbers and words."""
        found = picked(self, "controller variation scenario seed")
        found["status"] = "failed" if self.failed else "done"
        found |= picked(self, "reason seconds")
        found["metrics"] = {
            m.name: {"value": None if math.isnan(m.value) else m.value}
            | picked(m, "unit reason display_unit")
            for m in (self.metrics.values if self.metrics else ())
        }
        found["steps"] = [s.table() for s in self.steps]
        if self.events:
            found["events"] = [e._asdict() for e in self.events]
        if self.margins:
            found["margins"] = dict(self.margins)
        return found


_OR_NONE = optional(number)
_METRIC = TableShape({"value": _OR_NONE, "unit": text}, {"reason": text, "display_unit": text})
_STEP = TableShape(
    {"output": text, "begin_s": number, "from": number, "to": number, "reason": text},
    dict.fromkeys(("settling_s", "overshoot", "planned_s"), _OR_NONE),
)
_EVENT = TableShape(
    {"output": text, "time": number, "what": text, "peak": _OR_NONE, "left": _OR_NONE}
)
RECORD = TableShape(
    {
        **dict.fromkeys(("controller", "variation", "scenario", "reason"), text),
        "seed": whole,
        "status": one_of("done", "failed"),
        "metrics": named(_METRIC),
    },
    {
        "seconds": number,
        "traces": named(anything),
        "margins": named(number),
        "steps": listed(_STEP),
        "events": listed(_EVENT),
    },
)
"""Shape of a record in a file."""


def record_from_table(table: Mapping[str, Any]) -> Record:
    """Return the record of what `Record.table` returned, with ``traces`` if they were kept.

    Raises:
        KeyError: If the table is incomplete.
    """
    own = {key: table[key] for key in ("controller", "variation", "scenario", "seed", "reason")}
    metrics = None
    if table["status"] == "done":
        values = tuple(
            MetricValue(
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
        steps=tuple(StepResponse.from_table(row) for row in table.get("steps", ())),
        events=tuple(_event(row) for row in table.get("events", ())),
        margins=table.get("margins", {}),
    )


def _event(row: Mapping[str, Any]) -> EventResponse:
    sizes = (math.nan if row[key] is None else float(row[key]) for key in ("peak", "left"))
    return EventResponse(row["output"], row["time"], row["what"], *sizes)


def tasks(study: Study, *, traces: bool = True) -> tuple[Task, ...]:
    """List every run of a study, without those of its parameter box.

    Args:
        traces: Whether runs that pictures show keep their trajectories, and are also done on the
            linear model.
    """
    return tuple(
        Task(
            study.cases[variation.case].controllers[controller],
            variation,
            replace(study.cases[variation.case].scenarios[scenario], name=scenario),
            seed,
            study.own_metrics,
            traces=traces
            and (variation.nominal or variation.kind in study.report.traced)
            and seed == study.seeds[0],
        )
        for variation, controller, scenario, seed in study.runs()
    )


def execute(task: Task) -> Record:
    """Do one run; whatever goes wrong becomes the record's reason."""
    begin = time.perf_counter()
    # A run of a study never ends the study: what one's own code raises is a reason like any other.
    try:
        with watched(), user_code("run"):
            design = task.controller.designed()
            controller, variation = design.controller, task.variation
            if variation.plan_duration != 1.0 or variation.lead != 0.0:
                controller = with_plan(
                    controller, duration=variation.plan_duration, lead=variation.lead
                )
            controller = task.controller.guarded(controller)
            plant, scenario = variation.plant.build(), variation.of(task.scenario)
            run = verify(controller, plant, scenario, seed=task.seed)
            found = metrics(run, load_metrics(task.own_metrics, task.controller.plant.folder))
            traces = _traces(run, controller, task) if task.traces else {}
    except WorkbenchError as error:
        reason = " ".join(str(error).removeprefix("run failed: ").split())
        return Record(*task.key, reason=reason, seconds=time.perf_counter() - begin)
    return Record(
        *task.key,
        metrics=found,
        seconds=time.perf_counter() - begin,
        traces=traces,
        steps=tuple(step for name in run.controlled for step in response_to_each_step(run, name)),
        events=response_to_each_event(run),
        margins=_margins(design),
    )


def _margins(design: MarginedDesign[Controller]) -> dict[str, float]:
    if math.isnan(design.speed):
        return {}
    names = "speed_rad_per_s=speed Ms=sensitivity Mt=complementary Ms_one_sample_late=late"
    return picked(design, names)


def _traces(run: Run, controller: Controller, task: Task) -> dict[str, Any]:
    """Return the trajectories that pictures show, thinned, on the full and on the linear model."""
    stride = max(1, math.ceil(len(run.time) / TRACE_POINTS))
    # A peak between two kept samples would vanish from the page, so times of solving keep theirs.
    found: dict[str, Any] = {"time": run.time[::stride]}
    for name in run.controlled:
        found[f"reference.{name}"] = run.references[name][::stride]
        found[f"output.{name}"] = run[name][::stride]
    outputs = [q.name for q in run.output_quantities]
    for name in getattr(controller, "sensors", ()):
        if name in outputs and name not in run.controlled:
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
            for name in run.controlled:
                found[f"linear.{name}"] = linear[name][::stride]
    # Six digits draw any picture, and files stay small.
    return {
        name: [float(f"{v:.6g}") for v in value] if isinstance(value, np.ndarray) else value
        for name, value in found.items()
    }
