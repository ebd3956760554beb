"""What is taken back of a search, and what of it is taken up again, with the doubt."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.candidate import Candidate, is_sensor
from workbench.diagnosis.selection.held_out import (
    explained,
    held_out_errors,
    judged_run,
    run_errors,
    settled_run,
    start_floors,
)
from workbench.diagnosis.selection.selected import Accepted, Aside, Selected, Withdrawn
from workbench.diagnosis.selection.task import Task
from workbench.errors import NumericalError


def run_as_found(task: Task, state: Selected) -> tuple[Selected, float]:
    """Run the improved model freely, and take back what spoils that.

    Returns:
        The search with the runs, and the share of the error that goes, dimensionless; NaN if
        nothing was found.
    """
    share = math.nan
    while state.accepted:
        task.say("running the improved model freely on the held-out recordings")
        state, share = run_freely(task, state)
        least = rules.LEAST_EXPLAINED
        if not share < least:
            break
        why = (
            f"what was found takes away {100 * share:.0f} % of the error of the free run on"
            f" held-out recordings, {100 * least:.0f} % is asked for"
        )
        last = state.accepted[-1]
        without = task.without(state, last) if len(state.accepted) > 1 else None
        if without is None:
            return all_withdrawn(task, state, why, told=share >= rules.LEAST_PREDICTED), share
        # One that spoils the run must not take those before it along.
        state = replace(_taken_back(state, last, why, without[0]), free=without[1])
    return state, share


def _taken_back(state: Selected, found: Accepted, why: str, fit: ProcessNoiseFit) -> Selected:
    """Take back one effect; the fit of the model without it is given."""
    return replace(
        state,
        accepted=tuple(a for a in state.accepted if a is not found),
        withdrawn=(*state.withdrawn, Withdrawn(found.candidate, why)),
        extended=fit,
    )


def run_freely(task: Task, state: Selected) -> tuple[Selected, float]:
    """Run the models along the held-out recordings.

    Returns:
        The search with the runs, and the share of the error that goes, dimensionless; NaN if a
        model could not be run.
    """
    try:
        fits = {
            label: task.closest(fit, robust=True)
            for label, fit in (("refitted", task.base), ("extended", state.extended))
        }
        runs = {
            label: {r.name: judged_run(fit, task.nominal, r) for r in task.judging}
            for label, fit in fits.items()
        }
        errors = held_out_errors(runs, task.judging)
        share = explained(errors)
        closer = any(errors["extended"][q] < off for q, off in errors["refitted"].items())
        if share < rules.LEAST_EXPLAINED and closer:
            # What seems too little may be what the starts of the runs hide.
            share = explained(errors, start_floors(fits, task.nominal, task.judging))
        if share < rules.LEAST_EXPLAINED:
            share = max(share, _over_all(task, fits, errors))
    except (NumericalError, np.linalg.LinAlgError) as error:
        task.say(f"the improved model could not be run: {error}")
        return state, math.nan
    state = replace(state, closest=fits)
    first = task.judging[0]
    if first.diverges or not first.drifts:
        state = replace(state, runs=runs)
    return state, share


def _over_all(
    task: Task, fits: Mapping[str, ProcessNoiseFit], errors: Mapping[str, Mapping[str, float]]
) -> float:
    """Return the share that goes along whole recordings, where windows are further off than those.

    Where a machine is within its slack no filter knows, and a window that begins there is off from
    its start. A run over all of a recording, which can only drift beside windows, then tells more.

    Args:
        errors: Those of the runs over windows, by model and output, in SI.
    """
    if not task.judging[0].drifts or task.judging[0].diverges:
        return 0.0
    runs = {
        label: {r.name: settled_run(fit.model, task.nominal, r) for r in task.judging}
        for label, fit in fits.items()
    }
    whole = held_out_errors(runs, task.judging)
    closer = all(whole["extended"][q] <= error for q, error in errors["extended"].items())
    return explained(whole) if closer else 0.0


def too_little_withdrawn(task: Task, state: Selected, excess: float) -> Selected:
    """Take back the last effects while all together explain too little.

    Args:
        excess: Log likelihood that the refitted nominal model lacks, dimensionless.
    """
    while state.accepted:
        count = len(state.accepted)
        # What is likely only is reported with the doubt, and not asked for more.
        doubted = bool(state.accepted[-1].candidate.doubts)
        least = rules.LEAST_SHARE if count == 1 or doubted else rules.LEAST_TOGETHER
        gain = state.fits[0].cost - state.fits[count].cost
        if gain >= least * excess:
            break
        why = (
            f"explains too little: {100 * gain / excess:.0f} % of what is missing"
            + (" together with those before" if count > 1 else "")
            + f", {100 * least:.0f} % is asked for"
        )
        if count == 1 and gain >= rules.LEAST_PREDICTED * excess:
            shown = _shown_in_runs(task, state.accepted[0].candidate)
            state = _set_aside(state, why, shown=shown)
        state = _taken_back(state, state.accepted[-1], why, state.fits[count - 1])
        state = replace(state, fits=state.fits[:count])
    return state


def _shown_in_runs(task: Task, candidate: Candidate) -> bool:
    """Whether an effect alone takes most of the error of free runs on held-out recordings."""
    if candidate.run is None:
        return False
    without = run_errors(task.closest(task.base), task.nominal, task.judging)
    return candidate.run.closer_than(without, by=1.0 - math.sqrt(1.0 - rules.LEAST_SHOWN))


def all_withdrawn(task: Task, state: Selected, why: str, *, told: bool) -> Selected:
    """Take back everything that was found: the improved model does not run freely any better.

    Args:
        told: Whether the runs come so much closer that the first effect may be told as likely.
    """
    if told:
        state = _set_aside(state, why)
    return replace(
        state,
        withdrawn=(*state.withdrawn, *(Withdrawn(c, why) for c, _ in state.accepted)),
        accepted=(),
        extended=task.base,
        fits=(task.base,),
        closest={k: v for k, v in state.closest.items() if k == "refitted"},
        runs={k: v for k, v in state.runs.items() if k == "refitted"},
    )


def _set_aside(state: Selected, why: str, *, shown: bool = False) -> Selected:
    """Remember the first effect that was found, with the model that has no other.

    Args:
        shown: Whether it takes most of the error of free runs.
    """
    candidate, alike = state.accepted[0]
    extended = state.fits[1] if len(state.fits) > 1 else state.extended
    return replace(state, aside=(*state.aside, Aside(candidate, alike, extended, why, shown)))


def left_out(task: Task, state: Selected, least: float) -> Selected:
    """Take out effects that the later ones made needless.

    Args:
        least: Log likelihood that an effect must gain beside the others, dimensionless.
    """
    for found in state.accepted[:-1]:
        without = task.without(state, found)
        if without is not None and without[0].cost - state.extended.cost < least:
            state = _taken_back(state, found, "a later one makes it needless", without[0])
    return state


def taken_up_again(task: Task, state: Selected) -> Selected:
    """Take up again, with the doubt, what explains too little but shows in free runs."""
    shown = [a for a in state.aside if a.shown]
    if not shown:
        return state
    best = min(shown, key=lambda a: a.extended.cost)
    told = _told(state, best, f"it {best.reason}")
    return replace(told, fits=(task.base, best.extended), rounds=state.rounds[:1])


def _told(state: Selected, found: Aside, doubt: str) -> Selected:
    """Take up again what was set aside, alone and with a doubt."""
    doubted = replace(found.candidate, doubts=(*found.candidate.doubts, doubt))
    return replace(
        state,
        accepted=(Accepted(doubted, found.alike),),
        withdrawn=tuple(w for w in state.withdrawn if w.candidate.name != doubted.name),
        extended=found.extended,
    )


def likely(state: Selected) -> Selected:
    """Take up again what was withdrawn although it clearly gains on the held-out recordings.

    A rule on how much of the misfit an effect explains lowers the belief in it; it does not undo
    what the held-out recordings say. Of several the one that gains most there is reported, as
    likely, with the rule that speaks against it. What a sensor does is not: it colours the noise,
    and so predicts the next sample of anything.
    """
    aside = [a for a in state.aside if a.candidate.held_out[1] > 0.0]
    aside = [a for a in aside if not is_sensor(a.candidate)]
    if state.accepted or not aside:
        return state
    best = max(aside, key=lambda a: a.candidate.held_out[0])
    return _told(state, best, best.reason)
