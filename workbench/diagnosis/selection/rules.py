"""The rules by which an effect is accepted: each with its threshold, its reason and its words."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.selection.candidate import Candidate, colours_noise

UNTRIED = "could not be tried"
"""Name of the rule that a candidate breaks whose refit failed."""

FREE_RUN = "free run"
"""Name of the rule that what a sensor does has to show in free runs, and no law may spoil them."""

SAME_LEVELS = "levels that differ"
"""Name of the rule that what differs from recording to recording breaks where it does not."""

NO_EVENT = "begins in a recording"
"""Name of the rule that an event breaks which was there from the start."""

TOO_LITTLE = "it explains too little of what the model leaves out"
"""What breaks the rule that an effect explains a share of the excess."""

SURPASSED = "another effect explains the recordings better"
"""Why an effect that passed every rule, or was not followed, is not taken."""

WIDER = 5.0
"""Factor by which a bound of the library, which is a guess, is widened that a solution sits on."""

SURE_OF = 3.0
"""Standard deviations by which a size is another than none."""

LEAST_GAIN = 15.0
"""Gain of log likelihood per effect that is asked for beyond the penalty for the library."""


@dataclass(frozen=True)
class Limits:
    """What the recordings and the library ask of an effect.

    Args:
        penalty: Log likelihood that an effect must gain for its parameters and for the size of the
            library, dimensionless.
        least_gain: Log likelihood that it must gain to explain enough of the excess, dimensionless.
        least_level: The same of what differs from recording to recording, dimensionless, if that
            is more: one size in each absorbs a part of anything.
        near_noise: Whether the model without it predicts nearly to the noise.
        perfect: Whether the model without it predicts the next sample as well as a right one; what
            it lacks then has to show in free runs.
    """

    penalty: float
    least_gain: float = 0.0
    least_level: float = 0.0
    near_noise: bool = False
    perfect: bool = False


class Question(NamedTuple):
    """What a rule is asked about.

    Args:
        threshold: That of the rule, dimensionless.
    """

    candidate: Candidate
    limits: Limits
    threshold: float


@dataclass(frozen=True)
class Rule:
    """One thing that is asked of an effect before it is believed.

    Args:
        name: Short name, as `verdict.json` gives it.
        threshold: The number that decides; dimensionless.
        broken: Says in what the effect breaks the rule; empty if it does not.
    """

    name: str
    threshold: float
    reason: str
    broken: Callable[[Question], str]


def selection_penalty(library: int, samples: int, parameters: int) -> float:
    """Return the log likelihood that an effect must gain: parameters and size of the library.

    ``LEAST_GAIN + parameters log(samples) / 2 + log(library)``, after the extended Bayesian
    information criterion of Chen and Chen (2008).

    Args:
        samples: Number of samples of the fitting recordings.

    Example:
        >>> round(selection_penalty(40, 1000, 1), 1)
        22.1
    """
    return LEAST_GAIN + 0.5 * parameters * math.log(max(samples, 1)) + math.log(max(library, 1))


def _refit(q: Question) -> str:
    return "" if q.candidate.fit is not None else q.candidate.refused or "the refit failed"


def _converged(q: Question) -> str:
    fit = q.candidate.fit
    return "" if fit is None or fit.refit.converged else "the refit did not converge"


def _sigma(q: Question) -> str:
    size = q.candidate.size
    if size is None or abs(size.value) >= q.threshold * size.std:
        return ""
    return f"its size is within {q.threshold:g} standard deviations of zero"


def _seen(q: Question) -> str:
    shift = q.candidate.shift
    if not shift < q.threshold:
        return ""
    return f"it moves no held-out measurement by more than {shift:.2g} of the noise"


def _bound(q: Question) -> str:
    size, entry = q.candidate.size, q.candidate.entry
    if size is None or entry.whole:
        return ""
    # An effect that was chosen again may have kept the wider bounds of before.
    if abs(size.value) <= q.threshold * max(entry.largest_size, size.prior.upper):
        return ""
    if size.unit == "1" and entry.largest_size == 1.0:
        # All of it is a size, not the end of a guess.
        return ""
    return f"its size is on its bound, {entry.largest_size:g} {size.unit}, however wide"


def _noise_apart(q: Question) -> str:
    fit = q.candidate.fit
    if fit is None or not colours_noise(q.candidate) or not fit.model.traits.misread:
        return ""
    size, units = q.candidate.size, {one.name: one.unit for one in fit.model.inputs}
    alike = q.candidate.entry.unit
    noise = [rms for name, rms in fit.model.traits.misread if units[name] == alike]
    if noise and size is not None and abs(size.value) > q.threshold * max(noise):
        return ""
    read = ", ".join(name for name, _ in fit.model.traits.misread)
    return f"it may only even out the noise with which {read} was read"


def _ahead(q: Question) -> str:
    size, about = q.candidate.size, q.candidate.entry.effect.about
    if size is None or not about.advance or size.value >= -q.threshold * size.std:
        return ""
    return "no sensor reads what is not there yet: it may read some of a rate too"


def _penalty(q: Question) -> str:
    if q.candidate.gain >= q.threshold * q.limits.penalty:
        return ""
    return f"it gains less than the penalty for the library, {q.limits.penalty:.1f}"


def _share(q: Question) -> str:
    level = q.candidate.entry.effect.about.level
    least = max(q.limits.least_gain, q.limits.least_level if level else 0.0)
    if q.candidate.gain >= q.threshold * least:
        return ""
    return TOO_LITTLE


def _begun(q: Question) -> str:
    fit, effect = q.candidate.fit, q.candidate.entry.effect
    when, clocks = effect.about.moment, [s for s in effect.states if s.unit == "s"]
    if fit is None or not when or effect.about.period or not clocks:
        return ""
    time = fit.refit.estimate(f"{effect.name}.{when}").value
    latest = time - min([clocks[0].initial, *(start for _, start in clocks[0].start_in)])
    if latest >= q.threshold * clocks[0].scale:
        return ""
    return "it was there from the start of every recording: it is no event"


def _held_out(q: Question) -> str:
    if q.candidate.held_out[1] > q.threshold:
        return ""
    return "it does not reliably improve the held-out recordings"


RULES = (
    Rule("refit", 0.0, "A refit that failed says nothing.", _refit),
    Rule(NO_EVENT, 0.01, "What acts from the start is another law's.", _begun),
    Rule("selection penalty", 1.0, "Among many effects one gains by chance.", _penalty),
    Rule("share of the excess", 1.0, "Less may be the wrong shape of another effect.", _share),
    Rule("held-out gain", 0.0, "Only what predicts unseen recordings is physics.", _held_out),
)
"""What refuses an effect, in the order in which it is asked."""

DOUBTS = (
    Rule(
        "converged",
        0.0,
        "What it has gained it gains, but further steps would gain more: its size is not settled.",
        _converged,
    ),
    Rule(
        "size beyond its uncertainty",
        SURE_OF,
        "The gain excludes zero; where the curvature does not, the size is known from one side"
        " only, as that of a stiff brim, or what gained was the move of another parameter.",
        _sigma,
    ),
    Rule("seen in the measurements", 0.3, "What moves nothing is not worth naming.", _seen),
    Rule(
        "noise apart",
        10.0,
        "Noise of a meter that read an input moves the model and not the machine: whatever evens it"
        " out runs closer. A play that is many times as wide does more than that.",
        _noise_apart,
    ),
    Rule(
        "behind what it reads",
        3.0,
        "What is ahead of its plant reads a rate beside it, such as the drop over a resistance in"
        " series with a capacitor.",
        _ahead,
    ),
    Rule("size off its bound", 0.999, "A solution on a bound is not a solution.", _bound),
)
"""What lowers the belief in an effect. Where the model without it predicts to the noise, nothing
calls for an effect, and a doubt refuses it."""

REFIT, SHARE, HELD_OUT = RULES[0], RULES[-2], RULES[-1]

IMPERFECT = 0.1
"""Process-noise scale above which the equations still leave something out."""

LEAST_SHARE = 0.3
"""Share of the excess misfit of the refitted nominal that a single effect must explain."""

LEAST_SHOWN = 0.7
"""What takes so much of the mean square of the free runs' error is there, however far the rest is
from the noise."""

LEAST_PREDICTED = 0.1
"""What predicts less of the excess misfit is no name even if runs come closer with it: it has moved
other parameters to better values, beside something that the library may not have. Nor is what takes
less of the free runs' error, however much better it predicts the next sample: an encoder that had
lost counts was stops that give way, with which the runs came no closer."""

LEAST_OF_REST = 0.6
"""The wrong shape of an effect that was found leaves a rest too, of which another name explains a
part; so much of it a further effect must explain."""

LEAST_TOGETHER = 0.5
"""Share of the excess that several effects must explain."""

LEAST_AT_FIRST = 0.05
"""Two effects that hide each other explain little one by one."""

LEAST_OF_ALL = 0.05
"""Less may be the wrong shape of an effect that was found, and is not worth a wrong name."""

LEAST_LEFT = 0.5
"""Share of the free run's error that has to be left for two effects to be searched for at once,
unless `LEAST_SHARE` of the excess is: two laws together fit what the wrong shape of another has
left. What drifts, such as an offset, has all of that error, and hides what else is left."""

LEAST_EXPLAINED = 0.3
"""Share of the held-out free-run error beyond the noise that everything found must remove."""

MOST_LEFT = 0.5
"""Where more than half of the misfit of the worst place is left beside everything found, a name may
stand for something that the library does not have."""

MOST_OFF = 0.03
"""Part of the mean square of the held-out runs' error beyond the noise that is left beside
everything found, from which on a name is only likely where the equations leave something out: the
nearest law of the library takes the place of one that it does not have. Runs nearer to the noise
than `NEAR_NOISE` may leave a larger part, of as many times the noise."""

BESIDE_LARGER = 0.15
"""What a finding does at its strongest over what another does at the same place, up to which it may
be what is left of the other's shape: a law of a book describes a machine to some 6 %, and a pad at
the stops took 10 % of a force law whose shape was another."""

NO_NAME = 0.8
"""Where so much of the misfit of the worst place is left beside findings that are each doubted,
none is named: what nobody modelled and no sensor reads, such as a slope of the road, is imitated a
little by many laws."""

NEAR_NOISE = 3.0
"""Held-out error over what noise and the uncertainty of the parameters leave, up to which nothing
is missing."""

DRIFTING = 5.0
"""Held-out error over the sensor's noise beyond which uncertain parameters are no excuse where
single samples are less likely than noise makes them: a heat pump whose efficiency was wrong ran 55
times the noise off, as far as its efficiency, which that had made uncertain by 10 %, let it."""

OFF_NOISE = 1.2
"""Held-out error over that of noise alone from which on something may be missing beside what was
found, where its author trusts the equations."""

LITTLE_LEFT = 1e-3
"""Part of the square of the refitted model's held-out error, beside that of noise, up to which what
was found surely is not searched for elsewhere: a bend that is rounded otherwise leaves as much, and
the second search takes as long as the first."""

AT_NOISE = 1.1
"""Held-out error over what noise and the uncertainty of the parameters leave, up to which laws are
refitted only for their score: what parameters took over so well is not missing."""

LITTLE_EXCESS = 0.05
"""Log likelihood that a model lacks per measured value up to which it predicts nearly to the noise
where its runs are at the noise too: errors a fifth larger than foretold."""


def lacks_little(excess: float, recordings: Sequence[Observed]) -> bool:
    """Whether a log likelihood (dimensionless) that a model lacks is next to nothing a value."""
    return excess < LITTLE_EXCESS * sum(int(np.isfinite(r.outputs).sum()) for r in recordings)


MUCH_CLOSER = 0.2
"""Part of the error of another effect's free runs that has to go for unseen recordings to be
believed before those that were fitted: chance and a happy start move runs too."""

SAME = 15.0
"""Difference of log likelihood below which two effects explain the recordings equally well."""

TWIN = 0.999
"""Cosine between the signatures of two effects from which on they do the same to recordings: what
tells them apart, such as a reversal, has not been recorded."""

SAME_SHARE = 4e-3
"""Part of what a simpler effect gains that one with more parameters must gain beyond it: a law of a
book describes a machine to some 6 %, the square of which is left of its gain."""

INDISTINCT = 0.5
"""Mean difference of log likelihood in a block of time below which two effects predict the same:
parameters that only one of them has tell nothing."""


def judged(candidate: Candidate, limits: Limits) -> Candidate:
    """Return a candidate with the first rule that refuses it and all that lower the belief."""
    if candidate.refused:
        return candidate
    for rule in RULES:
        said = rule.broken(Question(candidate, limits, rule.threshold))
        if said:
            return replace(candidate, refused=said, rule=rule.name)
    doubts = _doubts(candidate, limits)
    if doubts and limits.near_noise:
        name, said = next(iter(doubts.items()))
        return replace(candidate, refused=said, rule=name)
    return replace(candidate, doubts=tuple(doubts.values()))


def _doubts(candidate: Candidate, limits: Limits) -> dict[str, str]:
    said = {r.name: r.broken(Question(candidate, limits, r.threshold)) for r in DOUBTS}
    return {name: text for name, text in said.items() if text}


def doubted_in(candidate: Candidate, fit: ProcessNoiseFit) -> Candidate:
    """Return a candidate with the doubts that its values in another fit leave, and those others."""
    limits = Limits(0.0)
    own = set(_doubts(candidate, limits).values())
    now = _doubts(replace(candidate, fit=fit), limits).values()
    doubts = (*now, *(d for d in candidate.doubts if d not in own))
    return candidate if doubts == candidate.doubts else replace(candidate, doubts=doubts)
