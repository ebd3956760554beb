"""From what a diagnosis computed to its verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.diagnosis.doubts import left_out_too, most_missing, still_off
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, as_it_reads
from workbench.diagnosis.findings import computed, named, own_parameters, without_name, wrong_values
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.held_out import held_out_errors, over_noise
from workbench.diagnosis.selection.rules import lacks_little
from workbench.diagnosis.selection.score import COLLINEAR, Score
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import AWAY, Finding, Kind, Verdict
from workbench.files import picked
from workbench.model.units import from_si, in_time, read_with_deviation, readably, with_unit

_MOST_SAID = 5
"""Effects that a sentence names, and sets of effects that a verdict weighs."""

_FURTHER = 0.1
"""Part of its range by which an input goes further than where it was fitted to be told."""

_CLEARLY = 100.0
"""Gain of an unknown input from which on it is told, however little it moves; noise gives none."""

_LEAST_WEIGHT = 0.005
"""Weight below which a set of effects is not worth a line."""


def conclude(diagnosis: Diagnosis) -> Verdict:
    """Put what a finished diagnosis found into a verdict."""
    prepared, nominal = diagnosis.prepared, diagnosis.nominal
    if prepared.unfit:
        return Verdict("data_unfit", prepared.unfit, nominal, **_spent(diagnosis))
    validated = diagnosis.validated
    assert validated is not None
    fit = held_out_errors(validated.runs, prepared.judging)
    if count := len(diagnosis.accepted):
        rest = left_out_too(diagnosis, fit)
        doubts = (*most_missing(diagnosis), *still_off(diagnosis, fit))
        findings = tuple(named(diagnosis, i, fit, rest, doubts) for i in range(count))
    else:
        rest, findings = "", without_name(diagnosis, fit)
    kind, sentence = _kind(diagnosis, findings, rest, _drifts(diagnosis, fit))
    left = validated.occurrence() if kind == "unexplained" and not findings else None
    used = prepared.judging[0].used
    return Verdict(
        kind=kind,
        sentence=f"{sentence} {left or ''}".rstrip() + _beyond(diagnosis, kind),
        model=as_it_reads(diagnosis.extended.model),
        findings=findings,
        fit=fit,
        units={q.name: q.unit for q in nominal.outputs if q.name in used},
        parameters=_parameters(diagnosis.refitted),
        improved=_parameters(diagnosis.extended) if diagnosis.improved else {},
        not_testable=_not_testable(diagnosis),
        refused=_refused(diagnosis),
        weights=tuple(w for w in diagnosis.weights[:_MOST_SAID] if w.weight >= _LEAST_WEIGHT),
        next_experiment=validated.advice,
        location={
            "before": dict(diagnosis.before.alone) if diagnosis.before else {},
            "after": dict(diagnosis.after.alone) if diagnosis.after else {},
        },
        **_spent(diagnosis),
        occurrence=left,
    )


def _drifts(diagnosis: Diagnosis, fit: Mapping[str, Mapping[str, float]]) -> str:
    """Say how far runs drift off that only uncertain parameters excuse; empty if they do not.

    What a model leaves out makes its parameters uncertain too, and then excuses itself.
    """
    scored, over = diagnosis.scored, over_noise(fit, "refitted")
    output = max(over, key=over.__getitem__, default="")
    if scored is None or not over or over[output] <= rules.DRIFTING:
        return ""
    if lacks_little(scored.excess, diagnosis.prepared.fitting):
        return ""
    return (
        f" On the held-out recordings {output.replace('_', ' ')} runs {over[output]:.3g} times as"
        " far off as its sensor's noise, which the uncertainty of the parameters would do too, but"
        " single samples are less likely than noise alone makes them."
    )


def _kind(
    diagnosis: Diagnosis, findings: Sequence[Finding], rest: str, drifts: str
) -> tuple[Kind, str]:
    """Return the kind of a verdict and its sentence.

    Args:
        drifts: What is said of runs that only uncertain parameters excuse; empty if nothing.
    """
    far = _far(diagnosis)
    if findings and not diagnosis.accepted:
        if findings[0].effect is not None:
            return "located_unnamed", findings[0].sentence
        return (
            "unexplained",
            f"{findings[0].sentence} No effect of the library explains it on the held-out"
            f" recordings.{far}",
        )
    if findings:
        sentence = " ".join(f.sentence for f in findings) + rest + _other_values(diagnosis)
        if all(f.belief == "likely" for f in findings):
            return "likely", sentence
        entries = [c.entry for c, _ in diagnosis.accepted]
        if any(len(f.alike) > 1 or f.or_value for f in findings) or any(
            computed(e, diagnosis.nominal) for e in entries
        ):
            return "named_class", sentence
        sensor = all(e.group == "sensor" for e in entries)
        return ("sensor" if sensor else "named"), sentence
    bound = wrong_values(diagnosis)
    if bound:
        names = ", ".join(f"{e.name} at {e.value:.3g} {e.unit}" for e in bound)
        return (
            "parameter",
            "No physics is missing that these recordings can show, but a value is wrong: the"
            f" refit ends on its bound with {names}. Check it, and what the notes say of values"
            f" that go with it.{far}",
        )
    if diagnosis.complete and diagnosis.nominal.traits.held:
        return (
            "parameter",
            "No physics is missing that these recordings can show, but a value is wrong:"
            f"{_other_values(diagnosis)} With it the model predicts them nearly to the noise of the"
            f" sensors.{_coloured(diagnosis)}",
        )
    if diagnosis.complete and drifts:
        return (
            "unexplained",
            "Something is left out, and no effect of the library that was tried explains it on the"
            f" held-out recordings.{drifts}",
        )
    if diagnosis.complete:
        return (
            "nothing_missing",
            "Nothing is missing that these recordings can show: with refitted parameters the model"
            f" predicts them nearly to the noise of the sensors.{_coloured(diagnosis)}"
            f"{_small(diagnosis)}",
        )
    return (
        "unexplained",
        "Something is left out, but neither a place nor an effect of the library explains it on the"
        f" held-out recordings.{far}",
    )


def _other_values(diagnosis: Diagnosis) -> str:
    """Say what constants are that the author of the plant holds."""
    told = []
    for name, held in diagnosis.nominal.traits.held:
        q, e = diagnosis.nominal.parameter(name), diagnosis.extended.refit.estimate(name)
        shown = q.unit, q.display_unit, abs(e.value)
        value, std, unit = read_with_deviation(e.value, e.std, *shown)
        was = with_unit(f"{float(readably(held, *shown)[0]):.4g}", unit)
        now = with_unit(f"{value:.5g} +- {std:.2g}", unit)
        told.append(f" {name.replace('_', ' ')} is {now}, where the plant holds {was}.")
    return "".join(told)


def _far(diagnosis: Diagnosis) -> str:
    """Say how far the runs of the refitted nominal model are from the noise."""
    scored = diagnosis.scored
    if scored is None or scored.farthest[1] <= rules.NEAR_NOISE:
        return ""
    output, ratio = scored.farthest
    if ratio > AWAY:
        return (
            f" On the held-out recordings {output.replace('_', ' ')} runs away from what was"
            " measured."
        )
    return (
        f" On the held-out recordings the error of {output.replace('_', ' ')} is {ratio:.3g} times"
        " what noise and the uncertainty of the parameters would leave."
    )


def _small(diagnosis: Diagnosis) -> str:
    """Say where an unknown input gains clearly, though runs without it are near the noise."""
    before, scored = diagnosis.before, diagnosis.scored
    if before is None or scored is None or max(before.alone.values(), default=0.0) < _CLEARLY:
        return ""
    ports = ", ".join(before.ports(diagnosis.nominal))
    output, ratio = scored.farthest
    return (
        f" Something small acts at {ports}, which no law of the library explains: without it the"
        f" runs are off by {ratio:.2g} times what noise would leave, at {output.replace('_', ' ')}."
    )


def _coloured(diagnosis: Diagnosis) -> str:
    """Say of which measurements the noise is correlated."""
    told = [
        f"{q.name.replace('_', ' ')} ({in_time(q.noise_correlation_time)})"
        for q in diagnosis.nominal.outputs
        if q.correlated_noise_rms > 0.0
    ]
    if not told:
        return ""
    return (
        f" That noise is correlated from sample to sample, of {', '.join(told)}, and follows no"
        " input."
    )


def _beyond(diagnosis: Diagnosis, kind: Kind) -> str:
    """Say what goes much further on the held-out recordings than where it was fitted.

    What acts there need not show in what was fitted. An input need not go far to meet an end of
    what a drive can do.
    """
    if kind not in ("unexplained", "likely"):
        return ""
    fitted, judged = diagnosis.prepared.fitting, diagnosis.prepared.judging
    known = {q.name: q for q in (*diagnosis.nominal.inputs, *diagnosis.nominal.outputs)}
    names = (*(q.name for q in diagnosis.nominal.inputs), *fitted[0].used)
    (low, high), (lowest, highest) = (
        [end([end([*r.inputs.T, *r.outputs.T], axis=1) for r in group], axis=0)
         for end in (np.nanmin, np.nanmax)]
        for group in (fitted, judged)
    )  # fmt: skip
    enough = np.where(np.arange(len(names)) < len(diagnosis.nominal.inputs), _FURTHER, 1.0)
    span = np.where(high > low, enough * (high - low), np.inf)
    above, below = highest - high, low - lowest
    worst = int(np.argmax(np.maximum(above, below) / span))
    up = above[worst] > below[worst]
    if not (above if up else below)[worst] > span[worst]:
        return ""
    name = names[worst]
    unit = known[name].display_unit
    ends = (highest, high) if up else (lowest, low)
    there, here = (with_unit(f"{from_si(end[worst], unit):.4g}", unit) for end in ends)
    return (
        f" Held out, {name.replace('_', ' ')} goes to {there}, where it was fitted to {here}"
        " only: fit on what goes as far."
    )


def conclude_early(diagnosis: Diagnosis, step: str, *, after: float | None = None) -> Verdict:
    """Put what was found before an interruption into a verdict that claims nothing beyond it.

    Args:
        step: What was being done, in plain words.
        after: Time limit that ended it, in s; None if it was interrupted.
    """
    ended = "Interrupted" if after is None else f"Ended after {after:g} s"
    if diagnosis.concluded is not None:
        # A first search had come to its end.
        said = f"{diagnosis.concluded.sentence} {ended} while {step}."
        return replace(diagnosis.concluded, sentence=said, interrupted=True)
    findings = tuple(
        Finding(
            where=candidate.entry.ports,
            effect=candidate.name,
            alike=alike,
            sentence=f"Found before the interruption: {candidate.name.replace('_', ' ')}.",
            parameters=own_parameters(diagnosis.extended, candidate.name),
            gain=candidate.gain,
            held_out=candidate.held_out,
            belief="likely",
            doubts=(*candidate.doubts, "the diagnosis ended before it was proved"),
        )
        for candidate, alike in diagnosis.accepted
    )
    kind: Kind = "likely" if findings else "unexplained"
    names = ", ".join(f.effect.replace("_", " ") for f in findings if f.effect) or "nothing"
    return Verdict(
        kind,
        f"{ended} while {step}; found until then: {names}{_most_at(diagnosis)}; not"
        f" tried{_not_tried(diagnosis)}.",
        as_it_reads(diagnosis.extended.model) if diagnosis.fitted else diagnosis.nominal,
        findings=findings,
        parameters=_parameters(diagnosis.base) if diagnosis.fitted else {},
        refused=_refused(diagnosis),
        location={"before": dict(diagnosis.before.alone)} if diagnosis.before else {},
        **_spent(diagnosis),
        interrupted=True,
    )


def _most_at(diagnosis: Diagnosis) -> str:
    """Say where most is missing, as long as nothing was found for it."""
    if diagnosis.accepted or diagnosis.before is None:
        return ""
    ports = diagnosis.before.ports(diagnosis.nominal)
    return f", but most is missing at {', '.join(ports)}" if ports else ""


def _not_tried(diagnosis: Diagnosis) -> str:
    """Say what a diagnosis did not come to; effects by falling score."""
    if diagnosis.fitted is None:
        return ": the refit of the nominal model and any effect"
    if diagnosis.scored is None:
        return ": any effect"
    if diagnosis.selected is not None and diagnosis.selected.finished:
        return ": the proof on the held-out recordings"
    if diagnosis.accepted:
        return ": what else may be missing, and the proof on the held-out recordings"
    tried = {c.name for _, candidates in diagnosis.rounds for c in candidates}
    scores = sorted(diagnosis.scored.scores.scores, key=lambda s: -s.gain)
    names = [s.entry.name.replace("_", " ") for s in scores if s.entry.name not in tried]
    more = len(names) - _MOST_SAID
    if not names:
        return ": the proof on the held-out recordings"
    rest = f" and {more} more effects" if more > 0 else ""
    return f" to the end: {', '.join(names[:_MOST_SAID])}{rest}"


def _spent(diagnosis: Diagnosis) -> dict[str, Any]:
    return {"data": diagnosis.prepared.data} | picked(diagnosis, "seconds work")


def _parameters(fit: ProcessNoiseFit) -> dict[str, dict[str, object]]:
    told = "value std unit prior=prior.mean prior_std=prior.std on_bound"
    return {e.name: picked(e, told) for e in fit.refit.estimates}


def _not_testable(diagnosis: Diagnosis) -> tuple[Mapping[str, str], ...]:
    scores = diagnosis.scored.scores.scores if diagnosis.scored else ()

    def reason(s: Score) -> str:
        if s.collinearity >= COLLINEAR:
            return f"{100 * s.collinearity:.1f} % of its signature is collinear with parameters"
        if s.entry.unit == "1" and s.entry.largest_size == 1.0 < s.smallest:
            return "not even all of it would show"
        size = diagnosis.nominal.size_text(s.smallest, s.entry.unit, s.entry.effect.places)
        return f"only sizes beyond {size} would show"

    return tuple({"effect": s.entry.name, "reason": reason(s)} for s in scores if not s.testable)


def _refused(diagnosis: Diagnosis) -> tuple[Mapping[str, object], ...]:
    """List what was tried and refused, surpassed, or found and taken back."""
    rows: dict[str, Mapping[str, object]] = {}

    def told(c: Candidate, rule: str, reason: str) -> None:
        rows[c.name] = {
            "effect": c.name,
            "rule": rule,
            "reason": reason,
            "log_likelihood_gain": c.gain,
            "held_out_gain": list(c.held_out),
        }

    for _, candidates in diagnosis.rounds:
        for c in candidates:
            if c.refused and c.name not in rows:
                told(c, c.rule or ("surpassed" if c.followed else "surpassed at first"), c.refused)
    kept = {c.name for c, _ in diagnosis.accepted}
    for c, why in diagnosis.withdrawn:
        told(c, "taken back", why)
    return tuple(row for name, row in rows.items() if name not in kept)
