"""A recording: every signal over time, excluded spans shaded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.model.units import written_unit
from workbench.recordings.recording import Recording
from workbench.reports.style import INK, MEASURED, REFERENCE, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_POINTS = 4000


def recorded_signals(
    time: npt.ArrayLike,
    names: Sequence[str],
    values: Sequence[npt.ArrayLike],
    held: Sequence[bool],
    excluded: Sequence[tuple[int, float, float]] = (),
) -> Figure:
    """Draw every signal of a recording.

    Args:
        time: Sample times, shape (n,), in s.
        names: Name of each signal with its unit, such as ``angle in °``.
        values: Values of each signal, shape (n,), in those units.
        held: Whether a signal keeps its value between samples, as commands do.
        excluded: Spans not to be used: place of the signal, start and stop in s.
    """
    t = np.asarray(time, dtype=float)
    thin = slice(None, None, max(1, len(t) // _MOST_POINTS))
    figure, panels = new_figure([0.9] * len(names))
    for i, (name, signal, steps) in enumerate(zip(names, values, held, strict=True)):
        shown = np.asarray(signal, dtype=float)[thin]
        if steps:
            panels[i].step(t[thin], shown, where="post", color=INK.light, linewidth=0.9)
        else:
            panels[i].plot(t[thin], shown, color=MEASURED.light, linewidth=1.0)
        for place, start, stop in excluded:
            if place == i:
                panels[i].axvspan(start, stop, color=REFERENCE.light, alpha=0.3, linewidth=0)
        label(panels[i], y=name, x="time in s" if i == len(names) - 1 else None)
    return figure


def recorded(recording: Recording) -> Figure:
    """Draw every signal of a recording, and the spans of each that are not to be used."""
    signals = recording.signals
    places = {signal.name: i for i, signal in enumerate(signals)}
    return recorded_signals(
        recording.time,
        [
            f"{s.name.replace('_', ' ')}\nin {written_unit(s.display_unit or '?') or '1'}"
            for s in signals
        ],
        [s.displayed() for s in signals],
        [s.zero_order_hold for s in signals],
        [(places[s.signal], s.start, s.stop) for s in recording.excluded if s.signal in places],
    )
