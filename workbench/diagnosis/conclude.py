"""From what a diagnosis computed to its verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from workbench.diagnosis.estimation.fixed_parameters import value_instead
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    as_it_reads,
    extended_start,
)
from workbench.diagnosis.estimation.refit_result import Estimate
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.location.missing_signal import Occurrence
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.held_out import (
    explained,
    held_out_errors,
    over_floor,
    over_noise,
)
from workbench.diagnosis.selection.moments import levels, moments
from workbench.diagnosis.selection.score import COLLINEAR
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import Finding, Kind, Value, Verdict
from workbench.errors import NumericalError
from workbench.model import Effect, Model
from workbench.model.quantities import declared_unit, shown_in
from workbench.model.units import from_si, in_time, in_times, with_unit
from workbench.physics.drift import along_curve
from workbench.physics.hypothesis import Hypothesis

_MOST_SAID = 5
"""Effects that a sentence names, and sets of effects that a verdict weighs."""

_LEAST_ALIKE = 0.1
"""Weight from which what stands for an effect in a set of effects cannot be told from it."""

_FURTHER = 0.1
"""Part of its range by which an input goes further than where it was fitted to be told."""

_SURE_OF = 3.0
"""Standard deviations within which a time constant must be longer than a sample."""

_LEAST_WEIGHT = 0.005
"""Weight below which a set of effects is not worth a line."""


def conclude(diagnosis: Diagnosis) -> Verdict:
    """Put what a finished diagnosis found into a verdict."""
    prepared, nominal = diagnosis.prepared, diagnosis.nominal
    if prepared.unfit:
        return Verdict(
            "data_unfit",
            prepared.unfit,
            nominal,
            data=prepared.data,
            seconds=diagnosis.seconds,
            work=diagnosis.work,
        )
    validated = diagnosis.validated
    assert validated is not None
    fit = held_out_errors(validated.runs, prepared.judging)
    count = len(diagnosis.accepted)
    rest = _rest(diagnosis, fit) if count else ""
    doubts = (*_still_missing(diagnosis), *_still_off(diagnosis, fit)) if count else ()
    findings = tuple(
        _finding(diagnosis, i, fit, (*doubts, *_differs(found.candidate.entry.effect, rest)))
        for i, found in enumerate(diagnosis.accepted)
    )
    findings = findings or _without_name(diagnosis, fit)
    kind, sentence = _kind(diagnosis, findings, rest)
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
        data=prepared.data,
        location={
            "before": dict(diagnosis.before.alone) if diagnosis.before else {},
            "after": dict(diagnosis.after.alone) if diagnosis.after else {},
        },
        seconds=diagnosis.seconds,
        work=diagnosis.work,
        occurrence=left,
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
    worst = int(np.argmax(np.maximum(highest - high, low - lowest) / span))
    up = highest[worst] - high[worst] > low[worst] - lowest[worst]
    further = highest[worst] - high[worst] if up else low[worst] - lowest[worst]
    if not further > span[worst]:
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
    findings = tuple(
        Finding(
            where=candidate.entry.ports,
            effect=candidate.entry.name,
            alike=alike,
            sentence=f"Found before the interruption: {candidate.entry.name.replace('_', ' ')}.",
            parameters=_own(diagnosis.extended, candidate.entry.effect.name),
            gain=candidate.gain,
            held_out=candidate.held_out,
            belief="likely" if candidate.doubts else "sure",
            doubts=candidate.doubts,
        )
        for candidate, alike in diagnosis.accepted
    )
    kind: Kind = "unexplained"
    if findings:
        kind = "named_class" if any(len(f.alike) > 1 for f in findings) else "named"
    names = ", ".join(f.effect.replace("_", " ") for f in findings if f.effect) or "nothing"
    ended = "Interrupted" if after is None else f"Ended after {after:g} s"
    return Verdict(
        kind,
        f"{ended} while {step}; found until then: {names}{_most_at(diagnosis)}; not"
        f" tried{_not_tried(diagnosis)}.",
        as_it_reads(diagnosis.extended.model) if diagnosis.fitted else diagnosis.nominal,
        findings=findings,
        parameters=_parameters(diagnosis.base) if diagnosis.fitted else {},
        refused=_refused(diagnosis),
        data=diagnosis.prepared.data,
        location={"before": dict(diagnosis.before.alone)} if diagnosis.before else {},
        seconds=diagnosis.seconds,
        work=diagnosis.work,
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
    tried = {c.entry.name for _, candidates in diagnosis.rounds for c in candidates}
    scores = sorted(diagnosis.scored.scores.scores, key=lambda s: -s.gain)
    names = [s.entry.name.replace("_", " ") for s in scores if s.entry.name not in tried]
    more = len(names) - _MOST_SAID
    if not names:
        return ": the proof on the held-out recordings"
    rest = f" and {more} more effects" if more > 0 else ""
    return f" to the end: {', '.join(names[:_MOST_SAID])}{rest}"


def _parameters(fit: ProcessNoiseFit) -> dict[str, dict[str, object]]:
    return {
        e.name: {
            "value": e.value,
            "std": e.std,
            "unit": e.unit,
            "prior": e.prior.mean,
            "prior_std": e.prior.std,
            "on_bound": e.on_bound,
        }
        for e in fit.refit.estimates
    }


def _not_testable(diagnosis: Diagnosis) -> tuple[Mapping[str, str], ...]:
    scores = diagnosis.scored.scores.scores if diagnosis.scored else ()
    return tuple(
        {
            "effect": s.entry.name,
            "reason": (
                f"{100 * s.collinearity:.1f} % of its signature is collinear with parameters"
                if s.collinearity >= COLLINEAR
                else "only sizes beyond"
                f" {diagnosis.nominal.size_text(s.smallest, s.entry.unit, s.entry.ports)}"
                " would show"
            ),
        }
        for s in scores
        if not s.testable
    )


def _refused(diagnosis: Diagnosis) -> tuple[Mapping[str, object], ...]:
    """List what was tried and refused, surpassed, or found and taken back."""
    rows: dict[str, Mapping[str, object]] = {}

    def told(c: Candidate, rule: str, reason: str) -> None:
        rows[c.entry.name] = {
            "effect": c.entry.name,
            "rule": rule,
            "reason": reason,
            "log_likelihood_gain": c.gain,
            "held_out_gain": list(c.held_out),
        }

    for _, candidates in diagnosis.rounds:
        for c in candidates:
            if c.refused and c.entry.name not in rows:
                told(c, c.rule or ("surpassed" if c.followed else "surpassed at first"), c.refused)
    kept = {c.entry.name for c, _ in diagnosis.accepted}
    for c, why in diagnosis.withdrawn:
        told(c, "taken back", why)
    return tuple(row for name, row in rows.items() if name not in kept)


def _own(fit: ProcessNoiseFit, effect: str) -> dict[str, Value]:
    return {
        e.name.removeprefix(f"{effect}."): Value(e.value, e.unit, e.std, fit.model.read_in(e.name))
        for e in fit.refit.estimates
        if e.name.startswith(f"{effect}.")
    }


def _since(diagnosis: Diagnosis, effect: Effect) -> str:
    """Say from when on an event acts in each recording; empty if it is none."""
    model, prepared = diagnosis.extended.model, diagnosis.prepared
    attached = next((e for e in model.effects if e.name == effect.name), None)
    if attached is None or not attached.about.moment or attached.about.period:
        return ""
    said = []
    for seen in (*prepared.fitting, *prepared.judging):
        begin, end = moments(model, attached, seen.name)
        last = seen.sample_time * (len(seen.outputs) - 2)
        if begin > last or end < 2.0 * seen.sample_time:
            said.append(f"not in {seen.name}")
        elif end < last:
            ends, unit = in_times([max(begin, 0.0), end])
            said.append(f"from {' to '.join(ends)} {unit} of {seen.name}")
        elif begin < seen.sample_time:
            said.append(f"throughout {seen.name}")
        else:
            said.append(f"from {in_time(begin)} of {seen.name} on")
    return ", ".join(said)


def _by_recording(model: Model, effect: Effect) -> str:
    """Say where what differs from recording to recording begins; empty if nothing does."""
    attached = next((e for e in model.effects if e.name == effect.name), effect)
    found = levels(model, attached)
    if not found or (not attached.about.level and max(found.values()) == min(found.values())):
        return ""
    subject, size = attached.about.subject, attached.parameters[0]
    unit = model.parameter(subject).unit if subject else size.unit
    told = (f"{model.size_text(v, unit, effect.ports, 3)} in {k}" for k, v in found.items())
    begins = "" if attached.about.level else "begins at "
    return f"; {subject or 'it'} {begins or 'is '}{', '.join(told)}"


def _beside(model: Model, effect: Effect) -> str:
    """Say the value that is told beside the size; empty if there is none."""
    if not effect.about.tells:
        return ""
    q = model.parameter(f"{effect.name}.{effect.about.tells}")
    return f", {effect.about.tells} {model.size_text(q.value, q.unit, effect.ports, 3)}"


def _along(model: Model, effect: Effect) -> str:
    """Say what a parameter is along the signal that it changes with; empty if it does not."""
    found = along_curve(model, effect)
    if not found:
        return ""
    subject, unit = effect.about.subject, model.parameter(f"{effect.name}.middle").unit
    named = [q for q in (*model.states, *model.inputs) if f"_over_{q.name}" in effect.name]
    over = max(named, key=lambda q: len(q.name), default=None)
    said = f"what {subject} multiplies" if over is None else over.name.replace("_", " ")
    read = declared_unit(over.name if over else "", unit, model.quantities)
    unit = read or (shown_in(over) if over else unit)
    own = model.parameter(subject).unit
    told = (
        f"{model.size_text(value, own, effect.ports, 3)} at"
        f" {with_unit(f'{from_si(at, unit):.3g}', unit)}"
        for at, value in found.items()
    )
    return f"; {subject} is {', '.join(told)} of {said}"


def _instead(diagnosis: Diagnosis, name: str) -> list[str]:
    """Return the effects with which, instead of one, a set of all others has a weight."""
    beside = {a.candidate.entry.effect.name for a in diagnosis.accepted} - {name}
    found = []
    for effects, weight in diagnosis.weights:
        other = set(effects) - beside
        if weight >= _LEAST_ALIKE and len(other) == 1 and len(effects) == len(beside) + 1:
            found += [n for n in other if n != name]
    return found


def _weight(diagnosis: Diagnosis, alike: set[str]) -> float:
    """Return the weight of all sets of effects that contain one of some look-alikes."""
    if not diagnosis.weights:
        return math.nan
    return min(1.0, sum(w.weight for w in diagnosis.weights if alike & set(w.effects)))


def _finding(
    diagnosis: Diagnosis, index: int, fit: dict[str, dict[str, float]], together: tuple[str, ...]
) -> Finding:
    candidate, alike = diagnosis.accepted[index]
    entry, nominal = candidate.entry, diagnosis.nominal
    alike = (*alike, *(n for n in _instead(diagnosis, entry.effect.name) if n not in alike))
    parameters = _own(diagnosis.extended, entry.effect.name)
    size = parameters.get(entry.size_parameter)
    tried = {c.entry.name: c.entry for _, candidates in diagnosis.rounds for c in candidates}
    members = (entry, *(tried[name] for name in alike[1:] if name in tried))
    # What each of them is told by; why it is, stands behind a colon.
    texts = (q.effect.about.separated_by.partition(":")[0] for q in members)
    deciding = dict.fromkeys(text for text in texts if text)
    # What was found is doubted alone, and together with all else.
    own = (*_too_quick(diagnosis, parameters), *_beside_larger(diagnosis, index))
    doubts = (*candidate.doubts, *own, *together)
    # A law that is either there or not is told by its other numbers.
    told = {entry.size_parameter: size} if size else parameters
    text = (
        f"{'Likely missing' if doubts else 'Missing'}:"
        f" {entry.name.replace('_', ' ')} at {', '.join(entry.ports)}"
        + "".join(
            f", {name} {value:.3g} +- {std:.2g} {unit}".removesuffix(" 1")
            for name, (value, std, unit) in ((name, v.read) for name, v in told.items())
        )
        + _beside(diagnosis.extended.model, entry.effect)
        + _by_recording(diagnosis.extended.model, entry.effect)
        + _along(diagnosis.extended.model, entry.effect)
        + (f"; cannot be told from {', '.join(alike[1:])}" if len(alike) > 1 else "")
        + (f"; {' or '.join(deciding)} would decide" if len(alike) > 1 and deciding else "")
        + _instead_of(diagnosis, entry)
        + (
            f"; so would another formula for {computed}"
            if (computed := _computed(entry, nominal))
            else ""
        )
        + "."
        + (f" Only likely: {'; '.join(doubts)}." if doubts else "")
    )
    occurrence = diagnosis.validated.occurrence(index) if diagnosis.validated else None
    if occurrence is not None:
        occurrence = replace(occurrence, since=_since(diagnosis, entry.effect))
    return Finding(
        where=entry.ports,
        effect=entry.name,
        alike=alike,
        sentence=f"{text} {occurrence or ''}".rstrip(),
        parameters=parameters,
        excess_explained=explained(fit),
        gain=candidate.gain,
        held_out=candidate.held_out,
        weight=_weight(diagnosis, {entry.effect.name, *alike}),
        p_value=_by_chance(candidate.held_out),
        belief="likely" if doubts else "sure",
        doubts=doubts,
        occurrence=occurrence,
    )


def _computed(entry: Hypothesis, nominal: Model) -> str:
    """Return the output whose formula would do the same as what a sensor does; empty if none.

    What the model computes of its states, such as the pressure of a gas of a volume, may be wrong
    as well as what reads it.
    """
    (port, *more) = entry.ports
    name = port.removesuffix(".reading")
    rows = [i for i, q in enumerate(nominal.outputs) if q.name == name]
    if entry.group != "sensor" or entry.effect.states or more or not rows:
        return ""
    trace = nominal.exact
    slopes = ca.jacobian(trace.outputs[rows[0]], trace.x)
    return name.replace("_", " ") if ca.depends_on(slopes, trace.x) else ""


def _instead_of(diagnosis: Diagnosis, entry: Hypothesis) -> str:
    """Say which value, that no refit changes, is wrong if an effect is not there; or nothing."""
    fit, nominal = diagnosis.extended, diagnosis.nominal
    seen = extended_start(diagnosis.prepared.fitting[0], nominal, fit.model)
    found = value_instead(fit, entry.effect, entry.size_parameter, seen)
    if found is None:
        return ""
    q = nominal.parameter(found[0])
    values = [nominal.size_text(value, q.unit, (q.name,), 3) for value in (found[1], q.value)]
    return (
        f"; {q.name} would do the same if it is {values[0]}, not {values[1]} (no refit changes it)"
    )


def _still_missing(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Doubt what was found where most of what was missing is missing still."""
    before, after = diagnosis.before, diagnosis.after
    if before is None or after is None:
        return ()
    share = still_missing(before, after)
    if not share > rules.MOST_LEFT:
        return ()
    place = after.best.replace("_", " ")
    return (f"beside it {100 * share:.0f} % of what was missing is still missing, at {place}",)


