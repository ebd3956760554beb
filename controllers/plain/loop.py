"""Followed outputs and commands: what the plain controllers know of a plant, and what they share.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from controllers.arithmetic import Arithmetic, Number, Numbers, Told
from controllers.law import ClosedForm, Kernel
from controllers.linear_law import LinearLaw
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.specification import Checked, number
from controllers.valve_inverse import ValveInverse
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.command_curve import command_curves
from workbench.linearisation.transfer import transfer_function
from workbench.model.quantities import of_names


class Loop(NamedTuple):
    """A linear model between commands and followed outputs.

    All but the model has one entry for each output or command, in SI.

    Args:
        output_scale: Typical sizes of the outputs.
        command_scale: Half of what each command may change by at rest, or its scale where that has
            no end.
        noise: Noise rms of the measurements, with that of their conversion, of outputs that are
            read beside the followed ones too.
        slew: Fastest changes of the commands, per s.
        curves: What bends each command, centred at rest, or None.
        fading: What a lag before each curve leaves of it after a sample, a ratio.
        read: The same model to all outputs that are read, the followed ones first; None if no
            others are.
    """

    linear: LinearModel
    measured: tuple[str, ...]
    actuators: tuple[str, ...]
    rest_output: Vector
    rest_command: Vector
    lower: Vector
    upper: Vector
    output_scale: Vector
    command_scale: Vector
    noise: Vector
    slew: Vector
    curves: tuple[ValveInverse | None, ...]
    fading: tuple[float, ...]
    read: LinearModel | None = None

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of all outputs that are read, the followed ones first."""
        return self.measured if self.read is None else self.read.output_names

    @property
    def seen(self) -> Matrix:
        """What the states show at all outputs that are read, shape (n_sensors, n_states), in SI."""
        return self.linear.C if self.read is None else self.read.C

    def response(self, speeds: npt.ArrayLike) -> Complex:
        """Return the plant at speeds in rad/s, shape (n, n_outputs, n_commands), in SI."""
        m = self.linear
        return transfer_function(m.A, m.B, m.C, m.D, 1j * np.asarray(speeds))

    def sizes(self, speeds: Sequence[float]) -> Matrix:
        """Return what all of the commands make each output swing by, shape (n, n_outputs), in SI.

        At a speed, in rad/s, it is the largest of those at it and above.
        """
        swings = np.linalg.norm(np.abs(self.response(speeds)) * self.command_scale, axis=2)
        return np.asarray(np.maximum.accumulate(swings, axis=0))

    @property
    def words(self) -> str:
        """Which outputs are followed by which commands, in words."""
        return f"{listed(self.measured)} by {listed(self.actuators)}"

    @property
    def ends(self) -> dict[str, Any]:
        """What a `PlainLaw` of this loop is told: names, rest and ends of the commands."""
        numbers = ("rest_command", "rest_output", "lower", "upper", "slew")
        rest, rest_output, lower, upper, slew = (
            tuple(getattr(self, name).tolist()) for name in numbers
        )
        if self.read is not None:
            rest_output = tuple(self.read.y0.tolist())
        return {
            "sensors": self.sensors,
            "controlled": self.measured,
            "actuators": self.actuators,
            "rest": rest,
            "rest_output": rest_output,
            "lower": lower,
            "upper": upper,
            "slew": slew,
            "curves": self.curves if any(self.curves) else (),
            "fading": self.fading if any(self.curves) else (),
        }


def speeds(sample_time: float, number: int = 40) -> list[float]:
    """Return speeds of a loop that may be tried, in rad/s, from fast to slow."""
    return [float(w) / sample_time for w in np.geomspace(0.3, 1e-5, number)]


def listed(names: Sequence[str]) -> str:
    """Return names as words: a, b and c."""
    return " and ".join(", ".join(names).rsplit(", ", 1))


def _do_not(names: Sequence[str]) -> str:
    return f"{listed(names)} {'do' if len(names) > 1 else 'does'} not"


def named(given: str | Sequence[str]) -> tuple[str, ...]:
    """Return the names in a text, between commas, or in a list."""
    parts = given.split(",") if isinstance(given, str) else given
    return tuple(part.strip() for part in parts if part.strip())


