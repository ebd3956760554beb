"""Requirements as data: a metric, a limit, hard or soft, in a scenario."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal, NamedTuple

from workbench.errors import WorkbenchError, check_choice, check_finite
from workbench.model.units import convert, of_difference, parse_unit, quantity
from workbench.verification.metrics import Metric, Metrics, metric_of


@dataclass(frozen=True)
class Requirement:
    """A limit on a metric.

    Args:
        limit: The limit, in ``unit``; positive, so that scores can be compared.
    """

    metric: str
    limit: float
    unit: str = ""
    kind: Literal["at_most", "at_least"] = "at_most"
    hard: bool = True
    scenario: str = ""

    def __post_init__(self) -> None:
        check_choice("kind of requirement", self.kind, ("at_most", "at_least"))
        limit = float(check_finite(f"limit of {self.metric}", self.limit))
        zero_allowed = self.kind == "at_most"
        if limit < 0 or (limit == 0 and not zero_allowed):
            raise WorkbenchError(
                f"the limit of {self.metric} is {limit:g}; give a positive number (0 only for"
                " something that must not happen at all)"
            )
        metric = metric_of(self.metric)
        if self.unit and metric is not None and not metric.level:
            unit = of_difference(self.unit)
            limit *= parse_unit(self.unit).factor / parse_unit(unit).factor
            object.__setattr__(self, "unit", unit)
            object.__setattr__(self, "limit", limit)


def limit_in_words(metric: Metric, name: str, text: str, unit: str) -> tuple[float, str]:
    """Return a limit on a metric that is written as text, and the unit that it is in.

    Args:
        name: The metric, as the user knows it.
        text: Number with a unit, or without one.
        unit: Unit of the metric, which is meant where the text has none.
    """
    limit = quantity(f"limit of {name}", text, unit, difference=not metric.level)
    own = re.sub(r"^\s*[-+.\d]+([eE][-+]?\d+)?\s*", "", text).strip() or unit
    own = own if metric.level else of_difference(own)
    return float(convert(limit, unit, own)), own


class Score(NamedTuple):
    """How well a requirement is met.

    Args:
        value: The metric, in the requirement's unit; NaN if there is none.
        score: Value over limit (or limit over value), a ratio: at most 1 means met, infinite that
            there is no value.
    """

    value: float
    score: float
    reason: str = ""

    @property
    def met(self) -> bool:
        """Whether the requirement is met."""
        return self.score <= 1.0


def judge(requirement: Requirement, measured: Metrics) -> Score:
    """Judge one requirement on the metrics of a run; a metric that is NaN is never met."""
    metric = measured[requirement.metric]
    value = metric.value
    if requirement.unit:
        value = float(convert(value, metric.unit, requirement.unit))
    return Score(value, score_of(requirement, value), metric.reason)


def score_of(requirement: Requirement, value: float) -> float:
    """Return the score, a ratio, of a value in the unit of a requirement; NaN is never met."""
    limit = requirement.limit
    if math.isnan(value):
        return math.inf
    if requirement.kind == "at_most":
        return value / limit if limit > 0 else (0.0 if value <= 0 else math.inf)
    return limit / value if value > 0 else math.inf