def _too_quick(diagnosis: Diagnosis, own: Mapping[str, Value]) -> tuple[str, ...]:
    """Doubt a memory that may last no longer than a sample: without one it is another law.

    A time constant is known by factors, so that one beyond what was recorded is no doubt.
    """
    sample = max(seen.sample_time for seen in diagnosis.prepared.fitting)
    return tuple(
        f"its {name.replace('_', ' ')} may be shorter than a sample, {in_time(sample)}"
        for name, q in own.items()
        if name.endswith("time_constant")
        and q.value * math.exp(-_SURE_OF * q.std / q.value) < sample
    )


def _beside_larger(diagnosis: Diagnosis, index: int) -> tuple[str, ...]:
    """Doubt what does so little beside another finding that it may be the rest of its shape."""
    validated = diagnosis.validated
    own = validated.occurrence(index) if validated else None
    if validated is None or own is None:
        return ()
    model = diagnosis.nominal
    others = ((i, validated.occurrence(i)) for i in range(len(diagnosis.accepted)) if i != index)
    larger = [(o.largest, i) for i, o in others if o is not None and _add_up(model, o, own)]
    most, which = max(larger, default=(0.0, 0))
    if own.largest >= rules.BESIDE_LARGER * most:
        return ()
    name = diagnosis.accepted[which].candidate.entry.name.replace("_", " ")
    return (
        f"it is {100 * own.largest / most:.0f} % of {name} at {own.port}, of whose shape it may be"
        " the rest",
    )


