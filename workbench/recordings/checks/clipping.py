"""Does a sensor or a command reach the end of its range?"""

from __future__ import annotations

from math import log

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector, runs
from workbench.model.units import in_time
from workbench.recordings.checks.check import MAX_EXCLUDED, Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.noise import white_rms
from workbench.recordings.checks.quantisation import MIN_LEVELS, smallest_step
from workbench.recordings.recording import Recording

_MIN_SAMPLES = 5


def clipped_samples(values: Vector) -> tuple[npt.NDArray[np.bool_], float]:
    """Find samples that stand at the end of the sensor's range.

    Samples equal to the largest or smallest value count if one run of them is longer than the
    signal's noise allows (a chance of one in ten thousand per recording), or if a quiet signal ran
    into its end with more than three converter steps per sample and was constant at once for five
    or more; a real turning point slows down.

    Returns:
        Mask, shape (n,), and the value of the limit, in the unit of the values, or NaN.
    """
    none = np.zeros(len(values), dtype=bool)
    if len(np.unique(values)) < MIN_LEVELS:
        return none, float("nan")
    step = smallest_step(values)
    noisy = white_rms(values) > 0.5 * step
    inner = (values[1:] != values.max()) & (values[1:] != values.min())
    chance = float(np.mean((np.diff(values) == 0)[inner])) if inner.any() else 1.0
    impossible = max(5.0, 1 + log(1e-4 / len(values)) / log(min(max(chance, 1e-3), 0.95)))
    best, limit = none, float("nan")
    for end in (float(values.max()), float(values.min())):
        mask = values == end
        proven = False
        for a, b in runs(mask):
            length = b - a + 1
            enters = abs(values[a] - values[a - 1]) if a else 0.0
            leaves = abs(values[b + 1] - values[b]) if b + 1 < len(values) else 0.0
            kink = not noisy and length >= 5 and max(enters, leaves) >= 3 * step
            proven = proven or kink or (noisy and length >= impossible)
        if proven and mask.sum() >= _MIN_SAMPLES and mask.sum() > best.sum():
            best, limit = mask, end
    return best, limit


@check("clipping", 40, fix="widen the range of the channel, or move less, and record again")
def check_clipping(recording: Recording, expected: Expected) -> Finding:
    """Check for clipped sensors and saturated commands.

    Clipped samples keep their value and are excluded from judgement, because the true one lies
    beyond; where they are more than a fifth they stay, and the limit belongs into the model.
    A saturated command is what the machine really got and only noted.
    """
    notes = []
    changed, limits = recording, {}
    for signal in recording.signals:
        if signal.role == "reference":
            continue
        if signal.role == "command":
            low, high = expected.ranges.get(signal.name, (-np.inf, np.inf))
            share = float(np.mean((signal.values <= low) | (signal.values >= high)))
            if share == 1.0:
                notes.append(f"{signal.name} is switched")
            elif share:
                notes.append(f"{signal.name} saturates in {100 * share:.3g} % of the samples")
            continue
        bad, limit = clipped_samples(signal.values)
        bad &= recording.valid(signal.name)
        if not bad.any():
            continue
        share = float(np.mean(bad))
        limits[signal.name] = limit
        text = (
            f"{signal.name} stands at its limit of {signal.displayed(limit):.5g} "
            f"{signal.display_unit} for {in_time(bad.sum() * recording.sample_time)} "
            f"({100 * share:.3g} %)"
        ).replace("  ", " ")
        if share > MAX_EXCLUDED:
            notes.append(f"{text}, too long to leave out: use a sensor of wider range")
            continue
        changed = changed.excluding(signal.name, bad, "clipped")
        notes.append(text + "; excluded")
    if changed is recording:
        note = "; ".join(notes) or "no sensor at its limit"
        return Finding("pass", note, {"limits": limits})
    return Finding("corrected", "; ".join(notes), {"limits": limits}, changed)