def loop_of(
    plant: Any,
    measured: str | Sequence[str] = (),
    actuators: str | Sequence[str] = (),
    also: str | Sequence[str] = (),
    sample_time: float = 0.0,
) -> Loop:
    """Read followed outputs and commands off a linear model or a python-control system.

    By default those outputs are followed, in their order, that the commands hold independently, or
    the first where they hold none; several by all commands that move something, one by the first
    that does.

    Args:
        also: Names of outputs that are read and not followed.
        sample_time: Time between steps of a law that sends its commands through the inverses of
            their curves, in s; 0 for one that does not.

    Raises:
        WorkbenchError: If there is no input, no output or no such signal, an output answers no
            command, they cannot be held independently, or a mode grows that no command moves or no
            output shows.
    """
    from workbench.linearisation.state_space import linear_model

    whole = linear_model(plant)
    for kind, names in (("input", whole.input_names), ("output", whole.output_names)):
        if not names:
            raise WorkbenchError(
                f"{whole.operating_point.model.name!r} has no {kind}, so no controller can act on"
                f" it; declare one with {kind}s=({kind.capitalize()}(...),)"
            )
    model = whole.operating_point.model
    only_measured = {q.name for q in model.inputs if not q.commanded}
    commands = [name for name in whole.input_names if name not in only_measured]
    given, acting = named(measured), named(actuators)
    for name in (*given, *named(also)):
        check_choice("measured output", name, whole.output_names)
    for name in acting:
        check_choice("actuator", name, commands)
    followed = given or held_outputs(whole, acting or commands) or whole.output_names[:1]
    if not acting:
        acting = _moving(whole, followed, tuple(commands or whole.input_names))
        acting = acting[:1] if len(followed) == 1 else acting
    others = tuple(name for name in named(also) if name not in followed)
    sensors = (*followed, *others)
    _check_growing(whole.select(inputs=acting, outputs=sensors))
    read = whole.select(inputs=acting, outputs=sensors).without_unseen()
    fastest = float(np.abs(whole.poles).max(initial=0.0)) or 1.0
    read = read.read_after_holding(sample_time or SOON / fastest)
    linear = read.select(outputs=followed)
    still = [
        n for n, moved in zip(followed, np.any(_moved(linear), axis=1), strict=True) if not moved
    ]
    if still:
        raise WorkbenchError(
            f"{_do_not(acting)} move {still[0]} near the"
            " operating point; take another, where it does: --from or --at, or the nominal of an"
            " input"
        )
    read = read.without_unreached()
    linear = read.select(outputs=followed)
    _check_independent(linear)
    sizes = [q.scale for q in of_names(model.outputs, followed)]
    noise = [
        math.hypot(q.noise_rms, q.resolution / math.sqrt(12.0))
        for q in of_names(model.outputs, sensors)
    ]
    rest, ones = linear.u0.astype(float), np.ones(len(acting))
    # By an inverted curve the command is a fraction, which no input of the plant is.
    lower, upper, scale, slew = -ones, ones, ones, math.inf * ones
    if whole.inverse is None:
        lower, upper, scale, slew = (
            np.array([getattr(q, end) for q in of_names(model.inputs, acting)], dtype=float)
            for end in ("lower", "upper", "scale", "slew")
        )
    curves, fading = _curves(whole, acting, sample_time)
    for k, (curve, left) in enumerate(zip(curves, fading, strict=True)):
        if curve is not None and not left:
            # Behind its inverse a command is what does as much by the slope at rest.
            lower[k], upper[k] = map(curve.straight, (-math.inf, math.inf))
    # What rests near an end has little room to one side, and all the more to the other.
    half = 0.5 * (upper - lower)
    if linear.ends is not None:
        # A clipped loop within is filled by less.
        ends = 0.5 * (linear.ends[1, :, 0] - linear.ends[0, :, 0])
        bent = [curve is not None and not left for curve, left in zip(curves, fading, strict=True)]
        half = np.where(bent, half, np.minimum(half, ends))
    return Loop(
        linear,
        followed,
        acting,
        linear.y0.astype(float),
        rest,
        lower,
        upper,
        np.array(sizes),
        np.where(half < math.inf, half, scale),
        np.array(noise),
        slew,
        curves,
        fading,
        read if others else None,
    )


