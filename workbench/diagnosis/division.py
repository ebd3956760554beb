"""Recordings to judge on where only some to fit on are given, and recordings in parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import in_time
from workbench.recordings.checks.check import CHECKS
from workbench.recordings.checks.expected import expectations
from workbench.recordings.checks.gaps import pieces
from workbench.recordings.checks.time_base import in_order
from workbench.recordings.recording import Recording

HELD_OUT = 0.4
"""Share of a recording that is held out."""

_ROOM = 0.1
_STILL, _STILL_SAMPLES = 0.01, 10

Both = tuple[tuple[Recording, ...], tuple[Recording, ...]]


def in_two(model: Model, recording: Recording) -> tuple[Recording, Recording]:
    """Divide a recording where the measurements move least, about `HELD_OUT` from its end."""
    n = len(recording)
    outputs = [q for q in model.outputs if q.name in recording]
    moved = np.nansum(
        [np.abs(np.diff(recording[q.name], prepend=np.nan)) / q.scale for q in outputs], axis=0
    )
    width = max(_STILL_SAMPLES, round(_STILL * n))
    around = np.convolve(moved, np.ones(width), mode="same")
    first, last = (round((1.0 - HELD_OUT + off) * n) for off in (-_ROOM, _ROOM))
    at = first + int(np.argmin(around[first:last]))
    begun, rest = (
        replace(recording.take(rows), name=f"{recording.name}, {word}")
        for rows, word in ((slice(0, at), "first part"), (slice(at, n), "last part"))
    )
    return begun, rest


def _of_use(model: Model, piece: Recording) -> bool:
    """Tell whether a piece of a recording is long enough for a judgement, and shows a motion."""
    inputs = [q.name for q in model.inputs if q.name in piece]
    outputs = [q.name for q in model.outputs if q.name in piece]
    driven = piece.with_roles(dict.fromkeys(inputs, "command"))
    expected = expectations(driven, model=model, required=(*inputs, *outputs))
    basic = (check for check in CHECKS.members().values() if check.foundation)
    return all(check(driven, expected).result != "unfit" for check in basic)


def without_gaps(
    model: Model, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], list[str]]:
    """Return each piece between gaps too long to fill as a recording, and what is to be said.

    A piece that is too short to judge a model by is left out; a recording of nothing else stays.
    """
    found: list[Recording] = []
    notes = []
    for recording in recordings:
        ordered = in_order(recording)
        between, gaps = pieces(ordered) if ordered.increasing else ((), "")
        kept = [piece for piece in between if _of_use(model, piece)] if gaps else []
        found += kept or [recording]
        if kept:
            starts = [in_time(piece.time[0] - ordered.time[0], 4) for piece in kept]
            each = " and ".join(
                f"{len(p)} rows from {start} on" for p, start in zip(kept, starts, strict=True)
            )
            notes.append(f"{recording.name} has {gaps}; taken as recordings of their own: {each}")
    return tuple(found), notes


def with_some_held_out(
    model: Model, fit_on: Sequence[Recording], hold_out: Sequence[Recording]
) -> tuple[Both, str]:
    """Return recordings to fit on and to judge on, `without_gaps`, and what is to be said of that.

    Where none is held out, it is the last of several, or the last part of the only one.

    Raises:
        WorkbenchError: If there is none to fit on, or the only one is too short for two.
    """
    both, said = _divided(model, fit_on, hold_out)
    (fits, cut), (held, also) = (without_gaps(model, given) for given in both)
    return (fits, held), "; ".join(filter(None, [said, *cut, *also]))


def _divided(
    model: Model, fit_on: Sequence[Recording], hold_out: Sequence[Recording]
) -> tuple[Both, str]:
    """Divide recordings into some to fit on and some to judge on, as `with_some_held_out` does.

    Raises:
        WorkbenchError: If there is none to fit on, or the only one is too short for two.
    """
    if not fit_on:
        raise WorkbenchError("there is no recording to fit on (--fit)")
    if hold_out:
        return (tuple(fit_on), tuple(hold_out)), ""
    *others, last = fit_on
    if others:
        said = f"no recording is held out (--hold-out), so {last.name} is"
        return (tuple(others), (last,)), said
    if len(last) < 10 * _STILL_SAMPLES:
        raise WorkbenchError(
            f"{last.name} has {len(last)} samples, and {10 * _STILL_SAMPLES} are needed to hold out"
            " its last part; give another to judge on (--hold-out)"
        )
    fit, held = in_two(model, last)
    share = round(100.0 * held.duration / last.duration)
    said = f"no recording is held out (--hold-out), so the last {share} % of {last.name} are"
    return ((fit,), (held,)), said
