"""One output, one command: what the plain controllers know of a plant, and what they share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.c_source import CSource, closed_form
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.sensitivity import loop_matrices, peaks_of
from controllers.shown import ShownLaw
from workbench.errors import WorkbenchError, check_choice

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

Matrix = npt.NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]


class SingleLoop(NamedTuple):
    """A linear model between one command and one measured output.

    Args:
        linear: The model with this input and this output only.
        measured: Name of the output.
        actuator: Name of the command.
        rest_output: Output at the operating point, in SI.
        rest_command: Command at the operating point, in SI.
        lower: Lower end of the command, in SI.
        upper: Upper end of the command, in SI.
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


def single_loop(plant: Any, measured: str = "", actuator: str = "") -> SingleLoop:
    """Read a single loop off a linear model.

    Args:
        plant: A `LinearModel`, or a python-control system.
        measured: Name of the output; the first one by default.
        actuator: Name of the input; the first one by default.

    Raises:
        WorkbenchError: If there is no such signal, or the output answers a command at once.
    """
    from workbench.linearisation.state_space import linear_model

    whole = linear_model(plant)
    measured = measured or whole.output_names[0]
    actuator = actuator or whole.input_names[0]
    check_choice("measured output", measured, whole.output_names)
    check_choice("actuator", actuator, whole.input_names)
    linear = whole.select(inputs=(actuator,), outputs=(measured,))
    if np.any(linear.D):
        raise WorkbenchError(
            f"{measured} answers {actuator} within the sample ({linear.D[0, 0]:g} at once); add the"
            " lag of the sensor or of the actuator to the model"
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
    room = min(upper - rest, rest - lower)
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


@dataclass(frozen=True, kw_only=True, repr=False)
class PlainLaw(ShownLaw):
    """A law of numbers from one measurement to one command, within its ends.

    Written once for floats and for symbols, like `controllers.valve_inverse.ClosedForm`; its info
    has ``asked``, the command before its ends.

    Args:
        sensors: Name of the measured output.
        controlled: Name of the controlled output.
        actuators: Name of the command.
        sample_time: Time between steps, in s.
        rest: Command at rest, in SI.
        lower: Lower end of the command, in SI.
        upper: Upper end of the command, in SI.
        preview: No future references are used.
        name: Name under which results are reported.
    """

    sensors: tuple[str, ...]
    controlled: tuple[str, ...]
    actuators: tuple[str, ...]
    sample_time: float = 0.002
    rest: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    preview: int = 0
    name: str = "plain"

    @property
    def rest_command(self) -> Command:
        """Command at rest, in SI."""
        return (self.rest,)

    def step(
        self, state: Any, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any, Info]:
        """Compute the command of one sample."""
        return self.law(state, measurement, reference, FLOATS)

    def initial_state(
        self, measurement: tuple[Number, ...], arithmetic: Arithmetic = FLOATS
    ) -> Any:
        """Return the state of a plant at rest."""
        raise NotImplementedError

    def law(
        self,
        state: Any,
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
    ) -> tuple[tuple[Number, ...], Any, dict[str, Number]]:
        """Compute one sample on floats or on symbols, in SI."""
        raise NotImplementedError

    def linear_law(
        self,
        state: Any,
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
        rest: Measurement,
    ) -> tuple[tuple[Number, ...], Any]:
        """Return command and next state, as `controllers.linear_law` asks."""
        _, following, info = self.law(state, measurement, reference, arithmetic)
        return (info["asked"],), following

    def linear_command(self, command: Command) -> Command:
        """Return the command unchanged."""
        return command

    def c_source(self, name: str) -> CSource:
        """Write the law as C."""
        return closed_form(self, name)


def peaks(law: PlainLaw, loop: SingleLoop) -> tuple[float, float]:
    """Return Ms and Mt of a sampled loop (ratios), both infinite if it is not stable.

    An integral that the measurement does not show, such as the angle where a speed is controlled,
    does not count.
    """
    parts = loop_matrices(law, loop.linear)
    A, B, C, F, G, H, J = parts
    _, sizes, directions = np.linalg.svd(np.vstack([A - np.eye(len(A)), C]))
    shown = directions[sizes > 1e-12 * sizes.max(initial=0.0)].T
    A, B, C = shown.T @ A @ shown, shown.T @ B, C @ shown
    parts = parts._replace(A=A, B=B, C=C)
    closed = np.block([[A + B @ J @ C, B @ H], [G @ C, F]])
    if np.max(np.abs(np.linalg.eigvals(closed))) >= 1.0 - 1e-9:
        return math.inf, math.inf
    return peaks_of(parts, law.sample_time)


def total(start: Number, factors: tuple[float, ...], values: tuple[Number, ...]) -> Number:
    """Return start + sum of factors times values (in any units), in their order, without zeros."""
    for factor, value in zip(factors, values, strict=True):
        if factor:
            start = start + factor * value
    return start


def rows(matrix: Any) -> Rows:
    """Return a matrix, in any units, as a tuple of rows."""
    return tuple(tuple(row) for row in np.atleast_2d(np.asarray(matrix, dtype=float)).tolist())
