"""Distance to the physical limit: settling of each step over the fastest that the plant can do.

The limit of a step is the time-optimal move of the nominal plant between the two references, from
rest until it is within the band of the settling time for good. It is an optimum of the plant, not
of any controller, so it says how much of a settling time a better controller could save at most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from workbench.checked_json import TableShape, number, optional, text
from workbench.errors import WorkbenchError
from workbench.files import picked
from workbench.model import Model
from workbench.study.execution import Progress, Workers
from workbench.study.plants import PlantRecipe
from workbench.study.study import Study, Variation
from workbench.study.tasks import Record
from workbench.verification import Scenario
from workbench.verification.physical_limit import physical_limit, shown_state, velocity_of
from workbench.verification.responses import Value


@dataclass(frozen=True)
class Move:
    """A step between two references, the same for every controller.

    Args:
        initial: Reference before the step, in the output's SI unit.
        final: Reference after the step, in the output's SI unit.
    """

    plant: PlantRecipe
    output: str
    initial: float
    final: float


@dataclass(frozen=True)
class StepDistance:
    """One step of one run and its limit.

    Args:
        begin: Time of the step, in s.
        settling: Settling time of the run, in s, or NaN with a reason.
        limit: Shortest time the plant allows, in s, or NaN with a reason.
    """

    controller: str
    scenario: str
    seed: int
    begin: float
    move: Move
    settling: Value
    limit: Value
    variation: str = "nominal"

    @property
    def ratio(self) -> Value:
        """Settling over limit, dimensionless, or NaN with a reason."""
        for time in (self.limit, self.settling):
            if math.isnan(time.value):
                return time
        return Value(self.settling.value / self.limit.value)


@dataclass(frozen=True)
class Distance:
    """How far a controller stays from the physical limit in a scenario: its worst step counts.

    Args:
        ratio: Settling over limit of the worst step, dimensionless, or NaN with a reason.
    """

    controller: str
    scenario: str
    ratio: Value
    worst: StepDistance | None = None
    case: str = ""


@dataclass(frozen=True)
class Distances:
    """Distance to the physical limit of every controller in every scenario."""

    asked: bool = False
    steps: tuple[StepDistance, ...] = ()
    worst: tuple[Distance, ...] = ()
    limits: tuple[tuple[str, Move, Value], ...] = ()

    def of(self, controller: str, scenario: str, case: str = "") -> Distance | None:
        """Return the distance of a controller in a scenario, or None."""
        asked = (controller, scenario, case)
        return next((d for d in self.worst if (d.controller, d.scenario, d.case) == asked), None)

    def table(self) -> dict[str, Any]:
        """Return the distances as plain numbers and words; times in s, references in SI."""
        return {
            "asked": self.asked,
            "steps": [
                picked(
                    s,
                    "controller variation scenario seed output=move.output begin_s=begin"
                    " from=move.initial to=move.final settling_s=settling.value"
                    " limit_s=limit.value ratio=ratio.value reason=ratio.reason",
                )
                for s in self.steps
            ],
            "limits": [
                {"variation": name}
                | picked(move, "from=initial to=final")
                | picked(limit, "limit_s=value reason")
                for name, move, limit in self.limits
            ],
            "worst": [
                {
                    "controller": d.controller,
                    **({"plant": d.case} if d.case else {}),
                    "scenario": d.scenario,
                    "ratio": d.ratio.value,
                    "limit_s": d.worst.limit.value if d.worst else math.nan,
                    "begin_s": d.worst.begin if d.worst else math.nan,
                    "seed": d.worst.seed if d.worst else None,
                    "reason": d.ratio.reason,
                }
                for d in self.worst
            ],
        }


def no_limit(scenario: Scenario, plant: Model) -> str:
    """Say why the steps of a scenario have no physical limit; empty if they have one."""
    if not any(signal.changes for signal in scenario.references.values()):
        return "the reference has no step"
    if len(scenario.references) > 1:
        return "several outputs are controlled"
    if scenario.changes:
        names = dict.fromkeys(c.parameter.replace("_", " ") for c in scenario.changes)
        verb = "changes" if len(names) == 1 else "change"
        return f"the {' and the '.join(names)} {verb} during the run"
    if scenario.disturbances:
        return "a disturbance acts during the run"
    name = next(iter(scenario.references))
    state = shown_state(plant, name)
    if state is None:
        return f"{name!r} shows no state of the plant, so there is no move between positions"
    if velocity_of(plant, state) is None:
        return f"the rate of {name!r} is no state of the plant: no move between positions at rest"
    return ""


def find_limits(
    study: Study, workers: Workers, progress: Progress | None = None
) -> dict[Move, Value]:
    """Find the physical limit of every step on the nominal plant, in s, or NaN with a reason.

    It is empty if the study does not ask.
    """
    if not study.report.physical_limit:
        return {}
    asked = dict.fromkeys(
        Move(variation.plant, output, initial, final)
        for variation in study.variations.values()
        if variation.nominal or variation.kind in study.report.limit_variations
        for scenario in study.cases[variation.case].scenarios.values()
        if not no_limit(scenario, variation.plant.build())
        for output, signal in scenario.references.items()
        for _, initial, final in signal.changes
        if _is_compared(study, initial, final)
    )

    def name(move: Move) -> str:
        return f"{move.output} {move.initial:g} to {move.final:g}"

    tables = workers.finished(list(asked), _limit, _LIMIT, name=name, progress=progress)
    values = (Value(t["limit_s"] or math.nan, t["reason"]) for t in tables)
    return dict(zip(asked, values, strict=True))


_LIMIT = TableShape({"limit_s": optional(number), "reason": text})


def _limit(move: Move) -> dict[str, Any]:
    found = limit_of(move)
    return {"limit_s": None if math.isnan(found.value) else found.value, "reason": found.reason}


def _is_compared(study: Study, initial: float, final: float) -> bool:
    chosen = study.report.limit_steps
    return not chosen or any(
        max(abs(a - initial), abs(b - final)) <= 1e-6 * abs(final - initial) for a, b in chosen
    )


def limit_of(move: Move) -> Value:
    """Find the physical limit of one move, in s, or NaN with the reason why there is none."""
    try:
        model = move.plant.build()
        # The limit of the plant itself: attached effects of memory are no smooth equations.
        plain = {e.name for e in replace(move.plant, effects=(), parameters=()).build().effects}
        model = model.without(*(e for e in model.dry_effects if e not in plain))
        found = physical_limit(model, move.initial, move.final, coordinate=move.output)
    except WorkbenchError as error:
        # Behind the semicolon stands what a caller of the function may change, not a reader.
        return Value(math.nan, str(error).split(";")[0])
    except Exception as error:  # noqa: BLE001 -- As of a run: a reason, never the end of a study.
        return Value(math.nan, f"{type(error).__name__}: {' '.join(str(error).split())}")
    return Value(found.seconds)


def distances(study: Study, records: Sequence[Record], limits: Mapping[Move, Value]) -> Distances:
    """Compare every step on the nominal plant with its limit; of several seeds the worst counts."""
    steps: list[StepDistance] = []
    worst: list[Distance] = []
    for case in study.cases.values():
        nominal = study.nominal(case.name)
        for controller in case.controllers:
            for name, scenario in case.scenarios.items():
                asked = study.report.physical_limit
                reason = no_limit(scenario, case.plant.build()) if asked else "not asked for"
                own = [r for r in records if r.key[:3] == (controller, nominal.name, name)]
                compared = []
                if not reason:
                    compared = [s for r in own for s in _compared(study, nominal, r, limits)]
                    failed = next((r.reason for r in own if r.failed), "")
                    reason = f"the run failed: {failed}" if failed else ""
                steps += compared
                ratio, most = _worst(compared, reason)
                worst.append(Distance(controller, name, ratio, most, case.name))
    by_plant = {v.plant: v.name for v in reversed(list(study.variations.values()))}
    every = tuple((by_plant[m.plant], m, v) for m, v in limits.items() if m.plant in by_plant)
    return Distances(study.report.physical_limit, tuple(steps), tuple(worst), every)


def _compared(
    study: Study, nominal: Variation, record: Record, limits: Mapping[Move, Value]
) -> list[StepDistance]:
    run, unknown = (
        (record.controller, record.scenario, record.seed),
        Value(math.nan, "not computed"),
    )
    return [
        StepDistance(*run, s.begin, move, s.settling, limits.get(move, unknown), nominal.name)
        for s in record.steps
        if _is_compared(study, s.initial, s.final)
        for move in (Move(nominal.plant, s.output, s.initial, s.final),)
    ]


def _worst(compared: Sequence[StepDistance], reason: str) -> tuple[Value, StepDistance | None]:
    """Return the ratio that counts and its step, or the reason why there is none, and no step."""
    # A step without a limit says nothing about the controller, one that never settled does.
    known = [s for s in compared if not math.isnan(s.limit.value)]
    if reason or not known:
        first = compared[0].ratio.reason if compared else "the run ends before the first step"
        return Value(math.nan, reason or first), None
    missing = [s for s in known if math.isnan(s.settling.value)]
    most = missing[0] if missing else max(known, key=lambda s: s.ratio.value)
    return most.ratio, most