def _curves(
    whole: LinearModel, acting: Sequence[str], sample_time: float
) -> tuple[tuple[ValveInverse | None, ...], tuple[float, ...]]:
    """Return the inverse of each command's curve, if any, and what a lag leaves after a sample.

    A lag that is over within a sample or two counts as none.
    """
    found: list[tuple[ValveInverse | None, float]] = [(None, 0.0)] * len(acting)
    if whole.inverse is None and sample_time:
        inputs = [q.name for q in whole.operating_point.model.inputs]
        each = command_curves(whole.operating_point)
        for k, name in enumerate(acting):
            curve, column = each[inputs.index(name)], whole.input_names.index(name)
            if curve is None or (whole.ends is not None and np.any(whole.ends[:, column, 1:])):
                continue
            left = math.exp(-sample_time * curve.rate)
            if left < OVER or curve.lags == 1:
                below, above = curve.sides
                inverse = ValveInverse(*above, float(whole.u0[column]), below)
                found[k] = inverse, left if left >= OVER else 0.0
    curves, fading = zip(*found, strict=True)
    return curves, fading


SOON = 1e-3
"""Sample time, times the fastest rate of a plant, of a loop that is not sampled."""

OVER = 0.6
"""What a lag leaves after a sample of which the rest is left out, a ratio."""


def spare_outputs(plant: Any, loop: Loop) -> tuple[str, ...]:
    """Return the outputs that a loop could read too, of a model of no more states.

    Commands move them, but none at once.
    """
    from workbench.linearisation.state_space import linear_model

    whole = linear_model(plant)
    states = len(loop.linear.A)
    found = []
    for name in whole.output_names:
        if name in loop.measured:
            continue
        own = whole.select(inputs=loop.actuators, outputs=(*loop.measured, name)).without_unseen()
        moved = np.any(_moved(own.select(outputs=(name,))))
        if moved and not np.any(own.D) and len(own.without_unreached().A) == states:
            found.append(name)
    return tuple(found)


def held_outputs(whole: LinearModel, commands: Sequence[str]) -> tuple[str, ...]:
    """Return the outputs, in their order, that commands hold independently, if there are any."""
    found: tuple[str, ...] = ()
    for name in whole.output_names:
        tried = whole.select(inputs=commands, outputs=(*found, name)).without_unseen()
        if np.any(tried.D) or not np.all(np.any(_moved(tried), axis=1)):
            continue
        if len(found) < len(commands) and _rank_lost(tried.without_unreached()) is None:
            found = (*found, name)
    return found


def _moved(linear: LinearModel) -> Matrix:
    """Return what the inputs make of the outputs within ever more samples, one row for each."""
    moved = [linear.B]
    for _ in linear.A:
        moved.append(linear.A @ moved[-1])
    return np.asarray(linear.C @ np.hstack(moved))


def _moving(
    whole: LinearModel, followed: Sequence[str], commands: tuple[str, ...]
) -> tuple[str, ...]:
    each = {n: whole.select(inputs=(n,), outputs=followed).without_unseen() for n in commands}
    return tuple(n for n, own in each.items() if np.any(_moved(own))) or commands


def _rank_lost(linear: LinearModel) -> Vector | None:
    """Return the sum of outputs, in their scales, that no inputs move to rest elsewhere, if any.

    Source: Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 4.5.
    """
    size, n = linear.state_scales, len(linear.A)
    outputs = of_names(linear.operating_point.model.outputs, linear.output_names)
    scale = np.array([q.scale for q in outputs])
    table = np.block([[linear.A, linear.B], [linear.C, linear.D]])
    table = table * np.append(size, np.ones(linear.B.shape[1]))
    table = table / np.append(np.ones(n), scale)[:, None]
    for _ in range(3):
        columns = np.maximum(np.abs(table).max(axis=0), 1e-300)
        table = table / columns
        rows = np.maximum(np.abs(table).max(axis=1), 1e-300)
        table = table / rows[:, None]
        scale = scale * rows[n:]
    left, values, _ = np.linalg.svd(table)
    if len(values) == len(table) and values[-1] > HELD * values[0]:
        return None
    return np.asarray(left[n:, -1])


