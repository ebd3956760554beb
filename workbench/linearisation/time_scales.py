"""How fast a linear model is: how long its response takes to show, and how finely to sample it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.zero_order_hold import zero_order_hold
from workbench.model import EXACT, Input, Output
from workbench.model.linear_system import LinearEquations
from workbench.model.quantities import of_names
from workbench.model.sizes import horizon
from workbench.operating_point import derivatives_of


def horizon_of(linear: LinearModel, steps: Mapping[str, float] | None = None) -> float:
    """Return how long the response of a linear model takes to show, in s; see `horizon`.

    Of integrators alone, which have no pace of their own, it is how long all of the commands take
    to move an output as far as it shows, or as it shall, the longest. An oscillation in which they
    move none by `SHARE` of that is none of the plant's own pace, as that of a valve behind which a
    furnace gets warm: it is as long as they take for the first output that they do, up to the
    slowest lag.

    Args:
        steps: How far outputs shall move, by name, in SI.
    """
    poles = np.array([m.pole for m in linear.modes])
    outputs = of_names(linear.operating_point.model.outputs, linear.output_names)
    if len(linear.A) and np.all(linear.poles == 0.0):
        asked = {q.name: max(_shows(q), abs((steps or {}).get(q.name, 0.0))) for q in outputs}
        times = [_time_for(_mover(linear, name), far) for name, far in asked.items()]
        if moved := [time for time in times if time < math.inf]:
            return max(moved)
    lags = poles[np.isreal(poles)]
    usual, slowest = (horizon(part, slowest=ROUNDED) for part in (poles, lags))
    if not usual < slowest:
        return usual
    movers = [(_mover(linear, q.name), SHARE * _shows(q)) for q in outputs]
    time = usual
    while time < slowest and all(moved(time) < far for moved, far in movers):
        time *= 1.25
    return min(time, slowest)


ROUNDED = 1e-9
"""What rounding may leave of an integrator, over the fastest mode: hours behind a sensor of
milliseconds are more."""

SHARE = 0.25
"""Part of its size by which an output moves in the time of a plant's own oscillation."""


SHOWS = 200.0
"""Reach over the noise of its sensor of an output of which nobody declares a size: a step is a
quarter of it, and what a loop makes of that noise still fits within 2 % of it."""


def noise_of(output: Output) -> float:
    """Return the noise rms of a measurement with that of its conversion, in SI."""
    return math.hypot(output.noise_rms, output.resolution / math.sqrt(12.0))


def _shows(output: Output) -> float:
    return output.scale if output.sized else max(output.scale, SHOWS * noise_of(output))


def _time_for(moved: Callable[[float], float], far: float) -> float:
    """Return the time, in s, in which integrators move by so much, in SI; infinite if never."""
    first, second = moved(1.0), moved(2.0)
    # n of them go with the time to the power of n.
    return (far / first) ** (1.0 / math.log2(second / first)) if first > 0.0 else math.inf


def step_time(linear: LinearModel, steps: Mapping[str, float] | None = None) -> float:
    """Return a round time, in s, in which a step shows: two horizons, as `horizon_of` has them."""
    return rounded_up(2.0 * horizon_of(linear, steps))


GROWN = 0.05
"""Most by which a mode may grow in a sample of a loop that shall hold it, as the exponent of e."""


LEFT = 0.5
"""Part of the room of a command that a step may take at rest without being slowed by its end."""

AT_REST = 1000.0
"""Samples of the usual time after which a step is over."""

SHOWN, FINEST = 0.05, 1e-3
"""Largest sample time over that in which all of a command moves an output half as far as it shall
move; and the smallest over the usual that is taken for it."""


