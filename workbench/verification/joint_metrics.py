"""Metrics of driven joints: supply, pair of pressures, stiffness, stops, by a plant's ports."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.errors import check_choice
from workbench.verification.closed_loop_run import Run
from workbench.verification.metrics import Metric, Tolerance, extremes

_STOP = "_stop.torque"


def joint_stiffness(run: Run) -> Vector:
    """Compute the joint's stiffness at constant pressures, ``-d torque / d angle``, in N m/rad."""
    check_choice("signal", "joint.torque", run.signal_names)
    check_choice("state", "angle", run.state_names)
    assert run.model is not None
    traced = run.model.exact
    torque = traced.signals[traced.signal_names.index("joint.torque")]
    slope = ca.jacobian(torque, traced.x[run.state_names.index("angle")])
    return traced.along(run.states, run.inputs, run.parameters, -slope)[0][:, 0, 0]


def _stops(run: Run) -> list[Vector]:
    return [run[name] for name in run.signal_names if name.endswith(_STOP)]


def _impacts(run: Run) -> float:
    touching = [torque > 0.0 for torque in _stops(run)]
    return float(sum(int(np.sum(t[1:] & ~t[:-1])) + int(t[0]) for t in touching))


def _has_stops(signals: Mapping[str, str]) -> bool:
    return any(name.endswith(_STOP) and unit == "N m" for name, unit in signals.items())


AIR = Metric(
    "air",
    lambda run: float(np.sum(run["supply.flow"]) * run.scenario.sample_time),
    "mass of air drawn from the supply over the whole run",
    unit="kg",
    display_unit="g",
    fits=lambda signals: signals.get("supply.flow") == "kg/s",
    tolerance=Tolerance(absolute=1e-6, relative=0.05),
    table="summary",
)
MEAN_PRESSURE_LOWEST, MEAN_PRESSURE_HIGHEST = extremes(
    "mean_pressure_",
    lambda run: 0.5 * (run["pressure_1"] + run["pressure_2"]),
    "mean of the two pressures",
    unit="Pa",
    display_unit="bar",
    fits=lambda signals: signals.get("pressure_1") == signals.get("pressure_2") == "Pa",
    tolerance=Tolerance("neither", 1e3, 0.02),
)
STIFFNESS_LOWEST, STIFFNESS_HIGHEST = extremes(
    "stiffness_",
    lambda run: run.derived("stiffness", joint_stiffness),
    "stiffness of the joint at constant pressures",
    unit="N m/rad",
    fits=lambda signals: signals.get("joint.torque") == "N m",
    tolerance=Tolerance("neither", 0.1, 0.02),
)
STOP_IMPACTS = Metric(
    "stop_impacts",
    _impacts,
    "how often a mechanical stop is touched",
    fits=_has_stops,
    tolerance=Tolerance(relative=0.0),
    zero=True,
    invariant=True,
    table="page",
)
STOP_PEAK_TORQUE = Metric(
    "stop_peak_torque",
    lambda run: max(float(torque.max()) for torque in _stops(run)),
    "largest torque of a mechanical stop",
    unit="N m",
    fits=_has_stops,
    tolerance=Tolerance(absolute=0.05, relative=0.05),
    zero=True,
    invariant=True,
)
