"""Loops between followed outputs and commands: what the plain controllers know of a plant.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.valve_inverse import ValveInverse
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import LinearModel
from workbench.linearisation.command_curve import command_curves
from workbench.linearisation.transfer import transfer_function
from workbench.model.quantities import Output, of_names

SOON = 1e-3
"""Sample time, times the fastest rate of a plant, of a loop that is not sampled."""

OVER = 0.6
"""What a lag leaves after a sample of which the rest is left out, a ratio."""

HELD = 1e-9
"""What rounding may leave of a combination of outputs that no commands move, over the rest."""


class Loop(NamedTuple):
    """A linear model between commands and followed outputs.

    Args:
        command_scale: Half of what each command may change by at rest, or its scale where that has
            no end.
        slew: Fastest changes of the commands, per s.
        curves: What bends each command, centred at rest, or None.
        fading: What a lag before each curve leaves of it after a sample, a ratio.
        read: The same model to all outputs that are read, the followed ones first; None if no
            others are.
    """

    linear: LinearModel
    lower: Vector
    upper: Vector
    command_scale: Vector
    slew: Vector
    curves: tuple[ValveInverse | None, ...]
    fading: tuple[float, ...]
    read: LinearModel | None = None

    def late(self, delay: float) -> Loop:
        """Return the loop whose commands act late, by a time in s."""
        read = self.read and self.read.late(delay)
        return self._replace(linear=self.linear.late(delay), read=read) if delay else self

    def at_once(self) -> Loop:
        """Return the loop without the plant's own delays, where they are known."""
        read = self.read and self.read.at_once()
        return self._replace(linear=self.linear.at_once(), read=read)

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the outputs that are followed."""
        return self.linear.output_names

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the commands."""
        return self.linear.input_names

    @property
    def shown(self) -> LinearModel:
        """The model to all outputs that are read."""
        return self.read or self.linear

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of all outputs that are read, the followed ones first."""
        return self.shown.output_names

    @property
    def output_scale(self) -> Vector:
        """Typical sizes of the outputs that are followed."""
        return np.array([q.scale for q in outputs_of(self.linear)])

    def response(self, speeds: npt.ArrayLike, read: bool = False) -> Complex:
        """Return the plant at speeds, in rad/s, to what is followed, or read, shape (n, p, m)."""
        m = self.shown if read else self.linear
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
        return {
            "sensors": self.sensors,
            "controlled": self.measured,
            "actuators": self.actuators,
            "rest": tuple(self.linear.u0.tolist()),
            "rest_output": tuple(self.shown.y0.tolist()),
            "lower": tuple(self.lower.tolist()),
            "upper": tuple(self.upper.tolist()),
            "slew": tuple(self.slew.tolist()),
            "curves": self.curves if any(self.curves) else (),
            "fading": self.fading if any(self.curves) else (),
        }


def outputs_of(linear: LinearModel) -> tuple[Output, ...]:
    """Return what a model says of its outputs."""
    return of_names(linear.operating_point.model.outputs, linear.output_names)


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


def followed_by(
    whole: LinearModel, measured: str | Sequence[str] = (), actuators: str | Sequence[str] = ()
) -> tuple[tuple[str, ...], tuple[str, ...], list[str]]:
    """Return the outputs that are followed, the commands that are named, and all there are.

    Raises:
        WorkbenchError: If there is no such output or command.
    """
    inputs = whole.operating_point.model.inputs
    only_measured = {q.name for q in inputs if not q.commanded}
    commands = [name for name in whole.input_names if name not in only_measured]
    given, acting = named(measured), named(actuators)
    for name in given:
        check_choice("measured output", name, whole.output_names)
    for name in acting:
        check_choice("actuator", name, commands)
    followed = given or held_outputs(whole, acting or commands) or whole.output_names[:1]
    return followed, acting, commands


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
    for name in named(also):
        check_choice("measured output", name, whole.output_names)
    followed, acting, commands = followed_by(whole, measured, actuators)
    if not acting:
        every = tuple(commands or whole.input_names)
        alone = [whole.select(inputs=(u,), outputs=followed).without_unseen() for u in every]
        acting = tuple(u for u, own in zip(every, alone, strict=True) if np.any(_moved(own)))
        acting = (acting or every)[: 1 if len(followed) == 1 else None]
    others = tuple(name for name in named(also) if name not in followed)
    read = whole.select(inputs=acting, outputs=(*followed, *others))
    _check_growing(read)
    read = read.without_unseen()
    fastest = float(np.abs(whole.poles).max(initial=0.0)) or 1.0
    read = read.read_after_holding(sample_time or SOON / fastest)
    linear = read.select(outputs=followed)
    moved = np.any(_moved(linear), axis=1)
    still = [name for name, answers in zip(followed, moved, strict=True) if not answers]
    if still:
        raise WorkbenchError(
            f"{_do_not(acting)} move {still[0]} near the operating point; take another, where it"
            " does: --from or --at, or the nominal of an input"
        )
    read = read.without_unreached()
    linear = read.select(outputs=followed)
    _check_independent(linear)
    ones = np.ones(len(acting))
    # By an inverted curve the command is a fraction, which no input of the plant is.
    lower, upper, scale, slew = -ones, ones, ones, math.inf * ones
    if whole.inverse is None:
        lower, upper, scale, slew = (
            np.array([getattr(q, end) for q in of_names(model.inputs, acting)], dtype=float)
            for end in ("lower", "upper", "scale", "slew")
        )
    curves, fading = _curves(whole, acting, sample_time)
    bent = [curve is not None and not left for curve, left in zip(curves, fading, strict=True)]
    for k, curve in enumerate(curves):
        if curve is not None and bent[k]:
            # Behind its inverse a command is what does as much by the slope at rest.
            lower[k], upper[k] = map(curve.straight, (-math.inf, math.inf))
    # What rests near an end has little room to one side, and all the more to the other.
    half = 0.5 * (upper - lower)
    if linear.ends is not None:
        # A clipped loop within is filled by less.
        ends = 0.5 * (linear.ends[1, :, 0] - linear.ends[0, :, 0])
        half = np.where(bent, half, np.minimum(half, ends))
    scale = np.where(half < math.inf, half, scale)
    return Loop(linear, lower, upper, scale, slew, curves, fading, read if others else None)


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


def spare_outputs(whole: LinearModel, loop: Loop) -> tuple[str, ...]:
    """Return the outputs that a loop could read too, of a model of no more states.

    Commands move them, but none at once.
    """
    found = []
    for name in [name for name in whole.output_names if name not in loop.measured]:
        own = whole.select(inputs=loop.actuators, outputs=(*loop.measured, name)).without_unseen()
        moved = np.any(_moved(own.select(outputs=(name,))))
        if moved and not np.any(own.D) and len(own.without_unreached().A) == len(loop.linear.A):
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


def _rank_lost(linear: LinearModel) -> Vector | None:
    """Return the sum of outputs, each in a size of its own, that no inputs move at rest, if any.

    Source: Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 4.5.
    """
    size = linear.state_scales
    # Commands and outputs of any size take nothing from what states, in theirs, do to each other.
    paces = _even(np.abs(linear.A * size).max(axis=1, initial=0.0))
    A, B = linear.A * size / paces[:, None], linear.B / paces[:, None]
    acts = _even(np.abs(B).max(axis=0, initial=0.0))
    shows = _even(np.abs(linear.C * size).max(axis=1, initial=0.0))[:, None]
    table = np.block([[A, B / acts], [linear.C * size / shows, linear.D / acts / shows]])
    for _ in range(3):
        table = table / np.maximum(np.abs(table).max(axis=0), 1e-300)
        table = table / np.maximum(np.abs(table).max(axis=1), 1e-300)[:, None]
    left, values, _ = np.linalg.svd(table)
    if len(values) == len(table) and values[-1] > HELD * values[0]:
        return None
    lost = left[len(A) :, -1]
    return np.asarray(lost) if np.abs(lost).max() > HELD else None


def _even(sizes: Vector) -> Vector:
    """Return sizes to divide by: 1 for none."""
    return np.where(sizes > 0.0, sizes, 1.0)


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
        moves = np.hstack([shifted, B / np.maximum(np.abs(B).max(axis=0), 1e-300)])
        shows = np.vstack([shifted, C / np.maximum(np.abs(C).max(axis=1), 1e-300)[:, None]])
        command = "command what does (actuator), or add it to the plant"
        follow = "follow an output that does (measured), or add a sensor to the plant"
        for table, names, does, fix in (
            (moves, linear.input_names, "move", command),
            (shows, linear.output_names, "show", follow),
        ):
            if np.linalg.svd(table, compute_uv=False)[-1] < HELD:
                raise WorkbenchError(
                    f"{state} grows by itself, as exp({values[k].real:.3g} t), and {_do_not(names)}"
                    f" {does} it: no loop of theirs holds it; {fix}"
                )


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
