"""Findings of a verdict: what is missing, where, how large, since when, and how sure that is."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca

from workbench.diagnosis.doubts import Errors, beside_larger, differs, too_quick
from workbench.diagnosis.estimation.fixed_parameters import value_instead
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.estimation.refit_result import Estimate
from workbench.diagnosis.selection.held_out import explained
from workbench.diagnosis.selection.moments import acts_in, levels, moments
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import Finding, Value
from workbench.model import Effect, Model
from workbench.model.quantities import declared_unit, shown_in
from workbench.model.units import from_si, in_range, in_time, in_times, with_unit
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.parameter_laws import along_curve

_LEAST_ALIKE = 0.1
"""Weight from which what stands for an effect in a set of effects cannot be told from it."""


def named(
    diagnosis: Diagnosis, index: int, fit: Errors, rest: str, together: tuple[str, ...]
) -> Finding:
    """Return the finding of an effect that was accepted.

    Args:
        index: Which of them, in the order of finding.
        rest: What is left out beside all that was found, in words; empty if nothing.
        together: Doubts of all that was found.
    """
    candidate, alike = diagnosis.accepted[index]
    entry, model = candidate.entry, diagnosis.extended.model
    attached = model.effect(entry.name)
    alike = (*alike, *(n for n in _instead(diagnosis, entry.name) if n not in alike))
    parameters = own_parameters(diagnosis.extended, entry.name)
    tried = {c.name: c.entry for _, candidates in diagnosis.rounds for c in candidates}
    members = (entry, *(tried[name] for name in alike[1:] if name in tried))
    # What each of them is told by; why it is, stands behind a colon.
    texts = (q.effect.about.separated_by.partition(":")[0] for q in members)
    deciding = [] if _one(diagnosis, entry.name) else list(dict.fromkeys(filter(None, texts)))
    # What was found is doubted alone, and together with all else.
    doubts = (
        *candidate.doubts,
        *too_quick(diagnosis, parameters),
        *beside_larger(diagnosis, index),
        *together,
        *differs(entry.effect, rest),
    )
    # A law that is either there or not is told by its other numbers.
    size = parameters.get(entry.size_parameter)
    told = {entry.size_parameter: size} if size else parameters
    numbers = {name: v.read for name, v in told.items()}
    formula = computed(entry, diagnosis.nominal)
    beside = ""
    if other := entry.effect.about.tells:
        q = model.parameter(f"{entry.name}.{other}")
        shown = model.size_text(q.value, q.unit, entry.effect.places, 3)
        beside = f", {other.replace('_', ' ')} {shown}"
    instead = _instead_of(diagnosis, entry)
    text = (
        f"{'Likely missing' if doubts else 'Missing'}:"
        f" {entry.name.replace('_', ' ')} at {', '.join(entry.ports)}"
        + "".join(
            f", {name} {value:.3g} +- {std:.2g} {unit}".removesuffix(" 1")
            for name, (value, std, unit) in numbers.items()
        )
        + beside
        + _by_recording(model, attached)
        + along(model, entry.effect)
        + (f"; cannot be told from {', '.join(alike[1:])}" if len(alike) > 1 else "")
        + (f"; {' or '.join(deciding)} would decide" if len(alike) > 1 and deciding else "")
        + instead
        + (f"; so would another formula for {formula}" if formula else "")
        + "."
        + (f" Only likely: {'; '.join(doubts)}." if doubts else "")
    )
    occurrence = diagnosis.validated.occurrence(index) if diagnosis.validated else None
    if occurrence is not None:
        occurrence = replace(occurrence, since=_since(diagnosis, attached))
    weights = [w.weight for w in diagnosis.weights if {entry.name, *alike} & {*w.effects}]
    return Finding(
        where=entry.ports,
        effect=entry.name,
        alike=alike,
        sentence=f"{text} {occurrence or ''}".rstrip(),
        parameters=parameters,
        excess_explained=explained(fit),
        gain=candidate.gain,
        held_out=candidate.held_out,
        weight=min(1.0, sum(weights)) if diagnosis.weights else math.nan,
        p_value=_by_chance(candidate.held_out),
        belief="likely" if doubts else "sure",
        doubts=doubts,
        occurrence=occurrence,
        or_value=bool(instead),
    )


def without_name(diagnosis: Diagnosis, fit: Errors) -> tuple[Finding, ...]:
    """Say where something is left out that no effect of the library explains."""
    term = diagnosis.nonparametric
    occurrence = diagnosis.validated.occurrence() if diagnosis.validated else None
    if diagnosis.complete or (wrong_values(diagnosis) and not (term and term.accepted)):
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
                parameters=own_parameters(diagnosis.extended, term.effect_name),
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
    said = f"Something is left out, most likely at {', '.join(ports)}. {occurrence or ''}".rstrip()
    return (Finding(ports, None, (), said, occurrence=occurrence),)


def wrong_values(diagnosis: Diagnosis) -> list[Estimate]:
    """Return estimates on a bound of a model whose equations are complete otherwise."""
    if diagnosis.validated is None:
        return []
    return [e for e in diagnosis.base.refit.estimates if e.name in diagnosis.validated.wrong]


def own_parameters(fit: ProcessNoiseFit, effect: str) -> dict[str, Value]:
    """Return the estimates of the parameters of an effect by short name."""
    return {
        e.name.removeprefix(f"{effect}."): Value(e.value, e.unit, e.std, fit.model.read_in(e.name))
        for e in fit.refit.estimates
        if e.name.startswith(f"{effect}.")
    }


def _by_chance(held_out: tuple[float, float, float]) -> float:
    """Probability of a held-out gain by chance, from its 99 % interval."""
    gain, low, _ = held_out
    deviation = max((gain - low) / 2.576, 1e-9)
    return 0.5 * math.erfc(gain / deviation / math.sqrt(2))


def _one(diagnosis: Diagnosis, name: str) -> bool:
    """Tell whether no input at all tells an effect from those that may stand for it."""
    advice = diagnosis.validated.advice if diagnosis.validated else {}
    return name in advice.get("effects", ()) and advice["separation_sigma"] < 1.0


def _instead(diagnosis: Diagnosis, name: str) -> list[str]:
    """Return the effects with which, instead of one, a set of all others has a weight."""
    beside = {a.candidate.name for a in diagnosis.accepted} - {name}
    taken_back = {c.name for c, _ in diagnosis.withdrawn} - {name} - beside
    found = []
    for effects, weight in diagnosis.weights:
        left = set(effects) - taken_back
        other = left - beside
        if weight >= _LEAST_ALIKE and len(other) == 1 and len(left) == len(beside) + 1:
            found += [n for n in other if n != name]
    return found


def _since(diagnosis: Diagnosis, effect: Effect) -> str:
    """Say from when on an event acts in each recording, or how often; empty if it is none."""
    model, prepared = diagnosis.extended.model, diagnosis.prepared
    if not effect.about.moment:
        return ""
    recordings, said = (*prepared.fitting, *prepared.judging), []
    if effect.about.period:
        own = {q.name: model.parameter(f"{effect.name}.{q.name}").value for q in effect.parameters}
        period = own[effect.about.period]
        lasting = period * own[effect.about.part] if effect.about.part else 0.0
        for seen in recordings if lasting else ():
            begin = (moments(model, effect, seen.name)[0] - 0.5 * lasting) % period
            times, unit = in_times([begin, begin + lasting])
            said.append(f"from {' to '.join(times)} {unit} of {seen.name} on")
        return ", ".join([f"every {in_time(period)}", *said])
    for seen in recordings:
        begin, end = moments(model, effect, seen.name)
        last = seen.sample_time * (len(seen.outputs) - 2)
        if not acts_in(model, effect, seen):
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
    found, about = levels(model, effect), effect.about
    if not found or (not about.level and max(found.values()) == min(found.values())):
        return ""
    subject = about.subject
    unit = model.parameter(subject).unit if subject else effect.parameters[0].unit
    told = (f"{model.size_text(v, unit, effect.places, 3)} in {k}" for k, v in found.items())
    return f"; {subject or 'it'} {'is' if about.level else 'begins at'} {', '.join(told)}"


def along(model: Model, effect: Effect) -> str:
    """Say what a parameter is along the signal that it changes with; empty if it does not."""
    found = along_curve(model, effect)
    if not found:
        return ""
    subject, unit = effect.about.subject, model.parameter(f"{effect.name}.middle").unit
    ends = ("_over_", "_over_each_", "_over_all_")
    signals = (*model.states, *model.inputs)
    named = [q for q in signals if any(f"{end}{q.name}" in effect.name for end in ends)]
    over = max(named, key=lambda q: len(q.name), default=None)
    said = f"what {subject} multiplies"
    if over is not None:
        slips = (q for q in model.states if effect.name.endswith(f"_over_{over.name}_{q.name}"))
        said = " - ".join(q.name.replace("_", " ") for q in (over, *slips))
        if f"_over_each_{over.name}" in effect.name:
            said += ", and so by what each other port changes"
        if f"_over_all_{over.name}" in effect.name:
            said = f"the vector of which {said} is a component"
    read = declared_unit(over.name if over else "", unit, model.quantities)
    unit = read or (shown_in(over) if over else unit)
    own = model.parameter(subject).unit
    told = (
        f"{model.size_text(value, own, effect.places, 3)} at {with_unit(at, unit)}"
        for at, value in zip(
            in_range([from_si(at, unit) for at in found]), found.values(), strict=True
        )
    )
    return f"; {subject} is {', '.join(told)} of {said}"


def _instead_of(diagnosis: Diagnosis, entry: Hypothesis) -> str:
    """Say which value, that no refit changes, is wrong if an effect is not there; or nothing."""
    fit, nominal = diagnosis.extended, diagnosis.nominal
    recordings = diagnosis.prepared.fitting
    found = value_instead(fit, entry.effect, entry.size_parameter, nominal, recordings)
    if found is None:
        return ""
    q = nominal.parameter(found[0])
    values = [nominal.size_text(value, q.unit, (q.name,), 3) for value in (found[1], q.value)]
    others = "; sizes of what else was found would be others then" * (len(diagnosis.accepted) > 1)
    return (
        f"; {q.name} would do the same if it is {values[0]}, not {values[1]} (no refit changes"
        f" it{others})"
    )


def computed(entry: Hypothesis, nominal: Model) -> str:
    """Return what another formula for would do the same as a sensor does; empty if nothing.

    What the model computes of its states, such as the pressure of a gas of a volume, may be wrong
    as well as what reads it. So may what it makes of an input that enters one equation, such as the
    growth of a plant of the light, as well as a curve of what reads that, or a gain that changes:
    the glass of a collector grows blind as a sensor of the sun does.
    """
    (port, *more) = entry.ports
    name = port.removesuffix(".reading")
    if entry.group != "sensor" or more:
        return ""
    trace, said = nominal.exact, name.replace("_", " ")
    rows = [i for i, q in enumerate(nominal.outputs) if q.name == name]
    if rows:
        slopes = ca.jacobian(trace.outputs[rows[0]], trace.x)
        return said if ca.depends_on(slopes, trace.x) and not entry.effect.states else ""
    read = [i for i, q in enumerate(nominal.inputs) if q.name == name]
    if not read or _slopes(nominal, read[0]).nnz() != 1:
        return ""
    wrong = nominal.with_effect(entry.at_size(entry.typical_size))
    own = wrong.exact.x[len(nominal.states) :]
    bent = ca.depends_on(_slopes(wrong, read[0]), ca.vertcat(wrong.exact.u[read[0]], own))
    return f"what {said} does" if bent else ""


def _slopes(model: Model, index: int) -> ca.SX:
    """Return the slopes of all rates and measurements over an input, in SI."""
    trace = model.exact
    return ca.sparsify(ca.jacobian(ca.vertcat(trace.rates, trace.outputs), trace.u[index]))
