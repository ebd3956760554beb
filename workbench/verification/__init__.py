"""The sampled loop on the full plant: scenarios, runs, metrics and requirements."""

from workbench.verification.closed_loop_run import Run
from workbench.verification.guard_limits import guarded
from workbench.verification.loop import verify
from workbench.verification.metrics import METRICS, Metric, Metrics, MetricValue, Tolerance, metrics
from workbench.verification.requirements import Requirement, judge
from workbench.verification.scenario import (
    Change,
    Disturbance,
    Scenario,
    SignalFault,
    step_scenario,
)
from workbench.verification.signals import (
    SIGNALS,
    Ramps,
    Recorded,
    Signal,
    Sine,
    Steps,
    signal_from_table,
)

__all__ = [
    "METRICS",
    "SIGNALS",
    "Change",
    "Disturbance",
    "Metric",
    "MetricValue",
    "Metrics",
    "Ramps",
    "Recorded",
    "Requirement",
    "Run",
    "Scenario",
    "Signal",
    "SignalFault",
    "Sine",
    "Steps",
    "Tolerance",
    "guarded",
    "judge",
    "metrics",
    "signal_from_table",
    "step_scenario",
    "verify",
]
