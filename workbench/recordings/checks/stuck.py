"""Does every signal move at all, and none of them stand still for a while?"""

from __future__ import annotations

from math import log

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector, runs
from workbench.model.units import in_time
from workbench.recordings.checks.check import MAX_EXCLUDED, Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.gaps import filled
from workbench.recordings.checks.noise import white_rms
from workbench.recordings.checks.quantisation import MIN_LEVELS, smallest_step
from workbench.recordings.recording import Recording


@check(
    "constant signals",
    30,
    foundation=True,
    fix="check the cable and the channel, and that the column is the right one",
)
def check_constant(recording: Recording, expected: Expected) -> Finding:
    """Check that something was measured and that no required measurement is constant.

    A constant input is what the machine really got, and allowed.
    """
    still = [s for s in recording.signals if np.ptp(s.values[np.isfinite(s.values)]) == 0]
    names = tuple(s.name for s in still)
    values = {"constant": names}
    measured = set(recording.measurements)
    if not measured:
        return Finding("unfit", "the recording holds no measurement", values)
    notes, problems = [], []
    for signal in still:
        value = f"{signal.displayed()[0]:g} {signal.display_unit}".strip()
        if signal.name not in measured:
            notes.append(f"{signal.name} is {value} throughout")
        elif signal.name in expected.required:
            problems.append(
                f"{signal.name} reads {value} throughout: the sensor is disconnected or its channel"
                " wrong; leave it out if it is not needed"
            )
        else:
            notes.append(f"{signal.name} constant, not required")
    if measured <= set(names):
        problems = problems or ["no measured signal changes"]
    if problems:
        return Finding("unfit", "; ".join(problems), values)
    return Finding("pass", "; ".join(notes) or "every signal changes", values)


_MIN_RUN = 10
_NEIGHBOURS = 10


def _jumps_out(values: Vector, first: int, last: int, step: float) -> bool:
    """Tell whether a constant run ends in a jump that the motion around it does not explain."""
    after = values[last + 1 : last + 2 + _NEIGHBOURS]
    if len(after) < 3:
        return False
    before = values[max(0, first - _NEIGHBOURS) : first]
    jump = abs(after[0] - values[last])
    around = np.abs(np.concatenate([np.diff(after), np.diff(before)]))
    return bool(jump > max(8 * step, 5 * around.max(initial=0.0)))


