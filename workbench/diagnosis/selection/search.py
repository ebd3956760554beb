"""The search for what is missing: forward over the library, then backward."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from workbench.diagnosis.diagnosis import Diagnosis
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    ProcessNoiseFit,
    extended_start,
    fit_with_process_noise,
    perfect_cost,
)
from workbench.diagnosis.selection.candidates import (
    SURPASSED,
    Candidate,
    charge_for,
    entry_priors,
    refit_candidates,
)
from workbench.diagnosis.selection.score import Scores, score_library
from workbench.diagnosis.selection.shortlist import shortlist
from workbench.errors import NumericalError
from workbench.model import Model
from workbench.physics.library import Hypothesis, library

Progress = Callable[[str], None]

MOST_FINDINGS = 3
"""Effects that are searched for, one after the other."""

LEAST_SHARE = 0.3
"""Share of the excess misfit of the refitted nominal that a single effect must explain."""

LEAST_OF_REST = 0.6
"""Share that a further effect must explain of what is left after those before: the wrong shape of
an effect that was found leaves a rest too, of which another name explains a part."""

LEAST_TOGETHER = 0.5
"""Share of it that several effects must explain together."""

LEAST_AT_FIRST = 0.05
"""Share that an effect must explain to stay while another is searched for: two effects that hide
each other explain little one by one."""

LEAST_OF_ALL = 0.05
"""Share of the first excess misfit that a further effect must explain: less may be the wrong shape
of an effect that was found, and is not worth a wrong name."""

_SAME = 15.0
"""Difference of log likelihood below which two effects explain the recordings equally well."""


def search(
    diagnosis: Diagnosis,
    fitting: Sequence[Observed],
    judging: Sequence[Observed],
    priors: Sequence[Prior],
    entries: Sequence[Hypothesis] | None,
    jobs: int,
    say: Progress,
    *,
    without: Collection[str] = (),
) -> str | None:
    """Add one effect after the other as long as one is accepted.

    Forward: the library is scored on what is left, the best hypotheses are refitted, and the one
    that gains the most among those that pass every rule is added. Backward: effects that together
    explain too little are taken back, and so are those that a later one made needless.

    Args:
        diagnosis: The diagnosis, with the refitted nominal model; what is found goes there.
        fitting: Fitting recordings, observed with the nominal model.
        judging: Held-out recordings, likewise.
        priors: Priors of the free parameters of the nominal model.
        entries: Effects that may be missing; the whole library if None.
        jobs: Number of processes.
        say: Called with a line of text before each step.
        without: Effects with which an earlier search began that came to nothing; this one begins
            with the next best of its first round.

    Returns:
        The effect with which the search began, whether it was kept or not; None if there was none.

    Raises:
        NumericalError: If the nominal model cannot be simulated along the recordings.

    Example:
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> len(example_diagnosis()[0].rounds) > 0
        True
    """
    free = list(priors)
    samples = round(sum(len(r.outputs) * r.sample_time for r in fitting) / 0.1)
    perfect = _perfect(diagnosis, fitting)
    whole = max(diagnosis.base.cost - perfect, 0.0)
    diagnosis.excess = whole
    passed = [diagnosis.base]
    charge = 0.0
    before = diagnosis.rounds[0] if without else None
    began: str | None = None
    diagnosis.rounds = []
    for number in range(MOST_FINDINGS):
        current = diagnosis.extended
        excess = max(current.cost - perfect, 0.0)
        least = LEAST_AT_FIRST * whole
        if number:
            least = max(LEAST_OF_REST * excess, LEAST_OF_ALL * whole)
            if excess < least:
                break
        if before is not None and not number:
            scores, candidates = before
            passing = [c for c in candidates if _passed(c) and c.entry.name not in without]
        else:
            given = library(current.model, outputs=fitting[0].used) if entries is None else entries
            attached = {effect.name for effect in current.model.effects}
            tried = [e for e in given if e.name not in attached]
            say(f"scoring {len(tried)} effects" + (" on what is left" if number else ""))
            begun, judged = started(fitting, diagnosis), started(judging, diagnosis)
            scores = score_library(current.model, begun, free, tried, share=current.share)
            # A score tells little of the gain of a large effect, such as a lag of many samples:
            # only what is left after another is asked for a share of the gain beforehand.
            chosen = shortlist(scores, most=8, least=0.05 * least) if number else shortlist(scores)
            charge = charge_for(len(tried), samples, 2)
            candidates = refit_candidates(
                current,
                chosen,
                free,
                begun,
                judged,
                charge=charge,
                least_gain=least,
                jobs=jobs,
                progress=say,
            )
            passing = [c for c in candidates if not c.refused]
        diagnosis.rounds.append((scores, candidates))
        best = passing[0] if passing else None
        if best is None or best.fit is None:
            break
        began = began or best.entry.name
        say(f"found {best.entry.name}")
        rivals = [c for c in candidates if c.entry.name not in without]
        diagnosis.accepted.append((best, _alike(best, rivals, scores)))
        free += entry_priors(next(s for s in scores.scores if s.entry.name == best.entry.name))[0]
        diagnosis.extended = _polished(best.fit, started(fitting, diagnosis, best.fit.model), free)
        passed.append(diagnosis.extended)
        if diagnosis.extended.share <= LADDER[-1] < current.share:
            break
    _withdraw(diagnosis, passed)
    if len(diagnosis.accepted) > 1:
        say("leaving out one effect at a time")
        _leave_out(diagnosis, fitting, free, max(charge, LEAST_OF_ALL * whole))
    return began


def _passed(candidate: Candidate) -> bool:
    """Whether an effect passed every rule, even if another explained more."""
    return candidate.followed and candidate.fit is not None and candidate.refused in ("", SURPASSED)


def _perfect(diagnosis: Diagnosis, fitting: Sequence[Observed]) -> float:
    try:
        return perfect_cost(diagnosis.base.model, fitting)
    except NumericalError:
        # Refitted values that stand for something else may not be fit for a simulation.
        return perfect_cost(diagnosis.nominal, fitting)


def _polished(
    fit: ProcessNoiseFit, recordings: Sequence[Observed], priors: Sequence[Prior]
) -> ProcessNoiseFit:
    """Refit once more, to the end: comparing hypotheses needs less."""
    start = {e.name: e.value for e in fit.refit.estimates}
    final = fit_with_process_noise(
        fit.model, recordings, priors, start=start, share=fit.share, follow=False
    )
    return replace(final, passed=fit.passed) if final.cost <= fit.cost else fit


def _withdraw(diagnosis: Diagnosis, passed: Sequence[ProcessNoiseFit]) -> None:
    """Take back the last effects while all together explain too little."""
    while diagnosis.accepted:
        count = len(diagnosis.accepted)
        least = LEAST_SHARE if count == 1 else LEAST_TOGETHER
        gain = diagnosis.base.cost - passed[count].cost
        if gain >= least * diagnosis.excess:
            return
        candidate, _ = diagnosis.accepted.pop()
        why = (
            f"explains too little: {100 * gain / diagnosis.excess:.0f} % of what is missing"
            + (" together with those before" if count > 1 else "")
            + f", {100 * least:.0f} % is asked for"
        )
        diagnosis.withdrawn.append((candidate, why))
        diagnosis.extended = passed[count - 1]


def withdraw_all(diagnosis: Diagnosis, why: str) -> None:
    """Take back everything that was found: the improved model does not run freely any better.

    Args:
        diagnosis: The diagnosis.
        why: The reason, in a few words.

    Example:
        >>> from dataclasses import replace
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> copy = replace(example_diagnosis()[0], accepted=[], withdrawn=[], runs={})
        >>> withdraw_all(copy, "it explains nothing")
        >>> copy.extended is copy.base
        True
    """
    diagnosis.withdrawn += [(candidate, why) for candidate, _ in diagnosis.accepted]
    diagnosis.accepted.clear()
    diagnosis.extended = diagnosis.base
    diagnosis.runs.pop("extended", None)


def _leave_out(
    diagnosis: Diagnosis, fitting: Sequence[Observed], free: Sequence[Prior], least: float
) -> None:
    """Take out effects that the later ones made needless."""
    for pair in diagnosis.accepted[:-1]:
        entry, full = pair[0].entry, diagnosis.extended
        begun = full.passed or full
        model = begun.model.without(entry.effect.name)
        own = f"{entry.effect.name}."
        values = {e.name: e.value for e in begun.refit.estimates if not e.name.startswith(own)}
        try:
            fit = fit_with_process_noise(
                model,
                [extended_start(r, diagnosis.nominal, model) for r in fitting],
                [p for p in free if not p.name.startswith(own) and p.name in values],
                start=values,
                share=begun.share,
            )
        except NumericalError:
            continue
        if fit.cost - full.cost < least:
            diagnosis.accepted.remove(pair)
            diagnosis.withdrawn.append((pair[0], "a later one makes it needless"))
            diagnosis.extended = fit


def _alike(best: Candidate, candidates: Sequence[Candidate], scores: Scores) -> tuple[str, ...]:
    """Name the accepted effect, and those that explain the recordings as well or always do."""
    same = [
        c.entry.name
        for c in candidates
        if c is not best and c.followed and c.fit and best.gain - c.gain < _SAME and c.gain > 0
    ]
    names = {s.entry.name for s in scores.scores if s.testable}
    known = {s.entry.name for s in scores.scores}
    equal = [n for n in best.entry.same_as if n in known and n not in same]
    return (best.entry.name, *[n for n in same if n in names], *equal)


def started(
    recordings: Sequence[Observed], diagnosis: Diagnosis, model: Model | None = None
) -> list[Observed]:
    """Return recordings with a start for a model of the diagnosis.

    Args:
        recordings: Recordings observed with the nominal model.
        diagnosis: The diagnosis.
        model: A model with effects attached; the extended one by default.

    Example:
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> started([], example_diagnosis()[0])
        []
    """
    model = model or diagnosis.extended.model
    return [extended_start(r, diagnosis.nominal, model) for r in recordings]
