"""Are values plausible in the units that the file states, and pressures counted from ambient?"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from workbench.model.units import from_si, same_dimension, to_si
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.column_matching import AMBIENT_PA
from workbench.recordings.recording import Recording, Signal

_NEAR = 0.06e5
"""Weather and sensor offsets move the ambient measurement by some 0.05 bar."""


@check(
    "gauge pressure",
    70,
    fix="say in a mapping (--mapping) whether the pressure is gauge or absolute",
)
def check_gauge(recording: Recording, expected: Expected) -> Finding:
    """Check whether pressures are gauge or absolute; turn absolute ones into gauge.

    A vented volume reads 0 gauge, and about 1.01 bar absolute. Pressures count as absolute if none
    ever falls below ambient, at least one dwells there, and they rise well above; or if one exceeds
    its range by no more than 1.4 bar. Pressures of a plant that counts from vacuum stay.
    """
    names = [
        s.name
        for s in recording.signals
        if s.kind in ("pressure", "gauge pressure")
        and expected.ranges.get(s.name, (0.0, 0.0))[0] < 0.5 * AMBIENT_PA
    ]
    if not names:
        return Finding("pass", "no gauge pressures")
    low = {n: float(np.quantile(recording[n], 0.001)) for n in names}
    high = {n: float(np.quantile(recording[n], 0.999)) for n in names}
    dwell = {n: float(np.mean(np.abs(recording[n] - AMBIENT_PA) < _NEAR)) for n in names}
    floored = all(v > AMBIENT_PA - _NEAR for v in low.values())
    vented = any(
        dwell[n] > 0.01 and low[n] < AMBIENT_PA + _NEAR and high[n] > 2.5 * AMBIENT_PA
        for n in names
    )
    excess = [high[n] - expected.ranges[n][1] for n in names if n in expected.ranges]
    above = any(e > 0.4 * AMBIENT_PA for e in excess)
    shifted = all(e < 1.4 * AMBIENT_PA for e in excess)
    values = {"lowest": low, "highest": high}
    unit = recording.signal(names[0]).display_unit
    least = f"{from_si(min(low.values()), unit):.3g} {unit}"
    if floored and shifted and (vented or above):
        changed = recording
        for name in names:
            signal = recording.signal(name)
            changed = changed.with_signal(
                replace(signal, values=signal.values - AMBIENT_PA, kind="gauge pressure")
            )
        why = ["never below ambient"]
        why += ["resting there"] * vented + ["above their range"] * above
        ambient = f"{from_si(AMBIENT_PA, unit):.6g} {unit}"
        note = f"{', '.join(names)} look absolute ({', '.join(why)}); {ambient} subtracted"
        return Finding("corrected", note, values, changed)
    if min(low.values()) < 0.5 * AMBIENT_PA:
        return Finding("pass", f"falls to {least}, so gauge", values)
    if all(recording.signal(name).kind == "gauge pressure" for name in names):
        return Finding("pass", "stated as gauge", values)
    note = (
        f"never below {least}, so gauge cannot be told from "
        'absolute; taken as gauge (a mapping may state it: reference = "gauge")'
    )
    return Finding("not checked", note, values)


# The usual units of the field first: several may be plausible.
_UNITS = (
    "rad", "deg", "mrad", "bar", "Pa", "kPa", "mbar", "MPa", "psi", "V", "mV", "m", "mm", "um",
    "N", "kN", "degC", "K", "s", "ms",
)  # fmt: skip
_SMALL = 20.0
"""Share of a range, inverted, below which a travel may be one in another unit."""
_FAR = 30.0
"""Times a model's typical size; a unit is wrong by more, a machine seldom."""


def _plausible(signal: Signal, expected: Expected) -> tuple[float, float, float] | None:
    """Return least and most value and least travel, in SI; None if nobody knows."""
    known = {**expected.reach, **expected.ranges}
    if signal.name in known:
        # A tenth of the range on each side for offsets, stops that give way, and noise.
        first, last = known[signal.name]
        margin = 0.1 * (last - first)
        return first - margin, last + margin, 0.002 * (last - first)
    scale = expected.scales.get(signal.name)
    if scale is None:
        return None
    return -_FAR * scale, _FAR * scale, scale / _FAR**2


def _better_unit(signal: Signal, stated: str, low: float, high: float, travel: float) -> str:
    """Return the unit in which the numbers would be plausible, ``""`` if there is none."""
    numbers = from_si(signal.values, stated)
    for unit in (signal.display_unit, *_UNITS):
        if unit == stated or not same_dimension(unit, stated):
            continue
        values = to_si(numbers, unit)
        if values.min() >= low and values.max() <= high and np.ptp(values) >= travel:
            return unit
    return ""


