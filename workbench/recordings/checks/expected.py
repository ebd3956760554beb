"""What is known about a machine before its recording is judged."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from workbench.errors import WorkbenchError
from workbench.recordings.recording import Recording

ARM_SIGNS: Mapping[tuple[str, str], int] = {
    ("valve", "pressure_1"): 1,
    ("valve", "pressure_2"): -1,
    ("pressure_1", "angle"): 1,
    ("pressure_2", "angle"): -1,
}
"""A valve above its centre fills muscle 1 and vents muscle 2; muscle 1 raises the angle."""


@dataclass(frozen=True)
class Expected:
    """What the notes of a trial and a model say about a recording.

    Args:
        required: Signals that must be fit; the others only get a note.
        sample_rate_Hz: Rate in the notes of the trial; None if unknown.
        supply_pressure: Supply pressure, gauge, in Pa; None if unknown.
        ranges: Smallest and largest plausible value by signal, in SI.
        signs: Sign of the response to a cause, by (cause, response).

    Example:
        >>> Expected(required=("angle",)).sample_rate_Hz is None
        True
    """

    required: tuple[str, ...] = ()
    sample_rate_Hz: float | None = None
    supply_pressure: float | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    signs: Mapping[tuple[str, str], int] = field(default_factory=dict)


def _number(recording: Recording, key: str) -> float | None:
    value = recording.metadata.get(key)
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return float(value) if value > 0 else None
    return None


def _required(recording: Recording) -> tuple[str, ...]:
    """Take signals that somebody declared: by a unit, a mapping file or a model."""
    if recording.mapping is None:
        return recording.names
    stated = {row.signal for row in recording.mapping.rows if row.stated}
    # A file that states no unit at all leaves no way to tell what matters.
    return tuple(n for n in recording.names if n in stated)


def expectations(
    recording: Recording,
    *,
    model: Any = None,
    required: Iterable[str] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    signs: Mapping[tuple[str, str], int] | None = None,
) -> Expected:
    """Collect what is known about a recording.

    Args:
        recording: The recording; its metadata may give ``sample_rate_Hz`` and ``supply_bar``.
        model: Object with ``inputs`` and ``outputs``, whose names are required and whose
            limits are the plausible ranges; None without.
        required: Names of the signals that must be fit; by default those of the model, else those
            whose unit is stated.
        ranges: Plausible ranges by signal, in SI; take precedence over the model's.
        signs: Sign of the response by (cause, response); by default those of the arm, where its
            signals are present.

    Returns:
        The expectations.

    Raises:
        WorkbenchError: If a required signal is not in the recording.

    Example:
        >>> from workbench.recordings.example import example_recording
        >>> trial = example_recording(seconds=2.0)
        >>> expectations(trial, required=["angle"]).required
        ('angle',)
    """
    known: dict[str, tuple[float, float]] = {}
    names: tuple[str, ...] | None = None
    if model is not None:
        quantities = (*model.inputs, *model.outputs)
        names = tuple(q.name for q in quantities)
        for q in quantities:
            low, high = getattr(q, "lower", -math.inf), getattr(q, "upper", math.inf)
            if math.isfinite(low) and math.isfinite(high):
                known[q.name] = (low, high)
    known.update(ranges or {})
    if required is not None:
        names = tuple(required)
    for name in names or ():
        if name not in recording:
            raise WorkbenchError(
                f"recording {recording.name!r} has no signal {name!r}; it has "
                f"{', '.join(recording.names)}"
            )
    supply = _number(recording, "supply_bar")
    arm = ARM_SIGNS if {"valve", "pressure_1", "pressure_2"} <= set(recording.names) else {}
    chosen = arm if signs is None else signs
    return Expected(
        names if names is not None else _required(recording),
        _number(recording, "sample_rate_Hz"),
        None if supply is None else supply * 1e5,
        known,
        {k: s for k, s in chosen.items() if k[0] in recording and k[1] in recording},
    )
