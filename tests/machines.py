"""What tests of machines share: states in a word, a machine at rest, a step with a law."""

from __future__ import annotations

from typing import Any

from workbench.linearisation import LinearModel, linearise
from workbench.model import Model, State
from workbench.operating_point import operating_point
from workbench.verification import metrics, step_scenario, verify


def states(*told: str) -> tuple[State, ...]:
    """Return states, each told as ``"name unit"``."""
    return tuple(State(*each.split(maxsplit=1)) for each in told)


def at_rest(model: Model, **at: float) -> LinearModel:
    """Return the linear model of a machine at rest, where some outputs or inputs have values."""
    return linearise(operating_point(model, at), verdict=False)


def stepped(
    law: Any, plant: Any, output: str, begin: float, end: float, **told: Any
) -> dict[str, float]:
    """Return the metrics of a step of an output, in SI; see `step_scenario`."""
    step = step_scenario(output, begin, end, sample_time=law.sample_time, **told)
    return {name: found.value for name, found in metrics(verify(law, plant, step)).items()}
