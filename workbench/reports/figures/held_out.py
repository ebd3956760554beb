"""A held-out recording beside free runs of the nominal and of the refitted model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import (
    MEASURED,
    REFERENCE,
    SIMULATED,
    key,
    label,
    named_line,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_POINTS = 3000
"""More points than a picture has pixels only make the file large."""


def held_out(
    time: npt.ArrayLike,
    names: Sequence[str],
    measured: npt.ArrayLike,
    nominal: npt.ArrayLike,
    refitted: npt.ArrayLike,
) -> Figure:
    """Draw each output with both runs, and the error of both below it.

    Args:
        time: Sample times, shape (n,), in s.
        names: Name of each output with its unit, such as ``angle in °``.
        measured: Measurements, shape (n, outputs), in those units.
        nominal: Free run of the nominal model, of the same shape and units.
        refitted: Free run of the refitted model, of the same shape and units.
    """
    t = np.asarray(time, dtype=float)
    thin = slice(None, None, max(1, len(t) // _MOST_POINTS))
    y, before, after = (np.asarray(a, dtype=float) for a in (measured, nominal, refitted))
    figure, panels = new_figure([1.3, 0.8] * len(names))
    for i, name in enumerate(names):
        value, error = panels[2 * i : 2 * i + 2]
        value.plot(t[thin], y[thin, i], color=MEASURED.light, linewidth=1.3)
        value.plot(t[thin], before[thin, i], color=REFERENCE.light, linewidth=0.9, linestyle="--")
        value.plot(t[thin], after[thin, i], color=SIMULATED.light, linewidth=1.0)
        error.axhline(0.0, color=REFERENCE.light, linewidth=0.9, linestyle=":")
        error.plot(
            t[thin], (y - before)[thin, i], color=REFERENCE.light, linewidth=0.9, linestyle="--"
        )
        error.plot(t[thin], (y - after)[thin, i], color=SIMULATED.light, linewidth=1.0)
        label(value, y=name)
        label(error, y="error", x="time in s" if i == len(names) - 1 else None)
    key(
        panels[0],
        columns=3,
        handles=[
            named_line("measured", MEASURED, width=1.3),
            named_line("nominal", REFERENCE, width=0.9, style="--"),
            named_line("refitted", SIMULATED, width=1.1),
        ],
    )
    figure.align_ylabels()
    return figure
