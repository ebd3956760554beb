"""Do responses follow the command, and not the other way round in time?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.model.units import in_time
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.innovations import (
    MAX_SAMPLES,
    MEMORY,
    correlation,
    innovations,
    surprises,
)
from workbench.recordings.checks.noise import white_rms
from workbench.recordings.recording import Recording

_BLOCKS = (1, 5, 25)
"""Samples of which a block takes the mean: slow responses show in long blocks."""
_AROUND = 40
"""Blocks before and after the command in which a response is looked for; more for single ones."""
_NEAR = 6
_SEEN = 6.0
"""Sigmas from which an answer is there."""
_SURE = 8.0
"""Sigmas from which an answer at the wrong time is a mistake."""
_NONE = 4.5
_FEEDBACK = 4
"""Blocks by which a command of a closed loop may answer to a measurement."""
_ENOUGH = 300
_AGAIN = 0.5
"""Correlation of what is new in a command with itself later, from which on it repeats itself."""
_RICH = 0.2
"""Share of a command that its past does not predict, above which a response must show."""


@dataclass(frozen=True)
class Answer:
    """When a measurement answers to what is new in a command, at one length of blocks.

    Args:
        strength: Strongest correlation at any lag, in sigmas (a ratio).
        lag: Time of it after the command, in s; negative before it.
        near: Strongest correlation right after the command, in sigmas (a ratio).
        early: Whether the strongest comes before the command by more than a loop explains.
        late: Whether it comes much later than right after the command. Where a command repeats
            itself, what comes before one change may answer to an earlier one: neither is told.
    """

    strength: float
    lag: float
    near: float
    early: bool
    late: bool


def answers(recording: Recording, command: str, measurement: str) -> tuple[Answer, ...]:
    """Correlate what is new in a command with what is new in a measurement, before and after it.

    Both are freed of what their own past predicts; blocks of several samples show slow responses.
    """
    found = []
    for block in _BLOCKS:
        action, reaction = (_new(recording, name, block) for name in (command, measurement))
        around = _AROUND if block > 1 else 25 * _AROUND
        around = min(around, len(action) // 4)
        near, before = (_NEAR, _FEEDBACK) if block > 1 else (100, 2 * MEMORY)
        if len(action) < 10 * MEMORY or around <= near:
            continue
        lags = np.arange(-around, around + 1)
        sigmas = correlation(action, reaction, lags)
        best = int(np.argmax(np.abs(sigmas)))
        close = (lags >= 0) & (lags <= near)
        repeats = _repeats(action)
        strength, right_after = float(abs(sigmas[best])), float(np.max(np.abs(sigmas[close])))
        lag = float(lags[best] * block * recording.sample_time)
        early = bool(np.all(lags[best] + repeats < -before))
        late = bool(np.all(lags[best] - repeats > near))
        found.append(Answer(strength, lag, right_after, early, late))
    return tuple(found)


def answered(found: Sequence[Answer]) -> bool:
    """Tell whether a measurement answers right after what is new in a command."""
    return any(a.near >= _SEEN for a in found)


def _means(recording: Recording, name: str, block: int) -> Vector:
    kept = recording[name][:MAX_SAMPLES]
    count = len(kept) // block
    return np.asarray(kept[: count * block].reshape(count, block).mean(axis=1))


def _new(recording: Recording, name: str, block: int) -> Vector:
    if block == 1:
        return surprises(recording, name)
    means = _means(recording, name, block)
    if len(means) <= MEMORY or np.ptp(means) == 0:
        return np.zeros(0)
    return innovations(means, [means], memory=MEMORY // 2)


def _repeats(action: Vector) -> npt.NDArray[np.int_]:
    """Return the lags, in blocks, at which what is new in a command comes again, or its reverse.

    Zero is the first of them.
    """
    lags = np.arange(len(action) // 2 + 1)
    sigmas = correlation(action, action, lags)
    return np.asarray(lags[np.abs(sigmas) > _AGAIN * np.sqrt(len(action))])


@check("response", 125, fix="put command and measurements of the same rows beside each other")
def check_response(recording: Recording, expected: Expected) -> Finding:
    """Check that what is new in a command shows in the measurements, and shows after it.

    A response that comes long before its command, or none at all to a command that jumps about,
    means rows out of order, columns that are shifted, or columns of different experiments.
    """

    def asked(names: Sequence[str]) -> Sequence[str]:
        return [n for n in names if n in expected.required] or names

    moving = recording.moving(asked(recording.commands))
    seen = {m: recording[m] for m in asked(recording.measurements)}
    measured = [m for m, v in seen.items() if np.ptp(v) > 20 * white_rms(v)]
    if not moving or not measured or len(recording) < 10 * MEMORY:
        return Finding("not checked", "no command or no measurement moves, or too short")
    problems, doubts, seen_to, doubt = [], [], [], False
    values: dict[str, object] = {}
    for command in moving:
        every = {m: answers(recording, command, m) for m in measured}
        unknown, means = (f(recording, command, _BLOCKS[-1]) for f in (_new, _means))
        jumps = len(unknown) >= _ENOUGH and np.std(unknown) > _RICH * np.std(means)
        values |= {f"{command}->{m}": [a.near for a in found] for m, found in every.items()}
        for name, found in every.items():
            if answered(found):
                seen_to.append(f"{name} answers to {command}")
                continue
            sure = [a for a in found if a.strength >= _SURE and a.near < _NONE]
            early = next((a for a in sure if a.early), None)
            late = next((a for a in sure if a.late), None)
            if early is not None:
                problems.append(
                    f"{name} moves {in_time(-early.lag)} before {command} does"
                    f" ({early.strength:.0f} sigma): the columns are out of step, or the rows"
                    " out of order"
                )
            elif late is not None:
                text = f"{name} answers to {command} only after {in_time(late.lag)}"
                if (command, name) in expected.signs:
                    problems.append(
                        f"{text}, which the model does not: the columns are out of step"
                    )
                else:
                    doubts.append(text)
                    doubt = True
            else:
                # What changes slowly, as the weather, may act without being seen to.
                doubts.append(f"no answer of {name} to {command} is seen")
                doubt = doubt or bool(jumps)
        told = [a for found in every.values() for a in found]
        if jumps and not any(a.near >= _NONE or (a.late and a.strength >= _SURE) for a in told):
            problems.append(
                f"nothing that is measured answers to {command}, though it changes all the"
                " time: its column is of another experiment, or the rows are out of order"
            )
    if problems:
        return Finding("unfit", "; ".join(dict.fromkeys(problems)), values)
    if not seen_to:
        return Finding("not checked", "; ".join(doubts), values)
    return Finding("pass", "; ".join((*seen_to, *doubts)), values, doubt=doubt)
