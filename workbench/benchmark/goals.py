"""What is wanted of every controller of the comparison."""

from __future__ import annotations

import math

from workbench.verification.responses import Value

SETTLING_15_S = {"0 kg": 0.5, "3 kg": 0.5, "8 kg": 0.9}
"""Goals for settling after 15°, s, by load."""

GOALS = {
    "overshoot_percent": 5.0,
    "steady_deg": 0.05,
    "swing_deg": 0.05,
    "rmse_0.2_Hz_deg": 0.3,
    "rmse_0.5_Hz_deg": 0.6,
    "rmse_1_Hz_deg": 1.5,
    "ratio_5": 2.0,
    "ratio_15": 2.0,
    "ratio_30": 2.0,
    "fallbacks": 0.0,
    "stop_impacts": 0.0,
}
"""Goals: the figure is at most so large, in the unit of its name."""


def goals_of(case: str) -> dict[str, float]:
    """Return the goals for a load.

    Args:
        case: Name of the case.

    Returns:
        Largest wanted figure by name, in the unit of the name.

    Example:
        >>> goals_of("8 kg horizontal")["settling_15_s"]
        0.9
    """
    settling = next((g for load, g in SETTLING_15_S.items() if case.startswith(load)), math.inf)
    return {**GOALS, "settling_15_s": settling}


def is_missed(figure: Value, goal: float) -> bool:
    """Tell whether a goal is missed; one that cannot be judged without a limit is not.

    Args:
        figure: The figure, in the unit of the goal.
        goal: Largest wanted value, in the same unit.

    Returns:
        Whether it is (a truth value, without unit).

    Example:
        >>> is_missed(Value(0.3), 0.2), is_missed(Value(math.nan, "no limit"), 0.2)
        (True, False)
    """
    if math.isnan(figure.value) and "limit" in figure.reason:
        return False
    return not figure.value <= goal
