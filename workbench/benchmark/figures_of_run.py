"""Figures of merit of the runs of the comparison, per size of step."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from workbench.benchmark.cases import CHANGES
from workbench.verification import Run, metrics, responses
from workbench.verification.each_step import each_step, response_to_each_step
from workbench.verification.responses import Value

SIZES_DEG = (5, 15, 30)
"""Sizes of steps, °."""


def figures_of_run(run: Run) -> dict[str, Value]:
    """Compute what the table needs of a run.

    Args:
        run: A run of the staircase, of a sine or of the changes at rest.

    Returns:
        Figures by name with the unit at its end. For the staircase, per size of step, the worst
        step counts; the time of one step from 20° (5°: 30°, 30°: 5°) upwards stands apart.

    Example:
        >>> figures_of_run.__name__
        'figures_of_run'
    """
    if run.scenario.name == "steps":
        return _steps(run)
    if run.scenario.name == CHANGES:
        return _changes(run)
    return _sine(run)


def _steps(run: Run) -> dict[str, Value]:
    found = step_figures(run)
    whole = metrics(run)
    found["chatter_V_per_s"] = Value(whole["chatter"].value)
    found["air_g"] = Value(1e3 * whole["air"].value)
    found["mean_pressure_lowest_bar"] = Value(1e-5 * whole["mean_pressure_lowest"].value)
    found["mean_pressure_highest_bar"] = Value(1e-5 * whole["mean_pressure_highest"].value)
    found["stop_impacts"] = Value(whole["stop_impacts"].value)
    if "surface" in run.infos[0]:
        found["surface_rms_rad_per_s2"] = responses.rms(run.info("surface"))
    if "plan" in run.infos[0]:
        found |= _planned(run)
    for name in ("fallbacks", "solve_time_p99"):
        if name in whole:
            found[name if name == "fallbacks" else f"{name}_s"] = Value(whole[name].value)
    return found


def _planned(run: Run) -> dict[str, Value]:
    """Return when the planned reference itself enters the band for good, per size of step."""
    found = {}
    for step in response_to_each_step(run, "angle"):
        a, b = _degrees(step.initial, step.final)
        if (a, b) in LIMITED_DEG:
            found[f"settling_planned_{round(abs(b - a))}_s"] = Value(step.planned)
    return found


def step_figures(run: Run) -> dict[str, Value]:
    """Compute figures of the steps of a run of the staircase.

    Args:
        run: The run; only time, reference and angle count. Steps are of the sizes of `SIZES_DEG`.

    Returns:
        Settling (s), overshoot (%), steady error and swing (°), the worst step of each size.

    Example:
        >>> step_figures.__name__
        'step_figures'
    """
    time, angle, error = run.time, run["angle"], run.references["angle"] - run["angle"]
    by_size: dict[int, dict[str, list[Value]]] = {
        size: {"settling": [], "overshoot": [], "steady": [], "swing": []} for size in SIZES_DEG
    }
    found: dict[str, Value] = {}
    for _, initial, final, part in each_step(time, run.scenario.references["angle"].changes):
        a, b = _degrees(initial, final)
        t, y = time[part], angle[part]
        own = by_size[round(abs(b - a))]
        settled = responses.settling_time(t, y, initial=initial, final=final)
        own["settling"].append(settled)
        own["overshoot"].append(responses.overshoot(y, initial=initial, final=final))
        own["steady"].append(responses.steady_error(t, error[part], window=0.5))
        own["swing"].append(responses.oscillation(t, y, window=0.5))
        if (a, b) in LIMITED_DEG:
            found[f"settling_limited_{round(abs(b - a))}_s"] = settled
    for size, own in by_size.items():
        found[f"settling_{size}_s"] = worst(own["settling"])
        found[f"overshoot_{size}_percent"] = _times(worst(own["overshoot"]), 100.0)
    for name in ("steady", "swing"):
        together = [figure for own in by_size.values() for figure in own[name]]
        found[f"{name}_deg"] = _times(worst(together), math.degrees(1.0))
    found["overshoot_percent"] = worst([found[f"overshoot_{s}_percent"] for s in SIZES_DEG])
    return found


def _degrees(initial: float, final: float) -> tuple[float, float]:
    return round(math.degrees(initial), 6), round(math.degrees(final), 6)


LIMITED_DEG = ((35.0, 30.0), (20.0, 35.0), (5.0, 35.0))
"""Steps that are compared with the physical limit, one of each size, °."""


def _sine(run: Run) -> dict[str, Value]:
    signal = run.scenario.references["angle"]
    frequency = float(getattr(signal, "frequency_Hz", math.nan))
    error = np.degrees(run.references["angle"] - run["angle"])
    # The sine starts at full speed, which no arm at rest can follow: half a period to catch up.
    late = run.time >= 0.5 / frequency
    return {
        f"rmse_{frequency:g}_Hz_deg": responses.rms(error[late]),
        f"rmse_from_rest_{frequency:g}_Hz_deg": responses.rms(error),
    }


def _changes(run: Run) -> dict[str, Value]:
    error = np.degrees(run.references["angle"] - run["angle"])
    found = {}
    for name, begin in (("load", 0.5), ("supply", 2.0), ("valve", 3.5)):
        part = (run.time >= begin) & (run.time < begin + 1.5)
        found[f"peak_after_{name}_deg"] = Value(float(np.max(np.abs(error[part]))))
        found[f"left_after_{name}_deg"] = responses.steady_error(
            run.time[part], error[part], window=0.4
        )
    return found


def worst(figures: list[Value]) -> Value:
    """Return the largest figure; one that is missing is worse than any number.

    Args:
        figures: Figures of one unit.

    Returns:
        The worst, in their unit.

    Example:
        >>> worst([Value(1.0), Value(2.0)]).value
        2.0
    """
    missing = [f for f in figures if math.isnan(f.value)]
    return missing[0] if missing else max(figures, key=lambda f: f.value)


def worst_of_all(all_figures: list[Mapping[str, Value]]) -> dict[str, Value]:
    """Return the worst of every figure over several variations.

    Args:
        all_figures: Figures by name, in the units of their names; the same names in each.

    Returns:
        The worst by name; of the lowest mean pressure, the lowest.

    Example:
        >>> worst_of_all([{"a": Value(1.0)}, {"a": Value(3.0)}])["a"].value
        3.0
    """
    result = {}
    for name in all_figures[0]:
        column = [figures[name] for figures in all_figures if name in figures]
        lowest = name.startswith("mean_pressure_lowest")
        result[name] = min(column, key=lambda f: f.value) if lowest else worst(column)
    return result


def _times(figure: Value, factor: float) -> Value:
    return Value(factor * figure.value, figure.reason)
