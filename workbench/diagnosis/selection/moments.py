"""When an event came in each recording: it does not repeat."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError, disturbances
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, extended_start
from workbench.errors import NumericalError
from workbench.model import Effect, Model

_MOMENTS, _STEPS = 100, 20
"""Starts of a clock along a recording that are tried, and steps from the best one on."""

_CLEARLY = 10.0
"""Log likelihood by which a recording must be likelier: more than so many tries give by chance."""


def with_own_moments(
    effect: Effect,
    fit: ProcessNoiseFit,
    before: Model,
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
) -> Effect:
    """Return an event with the time at which it came in each recording, where that is clear.

    Its parameter is the time in the first fitting recording. In others the clock starts late or
    early: the event comes at another time, is over before they begin, or does not come.

    Args:
        fit: The refitted model, the effect its last one.
        before: The model that the recordings have a start for.

    Returns:
        The effect; the same one if it is no event, or all times are as they were.
    """
    clocks = [q for q in effect.states if q.unit == "s"]
    if not effect.about.moment or len(clocks) != 1:
        return effect
    clock, model = clocks[0], fit.model
    place = [q.name for q in model.states].index(f"{effect.name}.{clock.name}")
    rms = disturbances(model, fit.noise_scale)
    starts = {}
    for observed in (*fit_on, *hold_out):
        begun = extended_start(observed, before, model)
        start = _likeliest(PredictionError(model, begun, (), rms), begun, place)
        if start is not None:
            starts[observed.name] = start
    if not starts:
        return effect
    # Relative to the first recording, whose time is the parameter.
    early = starts.pop(fit_on[0].name, clock.initial) - clock.initial
    moment = model.parameter(f"{effect.name}.{effect.about.moment}")
    time = float(np.clip(moment.value - early, moment.lower, moment.upper))
    found = {**dict(clock.start_in), **starts}
    if early:
        everywhere = {r.name: clock.initial for r in (*fit_on[1:], *hold_out)}
        found = {name: start - early for name, start in (everywhere | found).items()}
    states = tuple(
        replace(q, start_in=tuple(sorted(found.items()))) if q is clock else q
        for q in effect.states
    )
    return replace(effect, states=states).with_parameters({effect.about.moment: time})


def moments(model: Model, effect: Effect) -> dict[str, float]:
    """Return when an event came in recordings where that is not the time of its parameter, in s."""
    if not effect.about.moment:
        return {}
    time = model.parameter(f"{effect.name}.{effect.about.moment}").value
    return {name: time - start for q in effect.states for name, start in q.start_in}


def _likeliest(filter_: PredictionError, observed: Observed, place: int) -> float | None:
    """Return where a clock starts in a recording, in s; None if not clearly elsewhere."""
    reach = observed.sample_time * len(observed.outputs)

    def cost(start: float) -> float:
        x = observed.start.copy()
        x[place] = start
        try:
            return filter_.run(replace(observed, start=x), filter_.model.values).cost
        except NumericalError:
            return math.inf

    tried = observed.start[place] + np.linspace(-reach, reach, 2 * _MOMENTS + 1)
    costs = np.array([cost(start) for start in tried])
    best = int(np.argmin(costs))
    usual = costs[_MOMENTS]
    start, least = float(tried[best]), float(costs[best])
    if 0 < best < len(tried) - 1:
        near = minimize_scalar(
            cost,
            bounds=(tried[best - 1], tried[best + 1]),
            method="bounded",
            options={"maxiter": _STEPS},
        )
        if near.fun < least:
            start, least = float(near.x), float(near.fun)
    return start if least < usual - _CLEARLY else None