def _add_up(model: Model, one: Occurrence, other: Occurrence) -> bool:
    """Say whether two signals are at one place, or add up in the rate of a state."""
    names = [port.name for port in model.ports]
    if one.port == other.port or one.unit != other.unit or {one.port, other.port} - {*names}:
        return one.port == other.port
    entered = [model.exact.rates_by_port[:, names.index(o.port)] for o in (one, other)]
    return any(
        not (a.is_zero() or b.is_zero()) for a, b in zip(*map(ca.vertsplit, entered), strict=True)
    )


def _still_off(diagnosis: Diagnosis, fit: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    """Doubt what was found where equations that leave something out still run far off with it.

    Or where they are trusted, and yet most of the error beyond the noise is there without it too.
    """
    share, over = 1.0 - explained(fit), max(over_noise(fit).values())
    little = share > 1.0 - rules.LEAST_SHOWN and over > rules.NEAR_NOISE
    beyond = min((over**2 - 1.0) / (rules.NEAR_NOISE**2 - 1.0), 1.0)
    if not (little or (share * beyond > rules.MOST_OFF and _leaves_out(diagnosis))):
        return ()
    return (f"{100 * share:.0f} % of the mean square error of the held-out runs is left",)


def _differs(effect: Effect, rest: str) -> tuple[str, ...]:
    """Doubt what is another in each recording where the equations still leave something out.

    Recordings do different things: what bends another law acts differently in each of them.
    """
    if not (effect.about.level and rest):
        return ()
    return ("it is another in each recording, as what is left out may be",)


def still_missing(before: Location, after: Location) -> float:
    """Return the share of the misfit of the worst place that is left, dimensionless.

    Where no place of the process lacked anything, as beside a sensor that is off, nothing is left.
    """
    missing = before.alone.get(before.best, 0.0)
    return after.alone.get(after.best, 0.0) / missing if missing > rules.LEAST_GAIN else 0.0


def _without_name(
    diagnosis: Diagnosis, fit: Mapping[str, Mapping[str, float]]
) -> tuple[Finding, ...]:
    """Say where something is left out that no effect of the library explains."""
    term = diagnosis.nonparametric
    occurrence = diagnosis.validated.occurrence() if diagnosis.validated else None
    if diagnosis.complete or (_wrong_values(diagnosis) and not (term and term.accepted)):
        return ()
    if term is not None and term.accepted:
        over = " and ".join(a.name for a in term.arguments)
        law = term.likeness.law.replace("_", " ") if term.likeness else ""
        alike = f" The curve has the shape of {law}." if law else ""
        return (
            Finding(
                where=term.ports,
                effect=term.effect_name,
                alike=(term.effect_name,),
                sentence=(
                    f"Missing at {', '.join(term.ports)}: something that the library has no name"
                    f" for; a curve over {over}{' with a memory' if term.loop else ''} takes away"
                    f" {100 * term.explained:.0f} % of the signal that is missing there."
                    f"{alike} {occurrence or ''}".rstrip()
                ),
                parameters=_own(diagnosis.extended, term.effect_name),
                excess_explained=explained(fit),
                gain=term.gain,
                held_out=term.held_out,
                p_value=_by_chance(term.held_out),
                occurrence=occurrence,
            ),
        )
    ports = diagnosis.before.ports(diagnosis.nominal) if diagnosis.before else ()
    if not ports:
        return ()
    sentence = f"Something is left out, most likely at {', '.join(ports)}. {occurrence or ''}"
    return (
        Finding(
            where=ports, effect=None, alike=(), sentence=sentence.rstrip(), occurrence=occurrence
        ),
    )


def _by_chance(held_out: tuple[float, float, float]) -> float:
    """Probability of a held-out gain by chance, from its 99 % interval."""
    gain, low, _ = held_out
    deviation = max((gain - low) / 2.576, 1e-9)
    return 0.5 * math.erfc(gain / deviation / math.sqrt(2))


def _wrong_values(diagnosis: Diagnosis) -> list[Estimate]:
    """Return estimates on a bound of a model whose equations are complete otherwise."""
    if diagnosis.validated is None:
        return []
    return [e for e in diagnosis.base.refit.estimates if e.name in diagnosis.validated.wrong]


def _far(diagnosis: Diagnosis) -> str:
    """Say how far the runs of the refitted nominal model are from the noise."""
    scored = diagnosis.scored
    if scored is None or scored.farthest[1] <= rules.NEAR_NOISE:
        return ""
    output, ratio = scored.farthest
    return (
        f" On the held-out recordings the error of {output.replace('_', ' ')} is {ratio:.3g} times"
        " what noise and the uncertainty of the parameters would leave."
    )


def _rest(diagnosis: Diagnosis, fit: Mapping[str, Mapping[str, float]]) -> str:
    """Say what is still left out, by how much, and what would explain most of it."""
    over = over_noise(fit)
    output = max(over, key=lambda name: over[name])
    if over[output] <= rules.NEAR_NOISE or not _leaves_out(diagnosis):
        return ""
    said = (
        f" Something else is still left out: the held-out error of {output.replace('_', ' ')} is"
        f" {over[output]:.3g} times the noise"
    )
    rest = diagnosis.validated and diagnosis.validated.rest
    later = diagnosis.rounds[len(diagnosis.accepted) :]
    tried = [c for _, candidates in later[:1] for c in candidates if c.fit is not None]
    best = max(tried, key=lambda c: c.gain, default=None)
    if best is not None and best.gain < rules.LEAST_GAIN:
        said += ", and no law of the library explains more of it"
    elif best is not None:
        name = best.entry.name.replace("_", " ")
        said += f"; the best candidate for it, {name}, gains {best.gain:.3g} of log likelihood"
    return f"{said}. {rest.sentence('What is left')}" if rest else f"{said}."


def _leaves_out(diagnosis: Diagnosis) -> bool:
    """Whether the equations with all that was found still leave something out.

    A filter that corrects a level at each sample may leave them next to no doubt where small errors
    add up along a run, to more than uncertain parameters explain.
    """
    if diagnosis.extended.noise_scale > rules.IMPERFECT:
        return True
    try:
        over = over_floor(diagnosis.extended, diagnosis.nominal, diagnosis.prepared.judging)
    except (NumericalError, np.linalg.LinAlgError):
        return False
    return max(over.values(), default=0.0) > rules.NEAR_NOISE


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


def _kind(diagnosis: Diagnosis, findings: Sequence[Finding], rest: str) -> tuple[Kind, str]:
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
        sentence = " ".join(f.sentence for f in findings)
        sentence += rest
        if all(f.belief == "likely" for f in findings):
            return "likely", sentence
        entries = [c.entry for c, _ in diagnosis.accepted]
        if any(len(f.alike) > 1 for f in findings) or any(
            _computed(e, diagnosis.nominal) for e in entries
        ):
            return "named_class", sentence
        sensor = all(e.group == "sensor" for e in entries)
        return ("sensor" if sensor else "named"), sentence
    bound = _wrong_values(diagnosis)
    if bound:
        names = ", ".join(f"{e.name} at {e.value:.3g} {e.unit}" for e in bound)
        return (
            "parameter",
            "No physics is missing that these recordings can show, but a value is wrong: the"
            f" refit ends on its bound with {names}. Check it, and what the notes say of values"
            f" that go with it.{far}",
        )
    if diagnosis.complete:
        return (
            "nothing_missing",
            "Nothing is missing that these recordings can show: with refitted parameters the model"
            f" predicts them nearly to the noise of the sensors.{_coloured(diagnosis)}",
        )
    return (
        "unexplained",
        "Something is left out, but neither a place nor an effect of the library explains it on the"
        f" held-out recordings.{far}",
    )
