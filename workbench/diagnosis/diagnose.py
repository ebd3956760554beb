"""Diagnosis: locate a mismatch, name what was left out, model it, prove it on held-out data."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.diagnosis.free_run import FreeRun, free_run
from workbench.diagnosis.likely import (
    LADDER,
    LikelyFit,
    extended_start,
    fit_likely,
    perfect_cost,
)
from workbench.diagnosis.locate import Location, locate
from workbench.diagnosis.observe import observe
from workbench.diagnosis.prediction_error import Observed
from workbench.diagnosis.priors import Prior, default_priors
from workbench.diagnosis.score import Scores, score_library
from workbench.diagnosis.select import (
    Candidate,
    charge_for,
    entry_priors,
    refit_candidates,
    shortlist,
)
from workbench.diagnosis.verdict import Finding, Kind, Value, Verdict
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Model
from workbench.physics.library import Entry, library
from workbench.recordings.checks import check_recording
from workbench.recordings.recording import Recording

Progress = Callable[[str], None]

MOST_FINDINGS = 3
"""Effects that are searched for, one after the other."""

IMPERFECT = 0.1
"""Share of the expected disturbance above which something is still left out."""

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


@dataclass
class Diagnosis:
    """Everything that a diagnosis computed, for the verdict and its proof.

    Args:
        nominal: The model as given.
        base: The refitted nominal model.
        extended: The refitted model with what was found.
        accepted: What was found, in the order of finding.
        rounds: Scores and candidates of each round of the search.
        before: Location of the mismatch in the refitted nominal model.
        after: The same in the extended model.
        runs: Free runs on held-out recordings, by model and recording.
        excess: Log likelihood that the refitted nominal model lacks, dimensionless.
        withdrawn: Effects that were taken back because all together explained too little, or
            because a later one made them needless.
        verdict: The verdict.
    """

    nominal: Model
    base: LikelyFit
    extended: LikelyFit
    accepted: list[tuple[Candidate, tuple[str, ...]]] = field(default_factory=list)
    rounds: list[tuple[Scores, tuple[Candidate, ...]]] = field(default_factory=list)
    before: Location | None = None
    after: Location | None = None
    runs: dict[str, dict[str, FreeRun]] = field(default_factory=dict)
    excess: float = math.nan
    withdrawn: list[Candidate] = field(default_factory=list)
    verdict: Verdict | None = None


def diagnose(
    model: Model,
    fit_on: Sequence[Recording],
    hold_out: Sequence[Recording],
    *,
    entries: Sequence[Entry] | None = None,
    priors: Sequence[Prior] | None = None,
    jobs: int = 2,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose a model on recordings of the machine.

    Args:
        model: The nominal model.
        fit_on: Recordings to fit on.
        hold_out: Recordings to judge on.
        entries: Effects that may be missing; the whole library by default.
        priors: Free parameters of the nominal model; `default_priors` by default.
        jobs: Number of processes.
        progress: Called with a line of text before each step.

    Returns:
        The diagnosis, with the verdict.

    Raises:
        WorkbenchError: If there are no recordings or they do not belong to the model.
        NumericalError: If the nominal model cannot be refitted.

    Example:
        >>> from workbench.diagnosis.example import made_up_recording, pushes
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> runs = [
        ...     made_up_recording(axis, pushes(400, largest=200.0, seed=i), sample_time=0.01)
        ...     for i in (1, 2)
        ... ]
        >>> diagnose(axis, runs[:1], runs[1:], jobs=1).verdict.kind
        'nothing_missing'
    """
    if not fit_on or not hold_out:
        raise WorkbenchError(
            f"a diagnosis needs recordings to fit on and others to judge on; it got {len(fit_on)}"
            f" and {len(hold_out)}"
        )
    say = progress or (lambda text: None)
    began = time.perf_counter()
    say("checking the recordings")
    needed = [q.name for q in model.inputs]
    # What drives the model is held between samples, whatever its column was taken for.
    fit_on, hold_out = (
        [r.with_roles({n: "command" for n in needed if n in r}) for r in recordings]
        for recordings in (fit_on, hold_out)
    )
    reports = [
        check_recording(
            r,
            model=model,
            required=[*needed, *(q.name for q in model.outputs if q.name in r)],
        )
        for r in (*fit_on, *hold_out)
    ]
    data = tuple(row for report in reports for row in report.as_data())
    if not all(report.fit for report in reports):
        bad = next(report for report in reports if not report.fit)
        reason = next(c.note for c in bad.checks if c.result == "unfit")
        unfit = LikelyFit.__new__(LikelyFit)
        diagnosis = Diagnosis(model, unfit, unfit)
        diagnosis.verdict = Verdict(
            "data_unfit",
            f"Recording {bad.name} cannot be judged: {reason}",
            model,
            data=data,
            seconds=time.perf_counter() - began,
        )
        return diagnosis
    fitting = [observe(model, report.recording) for report in reports[: len(fit_on)]]
    judging = [observe(model, report.recording) for report in reports[len(fit_on) :]]
    known = tuple(priors if priors is not None else default_priors(model))
    say("refitting the nominal model")
    base = fit_likely(model, fitting, known)
    diagnosis = Diagnosis(model, base, base)
    say("locating the mismatch")
    diagnosis.before = locate(base.model, fitting)
    _search(diagnosis, fitting, judging, known, entries, jobs, say)
    if diagnosis.accepted:
        say("locating what is left")
        diagnosis.after = locate(diagnosis.extended.model, _started(fitting, diagnosis))
    say("running the models freely on the held-out recordings")
    for label, fitted in (
        ("nominal", model),
        ("refitted", base.model),
        ("extended", diagnosis.extended.model),
    ):
        diagnosis.runs[label] = {
            r.name: free_run(fitted, extended_start(r, model, fitted)) for r in judging
        }
    diagnosis.verdict = _verdict(diagnosis, judging, data, time.perf_counter() - began)
    return diagnosis


