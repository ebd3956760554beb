"""The first screen of a diagnosis: what, where, when, how sure, how much better, what next."""

from __future__ import annotations

import math

from workbench.diagnosis.comparison import Proof
from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.diagnosis.location.missing_signal import Occurrence
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import Finding, Verdict
from workbench.model.units import in_time, in_times, with_unit
from workbench.reports.diagnosis_tables import hull
from workbench.reports.figures.diagnosis import as_read, farthest_off
from workbench.reports.page import Answers
from workbench.reports.tables import interval, number, plain, plus_minus

KINDS: dict[str, str] = {
    "data_unfit": "the recordings are unfit to judge",
    "nothing_missing": "nothing is missing",
    "parameter": "a value is wrong",
    "likely": "likely, not sure",
    "sensor": "a sensor is wrong",
    "named": "named",
    "named_class": "named up to look-alikes",
    "located_unnamed": "located, without a name",
    "unexplained": "not explained",
}
"""Verdicts as people read them."""


def diagnosis_answers(diagnosis: Diagnosis, proof: Proof, verdict: Verdict) -> Answers:
    """Answer what a reader wants to know first; a question without an answer is left out."""
    entries = (
        ("what", _what(verdict)),
        ("where", _where(verdict)),
        ("when", _when(diagnosis, verdict)),
        ("how sure", _how_sure(diagnosis, proof, verdict)),
        ("what else it could be", _what_else(verdict)),
        ("how much better", _better(proof) if diagnosis.improved else ""),
        ("still left", _left(verdict)),
        ("record next", next_step(verdict)),
    )
    return Answers(tuple((question, answer) for question, answer in entries if answer))


def _what(verdict: Verdict) -> str:
    named = [_named(f) for f in verdict.findings if f.effect and f.effect != "nonparametric"]
    if named:
        return "; ".join(named)
    if verdict.kind == "unexplained" and verdict.findings:
        # When and where follow below.
        return f"{plain(verdict.findings[0].sentence).split('. ')[0]}."
    return plain(verdict.sentence)


def _named(finding: Finding) -> str:
    """Return the name of what was found, with its size: the first of its parameters."""
    name = plain(finding.effect or "")
    for parameter, size in finding.parameters.items():
        value, std, unit = size.read
        said = f"{plus_minus(value, std)} {unit}".removesuffix(" 1")
        return f"{name}, {plain(parameter)} {said}"
    return name


def _where(verdict: Verdict) -> str:
    said = (
        ", ".join(filter(None, (name + ", ".join(ports), seen.where if seen else "")))
        for name, ports, seen in _occurrences(verdict)
    )
    return plain("; ".join(said))


def _occurrences(verdict: Verdict) -> list[tuple[str, tuple[str, ...], Occurrence | None]]:
    """Return name, ports and occurrence of every finding, or of what could not be located.

    A single finding needs no name before its place.
    """
    if not verdict.findings:
        return [("", (), verdict.occurrence)]
    several = len(verdict.findings) > 1
    return [
        (f"{f.effect}: " if several and f.effect else "", f.where, f.occurrence)
        for f in verdict.findings
    ]


def _when(diagnosis: Diagnosis, verdict: Verdict) -> str:
    """Say when what is missing acts; else when the refitted model is farthest off, and where."""
    told = [
        f"{name}{seen.when}, up to {seen.how_large} rms"
        + (f", every {in_time(seen.period)}" if math.isfinite(seen.period) else "")
        for name, _, seen in _occurrences(verdict)
        if seen is not None
    ]
    if told:
        return plain("; ".join(told))
    runs = {name: run for name, run in diagnosis.runs.get("refitted", {}).items() if run.finite}
    if not runs or verdict.kind in ("nothing_missing", "parameter"):
        return ""
    title, worst = worst_run(runs)
    run = as_read(diagnosis.nominal, worst)
    rows = farthest_off(run)
    unit, seen = run.units[0], run.measured[rows, 0]
    seen = seen[seen == seen]
    (first, last), unit_of_time = in_times([float(t) for t in run.time[rows][[0, -1]]])
    at = interval(float(seen.min()), float(seen.max()), 2, unit=unit) if seen.size else ""
    return (
        (
            f"most from {first} to {last} {unit_of_time} of"
            f" {plain(title.split('/')[-1])}" + (f", at {plain(run.used[0])} {at}" if at else "")
        )
        .removesuffix(" 1")
        .replace(" °", "°")
    )


