"""Are the values plausible in the units they claim?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.model.units import from_si, same_dimension, to_si
from workbench.recordings.checks.check import Outcome, unchanged
from workbench.recordings.checks.expected import Expected
from workbench.recordings.recording import Recording, Signal

_NAME = "units"


class _Plausible(NamedTuple):
    """Extremes of a quantity on a laboratory machine, in SI, and the least useful travel."""

    low: float
    high: float
    travel: float


_BY_KIND = {
    "angle": _Plausible(-20.0, 20.0, 1e-4),
    "pressure": _Plausible(-1.05e5, 6e6, 100.0),
    "gauge pressure": _Plausible(-1.05e5, 6e6, 100.0),
    "voltage": _Plausible(-500.0, 500.0, 1e-4),
    "temperature": _Plausible(150.0, 2000.0, 0.0),
    "length": _Plausible(-100.0, 100.0, 1e-7),
    "force": _Plausible(-1e6, 1e6, 1e-4),
}
# The usual units of the field first: several may be plausible.
_UNITS = (
    "rad", "deg", "mrad", "bar", "Pa", "kPa", "mbar", "MPa", "psi", "V", "mV", "m", "mm", "um",
    "N", "kN", "degC", "K", "s", "ms",
)  # fmt: skip


def _better_unit(signal: Signal, stated: str, low: float, high: float, travel: float) -> str:
    """Return the unit in which the numbers would be plausible, ``""`` if there is none."""
    numbers = from_si(signal.values, stated)
    for unit in _UNITS:
        if unit == stated or not same_dimension(unit, stated):
            continue
        values = to_si(numbers, unit)
        if values.min() >= low and values.max() <= high and np.ptp(values) >= travel:
            return unit
    return ""


def _problem(signal: Signal, stated: str, expected: Expected) -> str:
    kind = _BY_KIND.get(signal.kind)
    if kind is None and signal.name not in expected.ranges:
        return ""
    low, high, travel = kind or _Plausible(-np.inf, np.inf, 0.0)
    if signal.name in expected.ranges:
        # A tenth of the range on each side for offsets, stops that give way, and noise.
        first, last = expected.ranges[signal.name]
        margin = 0.1 * (last - first)
        low, high, travel = first - margin, last + margin, 0.002 * (last - first)
    least, most = float(signal.values.min()), float(signal.values.max())
    unit = signal.display_unit or signal.unit
    shown = signal.displayed([least, most])
    if least < low or most > high:
        bounds = signal.displayed([low, high])
        text = (
            f"{signal.name} runs from {shown[0]:.4g} to {shown[1]:.4g} {unit}, outside the "
            f"plausible {bounds[0]:.4g} to {bounds[1]:.4g} {unit}"
        )
    elif 0 < most - least < travel and signal.role == "measurement":
        text = f"{signal.name} moves by {shown[1] - shown[0]:.3g} {unit} only"
    else:
        return ""
    better = _better_unit(signal, stated, low, high, 10 * travel) if stated else ""
    hint = f": the numbers look like {better}, not {stated}" if better else ""
    return f"{text}{hint}; correct the unit, sign or offset in the header or in a mapping file"


def check_units(recording: Recording, expected: Expected) -> Outcome:
    """Check that every signal is of a plausible size in its unit.

    Args:
        recording: The recording.
        expected: What is known about it; its ranges are sharper than the general ones.

    Returns:
        Pass or unfit; a wrong unit is named but not corrected, because two units may fit.

    Example:
        >>> from workbench.recordings.example import example_recording
        >>> trial = example_recording(seconds=2.0)
        >>> print(check_units(trial, Expected()).check)
        units: pass (plausible sizes)
    """
    stated = (
        {}
        if recording.mapping is None
        else {row.signal: row.unit for row in recording.mapping.rows}
    )
    problems, remarks = [], []
    for signal in recording.signals:
        problem = _problem(signal, stated.get(signal.name, signal.unit), expected)
        if problem and signal.name in expected.required:
            problems.append(problem)
        elif problem:
            remarks.append(problem)
    if problems:
        return unchanged(recording, _NAME, "unfit", "; ".join(problems))
    unstated = [s.name for s in recording.signals if not s.unit]
    if unstated:
        remarks.append(f"no unit stated for {', '.join(unstated)}: taken as SI")
    return unchanged(recording, _NAME, "pass", "; ".join(remarks) or "plausible sizes")
