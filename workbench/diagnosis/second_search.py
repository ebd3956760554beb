"""A second search, where a first one leaves something: under another view of the recordings.

What a free run of what was found leaves may be noise that is correlated, or something where the
author of the plant trusts the equations. Each is a view: a model to search again, among which
hypotheses, and when what is found so counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from workbench.diagnosis.estimation.noise_colour import (
    BY_CHANCE,
    Leftover,
    leftovers,
    with_correlated_noise,
)
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    PERFECT,
    ProcessNoiseFit,
    fit_with_process_noise,
    perfect_cost,
)
from workbench.diagnosis.selection.candidate import is_sensor
from workbench.diagnosis.selection.held_out import over_noise
from workbench.diagnosis.selection.moments import may_be_absent
from workbench.diagnosis.selection.rules import (
    AT_NOISE,
    LEAST_GAIN,
    LITTLE_LEFT,
    OFF_NOISE,
    SAME,
    SURE_OF,
    lacks_little,
)
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.undeclared.constants import Freed, likeliest_freed
from workbench.diagnosis.undeclared.disturbances import opened
from workbench.diagnosis.undeclared.inputs import clearly_likelier, otherwise_between_samples
from workbench.errors import NumericalError
from workbench.model import Model
from workbench.model.quantities import shown_in
from workbench.model.units import from_si, with_unit
from workbench.physics.library import Hypothesis
from workbench.recordings.checks.report import check_row
from workbench.recordings.recording import Recording

_KNOWN = 3.0
"""Standard deviations of what recordings that lack nothing say, with which other ones are searched:
they speak once more there, which makes an interval narrower by a twentieth."""


@dataclass(frozen=True)
class View:
    """A view under which recordings are searched again.

    Args:
        name: Name of the folder of its stages.
        why: What the user is told.
        rows: What was taken from the data.
        among: Ports whose hypotheses are tried, beside those that the first search followed.
        found: What that found; all hypotheses that ``may_be`` are tried without it.
        better: Whether what it found takes the place of what was found first.
        stops: Why it is of no use to go on with it, as far as it is; empty if it may be.
        priors: What is known of the free parameters; what the author says if empty.
        may_be: Whether a hypothesis is tried.
        complete: Names of recordings that lack nothing by themselves, to which no event came.
    """

    model: Model
    name: str = ""
    why: str = ""
    better: Callable[[Diagnosis, Diagnosis], bool] = lambda *_: True
    stops: Callable[[Diagnosis], str] = lambda _: ""
    rows: tuple[dict[str, str], ...] = ()
    among: tuple[str, ...] = ()
    found: Diagnosis | None = field(default=None, repr=False)
    priors: tuple[Prior, ...] = ()
    may_be: Callable[[Hypothesis], bool] = lambda _: True
    complete: tuple[str, ...] = ()

    def tries(self, hypothesis: Hypothesis) -> bool:
        """Whether a hypothesis is tried in this search."""
        if self.found is None:
            return self.may_be(hypothesis)
        return hypothesis.name in self._followed or any(p in self.among for p in hypothesis.ports)

    def searches_as(self, other: View) -> bool:
        """Whether another view of the same model looks among the same ports for the same.

        What was followed since, beside what was found, was tried there in vain if it is no part of
        that.
        """
        if self.found is None or not self.among or self.among != other.among:
            return False
        return {a.candidate.name for a in self.found.accepted} <= other._followed

    @cached_property
    def _followed(self) -> frozenset[str]:
        rounds = self.found.rounds if self.found else ()
        return frozenset(c.name for r in rounds for c in r.candidates if c.followed)

    def ends(self, again: Diagnosis) -> str:
        """Return why it is of no use to go on with this search; empty if it may be."""
        return self.stops(again) or "what it finds there runs farther off" * self._lags(again)

    def _lags(self, again: Diagnosis) -> bool:
        """Whether so many effects run clearly farther off than as many that were found first."""
        if not self.among or self.found is None or not self.found.accepted or not again.accepted:
            return False
        before = self.found.accepted[: len(again.accepted)]
        if [a.candidate.name for a in again.accepted] == [a.candidate.name for a in before]:
            return False  # What stands at its ports is still to come.
        runs = again.accepted[-1].candidate.run, before[-1].candidate.run
        return runs[0] is not None and runs[1] is not None and runs[0].spoilt_from(runs[1])


def beside_correlated_noise(
    found: Diagnosis, model: Model, recordings: Sequence[Recording]
) -> View | None:
    """View what is left as noise that is correlated, where it is not what was found surely."""
    if (
        any(q.correlated_noise_rms for q in model.outputs)
        or found.fitted is None
        or not _lacks(found)
    ):
        return None
    other, rows = with_correlated_noise(model, recordings, _left(found), _closest(found))
    if not rows:
        return None
    why = "searching again beside noise that is correlated"
    return View(
        other, "correlated_noise", why, lambda again, _: _explained(again), rows=tuple(rows)
    )


def where_a_constant_is_wrong(
    found: Diagnosis, model: Model, _: Sequence[Recording]
) -> View | None:
    """Refit a constant that the author holds, if that explains more than what was found first.

    A wrong number is no missing physics, and laws of any kind make up for some of it: it counts
    where nothing else is missing beside it.
    """
    prepared, gained = found.prepared, found.base.cost - found.extended.cost
    best = likeliest_freed(model, found.base, prepared.fitting, prepared.priors, gained)
    if best is None or best.cost > found.extended.cost - LEAST_GAIN:
        return None
    return _with_constant(best, found, "that explains more than any effect")


def where_a_curve_is_level(found: Diagnosis, model: Model, _: Sequence[Recording]) -> View | None:
    """Refit a constant that the author holds, where the curve that was found of it is level."""
    if len(found.accepted) != 1:
        return None
    (curve,), prepared = found.accepted, found.prepared
    size, subject = curve.candidate.size, curve.candidate.entry.effect.about.subject
    if not subject or size is None or abs(size.value) >= SURE_OF * size.std:
        return None
    only = {subject}
    best = likeliest_freed(model, found.base, prepared.fitting, prepared.priors, among=only)
    if best is None or best.cost > found.extended.cost + SAME:
        return None
    return _with_constant(best, found, "that explains as much as any change of it")


def _with_constant(best: Freed, found: Diagnosis, why: str) -> View:
    ((name, held),) = best.model.traits.held
    q = best.model.parameter(name)
    was = with_unit(f"{float(from_si(held, shown_in(q))):.4g}", shown_in(q))
    note = f"{name} is refitted, which the plant holds at {was}: {why}"
    row = check_row(found.prepared.fitting[0].name, "range", "corrected", note)
    return View(
        best.model,
        f"with_{name}",
        f"searching beside another {name}",
        lambda again, _: again.scored is not None and not _lacks_more(again),
        lambda again: "beside it something is missing too" * _lacks_more(again),
        (row,),
    )


def _lacks_more(again: Diagnosis) -> bool:
    """Whether something is missing beside another constant too, as far as that is known yet."""
    return again.scored is not None and again.scored.farthest[1] > AT_NOISE


def where_none_is_declared(
    found: Diagnosis, model: Model, recordings: Sequence[Recording]
) -> View | None:
    """Look where the plant has no port, if what was found runs off the noise or is not sure."""
    if found.validated is None or found.complete or not _lacks(found):
        return None
    return _opened("opened", _closer, found, model, recordings)


def where_none_is_declared_yet(
    found: Diagnosis, model: Model, recordings: Sequence[Recording]
) -> View | None:
    """Look there as soon as no single law explains the recordings at the ports that there are.

    Pairs of laws would be tried for minutes against a play of what carries out a command.
    """
    if found.complete or found.selected is None or found.selected.finished:
        return None
    return _opened("opened_first", lambda again, _: not _lacks(again), found, model, recordings)


def _opened(
    name: str,
    better: Callable[[Diagnosis, Diagnosis], bool],
    found: Diagnosis,
    model: Model,
    recordings: Sequence[Recording],
) -> View | None:
    other, places = opened(model, recordings)
    if not places:
        return None
    why = f"searching again where {model.name} has no port: {', '.join(places)}"
    return View(other, name, why, better, among=places, found=found)


def otherwise_between(
    found: Diagnosis, model: Model, recordings: Sequence[Recording]
) -> View | None:
    """Let inputs go straight that were held, or the other way, if that is likelier now.

    What the equations lacked may have spoken for or against the half of a sample between the two.
    """
    if not found.accepted or model.traits.misread or any(r.resampled for r in recordings):
        return None
    other, best = otherwise_between_samples(model, recordings), found.extended
    if other == model:
        return None
    own = replace(best.model.traits, straight=other.traits.straight)
    trial = replace(best.model, traits=own)
    if not clearly_likelier(trial, best.model, recordings, priors=best.refit.priors):
        return None
    names = ", ".join(other.traits.straight or model.traits.straight)
    told = f"{names} {'straight' if other.traits.straight else 'held'} between samples"
    note = f"{told}: that is likelier beside what was found"
    row = check_row(recordings[0].name, "rows", "corrected", note)
    return View(
        other,
        "between_samples",
        f"searching again with {told}",
        lambda again, _: bool(again.accepted),
        rows=(row,),
        found=found,
    )


def where_some_lack_nothing(found: Diagnosis, model: Model, _: Sequence[Recording]) -> View | None:
    """Look for what came to some recordings only, where others by themselves lack nothing.

    Those tell the parameters, which no compromise between all recordings does.
    """
    prepared = found.prepared
    if found.fitted is None or len(prepared.fitting) < 2 or not _lacks(found):
        return None
    fits = [_alone(model, (seen,), prepared.priors) for seen in prepared.fitting]
    clean = [seen for seen, fit in zip(prepared.fitting, fits, strict=True) if fit]
    if not 0 < len(clean) < len(fits):
        return None
    known = next(filter(None, fits)) if len(clean) == 1 else _alone(model, clean, prepared.priors)
    if known is None:
        return None
    priors = tuple(
        replace(p, mean=e.value, std=min(p.std, _KNOWN * e.std))
        for p, e in zip(prepared.priors, known.refit.estimates, strict=True)
    )
    names = tuple(seen.name for seen in clean)
    return View(
        model,
        "some_recordings",
        f"searching for what did not come to {', '.join(names)}, where nothing is missing",
        _closer,
        priors=priors,
        may_be=lambda entry: may_be_absent(entry.effect) or bool(entry.effect.about.level),
        complete=names,
    )


def _alone(
    model: Model, recordings: Sequence[Observed], priors: Sequence[Prior]
) -> ProcessNoiseFit | None:
    """Fit a model to recordings by themselves; None where it leaves something out of them."""
    try:
        fit = fit_with_process_noise(model, recordings, priors)
        perfect = perfect_cost(fit.model, recordings)
    except NumericalError:
        return None
    little = lacks_little(fit.cost - perfect, recordings)
    return fit if fit.noise_scale <= PERFECT and little else None


EARLY = (where_a_constant_is_wrong, where_none_is_declared_yet)
"""Those that are taken after the first round of a search, before it goes on."""

VIEWS = (
    where_some_lack_nothing, where_a_curve_is_level, otherwise_between, beside_correlated_noise,
    where_none_is_declared,
)  # fmt: skip
"""Those that are taken after it, in this order."""


def beside(found: Diagnosis, other: Diagnosis) -> Diagnosis:
    """Return a diagnosis with time and work of another that was made beside it."""
    seconds = found.seconds + other.seconds
    work = {u: found.work.get(u, 0) + other.work.get(u, 0) for u in {**found.work, **other.work}}
    verdict = replace(found.verdict, seconds=seconds, work=work)
    return replace(found, seconds=seconds, work=work, concluded=verdict)


def _misfit(found: Diagnosis, label: str = "extended") -> float:
    """Return the largest error of a model's free runs, over that of noise alone."""
    return max(over_noise(found.verdict.fit, label).values(), default=math.inf)