def worst_run(runs: dict[str, FreeRun]) -> tuple[str, FreeRun]:
    """Return the recording on which the first output is farthest off, against what moves there."""
    return max(runs.items(), key=lambda item: _share(item[1]))


def _share(run: FreeRun) -> float:
    name = run.used[0]
    return run.rmse[name] / run.spread[name] if run.spread[name] > 0 else 0.0


def _how_sure(diagnosis: Diagnosis, proof: Proof, verdict: Verdict) -> str:
    said = []
    if not verdict.findings and proof.errors:
        most = max(row.over_noise("refitted") for row in proof.errors if "refitted" in row.rmse)
        said.append(f"held-out error at most {number(most, 2)} times the sensor's noise")
    for finding in verdict.findings[:1]:
        gain, low, high = finding.held_out
        if math.isfinite(gain) and math.isfinite(low):
            said.append(
                f"gains {number(gain)} of log likelihood on held-out recordings (99 %:"
                f" {interval(low, high)})"
            )
        if math.isfinite(finding.weight):
            said.append(f"weight {finding.weight:.2f} among the sets of effects that were compared")
        if math.isfinite(finding.excess_explained):
            said.append(f"removes {100 * finding.excess_explained:.3g} % of the excess error")
        said += [plain(doubt) for doubt in finding.doubts]
    term = accepted_term(diagnosis)
    if term is not None:
        said.append(hull_sentence(term).removesuffix("."))
    return f"{KINDS[verdict.kind]}{': ' if said else ''}{'; '.join(said)}"


def _what_else(verdict: Verdict) -> str:
    """Name the look-alikes, or the law that comes next and how far it is behind."""
    alike = [plain(other) for f in verdict.findings for other in f.alike[1:]]
    if alike:
        return f"these recordings cannot tell it from {', '.join(alike)}"
    if len(verdict.findings) != 1 or not math.isfinite(verdict.findings[0].held_out[0]):
        return ""
    behind = {
        row["effect"]: verdict.findings[0].held_out[0] - row["held_out_gain"][0]
        for row in verdict.refused
        if str(row.get("rule", "")).startswith("surpassed")
        and row.get("held_out_gain")
        and math.isfinite(row["held_out_gain"][0])
    }
    if not behind:
        return "no other law of the library"
    name = min(behind, key=behind.__getitem__)
    return f"next best: {plain(name)}, {number(behind[name])} of log likelihood behind"


def _better(proof: Proof) -> str:
    """Say how far the errors on held-out recordings fall, or rise."""
    moved = []
    for row in proof.errors:
        if {"refitted", "extended"} <= set(row.rmse):
            before, after = (number(row.rmse[k]) for k in ("refitted", "extended"))
            moved.append(f"{plain(row.output)} {before} → {with_unit(after, row.unit)}")
    return f"error on held-out recordings: {', '.join(moved)}" if moved else ""


def _left(verdict: Verdict) -> str:
    """Return what the sentence says beyond its findings."""
    if not verdict.findings:
        return ""
    rest = verdict.sentence
    for finding in verdict.findings:
        rest = rest.replace(finding.sentence, "")
    return plain(rest.strip().removeprefix("Something else is still left out: "))


def next_step(verdict: Verdict) -> str:
    """Say what to record next, with the predicted separation."""
    step = verdict.next_experiment
    sentence = plain(str(step.get("sentence") or ""))
    sigma = step.get("separation_sigma")
    if sentence and sigma and "deviations" not in sentence:
        sentence += f" Predicted separation: {number(sigma)} standard deviations."
    return sentence


def accepted_term(diagnosis: Diagnosis) -> NonparametricTerm | None:
    """Return the term without a name that stands in the improved model; None if there is none."""
    term = diagnosis.nonparametric
    return term if term is not None and term.accepted and not diagnosis.accepted else None


def hull_sentence(term: NonparametricTerm) -> str:
    """Say where a fitted curve holds."""
    ranges = []
    for a in term.arguments:
        (low, high), unit = hull(term, a)
        ends = f"{number(low)} to {number(high)} {unit}".removesuffix(" 1")
        ranges.append(f"{plain(a.name)} from {ends}")
    curves, own = ("curve is", "its") if len(ranges) == 1 else ("curves are", "their")
    return f"The {curves} empirical: valid inside {own} data hull, {' and '.join(ranges)}."