def _check_growing(linear: LinearModel) -> None:
    """Refuse a mode that grows by itself and that inputs do not move, or outputs do not show.

    Source: Popov, Belevitch and Hautus; Skogestad and Postlethwaite, Multivariable Feedback
    Control, 2005, section 4.2.
    """
    size = linear.state_scales
    A, C = linear.A * size / size[:, None], linear.C * size
    B = linear.B / size[:, None]
    values, vectors = np.linalg.eig(A)
    integrators = int(np.sum(linear.poles == 0.0))
    values[np.argsort(np.abs(values))[:integrators]] = 0.0
    rate = float(np.abs(values).max(initial=0.0))
    for k in np.flatnonzero(values.real > HELD * rate):
        shifted = (A - values[k] * np.eye(len(A))) / rate
        state = linear.state_names[int(np.argmax(np.abs(vectors[:, k])))]
        said = f"{state} grows by itself, as exp({values[k].real:.3g} t), and"
        for table, words in (
            (
                np.hstack([shifted, B / np.maximum(np.abs(B).max(axis=0), 1e-300)]),
                f"{_do_not(linear.input_names)} move it: no loop of theirs holds it; command"
                " what does (actuator), or add it to the plant",
            ),
            (
                np.vstack([shifted, C / np.maximum(np.abs(C).max(axis=1), 1e-300)[:, None]]),
                f"{_do_not(linear.output_names)} show it: no loop of theirs holds it; follow"
                " an output that does (measured), or add a sensor to the plant",
            ),
        ):
            if np.linalg.svd(table, compute_uv=False)[-1] < HELD:
                raise WorkbenchError(f"{said} {words}")


HELD = 1e-9
"""What rounding may leave of a combination of outputs that no commands move, over the rest."""


def _check_independent(linear: LinearModel) -> None:
    """Refuse outputs that cannot be held at references of their own."""
    outputs, inputs = linear.output_names, linear.input_names
    if len(outputs) > len(inputs):
        raise WorkbenchError(
            f"{listed(outputs)} cannot all be followed by {listed(inputs)}: as many outputs as"
            f" there are commands can be; leave out {len(outputs) - len(inputs)}"
        )
    lost = _rank_lost(linear)
    if lost is not None:
        tied = [
            n for n, part in zip(outputs, np.abs(lost), strict=True) if part > 0.05 * max(abs(lost))
        ]
        raise WorkbenchError(
            f"{listed(tied)} cannot be held independently by {listed(inputs)}: at rest"
            " no commands move them otherwise than together (a transmission zero at 0); follow one"
            " of them, another output, or design where they part"
            if len(tied) > 1
            else f"{tied[0]} cannot be held at a reference by {listed(inputs)}: at rest it is"
            " the same whatever they are (a transmission zero at 0); follow another output"
        )


@dataclass(frozen=True)
class LoopSpecification(Checked):
    """What every design for any linear model is told.

    Args:
        measured: Name of the followed output, or several with commas between or as a list; by
            default those that the commands hold independently.
        actuator: Name of the command, or several; by default the first that moves one output, all
            for several.
        sample_time: Time between steps, in s.
        maximum_sensitivity: Limit on Ms, the peak of the sensitivity (ratio); by default (0) 1.8,
            or the least that a loop of this plant has.
        maximum_complementary: Limit on Mt, the peak of the complementary sensitivity (ratio); by
            default (0) 2.8, or the least that a loop of this plant has.
        delay: Delay beside that of sampling up to which the limits hold, in s.
        sensor_lag: Time constant of the sensor with which the limits hold as well, in s.
        trusted_frequency: Frequency above which nothing of the model is trusted, in rad/s; every
            one is by default (0).
        quiet: What the noise of the measurement may move the command by, rms, as a fraction of half
            its range; by default (0) 0.02, or 0.06 to hold a plant that is unstable.
        overshoot: Overshoot of a step within the command's ends that is allowed, as a fraction of
            the step.
        noise: Noise rms of every measurement, in SI of the output; by default (0) what the sensor
            declares, and 1e-4 of its scale at least where one is declared or no noise is.
    """

    measured: str | tuple[str, ...] = ""
    actuator: str | tuple[str, ...] = ""
    _: KW_ONLY
    sample_time: float = number(0.002, *TIMES_S, "s")
    maximum_sensitivity: float = 0.0
    maximum_complementary: float = 0.0
    delay: float = number(0.0, 0.0, TIMES_S[1], "s")
    sensor_lag: float = number(0.0, 0.0, TIMES_S[1], "s", "lag of the sensor")
    trusted_frequency: float = number(0.0, 0.0, 1.0 / TIMES_S[0], "rad/s")
    quiet: float = number(0.0, 0.0, 1e9, words="share of the command that noise may take")
    overshoot: float = number(0.02, 0.0, 1.0)
    noise: float = number(0.0, 0.0, 1e30)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value, least in (
            ("Ms", self.maximum_sensitivity, 1.05),
            ("Mt", self.maximum_complementary, 1.0),
        ):
            if value:
                check_range(f"limit on {name}", value, least, 10.0)

    def loop_noise(self, loop: Loop) -> Vector:
        """Return the noise rms that is reckoned with, shape (n_sensors,), in SI."""
        outputs = {q.name: q for q in (loop.read or loop.linear).operating_point.model.outputs}
        read = [outputs[name] for name in loop.sensors]
        # What the equations tell of a size is less sure than what a sensor declares.
        sure = np.array([q.sized for q in read]) | (loop.noise == 0.0)
        least = np.maximum(loop.noise, np.where(sure, 1e-4, 0.0) * [q.scale for q in read])
        return np.full_like(least, self.noise) if self.noise else least

    def loop(self, linear: Any) -> Loop:
        """Return the loop to control."""
        return loop_of(linear, self.measured, self.actuator, (), self.sample_time)