def stuck_samples(values: Vector) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Find samples that repeat a frozen measurement.

    A run of equal samples counts as frozen if the signal's own noise makes it impossible (the
    chance of one such run in the recording is below one in a million), or if it ends in a jump of
    more than five times the steps around it. A signal quieter than its converter's step repeats
    itself naturally where the machine rests, stuck by dry friction or at a stop.

    Args:
        values: Samples, shape (n,), finite.

    Returns:
        Masks, shape (n,), dimensionless: of frozen samples (the first one of a run is real), and of
        those that are surely so, for they end in a jump.
    """
    bad = np.zeros(len(values), dtype=bool)
    sure = bad.copy()
    equal = np.diff(values) == 0
    found = [(a, b + 1) for a, b in runs(equal) if b - a + 2 >= _MIN_RUN]
    if not found or len(np.unique(values)) < MIN_LEVELS:
        return bad, sure
    step = smallest_step(values)
    free = np.ones(len(equal), dtype=bool)
    for a, b in found:
        free[a:b] = False
    chance = float(np.mean(equal[free])) if free.any() else 1.0
    # The quietest blocks count: in the others, fast motion looks like noise.
    noisy = white_rms(values, quantile=0.1) > 0.5 * step and chance < 0.5
    # n p^(L-1) < 1e-6: no such run by chance.
    longest = 1 + log(1e-6 / len(values)) / log(max(chance, 1e-3)) if noisy else float("inf")
    for a, b in found:
        bad[a + 1 : b + 1] = jumps = _jumps_out(values, a, b, step)
        if b - a + 1 > max(longest, _MIN_RUN):
            bad[a + 1 : b + 1] = True
        sure[a + 1 : b + 1] = jumps
    return bad, sure


_FAR, _FEW = 3.0, 2
"""How many times a jump to an end of what a sensor reads exceeds all its other steps, there and
back, and how often it does so, where the sensor failed."""


def dropped_out(values: Vector) -> npt.NDArray[np.bool_]:
    """Find samples in which a sensor fails for a moment: it reads nothing, or all that it can.

    Args:
        values: Samples, shape (n,), finite.

    Returns:
        Mask, shape (n,), dimensionless.
    """
    bad = np.zeros(len(values), dtype=bool)
    if len(np.unique(values)) < MIN_LEVELS:
        return bad
    steps = np.abs(np.diff(values))
    for end in (values.min(), values.max()):
        at = values == end
        others = steps[~at[1:] & ~at[:-1]]
        spells = [(a, b) for a, b in runs(at) if a > 0 and b + 1 < len(values)]
        far = _FAR * others.max(initial=0.0)
        failed = [(a, b) for a, b in spells if min(steps[a - 1], steps[b]) > far]
        if len(failed) >= _FEW and np.mean(at) <= MAX_EXCLUDED:
            for a, b in failed:
                bad[a : b + 1] = True
    return bad


_EDGE, _FARTHER, _NOTHING = 0.005, 10.0, 0.02
"""Part of a recording, at its begin or end, in which a sensor may not be ready yet, or no more; how
many times its jump there exceeds all others where it does not read nothing; and what that is, as a
part of the jump."""


def not_ready(recording: Recording, name: str) -> npt.NDArray[np.bool_]:
    """Find samples at the begin or end in which a sensor reads nothing, or all that it can.

    It jumps from there farther than anywhere else, and no command does. What is let go as a
    recording begins moves less in the first step, unless that is all that it does.

    Returns:
        Mask, shape (n,), dimensionless.
    """
    values, shown = recording[name], recording.signal(name).displayed()
    bad, steps = np.zeros(len(values), dtype=bool), np.abs(np.diff(values))
    moved = [np.abs(np.diff(recording[c])) for c in recording.commands]
    for end in (values.min(), values.max()):
        for a, b in runs(values == end):
            at = b if a == 0 else a - 1
            if (a > 0 and b + 1 < len(values)) or b - a > _EDGE * len(values):
                continue
            nothing = abs(shown[a]) <= _NOTHING * abs(shown[at + 1] - shown[at])
            far = (_FAR if nothing else _FARTHER) * np.delete(steps, at).max(initial=0.0)
            quiet = all(m[at] < 0.5 * np.delete(m, at).max(initial=0.0) or not m[at] for m in moved)
            bad[a : b + 1] |= steps[at] > far and quiet
    return bad


def _goes_on(recording: Recording, name: str, bad: npt.NDArray[np.bool_]) -> bool:
    """Tell whether other measurements move to the end as before, while one stands still.

    A command that goes on proves nothing: friction or a stop may hold the machine against it.
    """
    first = runs(bad)[-1][0]
    others = [recording[m] for m in recording.measurements if m != name]
    return any(np.ptp(v[first:]) > 0.5 * np.ptp(v[:first]) > 0 for v in others)


@check("stuck samples", 50, fix="check the converter and the sampling, and record again")
def check_stuck(recording: Recording, expected: Expected) -> Finding:
    """Check for frozen measurements and such that drop out; bridge and exclude them.

    A reading that stands still and goes on without a jump has hidden nothing, and may be that of a
    machine which dry friction or a stop holds: that is a doubt, and nothing is left out.
    """
    notes, doubts = [], []
    changed = recording
    for name in recording.measurements:
        failed = dropped_out(recording[name]) | not_ready(recording, name)
        if (failed := failed & recording.valid(name)).any():
            changed = filled(changed, name, failed, "dropout")
            lasting = in_time(float(failed.sum()) * recording.sample_time)
            times = f"{(n := len(runs(failed)))} time{'s' * (n > 1)}"
            notes.append(f"{name} drops out {times}, for {lasting} in all; bridged and excluded")
        values = changed[name]
        bad, sure = (mask & changed.valid(name) for mask in stuck_samples(values))
        # One that stands at its largest or smallest value may be clipped.
        inside = values.min() < values[-1] < values.max()
        if bad[-1] and inside and _goes_on(recording, name, bad):
            sure[runs(bad)[-1][0] :] = True  # it never comes back
        if not bad.any():
            continue
        lost = sure if sure.any() else bad
        where = runs(lost)
        longest = max(where, key=lambda ab: ab[1] - ab[0])
        seconds = (longest[1] - longest[0] + 1) * recording.sample_time
        text = (
            f"{name} freezes {len(where)} time(s), the longest for {in_time(seconds)} at "
            f"{in_time(recording.time[longest[0]], 6)}"
        )
        share = float(np.mean(sure))
        if not share:
            doubts.append(
                f"{text} and goes on without a jump: the reading, or a machine that friction or a"
                " stop holds"
            )
            continue
        if share > MAX_EXCLUDED and name in expected.required:
            note = f"{text}; {100 * share:.3g} % of it is lost"
            return Finding("unfit", note, {"share": {name: share}})
        changed = filled(changed, name, sure, "frozen reading")
        notes.append(text + "; bridged and excluded")
    if notes:
        note = "; ".join((*notes, *doubts))
        return Finding("corrected", note, recording=changed, doubt=bool(doubts))
    return Finding("pass", "; ".join(doubts) or "no measurement freezes", doubt=bool(doubts))
