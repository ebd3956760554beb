"""Where a closed-loop run starts: the operating point of its first references."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.verification.scenario import Scenario

Vector = npt.NDArray[np.float64]


def start_values(scenario: Scenario) -> dict[str, float]:
    """Return what is given at the start of a scenario.

    Args:
        scenario: What is asked; its ``start``, or its references at t = 0.

    Returns:
        Values by name, in SI.

    Example:
        >>> from workbench.verification.scenario import step_scenario
        >>> start_values(step_scenario(from_deg=0, to_deg=45))
        {'angle': 0.0}
    """
    if scenario.start is not None:
        return dict(scenario.start)
    return {name: float(s.sample(0.0)) for name, s in scenario.references.items()}


def start_state(model: Model, scenario: Scenario) -> tuple[Vector, Vector]:
    """Return the states and inputs at which a run of a scenario starts.

    Args:
        model: The plant.
        scenario: What is asked; its ``start``, or its references at t = 0.

    Returns:
        States, shape (n_states,), and inputs, shape (n_inputs,), in SI.

    Raises:
        WorkbenchError: If the plant cannot rest there.

    Example:
        >>> from workbench.plants.arm import arm
        >>> from workbench.verification.scenario import step_scenario
        >>> x, u = start_state(arm(3), step_scenario(from_deg=30, to_deg=45))
        >>> round(float(u[0]), 2)
        5.0
    """
    point = operating_point(model, start_values(scenario))
    return np.asarray(point.x, dtype=float), np.asarray(point.u, dtype=float)
