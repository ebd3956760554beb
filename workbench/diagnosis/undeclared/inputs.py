"""How inputs go where a plant does not say it: how far, between samples, how noisily read."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from workbench.diagnosis.estimation.prediction_error import PredictionError, filter_of
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import PERFECT
from workbench.diagnosis.estimation.start import FEW, fit_to_few
from workbench.diagnosis.selection.rules import SAME
from workbench.diagnosis.undeclared.noise import shown
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.recordings.checks.noise import noise_of
from workbench.recordings.checks.quantisation import recorded_quantum
from workbench.recordings.checks.units import beyond_range
from workbench.recordings.recording import Recording
from workbench.recordings.resampling import refined

_MOVING = 0.5
"""Part of the samples at which an input changes that does not go in steps."""

_LEVELS = 8
"""Values of an input that goes through a coarse converter rather than in steps of its own."""

_AROUND = ((-1, 0, 1), (0,), (-2, -1, 0))
"""Rows of an input around one of which means are compared."""

_PARTS, _MOST_SAMPLES = 4, 20_000
"""Parts into which a step is divided for an input that goes straight, and samples that may come."""


def wider(model: Model, recordings: Sequence[Recording]) -> Model:
    """Widen the ranges of inputs that were recorded beyond them, unless that is less likely.

    That an actuator clips what it gets is found as a law; that it does not is not.
    """
    inputs = []
    for q in model.inputs:
        seen = [r.signal(q.name) for r in recordings if q.name in r]
        if any(beyond_range(signal, q.lower, q.upper) for signal in seen):
            least, most = (f(f(s.values) for s in seen) for f in (min, max))
            q = replace(q, lower=min(q.lower, least), upper=max(q.upper, most))  # noqa: PLW2901
        inputs.append(q)
    trial = replace(model, inputs=tuple(inputs))
    if trial.inputs == model.inputs or clearly_likelier(model, trial, recordings):
        return model
    return trial


def straight(model: Model, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return inputs that are read and that move from sample to sample rather than in steps."""
    trial = otherwise_between_samples(model, recordings)
    moving = tuple(n for n in trial.traits.straight if n not in model.traits.straight)
    return moving if moving and clearly_likelier(trial, model, recordings) else ()


def otherwise_between_samples(model: Model, recordings: Sequence[Recording]) -> Model:
    """Let inputs that are read go straight, where any is held that may; else hold all."""
    moving = tuple(
        q.name
        for q in model.inputs
        if not q.commanded
        and q.name not in model.traits.straight
        and all(_moves(r, q.name) for r in recordings if q.name in r)
    )
    lines = (*model.traits.straight, *moving) if moving else ()
    return replace(model, traits=replace(model.traits, straight=lines))


def _moves(recording: Recording, name: str) -> bool:
    """Whether an input moves at most samples, or by single steps of a converter when it does."""
    moves = np.abs(np.diff(recording[name]))
    moves = moves[moves > 0.0]
    often = len(moves) > _MOVING * len(recording)
    return often or bool(
        len(np.unique(recording[name])) > _LEVELS
        and np.median(moves) < 1.5 * recorded_quantum(recording, name)
    )


def clearly_likelier(
    one: Model,
    other: Model,
    recordings: Sequence[Recording],
    as_other: Sequence[Recording] | None = None,
    priors: Sequence[Prior] | None = None,
) -> bool:
    """Tell whether one model, refitted, foretells recordings clearly better than another.

    Args:
        as_other: The same recordings as the other model sees them, if that differs.
        priors: Of the parameters that are refitted; the default ones if not given.
    """
    costs = []
    for trial, given in ((one, recordings), (other, as_other or recordings)):
        try:
            costs.append(fit_to_few(trial, given, priors)[0].cost)
        except (WorkbenchError, np.linalg.LinAlgError):
            return False
    return costs[0] < costs[1] - SAME


class Misread(NamedTuple):
    """Noise of inputs that a meter read, which moves the model and not the machine.

    Args:
        inputs: Root mean square in SI, by input.
        outputs: What of it the measurements get at once, root mean square in SI, by output.
    """

    inputs: tuple[tuple[str, float], ...]
    outputs: dict[str, float]
    notes: tuple[str, ...]