def _started(
    recordings: Sequence[Observed], diagnosis: Diagnosis, model: Model | None = None
) -> list[Observed]:
    model = model or diagnosis.extended.model
    return [extended_start(r, diagnosis.nominal, model) for r in recordings]


def _search(
    diagnosis: Diagnosis,
    fitting: Sequence[Observed],
    judging: Sequence[Observed],
    priors: Sequence[Prior],
    entries: Sequence[Entry] | None,
    jobs: int,
    say: Progress,
) -> None:
    """Add one effect after the other as long as one is accepted."""
    free = list(priors)
    samples = round(sum(len(r.outputs) * r.sample_time for r in fitting) / 0.1)
    perfect = _perfect(diagnosis, fitting)
    whole = max(diagnosis.base.cost - perfect, 0.0)
    diagnosis.excess = whole
    passed = [diagnosis.base]
    charge = 0.0
    for number in range(MOST_FINDINGS):
        current = diagnosis.extended
        excess = max(current.cost - perfect, 0.0)
        least = LEAST_AT_FIRST * whole
        if number:
            least = max(LEAST_OF_REST * excess, LEAST_OF_ALL * whole)
            if excess < least:
                break
        given = library(current.model, outputs=fitting[0].used) if entries is None else entries
        attached = {effect.name for effect in current.model.effects}
        tried = [e for e in given if e.name not in attached]
        say(f"scoring {len(tried)} effects" + (" on what is left" if number else ""))
        started, judged = _started(fitting, diagnosis), _started(judging, diagnosis)
        scores = score_library(current.model, started, free, tried, share=current.share)
        # A score tells little of the gain of a large effect, such as a lag of many samples: only
        # what is left after another effect is asked for a share of the gain beforehand.
        chosen = shortlist(scores, most=8, least=0.05 * least) if number else shortlist(scores)
        charge = charge_for(len(tried), samples, 2)
        candidates = refit_candidates(
            current,
            chosen,
            free,
            started,
            judged,
            charge=charge,
            least_gain=least,
            jobs=jobs,
            progress=say,
        )
        diagnosis.rounds.append((scores, candidates))
        best = next((c for c in candidates if not c.refused), None)
        if best is None or best.fit is None:
            break
        say(f"found {best.entry.name}")
        diagnosis.accepted.append((best, _alike(best, candidates, scores)))
        free += entry_priors(next(s for s in scores.scores if s.entry.name == best.entry.name))[0]
        diagnosis.extended = _polished(best.fit, _started(fitting, diagnosis, best.fit.model), free)
        passed.append(diagnosis.extended)
        if diagnosis.extended.share <= LADDER[-1] < current.share:
            break
    _withdraw(diagnosis, passed)
    if len(diagnosis.accepted) > 1:
        say("leaving out one effect at a time")
        _leave_out(diagnosis, fitting, free, max(charge, LEAST_OF_ALL * whole))


