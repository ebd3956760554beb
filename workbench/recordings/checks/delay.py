"""How long after a command does a response show?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.arrays import Vector
from workbench.model.units import in_time
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.innovations import MEMORY, correlation, surprises
from workbench.recordings.checks.loop import check_loop
from workbench.recordings.checks.response import answered, answers
from workbench.recordings.recording import Recording

_THRESHOLD = 4.5
_PEAK = 5.5


@dataclass(frozen=True)
class Delay:
    """Delay between a command and a response.

    Args:
        onset: First lag at which the response shows, in s; NaN if it never does.
        peak: Lag of the strongest response, in s; NaN if it never shows.
        strength: Normalised correlation there, in sigmas, with its sign.
    """

    command: str
    response: str
    onset: float
    peak: float
    strength: float


def response_correlation(
    recording: Recording,
    command: str,
    response: str,
    *,
    max_delay: float = 0.2,
    closed_loop: bool = False,
    beside: tuple[str, ...] = (),
) -> Vector:
    """Return the correlation of a response with what is new in a command, in sigmas, by lag.

    Both are freed of what their own past predicts, so the result is close to the first samples of
    the impulse response, whatever the spectrum of the command. In closed loop the command answers
    to measurements within the sample; then the part that the measurements explain is taken out
    of the command, and what is left comes from the reference.

    Args:
        max_delay: Longest lag, in s; 10 samples at least, 200 at most, and none that is longer
            than what is new.
        beside: Commands that may move together with this one: what they explain of it is taken out.
    """
    lags = int(np.clip(round(max_delay / recording.sample_time), 10, 200))
    moving = recording.moving(recording.measurements) if closed_loop else ()
    explained = (*moving, *beside)
    action = surprises(recording, command, now=explained)
    return correlation(action, surprises(recording, response), np.arange(lags + 1)[: len(action)])


def estimate_delay(
    recording: Recording, command: str, response: str, *, closed_loop: bool = False
) -> Delay:
    """Estimate the delay between a command and a response, the sample of the reading included.

    The onset is the first of the lags around the strongest response that exceed 4.5 sigmas without
    a break and with the same sign; the strongest must exceed 5.5 sigmas.
    """
    if len(recording) < 10 * MEMORY:
        return Delay(command, response, float("nan"), float("nan"), 0.0)
    strength = response_correlation(recording, command, response, closed_loop=closed_loop)
    step = recording.sample_time
    if closed_loop:
        # What the measurements of the same sample explain has been taken out.
        strength[0] = 0.0
    peak = int(np.argmax(np.abs(strength)))
    if abs(strength[peak]) < _PEAK:
        return Delay(command, response, float("nan"), float("nan"), float(strength[peak]))
    onset = peak
    while onset > 0 and strength[onset - 1] * np.sign(strength[peak]) > _THRESHOLD:
        onset -= 1
    return Delay(command, response, onset * step, peak * step, float(strength[peak]))


@check("delay", 120)
def check_delay(recording: Recording, expected: Expected) -> Finding:
    """Estimate the delay from every command to every measured signal that is seen to answer.

    The strongest of many lags may be chance.
    """
    closed = check_loop(recording, expected).values["loop"] == "closed"
    delays = tuple(
        estimate_delay(recording, c, m, closed_loop=closed)
        for c in recording.moving(recording.commands)
        for m in recording.moving(recording.measurements)
    )
    shown = [d for d in delays if np.isfinite(d.onset)]
    seen = [d for d in shown if answered(answers(recording, d.command, d.response))]
    if not seen:
        why = "the commands change too smoothly" if delays else "no command moves"
        return Finding("not checked", f"{why} to see a delay", {"delays": delays})
    note = "; ".join(
        f"{d.command} shows in {d.response} after {in_time(d.onset)} (most after {in_time(d.peak)})"
        for d in seen
    )
    return Finding("pass", note, {"delays": delays})