def paced(away: Number, moved: Number, pace: float, brake: float, a: Arithmetic) -> Number:
    """Return by how much a reference moves in this sample, which moved by so much in the last one.

    It moves as fast as it may, and no faster than it can stop from at what is asked: n samples that
    each take ``brake`` off a move of n times that go n (n + 1) / 2 times as far.

    Args:
        away: What it is away from what is asked, in SI.
    """
    fast = a.clip(away, -pace, pace)
    if isinstance(brake, float) and brake == math.inf:
        return fast
    size = a.largest(away, -away)
    stops = 0.5 * brake * (a.root(1.0 + 8.0 * size / brake) - 1.0)
    return a.clip(a.clip(fast, -stops, stops), moved - brake, moved + brake)


@dataclass(frozen=True, kw_only=True, repr=False)
class PlainLaw(ClosedForm):
    """A law in closed form from measurements to commands, within their ends and slews.

    Each reference is that of the measurement in its place; further measurements have none.

    Args:
        slew: Fastest changes of the commands, in SI per s.
        curves: What bends each command, or None: it is reckoned with as what does as much by the
            slope at rest, and so are its ends unless a lag stands before the curve; none by
            default.
        fading: What that lag leaves after a sample, a ratio, 0 for none. Through it a change w of
            the command's state moves to a w + (1 - a) v, and what makes the curve do so is sent.
        pace: Largest changes of the references that are followed, in SI of the outputs per sample.
        brake: Largest changes of these changes from one sample to the next, in SI of the outputs.
    """

    sensors: tuple[str, ...]
    controlled: tuple[str, ...]
    actuators: tuple[str, ...]
    sample_time: float = 0.002
    rest: tuple[float, ...]
    rest_output: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    slew: tuple[float, ...] = ()
    curves: tuple[ValveInverse | None, ...] = ()
    fading: tuple[float, ...] = ()
    pace: tuple[float, ...] = ()
    brake: tuple[float, ...] = ()
    preview: int = 0
    name: str = "plain"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the kernel out: another process makes its own."""
        return {name: own for name, own in vars(self).items() if name != "_kernel"}

    @cached_property
    def _kernel(self) -> Kernel:
        return Kernel(self)

    def step(
        self, state: Any, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any, Info]:
        return self._kernel(state, measurement, reference)

    def deviations(self, values: Numbers) -> Numbers:
        """Return measurements or references, in SI, as deviations from rest."""
        # There may be fewer references than measurements.
        return tuple(v - rest for v, rest in zip(values, self.rest_output, strict=False))

    def followed(
        self, before: Numbers | None, reference: Numbers, a: Arithmetic
    ) -> tuple[Numbers, Numbers | None]:
        """Return references at their pace, deviations in SI, and what the next sample needs."""
        asked = self.deviations(reference)
        if before is None:
            return asked, None
        p, none = len(asked), (math.inf,) * len(asked)
        limits = zip(self.pace or none, self.brake or none, strict=True)
        moved = tuple(
            paced(r - b, v, *own, a)
            for r, b, v, own in zip(asked, before[:p], before[p:], limits, strict=True)
        )
        now = tuple(b + v for b, v in zip(before, moved, strict=False))
        return now, (*now, *moved)

    def applied(self, before: Numbers | None, asked: Numbers, a: Arithmetic) -> Numbers:
        """Return commands between their ends, from what is kept of the sample before, in SI."""
        ends = list(zip(self.lower, self.upper, strict=True))
        if before is None:
            return tuple(a.clip(u, *end) for u, end in zip(asked, ends, strict=True))
        h, found = self.sample_time, []
        slews = self.slew or (math.inf,) * len(asked)
        for k, (b, u, end, slew) in enumerate(zip(before, asked, ends, slews, strict=True)):
            if self._lagging(k):
                sent = self._through(k, b, u, a)
                ended = a.clip(sent, *end)
                found.append(a.where(ended == sent, u, self._back(k, b, ended, a)))
            else:
                within = a.clip(u, *end)
                found.append(
                    b + a.clip(within - b, -h * slew, h * slew) if slew < math.inf else within
                )
        return tuple(found)

    def _lagging(self, k: int) -> bool:
        return bool(self.fading) and self.fading[k] > 0.0

    def _through(self, k: int, before: Number, command: Number, a: Arithmetic) -> Number:
        """Return what is sent so that what lags moves as by a command along a straight line."""
        curve, left = cast(ValveInverse, self.curves[k]), self.fading[k]
        after = left * before + (1.0 - left) * command
        now, then = (curve.command(v - curve.centre, a) for v in (before, after))
        return now + (then - now) / (1.0 - left)

    def _back(self, k: int, before: Number, sent: Number, a: Arithmetic) -> Number:
        """Return the command along a straight line by which what lags moves as by what is sent."""
        curve, left = cast(ValveInverse, self.curves[k]), self.fading[k]
        now = curve.command(before - curve.centre, a)
        after = curve.straight(now + (1.0 - left) * (sent - now), a)
        return before + (after - before) / (1.0 - left)

    def sent(self, before: Numbers | None, commands: Numbers, a: Arithmetic) -> Numbers:
        """Return what of commands is sent, in SI, through the inverses of their curves."""
        if not self.curves:
            return commands
        return tuple(
            u
            if curve is None
            else self._through(k, cast(Numbers, before)[k], u, a)
            if self._lagging(k)
            else curve.command(u - curve.centre, a)
            for k, (u, curve) in enumerate(zip(commands, self.curves, strict=True))
        )

    def resting(self, references: Numbers) -> Numbers | None:
        """Return what is remembered of references, in SI, that have been there for long."""
        limits = (*self.pace, *self.brake)
        ended = bool(limits) and min(limits) < math.inf
        return (*references, *(0.0 for _ in references)) if ended else None

    def kept(self, before: Numbers | None, commands: Numbers) -> Numbers | None:
        """Return what of commands, in SI, the next sample needs."""
        if not (self.slew and min(self.slew) < math.inf) and not any(self.fading):
            return None
        if before is None or not any(self.fading):
            return commands
        rows = zip(self.fading, before, commands, strict=True)
        return tuple(left * b + (1.0 - left) * u if left else u for left, b, u in rows)

    def told(self, asked: Numbers) -> Told:
        """Tell the commands before their ends, in SI."""
        return {f"asked.{name}": u for name, u in zip(self.actuators, asked, strict=True)}

    @property
    def rest_command(self) -> Command:
        """Commands at rest, in SI."""
        return self.rest

    def around_rest(self) -> LinearLaw:
        """Return the law between its ends, from measurements and references as deviations."""
        raise NotImplementedError

    def straight(self, told: Told) -> Numbers:
        """Return the commands before their ends, in SI."""
        return tuple(told[f"asked.{name}"] for name in self.actuators)

    def linear_command(self, command: Command) -> Command:
        """Return what does as much by the slopes at rest."""
        pairs = zip(command, self.curves or (None,) * len(command), strict=True)
        return tuple(u if c is None else c.straight(u) for u, c in pairs)
