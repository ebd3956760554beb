"""How far a first trial steps an output: as far as its linear model is of use."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from weakref import WeakKeyDictionary

import numpy as np

from workbench.errors import WorkbenchError
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.linearise import linearise
from workbench.linearisation.time_scales import reach_of, step_time
from workbench.linearisation.transfer import transfer_function
from workbench.model import Input, Model
from workbench.model.units import from_si, of_difference, to_si
from workbench.operating_point import input_named, operating_point, usual_inputs

_KNOWN: WeakKeyDictionary[LinearModel, dict[tuple[object, ...], float]] = WeakKeyDictionary()


def step_of(
    model: Model, linear: LinearModel, name: str, followed: Sequence[str], command: str = ""
) -> float:
    """Return by how much a first trial steps an output, in SI.

    Every design of a linear model asks for the same, so it is kept as long as that is.

    Args:
        linear: The model that controllers are designed on.
        followed: Controlled outputs, which are at rest before.
        command: What a single loop commands; all else rests.
    """
    kept = _KNOWN.setdefault(linear, {})
    asked = (model.exact, model.values.tobytes(), name, *followed, command)
    if asked not in kept:
        about = next(q for q in model.outputs if q.name == name)
        # A size that nobody declared is all that the inputs bring about, from end to end.
        size = reach_of(linear, name)
        size = size if about.sized else _round(0.25 * size, about.display_unit)
        y0 = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
        kept[asked] = _reached(model, linear, name, size, {n: y0[n] for n in followed}, command)
    return kept[asked]


def _round(size: float, unit: str) -> float:
    """Return a difference, in SI, down to one that reads well in its unit."""
    shown = float(from_si(size, of_difference(unit)))
    decade = 10.0 ** math.floor(math.log10(shown))
    part = max(n for n in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0) if n <= shown / decade)
    return float(to_si(part * decade, of_difference(unit)))


def _reached(
    model: Model,
    linear: LinearModel,
    name: str,
    size: float,
    start: Mapping[str, float],
    command: str = "",
) -> float:
    """Return a step, halved until the plant rests behind it and its linear model is still of use.

    Args:
        linear: The model that controllers are designed on.
        start: Controlled outputs before it, in SI.
        command: What a single loop commands; all else rests.
    """
    rests: list[float] = []
    own = linear.operating_point.model
    # Where there is nothing above, or next to nothing, as of a pump that stands, it goes down.
    shares = [0.5**k for k in range(21)]
    both = [sign * np.array(shares[k : k + 3]) for k in range(0, 21, 3) for sign in (1.0, -1.0)]
    for part in map(float, size * np.concatenate(both)):
        if rests and (part * rests[0] < 0.0 or abs(part) < LEAST * size):
            continue
        at = tuple((n, y + part if n == name else y) for n, y in start.items())
        with suppress(WorkbenchError):
            given = dict(as_the_loop_rests(model, at, command) if command else at)
            point = operating_point(model, given)
            if abs(part) < LEAST * size and point.residual > EXACTLY:
                # Nothing rests there, as a hopper that is emptied: it is only so little.
                continue
            if linear.operating_point.is_equilibrium and not point.is_equilibrium:
                continue  # It goes by there, as a rotor beyond its fastest speed does.
            rests.append(part)
            # What the linear model leaves out, as dry friction, is no reason to step less far.
            point = point if own is model else operating_point(own, given)
            after = linearise(point, verdict=False)
            if after.inverse is not linear.inverse or _alike(linear, after, tuple(start), command):
                return part
    return min(rests, key=abs, default=size)


LEAST = 0.03
"""Least part of a usual step that is taken for the linear model to be of use behind it."""

EXACTLY = 1e-11
"""Residual of rest, over the states' scales, that rounding leaves where there is one."""

ALIKE, NEARLY_ALIKE = 0.5, 0.15
"""Most by which the responses at both ends of a step may differ, over the lesser of them; and that
of a plant that is unstable, of which a loop bears less."""


def _alike(one: LinearModel, other: LinearModel, outputs: Sequence[str], command: str) -> bool:
    """Tell whether commands move each output alike by two linear models.

    They do by C (i w - A)^-1 B where that of one differs from the other by no more than a part; w
    is how fast the plant grows, or 1 / `step_time`.
    """
    model = one.operating_point.model
    inputs = {q.name: q for q in model.inputs}
    acting = [command] if command else [n for n in one.input_names if inputs[n].commanded]
    slow = 1.0 / step_time(one)
    growing = float(np.max(one.poles.real, initial=0.0))
    found = []
    for linear in (one, other):
        own = linear.select(inputs=acting, outputs=outputs)
        columns = np.array([inputs[n].scale for n in own.input_names])
        response = transfer_function(own.A, own.B, own.C, own.D, 1j * max(growing, slow))
        found.append(response * columns)
    one_by, other_by, apart = np.linalg.norm([*found, found[1] - found[0]], axis=2)
    most = NEARLY_ALIKE if growing > slow else ALIKE
    return bool(np.all(apart <= most * np.minimum(one_by, other_by)))


def as_the_loop_rests(
    model: Model, at: tuple[tuple[str, float], ...], command: str
) -> tuple[tuple[str, float], ...]:
    """Return values at rest, in SI, with what a single loop does not command where it rests."""
    others = [(input_named(model, n), u) for n, u in usual_inputs(model).items() if n != command]
    idle = [(name, u) for name, u in others if name not in dict(at)]
    room = len(model.inputs) - len(at) if at else 0
    return (*at, *idle[: max(room, 0)])


def command_of_loop(linear: LinearModel, measured: str) -> str:
    """Return what a single loop commands: for the first output the first, else the strongest.

    The strongest is that whose range moves the output most in the time that a step takes: by its
    gain abs(C (i w - A)^-1 B + D) at w = 1 / `step_time`, times what the command may change.
    """
    model = linear.operating_point.model
    if len(model.commands) < 2 or measured == model.outputs[0].name:
        return next((q.name for q in model.commands), "")
    response = transfer_function(linear.A, linear.B, linear.C, linear.D, 1j / step_time(linear))
    gain = np.abs(response[linear.output_names.index(measured)])

    def moved(command: Input) -> float:
        span = command.upper - command.lower
        size = span if math.isfinite(span) else command.scale
        return float(size * gain[linear.input_names.index(command.name)])

    return max(model.commands, key=moved).name