def usual_sample_time(
    linear: LinearModel, controlled: Sequence[str] = (), steps: Mapping[str, float] | None = None
) -> float:
    """Return a sample time, in s, that shows the response: a thousandth of `step_time`.

    It is that of what controlled outputs show. It is less where a mode of a plant that is unstable
    would grow too far in it, and where a controlled output can be moved long before the slowest
    mode shows, as the air of a house with heavy walls can. A system that was given by its samples
    keeps their time.

    Args:
        steps: How far controlled outputs shall move, by name, in SI; as far as their scale by
            default, which of a temperature may be all of it.
    """
    equations = linear.operating_point.model.equations
    if isinstance(equations, LinearEquations) and equations.sample_time:
        return equations.sample_time
    growing = float(np.max(linear.poles.real, initial=0.0))
    own = linear.select(outputs=controlled).without_unseen() if controlled else linear
    far = steps or {}
    shown = step_time(own, far) / 1000.0
    quick = min([shown, *(_moved_within(linear, n, shown, far.get(n)) for n in controlled)])
    # What grows by less within the whole step integrates.
    if growing * shown <= GROWN:
        return quick
    return min(quick, rounded_up(0.4 * GROWN / growing))


def reach_of(linear: LinearModel, name: str) -> float:
    """Return how far an output goes, in SI.

    It is its size. Where nobody declares one and it integrates, it is how far all of the commands
    move it in a tenth of `step_time`, in the middle between that and the same of its fastest mode,
    before anything grows or an angle on the way turns so far that the equations bend; and what
    shows over its noise at least. The time counts from when the output answers: a delay passes
    before, and what goes the wrong way first; a loop takes some of those. A linear system, alike at
    any size, goes by a unit where its commands do that before its slowest mode shows.
    """
    model = linear.operating_point.model
    output = next(q for q in model.outputs if q.name == name)
    far = _shows(output)
    own = linear.select(outputs=[name]).without_unseen().poles
    rates = np.abs(own[own != 0.0])
    if output.sized or len(rates) == len(own) or not len(rates):
        return far
    moved, whole = _moves(linear, name), max(step_time(linear), 6.0 / rates.min())
    if isinstance(model.equations, LinearEquations):
        ends = not all(map(_endless, model.commands))
        return min(1.0, float(np.abs(moved(whole)).sum())) if ends else 1.0
    begun = _answered(moved, whole)
    # The time of a step is that of the slowest oscillation, if there is one.
    swinging = np.abs(own[np.iscomplex(own)])
    slowest = (swinging if len(swinging) else rates).min()
    within = 0.1 * step_time(linear) * math.sqrt(slowest / rates.max())
    within = max(within, LATE * max(begun))
    within = min(within, 2.0 / max(float(own.real.max()), 1e-300))
    for turned in _turned(linear, name):
        # A move turns it there, back, to the other side and back.
        while turned(0.25 * within) > 1.0:
            within *= 0.9
    reached = sum(abs(moved(within + t)[k]) for k, t in enumerate(begun))
    return max(SHOWS * noise_of(output), float(reached)) or far


LATE = 5.0
"""Time in which a loop settles over that by which its plant is late."""

_TRIED = 60
"""Times, at equal ratios over three decades, at which a response is looked at."""


def _answered(moved: Callable[[float], Vector], whole: float) -> Vector:
    """Return when an output last stood where it was, or beyond, after each command, in s."""
    times = whole * np.geomspace(1e-3, 1.0, _TRIED)
    signs = np.sign([moved(t) for t in times])
    wrong = np.where(signs != signs[-1], times[:, None], 0.0)
    return np.asarray(wrong.max(axis=0))


def _turned(linear: LinearModel, name: str) -> list[Callable[[float], float]]:
    """Return what tells how far all commands turn angles, in rad, within a time in s.

    Those count that an output does not show and with which the plant's slopes change.
    """
    point, seen = linear.operating_point, linear.select(outputs=[name]).without_unseen()
    at, names = derivatives_of(point.model, EXACT), [q.name for q in point.model.states]
    angles = {q.name for q in point.model.states if q.unit == "rad"}
    slopes, found = at(point.x, point.u, point.model.values)[1], []
    for k, state in enumerate(seen.state_names):
        if state in angles and not seen.C[0, k]:
            i = names.index(state)
            moved = at(point.x + np.eye(len(names))[i], point.u, point.model.values)[1]
            if not np.allclose(moved, slopes, rtol=0.1, atol=1e-3 * np.abs(slopes).max()):
                shown = replace(seen, C=np.eye(len(seen.A))[[k]], D=np.zeros_like(seen.D))
                found.append(_mover(shown, name))
    return found


