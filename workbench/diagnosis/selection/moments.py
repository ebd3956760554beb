"""When an event came in each recording: it does not repeat."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError, disturbances
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, extended_start
from workbench.errors import NumericalError
from workbench.model import Effect, Model, Parameter, State

Vector = npt.NDArray[np.float64]

_MOMENTS, _PHASES, _STEPS = 100, 33, 20
"""Starts of a clock along a recording that are tried, or along two periods of what repeats, and
steps from the best one on."""

_CLEARLY = 10.0
"""Log likelihood by which a recording must be likelier: more than so many tries give by chance."""


def with_own_moments(
    effects: Sequence[Effect],
    fit: ProcessNoiseFit,
    before: Model,
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
) -> tuple[Effect, ...]:
    """Return events with the time at which they came in each recording, where that is clear.

    Their parameter is the time in the first fitting recording. In others the clocks start late or
    early: the events come at another time, are over before they begin, or do not come.

    Args:
        effects: Effects of the fitted model; several come as long one after the other as in the
            first recording.
        fit: The refitted model.
        before: The model that the recordings have a start for.

    Returns:
        The effects; the same ones if one is no event, or all times are as they were.
    """
    model = fit.model
    if not all(map(is_event, effects)):
        return tuple(effects)
    names = [q.name for q in model.states]
    clocks = {names.index(f"{e.name}.{_clock(e).name}"): _clock(e).initial for e in effects}
    rms = disturbances(model, fit.noise_scale)
    late = {}
    for observed in (*fit_on, *hold_out):
        begun = extended_start(observed, before, model)
        length = begun.sample_time * len(begun.outputs)
        periods = [_own(model, e, e.about.period).value for e in effects if e.about.period]
        reach = min([length, *periods])
        tried = np.linspace(-reach, reach, 2 * _MOMENTS + 1 if reach == length else _PHASES)
        shift = _likeliest(PredictionError(model, begun, (), rms), begun, clocks, tried)
        if shift is not None:
            late[observed.name] = shift
    others = [r.name for r in (*fit_on[1:], *hold_out)]
    return tuple(_moved(e, model, dict(late), fit_on[0].name, others) for e in effects)


def is_event(effect: Effect) -> bool:
    """Whether an effect comes at a time, on a clock of its own."""
    return bool(effect.about.moment) and sum(q.unit == "s" for q in effect.states) == 1


def _own(model: Model, effect: Effect, name: str) -> Parameter:
    return model.parameter(f"{effect.name}.{name}")


def _clock(effect: Effect) -> State:
    return next(q for q in effect.states if q.unit == "s")


def _moved(
    effect: Effect, model: Model, late: dict[str, float], first: str, others: Sequence[str]
) -> Effect:
    """Return an event whose clock starts late or early in some recordings, by a time in s."""
    if not late:
        return effect
    clock = _clock(effect)
    # Relative to the first recording, whose time is the parameter.
    early = late.pop(first, 0.0)
    moment = _own(model, effect, effect.about.moment)
    time = float(np.clip(moment.value - early, moment.lower, moment.upper))
    found = dict(clock.start_in) | {name: clock.initial + shift for name, shift in late.items()}
    if early:
        everywhere = dict.fromkeys(others, clock.initial) | found
        found = {name: start - early for name, start in everywhere.items()}
    states = tuple(
        replace(q, start_in=tuple(sorted(found.items()))) if q is clock else q
        for q in effect.states
    )
    return replace(effect, states=states).with_parameters({effect.about.moment: time})


def moments(model: Model, effect: Effect) -> dict[str, float]:
    """Return when an event came in recordings where that is not the time of its parameter, in s."""
    if not effect.about.moment or effect.about.period:
        return {}
    time = _own(model, effect, effect.about.moment).value
    return {name: time - start for q in effect.states for name, start in q.start_in}


def _likeliest(
    filter_: PredictionError, observed: Observed, clocks: Mapping[int, float], tried: Vector
) -> float | None:
    """Return how late clocks start in a recording, in s; None if not clearly otherwise than now.

    Args:
        clocks: Number of each one's state, and its usual start in s.
        tried: Delays to begin with, shape (n,), in s, at equal distances.
    """
    usual, places = np.array(list(clocks.values())), list(clocks)

    def cost(start: Vector) -> float:
        x = observed.start.copy()
        x[places] = start
        try:
            return filter_.run(replace(observed, start=x), filter_.model.values).cost
        except NumericalError:
            return math.inf

    def late(shift: float) -> float:
        return cost(usual + shift)

    costs = np.array([late(shift) for shift in tried])
    best = int(np.argmin(costs))
    shift, least = float(tried[best]), float(costs[best])
    if 0 < best < len(tried) - 1:
        near = minimize_scalar(
            late,
            bounds=(tried[best - 1], tried[best + 1]),
            method="bounded",
            options={"maxiter": _STEPS},
        )
        if near.fun < least:
            shift, least = float(near.x), float(near.fun)
    return shift if least < cost(observed.start[places]) - _CLEARLY else None
