"""Which of several refitted hypotheses is taken: rules, unseen recordings, free runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.diagnosis.estimation.process_noise import gain_interval
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.candidate import Candidate, colours_noise, is_sensor
from workbench.diagnosis.selection.held_out import RunErrors, told_apart


def decided(
    candidates: Sequence[Candidate], without: RunErrors, limits: rules.Limits
) -> tuple[Candidate, ...]:
    """Decide which of several refitted hypotheses is taken.

    Args:
        without: Errors of the runs of the model without any of them.

    Returns:
        The candidates by falling gain, the one that is taken without a refusal, the others with
        the reason.
    """
    found = sorted((rules.judged(c, limits) for c in candidates), key=lambda c: -c.gain)
    if not limits.near_noise:
        found = [_run_freely(c, without, shown=limits.perfect) for c in found]
    for i, candidate in enumerate(found):
        if not candidate.refused or limits.near_noise:
            # Near the noise free runs cannot be closer but by chance.
            break
        if _runs_closer(candidate, without):
            # How much it explains may lower the belief; what it gains on unseen data it gains.
            doubt = (candidate.refused,) if candidate.rule == rules.SHARE.name else ()
            found[i] = replace(candidate, refused="", rule="", doubts=doubt)
            break
    reliable = [c for c in found if not c.refused]
    found = [_as_reliable(c, reliable, without, limits) for c in found]
    passing = [c for c in found if not c.refused]
    best = passing[0] if passing else None
    if best is not None and best.doubts:
        # Of two that the data cannot tell apart, the one without a doubt.
        sure = (c for c in passing if not c.doubts and not told_apart(best.blocks, c.blocks))
        best = next(sure, best)
    if best is not None and is_sensor(best):
        # Where the process explains the runs better, it is the process.
        closest = best
        for c in passing:
            if not is_sensor(c) and c.run and closest.run and c.run.closer_than(closest.run):
                closest = c
        if closest is not best:
            best = closest
            found = [_outrun(f, best) for f in found]
            passing = [f for f in found if not f.refused]
    if best is not None:
        # Of those that explain the recordings as well, the one with the fewest parameters; then
        # the likeliest on all recordings together.
        same = [c for c in passing if len(c.doubts) <= len(best.doubts)]
        # What lies within a few units where both were fitted, unseen recordings decide.
        better = [c for c in same if abs(best.gain - c.gain) < rules.SAME and preferred(c, best)]
        best = max(better, key=lambda c: c.held_out[0], default=best)
        # So they do where they say it twice: of what comes next, and of whole runs.
        closer = [c for c in same if closer_unseen(c, best)]
        best = max(closer, key=lambda c: c.held_out[0], default=best)
        same = [
            c
            for c in same
            if c is best
            or degenerates_to(best, c)
            or overfits(best, c)
            or not (told_apart(best.blocks, c.blocks) or closer_unseen(best, c))
        ]
        best = min(same, key=lambda c: (c.own_parameters, -c.gain - c.held_out[0]))
    return tuple(
        c if c is best or c.refused else replace(c, refused=rules.SURPASSED) for c in found
    )


def degenerates_to(one: Candidate, other: Candidate) -> bool:
    """Whether an effect ended where it is no more than another one with fewer parameters.

    Its shape is on a bound, or the recordings are as likely with the other from block to block.
    """
    if other.own_parameters >= one.own_parameters:
        return False
    if not one.degenerate and not _as_likely(one, other):
        return False
    gained = [one.gain - other.gain]
    within = max(rules.SAME, rules.SAME_SHARE * other.gain)
    if one.fit and other.fit and one.fit.noise_scale == other.fit.noise_scale:
        # What is trusted less gains less on unseen recordings, however equal.
        gained.append(one.held_out[0] - other.held_out[0])
    return max(map(abs, gained)) < within


def _as_likely(one: Candidate, other: Candidate) -> bool:
    pairs = list(zip(one.blocks, other.blocks, strict=False))
    if len(pairs) < 2 or any(len(a) != len(b) for a, b in pairs):
        return False
    count = sum(len(a) for a, _ in pairs)
    # Of what the simpler one gains in a block, a part may be told by the form of its law.
    within = max(rules.INDISTINCT, rules.SAME_SHARE * (other.gain + other.held_out[0]) / count)
    return all(float(np.abs(a - b).mean()) < within for a, b in pairs)


def overfits(one: Candidate, other: Candidate) -> bool:
    """Whether an effect loses on unseen recordings what it gains beyond a simpler one."""
    unseen = one.held_out[0] - other.held_out[0]
    more = one.own_parameters > other.own_parameters
    return more and unseen < 0.0 and one.gain - other.gain + unseen < rules.SAME


def preferred(one: Candidate, other: Candidate) -> bool:
    """Whether the held-out recordings clearly prefer one effect to another."""
    if len(one.blocks) < 2 or len(other.blocks) < 2:
        return False
    return gain_interval(other.blocks[1], one.blocks[1])[1] > 0.0


def closer_unseen(one: Candidate, other: Candidate) -> bool:
    """Whether unseen recordings are likelier with one effect, and its runs there much closer.

    A simpler effect with such runs need not be the likelier: it is enough that it gains there.
    What has a size of its own in each recording takes that from there: it has seen it.
    """
    if one.entry.effect.about.level:
        return False
    simpler = one.own_parameters < other.own_parameters and one.held_out[1] > 0.0
    if one.run is None or other.run is None:
        return False
    if one.held_out[0] <= other.held_out[0] and not simpler:
        return False
    return one.run.closer_than(other.run, by=rules.MUCH_CLOSER)


def _run_freely(candidate: Candidate, without: RunErrors, *, shown: bool) -> Candidate:
    """Refuse what predicts the next sample better and not what comes after it.

    What a sensor remembers between process and reading colours the noise, and so predicts the next
    sample of anything: it has to show in free runs. Any other law must not spoil them; what else is
    missing may be most of their error.

    Args:
        shown: Whether a law of the process has to show there too.
    """
    if candidate.refused or candidate.run is None:
        return candidate
    why = ""
    if shown or colours_noise(candidate):
        if not candidate.run.closer_than(without):
            why = "with it the model does not run closer to the held-out recordings"
    elif candidate.run.spoilt_from(without):
        why = "without it the model runs closer to the held-out recordings"
    return replace(candidate, refused=why, rule=rules.FREE_RUN) if why else candidate


def _as_reliable(
    candidate: Candidate, reliable: Sequence[Candidate], without: RunErrors, limits: rules.Limits
) -> Candidate:
    """Let pass what makes all recordings likelier than a law that passes does.

    Something is missing then, and a few moments must not give it the name of the worse law.
    """
    known = candidate.rule == rules.HELD_OUT.name and candidate.fit is not None
    if not known or not any(
        c.gain < candidate.gain and c.held_out[0] < candidate.held_out[0] for c in reliable
    ):
        return candidate
    assert candidate.fit is not None
    passed = rules.doubted_in(replace(candidate, refused="", rule=""), candidate.fit)
    if not limits.near_noise:
        passed = _run_freely(passed, without, shown=limits.perfect)
    return candidate if passed.doubts or passed.refused else passed


def _runs_closer(candidate: Candidate, without: RunErrors) -> bool:
    """Whether free runs show what single predictions leave open on the held-out recordings."""
    needed = {rules.HELD_OUT.name: 0, rules.SHARE.name: 1}.get(candidate.rule)
    if needed is None or candidate.run is None or candidate.held_out[needed] <= 0.0:
        return False
    if candidate.entry.effect.about.level and candidate.rule == rules.SHARE.name:
        # Its size in an unseen recording is taken from there.
        return False
    # The wrong shape of what was found leaves a rest too, of which another name takes a little.
    by = rules.LEAST_EXPLAINED if candidate.rule == rules.SHARE.name else 0.0
    return candidate.run.closer_than(without, by=by)


def _outrun(candidate: Candidate, by: Candidate) -> Candidate:
    """Refuse what a sensor does where a law of the process runs closer to the recordings."""
    if candidate.refused or not is_sensor(candidate):
        return candidate
    why = f"with {by.entry.name} the model runs closer to the held-out recordings"
    return replace(candidate, refused=why, rule=rules.FREE_RUN)
