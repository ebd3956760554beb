"""The sampled loop on the full plant: scenarios, runs, metrics and requirements."""

from workbench.verification.loop import verify
from workbench.verification.metrics import Metric, Metrics, metrics
from workbench.verification.requirements import (
    Requirement,
    Verdict,
    judge,
    requirement_from_table,
    score,
)
from workbench.verification.run import Run
from workbench.verification.scenario import (
    Change,
    Disturbance,
    Scenario,
    scenario_from_table,
    step_scenario,
)
from workbench.verification.signals import Ramps, Signal, Sine, Steps, signal_from_table

__all__ = [
    "Change",
    "Disturbance",
    "Metric",
    "Metrics",
    "Ramps",
    "Requirement",
    "Run",
    "Scenario",
    "Signal",
    "Sine",
    "Steps",
    "Verdict",
    "judge",
    "metrics",
    "requirement_from_table",
    "scenario_from_table",
    "score",
    "signal_from_table",
    "step_scenario",
    "verify",
]