def _moved_within(linear: LinearModel, name: str, usual: float, step: float | None) -> float:
    """Return the sample time, in s, that the fastest move of an output asks for, or the usual.

    It shall move as far as its size or the step, or, by commands of which nobody says how far they
    go, as far as these move it at rest.
    """
    inputs = linear.operating_point.model.inputs
    silent = {q.name for q in inputs if not q.sized and _endless(q)}
    output = next(q for q in linear.operating_point.model.outputs if q.name == name)
    asked, found = abs(step) if step else math.inf, usual
    # A step says more than a size that nobody declared.
    goal = asked if step and not output.sized else min(output.scale, asked)
    for told in (True, False):
        own = linear.select(inputs=[n for n in linear.input_names if (n not in silent) == told])
        moved, far = _right_way(own, name), goal
        if not told:
            far = moved(AT_REST * usual) if np.all(linear.poles.real < 0.0) else math.inf
        time = usual
        while time > FINEST * usual and moved(time / SHOWN) >= 0.5 * far > 0.0:
            time *= 0.8
        found = min(found, usual if time == usual else rounded_up(time))
    return found


def _right_way(linear: LinearModel, name: str) -> Callable[[float], float]:
    """Return what tells how far all commands move an output, in SI, to where it comes to rest.

    What goes the wrong way first moves it by nothing: no loop makes use of that.
    """
    moved = _moves(linear, name)
    stable = np.all(linear.poles.real < 0.0)
    way = np.sign(moved(REST / -float(linear.poles.real.max()))) if stable else 0.0
    return lambda time: float(np.sum(np.abs(part := moved(time)), where=part * way >= 0.0))


REST = 20.0
"""Time after which a plant that is stable rests, over that of its slowest mode."""


def _endless(command: Input) -> bool:
    return not math.isfinite(command.upper - command.lower)


_LOOKS = 100
"""Times, evenly spaced, at which it is looked how far an output is."""


def farthest(linear: LinearModel, name: str, time: float, *, up: bool = True) -> float:
    """Return how far all commands move an output up, or down, within a time in s, in SI.

    What swings may be farther before the time is over than at its end. A command without an end
    moves it as far as one likes.
    """
    moved = _moves(linear, name, at_once=True)
    rests = _commands_at_rest(linear).values()
    above, below = (
        np.array([1.0 if q is None else abs(getattr(q, end) - u) / _room(q, u) for q, u in rests])
        for end in ("upper", "lower")
    )

    def reach(time: float) -> float:
        way = moved(time) if up else -moved(time)
        share = np.where(way > 0.0, above, below)
        return float(np.sum(np.abs(way) * np.where(way == 0.0, 0.0, share)))

    return max(reach(t) for t in np.linspace(0.0, time, _LOOKS + 1)[1:])


def _mover(linear: LinearModel, name: str, *, at_once: bool = False) -> Callable[[float], float]:
    """Return what tells how far all commands move an output, in SI, within a time in s."""
    moved = _moves(linear, name, at_once=at_once)
    return lambda time: float(np.abs(moved(time)).sum())


def _moves(linear: LinearModel, name: str, *, at_once: bool = False) -> Callable[[float], Vector]:
    """Return what tells how far each command moves an output, in SI, within a time in s.

    Args:
        at_once: Whether what it does at once counts, which takes no time.
    """
    rests = _commands_at_rest(linear)
    own = linear.select(inputs=[*rests], outputs=[name]).without_unseen().without_unreached()
    rooms = np.array([1.0 if q is None else _room(q, u) for q, u in rests.values()])
    size = own.state_scales
    a, b = own.A * size / size[:, None], own.B * rooms / size[:, None]
    begins = at_once * own.D[0] * rooms
    return lambda time: begins + (own.C[0] * size) @ zero_order_hold(a, b, time)[1]


def _commands_at_rest(linear: LinearModel) -> dict[str, tuple[Input | None, float]]:
    """Return the inputs that somebody commands, with where they rest, in SI, by name.

    By an inverted curve the command is a fraction, which no input of the plant is.
    """
    inputs = {q.name: q for q in linear.operating_point.model.inputs}
    rests = zip(linear.input_names, linear.u0.tolist(), strict=True)
    return {n: (inputs.get(n), u) for n, u in rests if n not in inputs or inputs[n].commanded}


