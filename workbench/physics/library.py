"""The library of effects: everything that could be missing from a model, by its ports."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from itertools import islice

from workbench.model import Effect, Model
from workbench.physics.hypothesis import Hypothesis, look_alikes
from workbench.physics.law import LAWS, Law
from workbench.physics.recorded_facts import NOTHING, RecordedFacts
from workbench.physics.survey import Survey

_MORE = 2
"""How often an event may come again: as often as sets of effects have room for."""

__all__ = ["LAWS", "Hypothesis", "Law", "every_name", "library", "look_alikes"]


def library(
    model: Model,
    recorded: RecordedFacts = NOTHING,
    *,
    extra: Iterable[Law | Hypothesis] = (),
    more_of: Collection[str] = (),
    found: Collection[str] = (),
    named: str | None = None,
) -> tuple[Hypothesis, ...]:
    """Return every law of the library at each place of a model that it fits, at zero size.

    A law that is attached to one of the ports already is left out: its size is a parameter of the
    model. So is the delay of a sensor that has a lag, and the other way round.

    Args:
        recorded: What is known of the recordings.
        extra: Laws of your own that stand in no registry, or hypotheses; of two with one name
            yours is taken.
        more_of: Names of attached effects of which there may be more than their parameters allow.
        found: Names of attached effects that were missing at first: what they are is not offered a
            change with time too, and an event among them may come again.
        named: Only laws with whose names this name begins, as a hypothesis of theirs does.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> names = [hypothesis.name for hypothesis in library(servo_axis())]
        >>> "stribeck_friction" in names, "coulomb_friction" in names
        (True, False)
    """
    survey = Survey(model, recorded, found=found)
    given = [item for item in extra if isinstance(item, Hypothesis)]
    laws = dict.fromkeys([*LAWS.members().values(), *(x for x in extra if isinstance(x, Law))])
    if named is not None:
        laws = {law: None for law in laws if named.startswith(law.name)}
    own = {hypothesis.name for hypothesis in given}
    offered = [h for law in laws for h in law.hypotheses(survey) if h.name not in own]
    taken = {effect.name for effect in model.effects}
    known = [effect for effect in model.effects if effect.name not in more_of]
    downhill = {law.name for law in laws if law.downhill}
    missing = [
        h
        for h in (*offered, *given)
        if h.name not in taken and not any(_same(h, e, downhill) for e in known)
    ]
    events = (h for h in (*offered, *given) if h.name in found)
    missing += [next(h for h in _again(e) if h.name not in taken) for e in events if e.comes_once]
    return tuple(sorted(missing, key=lambda h: h.group == "sensor"))


def _again(event: Hypothesis) -> Iterator[Hypothesis]:
    """Return what may come once, a second time, and so on."""
    while True:
        event = replace(event, effect=replace(event.effect, name=f"{event.name}_again"))
        yield event


def every_name(
    model: Model, *, duration: float = 0.0, sample_time: float = 0.0, named: str | None = None
) -> dict[str, Hypothesis]:
    """Return whatever a diagnosis of a model may name, by name.

    Beside `library` that is a law at one of the places that it shares, and what is offered only
    after a refit: a change of a parameter that is zero until then, more of what is attached, what
    repeats.

    Args:
        duration: Length of the recordings, in s; 0 if it is not known.
        sample_time: Sampling interval of the recordings, in s; 0 if it is not known.
        named: The name that is wanted, if it is one alone: what else is found is not all.
    """
    values = {}
    for q in model.parameters:
        ends = [v for v in (q.lower, q.upper, q.value) if math.isfinite(v)]
        if q.fitted:
            values[q.name] = max((*ends, min(q.scale, q.upper)), key=abs)
    refitted = model.with_parameters(values)
    recorded = RecordedFacts(
        duration=duration,
        sample_time=sample_time,
        period=model.horizon,
        episode=(0.0, model.horizon),
        strides={f"{q.name}.command": q.scale * model.horizon for q in model.inputs},
    )
    found: dict[str, Hypothesis] = {}
    for known, more_of in ((model, ()), (refitted, [e.name for e in model.effects])):
        offered = library(known, recorded, more_of=more_of, named=named)
        for hypothesis in (one for h in offered for one in (h, *h.alone)):
            more = islice(_again(hypothesis), _MORE if hypothesis.comes_once else 0)
            for one in (hypothesis, *more):
                found.setdefault(one.name, one)
        if named in found:
            break
    return found


def _same(hypothesis: Hypothesis, attached: Effect, downhill: set[str]) -> bool:
    if hypothesis.group == "sensor" and hypothesis.ports == attached.ports:
        # A second memory of one sensor is the shape of the first: a lag beside a delay.
        alike = hypothesis.law in attached.about.look_alikes
        if alike and hypothesis.effect.states and attached.states:
            return True
    own, other = hypothesis.effect.about, attached.about
    if own.equation == other.equation and own.subject == other.subject:
        if hypothesis.law in downhill:
            return hypothesis.ports[0] == attached.ports[0]
        return bool(set(hypothesis.ports) & set(attached.ports))
    places = [{p.split(".")[0] for p in ports} for ports in (hypothesis.ports, attached.ports)]
    return hypothesis.law == attached.name and bool(places[0] & places[1])
