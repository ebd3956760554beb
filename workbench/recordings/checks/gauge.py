"""Are the pressures gauge pressures?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.recordings.checks.check import Outcome, corrected, unchanged
from workbench.recordings.checks.expected import Expected
from workbench.recordings.column_assignment import AMBIENT_PA
from workbench.recordings.recording import Recording

_NAME = "gauge pressure"
_NEAR = 0.06e5
"""Weather and sensor offsets move the ambient reading by some 0.05 bar."""


def check_gauge(recording: Recording, expected: Expected) -> Outcome:
    """Check whether pressures are gauge or absolute; turn absolute ones into gauge.

    A vented volume reads 0 gauge, and about 1.01 bar absolute. Pressures count as absolute if none
    ever falls below ambient, at least one dwells there, and they rise well above; or if one exceeds
    the supply by no more than 1.4 bar. Both the shift and its reason are noted.

    Args:
        recording: The recording.
        expected: What is known about it; the supply pressure if it stands in the notes.

    Returns:
        Pass, corrected (1.01325 bar subtracted) or unfit (both a gauge and an absolute sign).

    Example:
        >>> from workbench.recordings.example import example_recording
        >>> trial = example_recording(seconds=2.0)
        >>> check_gauge(trial, Expected(supply_pressure=6e5)).check.result
        'pass'
    """
    names = [s.name for s in recording.signals if s.kind in ("pressure", "gauge pressure")]
    if not names:
        return unchanged(recording, _NAME, "pass", "no pressures")
    low = {n: float(np.quantile(recording[n], 0.001)) for n in names}
    high = {n: float(np.quantile(recording[n], 0.999)) for n in names}
    dwell = {n: float(np.mean(np.abs(recording[n] - AMBIENT_PA) < _NEAR)) for n in names}
    floored = all(v > AMBIENT_PA - _NEAR for v in low.values())
    vented = any(
        dwell[n] > 0.01 and low[n] < AMBIENT_PA + _NEAR and high[n] > 2.5 * AMBIENT_PA
        for n in names
    )
    supply = expected.supply_pressure
    above = supply is not None and max(high.values()) > supply + 0.4 * AMBIENT_PA
    shifted = supply is None or max(high.values()) < supply + 1.4 * AMBIENT_PA
    values = {"lowest": low, "highest": high}
    if floored and shifted and (vented or above):
        changed = recording
        for name in names:
            signal = recording.signal(name)
            changed = changed.with_signal(
                replace(signal, values=signal.values - AMBIENT_PA, kind="gauge pressure")
            )
        why = (
            "never below ambient"
            + (", resting there" if vented else "")
            + (", above the supply" if above else "")
        )
        return corrected(
            changed,
            _NAME,
            f"{', '.join(names)} look absolute ({why}); 1.01325 bar subtracted",
            values,
        )
    if above and supply is not None:
        worst = max(high, key=lambda n: high[n])
        return unchanged(
            recording,
            _NAME,
            "unfit",
            f"{worst} reaches {high[worst] / 1e5:.4g} bar but the supply is {supply / 1e5:.4g} "
            "bar gauge; correct the unit, the offset or the supply in the notes",
            values,
        )
    if min(low.values()) < 0.5 * AMBIENT_PA:
        note = f"falls to {min(low.values()) / 1e5:.3g} bar, so gauge"
    else:
        note = (
            f"never below {min(low.values()) / 1e5:.3g} bar, so gauge cannot be told from "
            "absolute; taken as gauge"
        )
    return unchanged(recording, _NAME, "pass", note, values)
