"""Maxwell-slip elements of a muscle's hysteresis as parameters of the rig.

Units: SI; shares are relative.
"""

from __future__ import annotations

import numpy as np

from workbench.evaluation.rig.parameters import ELEMENTS


def elements(smallest: float, largest: float, count: int = ELEMENTS) -> dict[str, float]:
    """Return parameters of `count` equal elements, break-aways from smallest to largest in m."""
    if count == 1:
        spread = np.array([largest])
    else:
        spread = np.geomspace(smallest, largest, count)
    return explicit(list(spread), [1.0 / count] * count)


def explicit(breakaways: list[float], weights: list[float]) -> dict[str, float]:
    """Return parameters of elements with the given break-aways in m and shares."""
    values: dict[str, float] = {}
    for i in range(ELEMENTS):
        inside = i < len(breakaways)
        values[f"hyst_d{i + 1}"] = float(breakaways[i]) if inside else 1.0
        values[f"hyst_w{i + 1}"] = float(weights[i]) if inside else 0.0
    return values
