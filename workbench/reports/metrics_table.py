"""Metrics of closed-loop runs as a table with requirement marks, and how each was computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from workbench.reports.tables import Cell, Table, number
from workbench.verification import Metrics, Requirement, judge

_TITLES = {
    "solve_time_median": "solve time, median",
    "solve_time_p99": "solve time, 99th percentile",
    "surface_rms": "surface, rms",
    "surface_peak": "surface, peak",
}

METRIC_METHODS: tuple[tuple[str, str], ...] = (
    (
        "settling time",
        "time from the step until the angle stays within 2 % of the step; worst step",
    ),
    ("overshoot", "largest angle past the reference, as a share of the step; worst step"),
    ("steady error", "mean error of the last second of each step, as a magnitude; worst step"),
    (
        "oscillation",
        "what still moves: half of highest minus lowest angle in the last second of each step, its "
        "straight line taken away, the amplitude of a limit cycle; worst step",
    ),
    ("stop impacts", "how often the arm touches a mechanical stop"),
    ("rmse", "root mean square of reference minus angle over the whole run"),
    (
        "chatter",
        "how much the command moves: sum of the magnitudes of all changes of the valve voltage, "
        "per second",
    ),
    ("air", "mass of air drawn from the supply over the whole run"),
    (
        "solve time, median and 99th percentile",
        "time of one optimisation on this machine, exceeded by every second sample and by one in "
        "a hundred; whatever else the machine does adds to it",
    ),
    ("fallbacks", "how often the optimisation failed and its named fallback was used"),
)
"""How each metric was computed, in the words of the table."""


def metric_title(name: str) -> str:
    """Write the name of a metric as people read it.

    Example:
        >>> metric_title("settling_time"), metric_title("solve_time_p99")
        ('settling time', 'solve time, 99th percentile')
    """
    return _TITLES.get(name, name.replace("_", " "))


def metrics_table(
    title: str,
    keys: tuple[str, ...],
    measured: Mapping[tuple[str, ...], Metrics],
    columns: Sequence[str],
    requirements: Sequence[Requirement] = (),
) -> Table:
    """Build a table of metrics, one run per row, with a mark on every required number.

    Args:
        title: What the table lists.
        keys: Headings of what tells the runs apart, such as controller and plant.
        measured: Metrics of each run by what tells it apart.
        columns: Names of the metrics shown; those that no run has are left out.
        requirements: Limits on metrics.

    Raises:
        WorkbenchError: If the unit of a limit does not fit its metric.

    Example:
        >>> from workbench.verification import MetricValue
        >>> run = Metrics("pid", "arm", "step", (MetricValue("settling_time", 0.4, "s"),))
        >>> limit = Requirement("settling_time", 0.8, "s")
        >>> print(metrics_table("Steps", ("run",), {("one",): run}, ["settling_time"], [limit]))
        Steps
        run  settling time
        one  0.400 s ✓
        Required: settling time at most 0.8 s.
    """
    shown = [name for name in columns if any(name in found for found in measured.values())]
    limits = {requirement.metric: requirement for requirement in requirements}
    rows: tuple[tuple[Cell | str, ...], ...] = tuple(
        (*key, *(_cell(found, name, limits.get(name)) for name in shown))
        for key, found in measured.items()
    )
    return Table(
        title, (*keys, *(metric_title(name) for name in shown)), rows, _note(limits, shown)
    )


def _cell(found: Metrics, name: str, requirement: Requirement | None) -> Cell:
    if name not in found:
        return Cell("")
    metric = found[name]
    value, unit = metric.shown()
    whole = unit == "1" and value.is_integer()
    text = number(int(value) if whole else value, unit="" if unit == "1" else unit)
    text = text.replace(" deg", "°")
    if requirement is None:
        return Cell(text, reason=metric.reason)
    return Cell(text, "met" if judge(requirement, found).met else "missed", metric.reason)


def _note(limits: Mapping[str, Requirement], shown: Sequence[str]) -> str:
    said = []
    for name in shown:
        if name in limits:
            limit = limits[name]
            unit = f" {limit.unit}".replace(" deg", "°") if limit.unit not in ("", "1") else ""
            kind = limit.kind.replace("_", " ")
            said.append(f"{metric_title(name)} {kind} {limit.limit:g}{unit}")
    return f"Required: {', '.join(said)}." if said else ""