def _lacks(found: Diagnosis) -> bool:
    """Whether what was found is not sure, or runs off the noise."""
    return _unsure(found) or (_misfit(found) > OFF_NOISE and not _little_left(found))


def _little_left(found: Diagnosis) -> bool:
    left, before = (_misfit(found, label) ** 2 - 1.0 for label in ("extended", "refitted"))
    return left < LITTLE_LEFT * before


def _closer(again: Diagnosis, found: Diagnosis) -> bool:
    """Whether the second diagnosis names something and leaves less than half of what is left."""
    if again.validated is None or not again.accepted:
        return False
    return not _unsure(again) and _misfit(again) ** 2 - 1.0 < 0.5 * (_misfit(found) ** 2 - 1.0)


def _unsure(found: Diagnosis) -> bool:
    return found.verdict.kind in ("unexplained", "likely")


def _explained(found: Diagnosis) -> bool:
    """Whether something was found surely, and what is left follows nothing that drives."""
    verdict = found.verdict
    if verdict.kind not in ("named", "named_class", "sensor") or found.selected is None:
        return False
    left = _left(found)
    return bool(left) and all(x.chance >= BY_CHANCE for x in left.values())


def _left(found: Diagnosis) -> dict[str, Leftover]:
    return leftovers(_closest(found), found.nominal, found.prepared.judging)


def _closest(found: Diagnosis) -> ProcessNoiseFit:
    """Return the model with what was found, or with the process effect that gains most unseen.

    Beside noise that is correlated a right effect explains little of what seems to be missing.
    """
    gone = [] if found.accepted else [w.candidate for w in found.withdrawn]
    gaining = [c for c in gone if c.held_out[1] > 0.0 and not is_sensor(c)]
    best = max(gaining, key=lambda c: c.held_out[0], default=None)
    return found.extended if best is None or best.fit is None else best.fit