def misread(model: Model, recordings: Sequence[Recording]) -> Misread | None:
    """Return the noise of inputs that a meter read, where there are any.

    The machine follows the noise that a controller passes on: means of three rows foretell it worse
    then. What follows the rows before better than those around is slow itself. A machine that is
    slow beside a row shows no difference: there, and there alone, it is enough that the equations
    lack nothing else beside that noise.
    """
    given = [r for r in recordings[:FEW] if not r.resampled]
    noise = {}
    for q in model.inputs:
        floors = [noise_of(r, q.name) for r in given if q.name in r and _moves(r, q.name)]
        if floors and all(f.noise_rms > 0.0 and not f.upper_bound for f in floors):
            noise[q.name] = min(f.noise_rms for f in floors)
    if not noise:
        return None
    columns = {q.name: k for k, q in enumerate(model.inputs)}
    try:
        fit, seen = fit_to_few(model, given)
        filter_ = filter_of(fit.model, seen[0], fit.noise_scale)
        # What is hardly visible beside what a filter allows for shows in one that allows for none.
        strict = filter_of(fit.model, seen[0], min(fit.noise_scale, PERFECT))

        def cost(name: str, around: Sequence[int], filter_: PredictionError = filter_) -> float:
            column, total = columns[name], 0.0
            for one in seen:
                inputs, every = one.inputs.copy(), np.arange(len(one.inputs))
                rows = np.clip(every[:, None] + around, 0, every[-1])
                inputs[:, column] = np.mean(one.inputs[rows, column], axis=1)
                total += filter_.run(replace(one, inputs=inputs), fit.model.values).cost
            return total

        costs = {name: [cost(name, around) for around in _AROUND] for name in noise}
        around, own = _AROUND[:2]
        followed = {n for n in noise if cost(n, own, strict) < cost(n, around, strict) - SAME}
        states = filter_.run(seen[0], fit.model.values).states
    except (WorkbenchError, np.linalg.LinAlgError):
        return None
    found = [name for name, (around, own, late) in costs.items() if around < min(own - SAME, late)]
    unknown = {name: rms for name, rms in noise.items() if name not in followed}
    if not found and unknown and fit.noise_scale > PERFECT:
        read = tuple(unknown.items())
        trial = replace(model, traits=replace(model.traits, misread=read, straight=tuple(unknown)))
        with contextlib.suppress(WorkbenchError, np.linalg.LinAlgError):
            other = fit_to_few(trial, given)[0]
            if other.noise_scale <= PERFECT and other.cost < fit.cost + SAME:
                found = list(unknown)
    if not found:
        return None
    trace = fit.model.exact
    through = ca.jacobian(trace.outputs, trace.u)[:, [columns[name] for name in found]]
    slopes = trace.along(states, seen[0].inputs, fit.model.values, through)[0]
    each = [noise[name] for name in found]
    # Half-way between two samples a mean of both is taken.
    passed = np.sqrt(0.5 * np.mean(np.sum((slopes * each) ** 2, axis=2), axis=0)).tolist()
    told = [(name, shown(model.inputs[columns[name]], noise[name])) for name in found]
    return Misread(
        tuple(zip(found, each, strict=True)),
        dict(zip((q.name for q in model.outputs), passed, strict=True)),
        tuple(
            f"{name} was read with {rms} rms of noise, which the machine does not follow"
            for name, rms in told
        ),
    )


def more_finely(model: Model, recordings: Sequence[Recording]) -> list[Recording]:
    """Return recordings with divided steps, where inputs that go straight are better followed so.

    The mean of a step gives a plant the right momentum, but not quite the right place. Lines
    between what a meter read have no white noise.

    Returns:
        The recordings; none where the steps are short enough, or where too many samples would come.
    """
    parts = min(_PARTS, _MOST_SAMPLES // max(len(r.time) for r in recordings))
    if not model.traits.straight or model.traits.misread or parts < 2:
        return []
    finer = [refined(r, parts, model.traits.straight) for r in recordings]
    return finer if clearly_likelier(model, model, finer, recordings) else []
