"""When an event came in each recording, and where what ages or was changed begins there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError, filter_of
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import LADDER, ProcessNoiseFit, extended_start
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.selection.delays import Delays
from workbench.diagnosis.selection.scalar_search import least_between
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Effect, Model, Parameter, State
from workbench.physics.drift import from_first
from workbench.physics.library import Hypothesis

_MOMENTS, _PHASES, _STEPS = 100, 33, 20
"""Starts of a clock along a recording that are tried, or along two periods of what repeats, and
steps from the best one on."""

_WIDTHS = 5.0
"""Half-widths of an event from its middle to where it has not begun, or is over."""

_NEVER = 3.0
"""Lengths of a recording by which a clock starts early on which an event does not come."""

_PARTS_OF_LENGTH = 1.0, 0.5, 0.25
"""How much shorter an event may be in a recording, to which it does not seem to come."""

_CLEARLY = 10.0
"""Log likelihood by which a recording must be likelier: more than so many tries give by chance."""

_NEAR = np.linspace(-3.0, 3.0, 13)
"""Samples by which the ends of an event are moved one by one."""

_LOOSE = 30.0
"""Process-noise scale of equations that are hardly trusted."""

_DIFFERENT = 0.25
"""Standard deviation of levels over their root mean square from which on they differ: with less it
is what acts everywhere that is missing, and not that it differs."""

_REACH, _KNOWN = 4.0, 1e-3
"""Range of the beginnings that are tried at first, and how well one is known that was found, both
over the usual one."""


def with_own_starts(
    effects: Sequence[Effect],
    fit: ProcessNoiseFit,
    before: Model,
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
) -> tuple[Effect, ...]:
    """Return effects with when, or where, they begin in each recording, where that is clear.

    Args:
        before: The model that the recordings have a start for.

    Returns:
        The effects, with the values of those of their parameters that change with it; the same
        ones where nothing does.
    """
    events = tuple(e for e in effects if is_event(e))
    own = with_own_moments(events, fit, before, fit_on, hold_out) if events else ()
    moved = dict(zip((e.name for e in events), own, strict=True))
    return tuple(
        _begun(e, fit, before, (*fit_on, *hold_out)) if e.about.begins else moved.get(e.name, e)
        for e in effects
    )


def changed_values(
    model: Model, before: Sequence[Effect], after: Sequence[Effect]
) -> dict[str, float]:
    """Return parameters that change with effects, by full name, in SI.

    Where the first recording shows a part of what ages as reached, the parameter that ages begins
    there.

    Args:
        model: The refitted model, with the effects as they were.
    """
    changed = {
        f"{new.name}.{q.name}": q.value
        for old, new in zip(before, after, strict=True)
        for q, was in zip(new.parameters, old.parameters, strict=True)
        if q.value != was.value
    }
    for old, new in zip(before, after, strict=True):
        about = new.about
        if new is not old and about.begins and about.subject and not about.level:
            left = _own(model, old, new.parameters[0].name).value - new.parameters[0].value
            aging = model.parameter(about.subject)
            aged = aging.value + left / _reached(model, old)
            changed[about.subject] = float(np.clip(aged, aging.lower, aging.upper))
    return changed


def _reached(model: Model, effect: Effect) -> float:
    """Return which part of what it tends to an ageing reaches along the recordings."""
    lasting, pace = (_own(model, effect, name).value for name in ("lasting", "rate_constant"))
    # Of a ramp it is next to nothing, of which enough digits are left.
    along = lasting * pace
    return -math.expm1(-math.copysign(max(abs(along), 1e-6), along))


def level_everywhere(effect: Effect) -> float | None:
    """Return the level of all recordings alike, dimensionless; None where they differ."""
    found = [v for q in effect.states for _, v in q.start_in if q.name == effect.about.begins]
    if not effect.about.level or not found:
        return None
    differ = float(np.std(found)) >= _DIFFERENT * math.sqrt(float(np.mean(np.square(found))))
    return None if differ else float(np.mean(found))


def _begun(
    effect: Effect, fit: ProcessNoiseFit, before: Model, recordings: Sequence[Observed]
) -> Effect:
    """Return an effect with where it begins in each recording, in multiples of its amount."""
    model, about = fit.model, effect.about
    place = [q.name for q in model.states].index(f"{effect.name}.{about.begins}")
    found = {}
    for observed in recordings:
        begun = extended_start(observed, before, model)
        sure = begun.start_rms.copy()
        sure[place] = _KNOWN
        filter_ = filter_of(model, begun, fit.noise_scale)

        def cost(
            start: float,
            filter_: PredictionError = filter_,
            begun: Observed = begun,
            sure: Vector = sure,
        ) -> float:
            x = begun.start.copy()
            x[place] = start
            try:
                return filter_.run(replace(begun, start=x, start_rms=sure), model.values).cost
            except NumericalError:
                return math.inf

        middle, step = float(begun.start[place]), _REACH / 8.0
        tried = middle + np.linspace(-_REACH, _REACH, 17)
        costs = [cost(start) for start in tried]
        best = float(tried[int(np.argmin(costs))])
        while best in (tried[0], tried[-1]) and step < 1e3:
            # Far away it goes on in longer steps.
            step *= 2.0
            tried = best + step * np.array([-1.0, 0.0, 1.0, 2.0]) * (1 if best > middle else -1)
            best = float(tried[int(np.argmin([cost(start) for start in tried]))])
        least, value = least_between(cost, best - step, best + step, _STEPS, _KNOWN)
        if not math.isfinite(value):
            return effect
        found[observed.name] = least
    own = {q.name: q for q in effect.parameters}
    size = next(iter(own))
    if about.level:
        # Its amount is the root mean square of the levels.
        factor = math.sqrt(sum(v * v for v in found.values()) / len(found)) or 1.0
        found = {name: v / factor for name, v in found.items()}
    elif not about.subject:
        # What turns is told with a positive amplitude.
        factor = math.copysign(1.0, _own(model, effect, size).value)
        turn = 0.0 if factor > 0.0 else math.pi
        found = {name: math.remainder(v + turn, 2.0 * math.pi) for name, v in found.items()}
    else:
        factor, found = from_first(found, recordings[0].name, _reached(model, effect))
    value = factor * _own(model, effect, size).value
    lower, upper = min(own[size].lower, 2.0 * value), max(own[size].upper, 2.0 * value)
    own[size] = replace(own[size], value=value, lower=lower, upper=upper)
    begins = next(q for q in effect.states if q.name == about.begins)
    usual, own_starts = sum(found.values()) / len(found), tuple(sorted(found.items()))
    begins = replace(begins, initial=usual, start_rms=_KNOWN, start_in=own_starts)
    return replace(_with_states(effect, [begins]), parameters=tuple(own.values()))


def with_own_moments(
    effects: Sequence[Effect],
    fit: ProcessNoiseFit,
    before: Model,
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
) -> tuple[Effect, ...]:
    """Return events with the times at which they came, and ended, in each recording, where clear.

    Their parameters are those in the first fitting recording. In others the clocks start late or
    early: the events come at another time, are over before they begin, or do not come.

    Args:
        effects: Effects of the fitted model; several come as long one after the other as in the
            first recording.

    Returns:
        The effects; the same ones if all times are as they were.
    """
    model = fit.model
    names = [q.name for q in model.states]
    clocks = {e.name: [names.index(f"{e.name}.{q.name}") for q in _clocks(e)] for e in effects}
    usual = {i: model.states[i].initial for own in clocks.values() for i in own}
    late: dict[int, dict[str, float]] = {i: {} for i in usual}
    for observed in (*fit_on, *hold_out):
        begun = extended_start(observed, before, model)
        length = begun.sample_time * len(begun.outputs)
        periods = [_own(model, e, e.about.period).value for e in effects if e.about.period]
        reach = min([length, *periods])
        tried = np.linspace(-reach, reach, 2 * _MOMENTS + 1 if reach == length else _PHASES)
        span = None
        if not periods:
            soon, last, width = _span(model, effects)
            span = soon - width, last + width
            # All that came before a recording, or comes after it, is the same to it.
            beyond = max(width, 2.0 * (tried[1] - tried[0]))
            tried = tried[(soon - tried < length + beyond) & (last - tried > -beyond)]
            # Half of what one takes to come is moved within the same slope of the likelihood.
            tried = tried[:: max(1, math.floor(0.5 * width / _WIDTHS / (tried[1] - tried[0])))]
        filter_ = filter_of(model, begun, fit.noise_scale)
        start = begun.start.copy()
        for part in _PARTS_OF_LENGTH if any(map(_length, effects)) else (1.0,):
            # What is over sooner has a clock of its end that is ahead.
            ahead = usual | {
                clocks[e.name][1]: usual[clocks[e.name][1]] + (1.0 - part) * _lasting(model, e)
                for e in filter(_length, effects)
            }
            of = Delays(filter_, begun, ahead, span)
            found = _likeliest(of, of.cost_from(start[list(usual)]), tried)
            if found is not None:
                start[list(usual)] = [t + found for t in ahead.values()]
            moved = [start[i] - t for i, t in usual.items()]
            if span and span[0] - min(moved) < length and span[1] - max(moved) > 0.0:
                break
        for e in filter(_length, effects):
            own = clocks[e.name]
            start[own] = _with_own_end(fit, e, replace(begun, start=start), own)
        for i, was in usual.items():
            if start[i] != begun.start[i]:
                late[i][observed.name] = float(start[i]) - was
    others = [r.name for r in (*fit_on[1:], *hold_out)]
    first = fit_on[0].name
    return tuple(
        _moved(e, model, [late[i] for i in clocks[e.name]], first, others) for e in effects
    )


def _with_own_end(
    fit: ProcessNoiseFit, effect: Effect, begun: Observed, clocks: Sequence[int]
) -> Vector:
    """Return how the clocks of what ends start in a recording, shape (2,), in s.

    Args:
        begun: The recording with starts for the fitted model.
        clocks: Numbers of their states.
    """
    model, now = fit.model, begun.start[list(clocks)]
    usual = np.array([q.initial for q in _clocks(effect)])
    ends, width = np.array(_times(model, effect)), _span(model, [effect])[2]
    reach = begun.sample_time * len(begun.outputs)
    # Where the equations are hardly trusted, each end shows by itself.
    shown = np.linspace(0.0, reach, _MOMENTS + 1)
    loose = _Ends(filter_of(model, begun, _LOOSE), begun, tuple(clocks), ends, width)
    begin, end = ends - loose.likeliest(now, lambda _: shown)
    names = [f"{effect.name}.{name}" for name in (effect.about.moment, _length(effect))]
    free = [Prior(name, 0.0, 10.0 * reach, -2.0 * reach, 2.0 * reach) for name in names]
    start = begun.start.copy()
    start[list(clocks)] = usual
    filter_ = filter_of(model, begun, fit.noise_scale)
    try:
        own = refit(
            model,
            [replace(begun, start=start)],
            priors=free,
            stages=(_LOOSE, *(s for s in LADDER if fit.noise_scale <= s < _LOOSE)),
            start=dict(zip(names, (begin, end - begin), strict=True)),
        )
        begin, lasting = (own.estimate(name).value for name in names)
        if lasting > 0.0 and own.cost < filter_.run(begun, model.values).cost - _CLEARLY:
            now = ends - (begin, begin + lasting)
    except WorkbenchError:
        pass  # It began too early, or ended too late, to be told.
    # Where little moves a refit sees no slope, nor where a sharp end jumps from one step of the
    # filter to the next.
    sharp = replace(loose, filter_=filter_)
    now = sharp.likeliest(now, lambda _: shown[:: _MOMENTS // _PHASES])
    return sharp.likeliest(now, lambda time: time + begun.sample_time * _NEAR)


@dataclass(frozen=True)
class _Ends:
    """What begins and ends in a recording.

    Args:
        clocks: Numbers of the states that are its two clocks.
        ends: When it begins and ends on clocks that start at zero, shape (2,), in s.
        width: How long it takes to come, in s.
    """

    filter_: PredictionError
    begun: Observed
    clocks: tuple[int, ...]
    ends: Vector
    width: float

    def likeliest(self, now: Vector, tried: Callable[[float], Vector]) -> Vector:
        """Return how the clocks start, the end moved first where the recording is likelier.

        Args:
            now: How they start before, shape (2,), in s.
            tried: Gives times in the recording at equal distances, shape (n,), in s, for the one at
                which it begins or ends so far.
        """
        start = self.begun.start.copy()
        start[list(self.clocks)] = now
        for k in (1, 0):
            clock = self.clocks[k]
            time, other = (self.ends - start[list(self.clocks)])[[k, 1 - k]]
            instants = tried(time)
            instants = instants[instants > other] if k else instants[instants < other]
            span = float(time - self.width), float(time + self.width)
            begun = replace(self.begun, start=start)
            of = Delays(self.filter_, begun, {clock: float(start[clock])}, span)
            if len(instants):
                late = _likeliest(of, of.cost_from(start[[clock]]), (time - instants)[::-1])
                start[clock] += late or 0.0
        return start[list(self.clocks)]


def _span(model: Model, effects: Sequence[Effect]) -> tuple[float, float, float]:
    """Return when the first and the last of several events come, and how long one takes, in s."""
    times, widths = [], []
    for effect in effects:
        clock = _clocks(effect)[0].initial
        times += [t - clock for t in _times(model, effect) if t < math.inf]
        fixed = (q.name for q in effect.parameters if q.unit == "s" and not q.fitted)
        widths += [_own(model, effect, name).value for name in fixed]
    return min(times), max(times), _WIDTHS * max(widths, default=0.0)


def is_event(effect: Effect) -> bool:
    """Whether an effect comes at a time, on a clock of its own, or ends again on another one."""
    return bool(effect.about.moment) and len(_clocks(effect)) == 1 + bool(_length(effect))


def times_of(effect: Effect) -> tuple[str, ...]:
    """Return the names of the parameters that tell when an event comes and how long it lasts."""
    return tuple(filter(None, (effect.about.moment, _length(effect))))


def at_times_of(effect: Effect, other: Effect) -> Effect:
    """Return an event whose clocks start in each recording as those of another one."""
    pairs = zip(_clocks(effect), _clocks(other), strict=True)
    return _with_states(
        effect, [replace(q, initial=its.initial, start_in=its.start_in) for q, its in pairs]
    )


def may_be_absent(effect: Effect) -> bool:
    """Whether an effect is an event that may come to some recordings and not to others."""
    return is_event(effect) and not effect.about.period


def absent_from(entry: Hypothesis, recordings: Sequence[Observed]) -> Hypothesis:
    """Return a hypothesis whose event, if it is one, does not come to some recordings.

    Their clocks start too early.
    """
    if not recordings or not may_be_absent(entry.effect):
        return entry
    never = {r.name: -_NEVER * r.sample_time * len(r.outputs) for r in recordings}
    clocks = [
        replace(q, start_in=tuple(sorted((dict(q.start_in) | never).items())))
        for q in _clocks(entry.effect)
    ]
    return replace(entry, effect=_with_states(entry.effect, clocks))


def _length(effect: Effect) -> str:
    """Return the name of the parameter that is how long an event lasts; empty if it is for good."""
    known = effect.about.moment, effect.about.period
    own = (q.name for q in effect.parameters if q.unit == "s" and q.fitted)
    return next((name for name in own if name not in known), "")


def _lasting(model: Model, effect: Effect) -> float:
    length = _length(effect)
    return _own(model, effect, length).value if length else math.inf


def _times(model: Model, effect: Effect) -> tuple[float, float]:
    """Return when an event begins and ends on its clocks, in s; it never ends at infinity."""
    begin = _own(model, effect, effect.about.moment).value
    return begin, begin + _lasting(model, effect)


def _own(model: Model, effect: Effect, name: str) -> Parameter:
    return model.parameter(f"{effect.name}.{name}")


def _clocks(effect: Effect) -> list[State]:
    return [q for q in effect.states if q.unit == "s"]


def _with_states(effect: Effect, changed: Iterable[State]) -> Effect:
    """Return an effect some of whose states are others of the same names."""
    states = {q.name: q for q in (*effect.states, *changed)}
    return replace(effect, states=tuple(states.values()))


def _moved(
    effect: Effect,
    model: Model,
    late: Sequence[Mapping[str, float]],
    first: str,
    others: Sequence[str],
) -> Effect:
    """Return an event whose clocks start late or early in some recordings, by a time in s."""
    if not any(late):
        return effect
    # Relative to the first recording, whose times the parameters tell.
    early = [found.get(first, 0.0) for found in late]
    begin, end = _times(model, effect)
    values = {effect.about.moment: begin - early[0]}
    if length := _length(effect):
        values[length] = end - early[1] - values[effect.about.moment]
    clocks = []
    for clock, known, before in zip(_clocks(effect), late, early, strict=True):
        starts = dict.fromkeys(others, clock.initial) if before else {}
        starts |= dict(clock.start_in)
        starts |= {name: clock.initial + t for name, t in known.items() if name != first}
        starts = {name: start - before for name, start in starts.items()}
        clocks.append(replace(clock, start_in=tuple(sorted(starts.items()))))
    bounds = {name: _own(model, effect, name) for name in values}
    values = {k: float(np.clip(v, bounds[k].lower, bounds[k].upper)) for k, v in values.items()}
    return _with_states(effect, clocks).with_parameters(values)


def levels(model: Model, effect: Effect) -> dict[str, float]:
    """Return what an effect adds at the start of each recording, in its SI unit; empty if one."""
    if not effect.about.begins or not (effect.about.level or effect.about.subject):
        return {}
    size = model.parameter(f"{effect.name}.{effect.parameters[0].name}").value
    subject = model.parameter(effect.about.subject).value if effect.about.subject else 0.0
    own = next(q for q in effect.states if q.name == effect.about.begins)
    return {name: subject + size * start for name, start in own.start_in}


def acts_in(model: Model, effect: Effect, seen: Observed) -> bool:
    """Tell whether an event that comes once comes to a recording."""
    begin, end = moments(model, effect, seen.name)
    return begin <= seen.sample_time * (len(seen.outputs) - 2) and end >= 2.0 * seen.sample_time


def moments(model: Model, effect: Effect, recording: str) -> tuple[float, float]:
    """Return when an event begins and ends in a recording, in s; it never ends at infinity."""
    starts = [dict(q.start_in).get(recording, q.initial) for q in _clocks(effect)]
    begin, end = _times(model, effect)
    return begin - starts[0], end - starts[-1]


def _likeliest(of: Delays, now: float, tried: Vector) -> float | None:
    """Return how late clocks start in a recording, in s; None if not clearly otherwise than now.

    Args:
        now: Minus the log likelihood of the recording as it is, dimensionless.
        tried: Delays to begin with, shape (n,), in s, at equal distances.
    """
    costs = np.array([of.cost(delay) for delay in tried])
    best = int(np.argmin(costs))
    late, least = float(tried[best]), float(costs[best])
    if 0 < best < len(tried) - 1:
        near, cost = least_between(of.cost, tried[best - 1], tried[best + 1], _STEPS)
        if cost < least:
            late, least = near, cost
    return late if least < now - _CLEARLY else None
