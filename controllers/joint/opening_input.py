"""The valve opening as the input of a linear model, whichever input the model was made with."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from controllers.valve_inverse import ValveInverse
from workbench.errors import check_choice

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

OPENING = "opening"
"""Name of the input of a linear model that was made with the valve's curve inverted."""


class OpeningInput(NamedTuple):
    """How the opening enters a linear model.

    Args:
        name: Name of the model's input.
        per_opening: Change of that input per full opening, in the input's SI unit.
        at_rest: Opening at the operating point, a fraction.
    """

    name: str
    per_opening: float
    at_rest: float


def opening_input(
    linear: LinearModel, valve: ValveInverse, actuator: str = "valve"
) -> OpeningInput:
    """Tell how the opening enters a linear model.

    Returns:
        Name of the input, its change per full opening in SI, and the opening at rest (fraction).

    Raises:
        WorkbenchError: If the model has neither input.
    """
    name = OPENING if OPENING in linear.input_names else actuator
    check_choice("actuator of the linear model", name, linear.input_names)
    at_point = float(linear.u0[linear.input_names.index(name)])
    if name == OPENING:
        return OpeningInput(name, 1.0, at_point)
    return OpeningInput(name, 1.0 / valve.gain_at_rest, valve.opening(at_point))
