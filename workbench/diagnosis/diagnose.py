"""Diagnosis: locate a mismatch, name what was left out, model it, prove it on held-out data."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.diagnosis.free_run import FreeRun, free_run
from workbench.diagnosis.likely import LikelyFit, extended_start, fit_likely, white_cost
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
from workbench.errors import WorkbenchError
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
"""Share of the excess misfit of the refitted nominal that a single effect must explain, or of what
is left after another effect."""

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


def _started(recordings: Sequence[Observed], diagnosis: Diagnosis) -> list[Observed]:
    model = diagnosis.extended.model
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
    perfect = white_cost(fitting, diagnosis.nominal)
    first_excess = max(diagnosis.base.cost - perfect, 0.0)
    for number in range(MOST_FINDINGS):
        current = diagnosis.extended
        excess = max(current.cost - perfect, 0.0)
        least = max(LEAST_SHARE * excess, LEAST_OF_ALL * first_excess)
        if number and excess < least:
            break
        given = library(current.model, outputs=fitting[0].used) if entries is None else entries
        attached = {effect.name for effect in current.model.effects}
        tried = [e for e in given if not e.stiff and e.name not in attached]
        say(f"scoring {len(tried)} effects" + (" on what is left" if number else ""))
        started, judged = _started(fitting, diagnosis), _started(judging, diagnosis)
        scores = score_library(current.model, started, free, tried, share=current.share)
        # A score tells little of the gain of a large effect, such as a lag of many samples: only
        # what is left after another effect is asked for a share of the gain beforehand.
        chosen = shortlist(scores, most=3, least=0.05 * least) if number else shortlist(scores)
        candidates = refit_candidates(
            current,
            chosen,
            free,
            started,
            judged,
            charge=charge_for(len(tried), samples, 2),
            least_gain=least,
            jobs=jobs,
            progress=say,
        )
        diagnosis.rounds.append((scores, candidates))
        best = next((c for c in candidates if not c.refused), None)
        if best is None or best.fit is None:
            break
        diagnosis.accepted.append((best, _alike(best, candidates, scores)))
        diagnosis.extended = best.fit
        score = next(s for s in scores.scores if s.entry.name == best.entry.name)
        free += entry_priors(score)[0]
        say(f"found {best.entry.name}")
        if best.fit.share <= min(IMPERFECT, current.share / 3) and best.fit.share <= 0.03:
            break


def _alike(best: Candidate, candidates: Sequence[Candidate], scores: Scores) -> tuple[str, ...]:
    """Name the accepted effect and those that explain the recordings as well."""
    same = [
        c.entry.name
        for c in candidates
        if c is not best and c.fit is not None and best.gain - c.gain < _SAME and c.gain > 0
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
    size = candidate.size
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
