"""Requirements that no controller can meet are mistakes, found before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from workbench.errors import WorkbenchError
from workbench.model.units import convert, same_dimension
from workbench.study.designs import ControllerRecipe
from workbench.study.study import Demand
from workbench.verification import Metric, Scenario
from workbench.verification.metrics import metric_of
from workbench.verification.signals import rests


def check_demand(
    demand: Demand,
    units: Mapping[str, str],
    scenarios: Mapping[str, Scenario],
    controllers: Mapping[str, ControllerRecipe],
    own_metrics: Sequence[Metric] = (),
) -> None:
    """Check that a requirement can be judged and met."""
    required = demand.requirement
    unit = units[required.metric]
    given = required.unit or unit
    if not same_dimension(given, unit):
        raise WorkbenchError(
            f"unit of the limit on {required.metric} is {given!r}; {required.metric} is in {unit!r}"
        )
    limit = float(convert(required.limit, given, unit))
    metric = metric_of(required.metric, own_metrics)
    assert metric is not None, "the schema has checked its name"
    if limit == 0.0 and required.kind == "at_most" and not metric.zero:
        raise WorkbenchError(
            f"{required.metric} at most 0 is impossible: it is above zero in every run; give a"
            " positive limit"
        )
    chosen = [s for name, s in scenarios.items() if required.scenario in ("", name)]
    judged = [s for s in chosen if can_have(required.metric, s, own_metrics)]
    if not judged:
        where = f"scenario {required.scenario!r}" if required.scenario else "any scenario"
        what = "a step" if metric.needs == "step" else "a reference that rests"
        raise WorkbenchError(
            f"a requirement on {required.metric} is impossible: {where} has no reference with"
            f" {what}; name another metric or scenario"
        )
    shortest = min(s.sample_time for s in judged)
    of_time = metric.unit == "s" and metric.needs == "step"
    if of_time and required.kind == "at_most" and limit < shortest:
        raise WorkbenchError(
            f"{required.metric} at most {limit:g} s is impossible: a sample lasts {shortest:g} s"
        )
    own = [c for name, c in controllers.items() if name in (demand.controllers or controllers)]
    for need, can, what in (
        ("solver", [c.kind().solves for c in own], "solves an optimisation"),
        ("surface", [c.kind().slides for c in own], "has a sliding surface"),
    ):
        if metric.needs == need and not any(can):
            raise WorkbenchError(
                f"a requirement on {required.metric} is impossible: no controller it applies"
                f" to {what}"
            )


def check_demands(demands: Sequence[Demand]) -> None:
    """Check that the last requirement does not contradict one before it."""
    if not demands:
        return
    last = demands[-1].requirement
    for other in demands[:-1]:
        before = other.requirement
        same = before.metric == last.metric and before.kind != last.kind
        if not same or not (
            "" in (before.scenario, last.scenario) or before.scenario == last.scenario
        ):
            continue
        most, least = (before, last) if before.kind == "at_most" else (last, before)
        unit = most.unit or least.unit
        low = float(convert(least.limit, least.unit, unit)) if least.unit and unit else least.limit
        high = float(convert(most.limit, most.unit, unit)) if most.unit and unit else most.limit
        if low > high:
            raise WorkbenchError(
                f"{last.metric} at least {least.limit:g} {least.unit} and at most {most.limit:g}"
                f" {most.unit} is impossible; change one of the limits"
            )


def can_have(metric: str, scenario: Scenario, own: Sequence[Metric] = ()) -> bool:
    """Tell whether a scenario can give a metric a value."""
    found = metric_of(metric, own)
    signals = scenario.references.values()
    if found is not None and found.needs == "step":
        return any(s.changes for s in signals)
    if found is not None and found.needs == "rest":
        return any(rests(s) for s in signals)
    return True