def _problem(
    signal: Signal, stated: str, known: tuple[float, float, float], believed: bool
) -> tuple[str, bool]:
    """Return what is not plausible, ``""`` if nothing, and whether another unit would be."""
    low, high, travel = known
    least, most = float(signal.values.min()), float(signal.values.max())
    unit = signal.display_unit
    shown = signal.displayed([least, most])
    if least < low or most > high:
        bounds = signal.displayed([low, high])
        text = (
            f"{signal.name} runs from {shown[0]:.4g} to {shown[1]:.4g} {unit}, outside the "
            f"plausible {bounds[0]:.4g} to {bounds[1]:.4g} {unit}"
        )
    elif believed and 0 < most - least < travel and signal.role == "measurement":
        text = f"{signal.name} moves by {shown[1] - shown[0]:.3g} {unit} only"
    else:
        return "", False
    # Units differ by ten and more; what is only somewhat outside is a sensor's gain or offset.
    far = most - least < travel or max(-least, most) > 5 * max(abs(low), abs(high))
    # In the right unit it moves by a tenth of its range or more, as a wrong gain need not.
    better = _better_unit(signal, stated, low, high, 50 * travel) if stated and far else ""
    if better:
        return (
            f"{text}: the numbers look like {better}, not {stated}; correct the unit in the header"
            " or in a mapping file",
            True,
        )
    return text, False


def _suspicion(signal: Signal, stated: str, low: float, high: float) -> str:
    """Return what speaks for another unit although the values are possible; empty if nothing."""
    travel, width = float(np.ptp(signal.values)), high - low
    if not stated or not 0 < travel < width / _SMALL:
        return ""
    for unit in _UNITS:
        factor = float(to_si(1.0, unit) / to_si(1.0, stated)) if same_dimension(unit, stated) else 0
        values = factor * signal.values
        if factor > _SMALL and values.min() >= low and values.max() <= high:
            least, most = signal.displayed([signal.values.min(), signal.values.max()])
            shown = signal.display_unit
            return (
                f"{signal.name} moves by {most - least:.3g} {shown} only, a {width / travel:.0f}th"
                f" of its range: numbers in {unit} would do so too"
            )
    return ""


def beyond_range(signal: Signal, low: float, high: float, *, clipped: bool = True) -> str:
    """Say that a command leaves the range of its input, in SI; empty if it does not.

    A hundredth of the travel is the converter's or the noise's.

    Args:
        low: Lower end of the range, in SI.
        high: Its upper end, in SI.
        clipped: Whether the model clips it to its range; else the range is taken as wide.
    """
    margin = 0.01 * np.ptp(signal.values)
    out = (signal.values < low - margin) | (signal.values > high + margin)
    if signal.role != "command" or not out.any():
        return ""
    unit = signal.display_unit
    ends = signal.displayed([signal.values.min(), signal.values.max(), low, high])
    said = (
        f"{signal.name} runs from {ends[0]:.4g} to {ends[1]:.4g} {unit}, the plant declares"
        f" {ends[2]:.4g} to {ends[3]:.4g}: "
    )
    if not clipped:
        return f"{said}no measurement shows it clipped, so the range is taken as wide"
    return (
        f"{said}the model gets it clipped, as an actuator would; declare lower and upper wider if"
        " nothing clips it"
    )


@check(
    "units", 60, fix="say the unit in the heading or in a mapping (--mapping), such as pressure_bar"
)
def check_units(recording: Recording, expected: Expected) -> Finding:
    """Check that every signal is of the size that the model or a range says.

    Numbers that are plausible in another unit alone are unfit, not corrected, because two units may
    fit. What is out of range in every unit is a gain or an offset that a diagnosis may name; what
    is possible, but so small that another unit is as likely, is a doubt.
    """
    stated = {row.signal: row.unit for row in recording.mapping or ()}
    problems, remarks, unknown = [], [], []
    for signal in recording.signals:
        known = _plausible(signal, expected)
        if known is None:
            unknown.append(signal.name)
            continue
        unit = stated.get(signal.name) or signal.unit
        ranged = signal.name in expected.reach or signal.name in expected.ranges
        believed = ranged or signal.name in expected.believed
        problem, other_unit = _problem(signal, unit, known, believed)
        if believed and not problem and (suspicion := _suspicion(signal, unit, *known[:2])):
            remarks.append(suspicion)
        bounds = expected.ranges.get(signal.name, (-math.inf, math.inf))
        problem = problem or beyond_range(signal, *bounds)
        if problem and other_unit and signal.name in expected.required:
            problems.append(problem)
        elif problem:
            remarks.append(problem)
    if problems:
        return Finding("unfit", "; ".join(problems))
    doubt = bool(remarks)
    unstated = [
        s.name for s in recording.signals if s.unit != "1" and not stated.get(s.name, s.unit)
    ]
    if unstated:
        remarks.append(f"no unit stated for {', '.join(unstated)}: taken as SI")
    if len(unknown) == len(recording.signals):
        remarks.insert(0, "no model or range says what is plausible")
        return Finding("not checked", "; ".join(remarks))
    note = "; ".join(remarks) or "plausible sizes"
    return Finding("pass", note, doubt=doubt)
