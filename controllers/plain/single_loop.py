"""One output, one command: what the plain controllers know of a plant, and what they share.

Units: SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controllers.arithmetic import Numbers, Told
from controllers.law import ClosedForm
from controllers.protocol import Command
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_range

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


class SingleLoop(NamedTuple):
    """A linear model between one command and one measured output.

    Args:
        output_scale: Typical size of the output, in SI.
        command_scale: What the command may change by, in SI.
        noise: Noise rms of the measurement, with that of its conversion, in SI.
    """

    linear: LinearModel
    measured: str
    actuator: str
    rest_output: float
    rest_command: float
    lower: float
    upper: float
    output_scale: float
    command_scale: float
    noise: float

    @property
    def ends(self) -> dict[str, Any]:
        """What a `PlainLaw` of this loop is told: names, rest and ends of the command."""
        return {
            "measured": self.measured,
            "actuator": self.actuator,
            "rest": self.rest_command,
            "rest_output": self.rest_output,
            "lower": self.lower,
            "upper": self.upper,
        }


SPEED = 0.02
"""Usual speed of a loop, times the sample time, dimensionless."""

DISTURBED = 500.0
"""Samples over which the disturbance of a command is taken to walk as far as it declares."""


def single_loop(plant: Any, measured: str = "", actuator: str = "") -> SingleLoop:
    """Read a single loop off a linear model or a python-control system.

    Raises:
        WorkbenchError: If there is no input, no output or no such signal, or the output answers a
            command at once or not at all.
    """
    from workbench.linearisation.state_space import linear_model

    whole = linear_model(plant)
    for kind, names in (("input", whole.input_names), ("output", whole.output_names)):
        if not names:
            raise WorkbenchError(
                f"{whole.operating_point.model.name!r} has no {kind}, so no controller can act on"
                f" it; declare one with {kind}s=({kind.capitalize()}(...),)"
            )
    measured = measured or whole.output_names[0]
    only_measured = {q.name for q in whole.operating_point.model.inputs if not q.commanded}
    commands = [name for name in whole.input_names if name not in only_measured]
    actuator = actuator or next(iter(commands), whole.input_names[0])
    check_choice("measured output", measured, whole.output_names)
    check_choice("actuator", actuator, commands)
    linear = whole.select(inputs=(actuator,), outputs=(measured,)).without_unseen()
    if np.any(linear.D):
        raise WorkbenchError(
            f"{measured} answers {actuator} within the sample ({linear.D[0, 0]:g} at once); add the"
            " lag of the sensor or of the actuator to the model"
        )
    moved = [linear.B]
    for _ in linear.A:
        moved.append(linear.A @ moved[-1])
    if not np.any(linear.C @ np.hstack(moved)):
        raise WorkbenchError(
            f"{actuator} does not move {measured} near the operating point; take another, where it"
            " does: --from or --at, or the nominal of an input"
        )
    model = whole.operating_point.model
    output = next(q for q in model.outputs if q.name == measured)
    inputs = {q.name: q for q in model.inputs}
    # By an inverted curve the command is a fraction, which no input of the plant is.
    lower, upper, scale = -1.0, 1.0, 1.0
    if whole.inverse is None:
        quantity = inputs[actuator]
        lower, upper, scale = quantity.lower, quantity.upper, quantity.scale
    rest = float(linear.u0[0])
    # A command that rests at an end has one direction only; half of its range is its size then.
    room = min(upper - rest, rest - lower) or 0.5 * (upper - lower)
    return SingleLoop(
        linear,
        measured,
        actuator,
        float(linear.y0[0]),
        rest,
        lower,
        upper,
        output.scale,
        room if 0.0 < room < math.inf else scale,
        math.hypot(output.noise_rms, output.resolution / math.sqrt(12.0)),
    )


@dataclass(frozen=True)
class LoopSpecification:
    """What every design for any linear model is told.

    Args:
        measured: Name of the controlled output; the first one by default.
        actuator: Name of the command; the first one by default.
        sample_time: Time between steps, in s.
    """

    measured: str = ""
    actuator: str = ""
    sample_time: float = field(default=0.002, kw_only=True)

    def __post_init__(self) -> None:
        check_range("sample time", self.sample_time, *TIMES_S, "s")

    def loop(self, linear: Any) -> SingleLoop:
        """Return the loop to control."""
        return single_loop(linear, self.measured, self.actuator)


@dataclass(frozen=True, kw_only=True, repr=False)
class PlainLaw(ClosedForm):
    """A law in closed form from one measurement to one command, within its ends.

    What it tells has ``asked``, the command before its ends.
    """

    sensors: tuple[str, ...]
    controlled: tuple[str, ...]
    actuators: tuple[str, ...]
    sample_time: float = 0.002
    rest: float = 0.0
    rest_output: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    preview: int = 0
    name: str = "plain"

    @property
    def rest_command(self) -> Command:
        """Command at rest, in SI."""
        return (self.rest,)

    def straight(self, told: Told) -> Numbers:
        """Return the command before its ends, in SI."""
        return (told["asked"],)

    def linear_command(self, command: Command) -> Command:
        """Return the command unchanged."""
        return command
