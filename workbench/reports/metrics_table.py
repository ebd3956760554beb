"""Metrics of closed-loop runs as a table with requirement marks, and how each was computed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from workbench.model.units import with_unit
from workbench.reports.tables import Cell, Table, number
from workbench.study.study import Demand
from workbench.study.summary import score_text
from workbench.verification import Metrics, Requirement, judge
from workbench.verification.metrics import known_metrics, metric_of


def metric_methods(runs: Iterable[Metrics] = ()) -> tuple[tuple[str, str], ...]:
    """Say how each metric of a page is computed: of some runs, or of all that may be columns."""
    had = {metric_of(n) for metrics in runs for n, found in metrics.items() if not found.reason}
    shown = [m for m in known_metrics() if m.table and m.help]
    return tuple((m.words, m.help) for m in shown if not had or m in had)


def metric_title(name: str) -> str:
    """Write the name of a metric as people read it.

    Example:
        >>> metric_title("settling_time"), metric_title("solve_time_p99")
        ('settling time', 'solve time, 99th percentile')
    """
    metric = metric_of(name)
    return (name if metric is None else name.replace(metric.name, metric.words)).replace("_", " ")


def score_cell(value: float, *, capped: bool = False) -> Cell:
    """Write a score with its mark.

    Args:
        value: The score, a ratio.
        capped: Whether 10 stands for 10 and above.
    """
    return Cell(score_text(value, capped=capped), "met" if value <= 1.0 else "missed")


def demand_text(demand: Demand | str) -> str:
    """Write a requirement with the name of its metric in words."""
    metric, _, rest = str(demand).partition(" ")
    return f"{metric_title(metric)} {rest}"


def metrics_table(
    title: str,
    keys: tuple[str, ...],
    measured: Mapping[tuple[str, ...], Metrics],
    columns: Sequence[str],
    requirements: Sequence[Requirement] = (),
) -> Table:
    """Build a table of metrics, one run per row, with a mark on every required number.

    Args:
        columns: Names of the metrics shown; those that no run has are left out.
    """
    shown = [name for name in columns if any(name in found for found in measured.values())]
    limits = {requirement.metric: requirement for requirement in requirements}
    rows: tuple[tuple[Cell | str, ...], ...] = tuple(
        (*key, *(metric_cell(found, name, limits.get(name)) for name in shown))
        for key, found in measured.items()
    )
    return Table(
        title, (*keys, *(metric_title(name) for name in shown)), rows, _note(limits, shown)
    )


def metric_cell(found: Metrics | None, name: str, requirement: Requirement | None = None) -> Cell:
    """Write a metric of a run, with a mark if it is required; nothing where the run has none."""
    if found is None or name not in found:
        return Cell("")
    metric = found[name]
    value, unit = metric.shown()
    whole = unit == "1" and value.is_integer()
    shown = number(int(value) if whole else value)
    text = with_unit(shown, unit) if value == value else shown  # NaN has no unit
    if requirement is None:
        return Cell(text, reason=metric.reason)
    return Cell(text, "met" if judge(requirement, found).met else "missed", metric.reason)


def _note(limits: Mapping[str, Requirement], shown: Sequence[str]) -> str:
    required = [limits[name] for name in shown if name in limits]
    said = [
        f"{metric_title(r.metric)} {r.kind.replace('_', ' ')} {with_unit(f'{r.limit:g}', r.unit)}"
        for r in required
    ]
    return f"Required: {', '.join(said)}." if said else ""
