"""The last refit of a hypothesis that is followed, and how far it is from what was held out."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import as_recorded, free_run
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.process_noise import (
    INDIFFERENT,
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
)
from workbench.diagnosis.estimation.windows import windows
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.first_refit import untried, variants
from workbench.diagnosis.selection.held_out import RunErrors, held_out_gain, run_errors
from workbench.diagnosis.selection.moments import (
    changed_values,
    is_event,
    level_everywhere,
    with_own_starts,
)
from workbench.diagnosis.selection.refit_in_turn import NEARER, WIDENINGS, Basis, in_turn
from workbench.diagnosis.selection.rules import SAME_LEVELS
from workbench.diagnosis.selection.simulation_error import closest_runs
from workbench.errors import NumericalError
from workbench.model import Model
from workbench.physics.library import Hypothesis


def followed(
    basis: Basis, first: Candidate, hold_out: Sequence[Observed], before: Vector | None
) -> Candidate:
    """Go on from a first refit with more trust in the equations, and judge on held-out data.

    Args:
        before: Cost of the base on the held-out recordings by block of time, shape (n,),
            dimensionless; None if there are none.
    """
    try:
        return _judged_on(basis, first, hold_out, before)
    except Exception as error:  # noqa: BLE001
        # Whatever a law does, its failure must not end the diagnosis.
        return replace(untried(first.entry, error), followed=True)


def _judged_on(
    basis: Basis, first: Candidate, hold_out: Sequence[Observed], before: Vector | None
) -> Candidate:
    assert first.fit is not None
    base, entry, fit = basis.base, first.entry, first.fit
    # An effect may take over from another one of the same law.
    before_it = f"{fit.model.effects[-1].name}."
    ended = {
        f"{entry.name}.{k.removeprefix(before_it)}" if k.startswith(before_it) else k: v
        for k, v in fit.refit.values.items()
    }
    entry, fit, started = in_turn(basis, entry, ended, fit.noise_scale, sharper=True)
    for other in variants(entry, guessed=False):
        # Where recordings do not mind, it is what is usual: another variant may be far off once
        # more is explained.
        fixed = {q.name: q.value for q in other.effect.parameters if not q.fitted}
        usual = all(fixed.get(name, value) == value for name, value in entry.shapes[0].items())
        with contextlib.suppress(NumericalError):
            told = in_turn(basis, other, fit.refit.values, fit.noise_scale, times=0)
            if told[1].cost < fit.cost + (INDIFFERENT if usual else -INDIFFERENT):
                entry, fit, started = told
    for again in (True, False) if is_event(entry.effect) else (False,):
        (effect,) = with_own_starts((entry.effect,), fit, base.model, basis.fit_on, hold_out)
        if effect is entry.effect:
            break
        ended = fit.refit.values | changed_values(fit.model, (entry.effect,), (effect,))
        entry = replace(entry, effect=effect)
        if level_everywhere(effect) is not None:
            return replace(first, refused="it is the same in all recordings", rule=SAME_LEVELS)
        # Told one time for all recordings an event came slowly; told more, it may be sharp, and
        # what is sharp tells its times better; what gained nothing by its own times is no event.
        told_once, times = fit.cost, WIDENINGS if again else 0
        entry, fit, started = in_turn(
            basis, entry, ended, fit.noise_scale, times=times, sharper=True
        )
        if fit.cost > told_once - NEARER:
            break
    run = closest_errors(fit, base.model, basis.fit_on, hold_out)
    blocks = (blocks_of_cost(fit, started),)
    judged = Candidate(entry, fit, base.cost - fit.cost, blocks=blocks, run=run)
    if before is None:
        return judged
    held_out, unseen = held_out_gain(
        before, fit, basis.started(hold_out, fit.model), base.noise_scale
    )
    # What comes at a time may not come to some of them.
    shift = max(_shift(entry, fit, base.model, r) for r in hold_out)
    return replace(judged, held_out=held_out, shift=shift, blocks=(*blocks, unseen))


def closest_errors(
    fit: ProcessNoiseFit, nominal: Model, fit_on: Sequence[Observed], hold_out: Sequence[Observed]
) -> RunErrors:
    """Return the errors of the runs of a fit, each model with the values that run closest."""
    return run_errors(closest_runs(fit, nominal, fit_on, hold_out), nominal, hold_out)


def _shift(entry: Hypothesis, fit: ProcessNoiseFit, base: Model, observed: Observed) -> float:
    """Return how far the effect moves an output in free runs, over the noise."""
    if entry.replaces:
        return math.nan
    absent = fit.model.with_parameters(entry.absent)
    begun = extended_start(observed, base, fit.model)
    try:
        parts = windows(fit.model, fit.model, begun) if observed.diverges else [begun]
    except NumericalError:
        return math.inf
    runs = [
        (as_recorded(free_run(fit.model, part), part, observed), free_run(absent, part))
        for part in parts
    ]
    if not all(run.finite for pair in runs for run in pair):
        return math.inf
    apart = np.concatenate([one.simulated - other.simulated for one, other in runs])
    moved = np.sqrt(np.nanmean(apart**2, axis=0))
    return float(np.max(moved / observed.noise_rms))
