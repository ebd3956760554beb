"""One output, one command: what the plain controllers know of a plant, and what they share.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controllers.arithmetic import Arithmetic, Number, Numbers, Told
from controllers.law import ClosedForm
from controllers.linear_law import LinearLaw
from controllers.named_state import flat, restored
from controllers.protocol import Command
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_range
from workbench.linearisation.transfer import transfer_function

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

    def sizes(self, speeds: Sequence[float]) -> list[float]:
        """Return what all of the command makes the output swing by at each speed, in its SI.

        At a speed, in rad/s, it is the largest of those at it and above.
        """
        m = self.linear
        P = transfer_function(m.A, m.B, m.C, m.D, 1j * np.array(speeds))[:, 0, 0]
        sizes = np.maximum.accumulate(np.abs(P) * self.command_scale)
        return [float(size) for size in sizes]

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


def speeds(sample_time: float, number: int = 40) -> list[float]:
    """Return speeds of a loop that may be tried, in rad/s, from fast to slow."""
    return [float(w) / sample_time for w in np.geomspace(0.3, 1e-5, number)]


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
    linear = linear.without_unreached()
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
        maximum_sensitivity: Limit on Ms, the peak of the sensitivity (ratio); by default (0) 1.8,
            or the least that a loop of this plant has.
        maximum_complementary: Limit on Mt, the peak of the complementary sensitivity (ratio); by
            default (0) 1.6, or the least that a loop of this plant has.
        delay: Delay beside that of sampling up to which the limits hold, in s.
        sensor_lag: Time constant of the sensor with which the limits hold as well, in s.
        trusted_frequency: Frequency above which nothing of the model is trusted, in rad/s; every
            one is by default (0).
        quiet: What the noise of the measurement may move the command by, rms, as a fraction of half
            its range.
        overshoot: Overshoot of a step within the command's ends that is allowed, as a fraction of
            the step.
        noise: Noise rms of the measurement, in SI of the output; by default (0) what the sensor
            declares, and 1e-4 of its scale at least.
    """

    measured: str = ""
    actuator: str = ""
    sample_time: float = field(default=0.002, kw_only=True)
    maximum_sensitivity: float = field(default=0.0, kw_only=True)
    maximum_complementary: float = field(default=0.0, kw_only=True)
    delay: float = field(default=0.0, kw_only=True)
    sensor_lag: float = field(default=0.0, kw_only=True)
    trusted_frequency: float = field(default=0.0, kw_only=True)
    quiet: float = field(default=0.02, kw_only=True)
    overshoot: float = field(default=0.02, kw_only=True)
    noise: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        check_range("sample time", self.sample_time, *TIMES_S, "s")
        for name, value, least in (
            ("Ms", self.maximum_sensitivity, 1.05),
            ("Mt", self.maximum_complementary, 1.0),
        ):
            if value:
                check_range(f"limit on {name}", value, least, 10.0)
        check_range("delay", self.delay, 0.0, TIMES_S[1], "s")
        check_range("lag of the sensor", self.sensor_lag, 0.0, TIMES_S[1], "s")
        check_range("trusted frequency", self.trusted_frequency, 0.0, 1.0 / TIMES_S[0], "rad/s")
        check_range("share of the command that noise may take", self.quiet, 1e-9, 1e9)
        check_range("overshoot", self.overshoot, 0.0, 1.0)
        check_range("noise", self.noise, 0.0, 1e30)

    def loop_noise(self, loop: SingleLoop) -> float:
        """Return the noise rms that is reckoned with, in SI of the output."""
        return self.noise or max(loop.noise, 1e-4 * loop.output_scale)

    def loop(self, linear: Any) -> SingleLoop:
        """Return the loop to control."""
        return single_loop(linear, self.measured, self.actuator)


class _Arrays:
    """Arithmetic of a law on arrays of any shape."""

    clip = staticmethod(np.clip)
    where = staticmethod(np.where)


ARRAYS: Any = _Arrays()


class _Endless:
    """Arithmetic, on arrays of any shape, of a law whose limits are all out of reach."""

    def clip(self, x: Number, lower: Number, upper: Number) -> Number:
        return x

    def where(self, condition: Any, yes: Number, no: Number) -> Number:
        return yes


ENDLESS: Any = _Endless()


@dataclass(frozen=True, kw_only=True, repr=False)
class PlainLaw(ClosedForm):
    """A law in closed form from one measurement to one command, within its ends.

    What it tells has ``asked``, the command before its ends.

    Args:
        pace: Largest change of the reference that is followed, in SI of the output per sample.
    """

    sensors: tuple[str, ...]
    controlled: tuple[str, ...]
    actuators: tuple[str, ...]
    sample_time: float = 0.002
    rest: float = 0.0
    rest_output: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    pace: float = math.inf
    preview: int = 0
    name: str = "plain"

    def followed(self, before: Number, r: Number, arithmetic: Arithmetic) -> Number:
        """Return the reference at its pace, from that of the sample before, in SI."""
        if self.pace == math.inf:
            return r
        return before + arithmetic.clip(r - before, -self.pace, self.pace)

    @property
    def rest_command(self) -> Command:
        """Command at rest, in SI."""
        return (self.rest,)

    def around_rest(self) -> LinearLaw:
        """Return the law between its ends, from measurement and reference as deviations."""
        law = replace(self, rest=0.0, rest_output=0.0)
        example = law.initial_state((0.0,))
        n = len(flat(example))
        *before, y, r = np.eye(n + 2)
        _, following, told = law.law(restored(example, before), (y,), (r,), ENDLESS)
        states = [part for part in following if part is not None]
        table = np.vstack([*states, *law.straight(told)])
        return LinearLaw(table[:n, :n], table[:n, n:], table[n:, :n], table[n:, n:])

    def straight(self, told: Told) -> Numbers:
        """Return the command before its ends, in SI."""
        return (told["asked"],)

    def linear_command(self, command: Command) -> Command:
        """Return the command unchanged."""
        return command
