"""Are the pressures gauge pressures?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.column_assignment import AMBIENT_PA
from workbench.recordings.recording import Recording

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
    its range by no more than 1.4 bar. A model whose range begins above half an atmosphere counts
    from vacuum, and its pressures stay.
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
            + (", above their range" if above else "")
        )
        note = f"{', '.join(names)} look absolute ({why}); 1.01325 bar subtracted"
        return Finding("corrected", note, values, changed)
    if min(low.values()) < 0.5 * AMBIENT_PA:
        return Finding("pass", f"falls to {min(low.values()) / 1e5:.3g} bar, so gauge", values)
    if all(recording.signal(name).kind == "gauge pressure" for name in names):
        return Finding("pass", "stated as gauge", values)
    note = (
        f"never below {min(low.values()) / 1e5:.3g} bar, so gauge cannot be told from "
        'absolute; taken as gauge (a mapping may state it: reference = "gauge")'
    )
    return Finding("not checked", note, values)