def _perfect(diagnosis: Diagnosis, fitting: Sequence[Observed]) -> float:
    try:
        return perfect_cost(diagnosis.base.model, fitting)
    except NumericalError:
        # Refitted values that stand for something else may not be fit for a simulation.
        return perfect_cost(diagnosis.nominal, fitting)


def _polished(fit: LikelyFit, recordings: Sequence[Observed], priors: Sequence[Prior]) -> LikelyFit:
    """Refit once more, to the end: comparing hypotheses needs less."""
    start = {e.name: e.value for e in fit.refit.estimates}
    final = fit_likely(fit.model, recordings, priors, start=start, share=fit.share, follow=False)
    return replace(final, passed=fit.passed) if final.cost <= fit.cost else fit


def _withdraw(diagnosis: Diagnosis, passed: Sequence[LikelyFit]) -> None:
    """Take back the last effects while all together explain too little."""
    while diagnosis.accepted:
        count = len(diagnosis.accepted)
        least = LEAST_SHARE if count == 1 else LEAST_TOGETHER
        if diagnosis.base.cost - passed[count].cost >= least * diagnosis.excess:
            return
        candidate, _ = diagnosis.accepted.pop()
        diagnosis.withdrawn.append(candidate)
        diagnosis.extended = passed[count - 1]


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
            fit = fit_likely(
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
            diagnosis.withdrawn.append(pair[0])
            diagnosis.extended = fit


def _alike(best: Candidate, candidates: Sequence[Candidate], scores: Scores) -> tuple[str, ...]:
    """Name the accepted effect and those that explain the recordings as well."""
    same = [
        c.entry.name
        for c in candidates
        if c is not best and c.followed and c.fit and best.gain - c.gain < _SAME and c.gain > 0
    ]
    names = {s.entry.name for s in scores.scores if s.testable}
    return (best.entry.name, *[n for n in same if n in names])


def _verdict(
    diagnosis: Diagnosis,
    judging: Sequence[Observed],
    data: tuple[dict[str, str], ...],
    seconds: float,
) -> Verdict:
    outputs = judging[0].used
    floor = dict(zip(outputs, judging[0].noise_rms.tolist(), strict=True))
    fit = {
        label: {o: _rms([run.rmse[o] for run in runs.values()]) for o in outputs}
        for label, runs in diagnosis.runs.items()
    } | {"noise_floor": floor}
    units = {q.name: q.unit for q in diagnosis.nominal.outputs if q.name in outputs}
    findings = tuple(_finding(diagnosis, i, fit) for i in range(len(diagnosis.accepted)))
    kind, sentence = _kind(diagnosis, findings)
    first = diagnosis.rounds[0][0] if diagnosis.rounds else None
    return Verdict(
        kind=kind,
        sentence=sentence,
        model=diagnosis.extended.model,
        findings=findings,
        fit=fit,
        units=units,
        parameters={
            e.name: {
                "value": e.value,
                "std": e.std,
                "unit": e.unit,
                "prior": e.prior.mean,
                "prior_std": e.prior.std,
                "on_bound": e.on_bound,
            }
            for e in diagnosis.base.refit.estimates
        },
        not_testable=tuple(
            {
                "effect": s.entry.name,
                "reason": (
                    f"{100 * s.absorption:.1f} % of its signature can be imitated by parameters"
                    if s.absorption >= 0.99
                    else f"only sizes beyond {s.smallest:.2g} {s.entry.unit} would show"
                ),
            }
            for s in (first.scores if first else ())
            if not s.testable
        ),
        next_experiment=_next_experiment(diagnosis),
        data=data,
        location={
            "before": dict(diagnosis.before.alone) if diagnosis.before else {},
            "after": dict(diagnosis.after.alone) if diagnosis.after else {},
        },
        seconds=seconds,
    )


def _finding(diagnosis: Diagnosis, index: int, fit: dict[str, dict[str, float]]) -> Finding:
    candidate, alike = diagnosis.accepted[index]
    entry = candidate.entry
    own = [
        e for e in diagnosis.extended.refit.estimates if e.name.startswith(f"{entry.effect.name}.")
    ]
    parameters = {
        e.name.removeprefix(f"{entry.effect.name}."): Value(e.value, e.unit, e.std) for e in own
    }
    share = _explained(fit)
    name = f"{entry.effect.name}.{entry.size_parameter}"
    size = next((e for e in own if e.name == name), None)
    about = entry.effect.about
    text = (
        f"Missing: {entry.name.replace('_', ' ')} at {', '.join(entry.ports)}"
        + (
            f", {entry.size_parameter} {size.value:.3g} +- {size.std:.2g} {size.unit}"
            if size
            else ""
        )
        + (f"; cannot be told from {', '.join(alike[1:])}" if len(alike) > 1 else "")
        + (f"; {about.separated_by} would decide" if len(alike) > 1 and about.separated_by else "")
        + "."
    )
    gain, low, _ = candidate.held_out
    deviation = max((gain - low) / 2.576, 1e-9)
    return Finding(
        where=entry.ports,
        effect=entry.name,
        alike=alike,
        sentence=text,
        parameters=parameters,
        share_of_excess_explained=share,
        gain=candidate.gain,
        p_value=0.5 * math.erfc(gain / deviation / math.sqrt(2)),
    )


def _explained(fit: dict[str, dict[str, float]]) -> float:
    """Share of the mean square error beyond the noise that the extension removes."""
    shares = []
    for output, noise in fit["noise_floor"].items():
        before = fit["refitted"][output] ** 2 - noise**2
        after = fit["extended"][output] ** 2 - noise**2
        if math.isfinite(before) and before > 0:
            shares.append(1.0 - max(after, 0.0) / before)
    return float(np.clip(np.mean(shares), 0.0, 1.0)) if shares else math.nan


def _kind(diagnosis: Diagnosis, findings: Sequence[Finding]) -> tuple[Kind, str]:
    base, extended = diagnosis.base, diagnosis.extended
    if findings:
        sentence = " ".join(f.sentence for f in findings)
        if extended.share > IMPERFECT:
            sentence += " Something else is still left out."
        if any(len(f.alike) > 1 for f in findings):
            return "named_class", sentence
        sensor = all(c.entry.group == "sensor" for c, _ in diagnosis.accepted)
        return ("sensor" if sensor else "named"), sentence
    if base.share <= IMPERFECT:
        return (
            "nothing_missing",
            "Nothing is missing: with refitted parameters the model explains the recordings to the"
            " noise of the sensors.",
        )
    where = diagnosis.before.best if diagnosis.before else "an unknown place"
    return (
        "unexplained",
        f"Something is left out, most likely at {where}, but no effect of the library explains it"
        " on the held-out recordings.",
    )


def _next_experiment(diagnosis: Diagnosis) -> dict[str, object]:
    for candidate, alike in diagnosis.accepted:
        if len(alike) > 1:
            about = candidate.entry.effect.about
            return {
                "sentence": (
                    f"To tell {candidate.entry.name} from {', '.join(alike[1:])}:"
                    f" {about.separated_by or 'record with another excitation'}."
                ),
                "separation_sigma": None,
            }
    return {}


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