def has_room(linear: LinearModel, actuators: Sequence[str], steps: Mapping[str, float]) -> bool:
    """Say whether rest after steps, in SI, takes so little of commands that their ends slow none.

    Args:
        actuators: Commands that a law moves; all else rests.
        steps: Change of each output by name, in SI.
    """
    used, moved = _moved_at_rest(linear, actuators, steps)
    below, above = _rooms(linear, used)
    rooms = np.where(moved > 0.0, above, below)
    return bool(np.all(np.abs(moved) <= LEFT * rooms))


def least_time(linear: LinearModel, actuators: Sequence[str], steps: Mapping[str, float]) -> float:
    """Return the time, in s, in which commands at their ends move outputs by steps and back.

    It is that of the slowest; infinite where they do not within ten times `step_time`.

    Args:
        actuators: Commands that a law moves; all else rests.
        steps: Change of each output by name, in SI.
    """
    longest = 0.0
    for name, step in steps.items():
        used, moved = _moved_at_rest(linear, actuators, {name: step})
        below, above = _rooms(linear, used)
        own = linear.select(inputs=used, outputs=[name]).without_unseen()
        size, shown = own.state_scales, step_time(own)
        a, b, c = own.A * size / size[:, None], own.B / size[:, None], own.C * size
        for asked, down, up in ((step, below, above), (-step, below + moved, above - moved)):
            time, most = 1e-4 * shown, 10.0 * step_time(linear, steps)
            while time < most:
                by = (c @ zero_order_hold(a, b, time)[1])[0] + own.D[0]
                by = math.copysign(1.0, asked) * by
                # What may move without end need not be asked whether it moves enough.
                far = np.where(by > 0.0, up, down)
                if np.sum(np.abs(by[by != 0.0]) * far[by != 0.0]) >= abs(asked):
                    break
                time *= 1.25
            longest = max(longest, time if time < most else math.inf)
    return longest


def _moved_at_rest(
    linear: LinearModel, actuators: Sequence[str], steps: Mapping[str, float]
) -> tuple[list[str], Vector]:
    """Return commands, and what they move by for rest after steps, in SI."""
    inputs = {q.name for q in linear.operating_point.model.inputs}
    column = {name: i for i, name in enumerate(linear.input_names)}
    used = [name for name in actuators if name in inputs and name in column]
    rows = [linear.output_names.index(name) for name in steps]
    own = [column[name] for name in used]
    left = np.block([[linear.A, linear.B[:, own]], [linear.C[rows], linear.D[np.ix_(rows, own)]]])
    right = np.append(np.zeros(len(linear.A)), list(steps.values()))
    # States, commands and outputs have units of their own.
    left = left * np.append(linear.state_scales, np.ones(len(own)))
    size = np.maximum(np.abs(left).max(axis=1), 1e-300)
    columns = np.maximum(np.abs(left / size[:, None]).max(axis=0), 1e-300)
    found = np.linalg.lstsq(left / size[:, None] / columns, right / size, rcond=None)[0]
    return used, (found / columns)[len(linear.A) :]


def _rooms(linear: LinearModel, commands: Sequence[str]) -> tuple[Vector, Vector]:
    """Return what commands may change by below and above rest, in SI."""
    inputs = of_names(linear.operating_point.model.inputs, commands)
    rest = np.array([linear.u0[linear.input_names.index(name)] for name in commands])
    ends = np.array([(q.lower, q.upper) for q in inputs]).reshape(-1, 2)
    return rest - ends[:, 0], ends[:, 1] - rest


def _room(command: Input, rest: float) -> float:
    """Return the most that a command may change by, in SI."""
    room = max(command.upper - rest, rest - command.lower)
    return room if room < math.inf else command.scale


def rounded_up(long: float) -> float:
    """Return a time, in s, up to 1, 2 or 5 times 10^n."""
    decade = 10.0 ** math.floor(math.log10(long))
    return float(f"{next(n for n in (1, 2, 5, 10) if n * decade >= long) * decade:.1g}")
