"""The next experiment: what to record so that the open question of a diagnosis is decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.process_noise import extended_start
from workbench.diagnosis.experiment.menu import Experiment, menu, other_settings, with_setting
from workbench.diagnosis.experiment.separation import (
    Explanation,
    Separation,
    Separator,
    sensors,
    separation,
    spread_after,
    visible,
)
from workbench.diagnosis.location.isolability import isolability
from workbench.diagnosis.selection.score import COLLINEAR
from workbench.model import Model
from workbench.physics.library import Hypothesis

if TYPE_CHECKING:
    from workbench.diagnosis.stages import Diagnosis

DECISIVE = 3.0
"""Standard deviations that an experiment should reach."""

SEEN = 4.0
"""Standard deviations from which an effect would be seen."""

_REPEATED = 3
_MOST_UNSEEN = 4
_WORTHWHILE = 0.8
_MOST_EXPLANATIONS = 3


class Advice(NamedTuple):
    """What to record next.

    Args:
        said: ``sentence``, ``experiment``, and ``separation_sigma``: the standard deviations by
            which it is predicted to separate the explanations, None where only one is left; with
            ``sensor`` and ``sensor_sigma`` where a sensor does better; empty where nothing is worth
            recording.
        plan: The best input that can be played on the machine as it is set; None if there is none.
    """

    said: Mapping[str, Any] = {}
    plan: Experiment | None = None


def separate(
    explanations: Sequence[Explanation], recordings: Sequence[Observed], observed_with: Model
) -> tuple[Separation, ...]:
    """Rank experiments by how well they separate explanations of the same recordings.

    They are those of a menu within what the recordings show, the best of them also at other
    settings of load and supply. The first explanation is taken as true and told from each of the
    others, refitted; for the best experiments also the other way round. The smaller separation
    counts.

    Args:
        explanations: Two or more fitted explanations, the most likely first.
    """
    first, *others = explanations[:_MOST_EXPLANATIONS]
    separator = Separator(recordings[0], observed_with)
    free = sorted({name for e in explanations for name in e.free})
    offered = _offered(first.fit.model, recordings, observed_with)

    def told(experiment: Experiment) -> Separation:
        found = (separation(separator, first, other, experiment) for other in others)
        return min(found, key=lambda s: s.sigma)

    ranked = sorted((told(e) for e in offered), key=lambda s: -s.sigma)
    best = ranked[:_REPEATED]
    settings = other_settings(first.fit.model, free)
    set_otherwise = [
        told(with_setting(s.experiment, *setting)) for s in best for setting in settings
    ]
    best += sorted(set_otherwise, key=lambda s: -s.sigma)[:_REPEATED]
    for i, found in enumerate(best):
        back = [separation(separator, other, first, found.experiment) for other in others]
        best[i] = min(found, *back, key=lambda s: s.sigma)
    return tuple(sorted(best, key=lambda s: -s.sigma))


def next_experiment(diagnosis: Diagnosis, recordings: Sequence[Observed]) -> Advice:
    """Propose what to record next.

    Where several explanations are left, what separates them best, or the sensor to add if nothing
    does; where one is left, what sharpens its size; where nothing is missing, what would show the
    effects that these recordings could not have shown; where something unnamed is missing, the
    sensor that narrows down its place.

    Args:
        recordings: The fitting recordings, observed with the nominal model.
    """
    nominal = diagnosis.nominal
    if diagnosis.accepted:
        for best, alike in diagnosis.accepted:
            # Of the round in which it was found, where its rivals were fitted to the same model.
            rounds = (candidates for _, candidates in diagnosis.rounds)
            tried = {
                c.entry.name: c
                for candidates in rounds
                if best.entry.name in {c.entry.name for c in candidates}
                for c in candidates
            }
            left = [
                Explanation(name, fit)
                for name in (best.entry.name, *alike[1:])
                if (fit := tried[name].fit if name in tried else None) is not None
            ]
            if len(left) > 1:
                return _deciding(left, recordings, nominal)
        return _sharpening(diagnosis, recordings)
    if not diagnosis.complete:
        return _locating(diagnosis, recordings[0].used)
    if not diagnosis.rounds:
        return Advice()
    return _revealing(diagnosis, recordings)


def _offered(
    model: Model, recordings: Sequence[Observed], observed_with: Model
) -> tuple[Experiment, ...]:
    return menu(model, [extended_start(r, observed_with, model) for r in recordings])


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _deciding(
    left: Sequence[Explanation], recordings: Sequence[Observed], nominal: Model
) -> Advice:
    ranked = separate(left, recordings, nominal)
    if not ranked or not ranked[0].gain > 0.0:
        return Advice()
    best = ranked[0]
    names = f"{_plain(left[0].name)} from {' and '.join(_plain(e.name) for e in left[1:])}"
    step: dict[str, object] = {
        "experiment": best.experiment.text,
        "effects": [e.name for e in left],
        "separation_sigma": round(float(best.sigma), 1),
        "sentence": f"{_capital(best.experiment.text)} would tell {names} by {best.sigma:.1f}"
        " standard deviations.",
    }
    if best.sigma < DECISIVE:
        separator = Separator(recordings[0], nominal)
        read = sensors(separator, left[0], left[1], best.experiment)
        step["sentence"] = (
            f"No admissible input tells {names} well: the best, {best.experiment.text}, by"
            f" {best.sigma:.1f} standard deviations."
        )
        if read and read[0][1] >= DECISIVE:
            name, sigma = read[0]
            step |= {"sensor": name, "sensor_sigma": round(float(sigma), 1)}
            step["sentence"] = f"{step['sentence']} A sensor of {name} in it would, by {sigma:.1f}."
    playable = next((s.experiment for s in ranked if not s.experiment.settings), None)
    return Advice(step, playable)


def _sharpening(diagnosis: Diagnosis, recordings: Sequence[Observed]) -> Advice:
    best = diagnosis.accepted[0][0]
    if best.size is None or not diagnosis.improved:
        return Advice()
    name = best.entry.size_name
    explanation = Explanation(best.entry.name, diagnosis.extended, name)
    separator = Separator(recordings[0], diagnosis.nominal)
    offered = _offered(diagnosis.extended.model, recordings, diagnosis.nominal)
    spreads = [(spread_after(separator, explanation, e), e) for e in offered]
    if not spreads:
        return Advice()
    (now, then), experiment = min(spreads, key=lambda pair: pair[0][1])
    if then > _WORTHWHILE * now:
        return Advice()
    size = diagnosis.extended.refit.estimate(name)
    before, after = (
        diagnosis.nominal.size_text(x, size.unit, best.entry.effect.places) for x in (now, then)
    )
    value = diagnosis.nominal.size_text(size.value, size.unit, best.entry.effect.places, 3)
    said = {
        "experiment": experiment.text,
        "separation_sigma": None,
        "sentence": f"{_capital(experiment.text)} would bring the size of"
        f" {_plain(explanation.name)}, {value}, from +-{before} to +-{after}.",
    }
    return Advice(said, experiment)


def _locating(diagnosis: Diagnosis, outputs: Sequence[str]) -> Advice:
    """Propose the sensor that splits the group in which something unknown is missing."""
    ports = diagnosis.before.ports(diagnosis.base.model) if diagnosis.before else ()
    if not ports:
        return Advice()
    told = isolability(diagnosis.base.model, outputs=outputs)
    # Where an output reads a signal as it is, a sensor of it is there already.
    there = {*outputs, *(f"{name}.reading" for name in outputs)}
    split = told.sensors_that_split(ports[:1])
    best = next((sensor for sensor in split if sensor.signal not in there), None)
    if best is None:
        return Advice()
    parts = "; ".join(", ".join(part) for part in best.splits[0])
    said = {
        "sensor": best.text,
        "separation_sigma": None,
        "sentence": f"A sensor of {best.text} would tell apart what these measurements cannot:"
        f" {parts}.",
    }
    return Advice(said)


def _revealing(diagnosis: Diagnosis, recordings: Sequence[Observed]) -> Advice:
    scores = [s for s in diagnosis.rounds[0][0].scores if not s.testable]
    # Those whose typical size is nearest to what these recordings could have shown.
    scores.sort(key=lambda s: s.smallest / max(abs(s.entry.typical_size), 1e-300))
    entries: list[Hypothesis] = [s.entry for s in scores[:_MOST_UNSEEN]]
    if not entries:
        return Advice()
    explanation = Explanation("the model", diagnosis.base)
    separator = Separator(recordings[0], diagnosis.nominal)
    offered = list(menu(diagnosis.base.model, recordings))
    found = visible(separator, explanation, entries, recordings, offered)
    settings = other_settings(diagnosis.base.model, explanation.free)
    best = max(found, key=lambda sight: sight.now / sight.then, default=None)
    if best is not None and settings:
        again = [with_setting(best.experiment, *setting) for setting in settings]
        found += visible(separator, explanation, entries, recordings, again)
    found = [
        sight
        for sight in found
        if sight.collinearity < COLLINEAR
        and sight.then < _WORTHWHILE * sight.now
        and abs(sight.entry.typical_size) > SEEN * sight.then
    ]
    if not found:
        return Advice()
    best = max(found, key=lambda sight: sight.now / sight.then)
    least, before = (
        diagnosis.nominal.size_text(SEEN * std, best.entry.unit, best.entry.effect.places)
        for std in (best.then, best.now)
    )
    # An input that never changes sign shows nothing of what happens below zero.
    blind = SEEN * best.now > best.entry.largest_size
    shown = "cannot show it" if blind else f"show it from {before} on"
    said = {
        "experiment": best.experiment.text,
        "separation_sigma": None,
        "sentence": f"{_capital(best.experiment.text)} would show {_plain(best.entry.name)} of"
        f" {least} or more; these recordings {shown}.",
    }
    playable = [sight for sight in found if not sight.experiment.settings]
    plan = max(playable, key=lambda sight: sight.now / sight.then, default=None)
    return Advice(said, plan.experiment if plan is not None else None)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
