"""Measured force maps of a muscle against force laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import FAINT, FURTHER, INK, MEASURED, REFERENCE, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def force_map(
    contractions: Sequence[npt.ArrayLike],
    measured: Sequence[npt.ArrayLike],
    pressures: npt.ArrayLike,
    fine: npt.ArrayLike,
    laws: Mapping[str, Sequence[npt.ArrayLike]],
) -> Figure:
    """Draw measured force over contraction with several laws, one panel per pressure.

    Args:
        contractions: Contraction of the measured points of each panel, in m.
        measured: Measured force of each panel, in N.
        pressures: Gauge pressure of each panel, shape (panels,), in Pa.
        fine: Contractions along which the laws are drawn, shape (n,), in m.
        laws: Force of each law, one row of shape (n,) per panel, in N.
    """
    from matplotlib.lines import Line2D

    bars = np.asarray(pressures, dtype=float) / 1e5
    figure, panels = new_figure([1.45] * len(bars))
    shades = dict(zip(laws, FURTHER, strict=False))
    for i, (axes, bar) in enumerate(zip(panels, bars, strict=True)):
        axes.axhline(0.0, color=REFERENCE.light, linewidth=0.9)
        for name, rows in laws.items():
            axes.plot(1e3 * np.asarray(fine), rows[i], color=shades[name].light, linewidth=1.2)
        axes.plot(1e3 * np.asarray(contractions[i]), measured[i], "o", color=MEASURED.light, ms=4)
        axes.text(
            0.985,
            0.88,
            f"{bar:.3g} bar",
            transform=axes.transAxes,
            ha="right",
            color=INK.light,
            fontsize=9,
        )
        axes.margins(x=0.02)
        axes.set_ylim(bottom=min(-30.0, 1.3 * float(np.min(measured[i]))))
        label(axes, x="contraction in mm" if i == len(bars) - 1 else None, y="force in N")
    handles = [
        Line2D([], [], color=MEASURED.light, marker="o", ms=4, linestyle="none", label="measured")
    ]
    handles += [Line2D([], [], color=shades[n].light, linewidth=1.2, label=n) for n in laws]
    key(panels[0], columns=2, handles=handles)
    figure.align_ylabels()
    return figure


def law_errors(
    names: Sequence[str], fitted_on: npt.ArrayLike, held_out: npt.ArrayLike, nominal: npt.ArrayLike
) -> Figure:
    """Draw how far each force law is from the measurement, on a logarithmic axis.

    Args:
        fitted_on: Rms error on the points fitted on, shape (laws,), in N.
        held_out: Rms error on the points held out, shape (laws,), in N.
        nominal: Rms error with the published coefficients, shape (laws,), in N; NaN if none.

    Returns:
        The figure: rms error in N, on a logarithmic axis.
    """
    figure, (axes,) = new_figure([0.36 * len(names) + 0.4])
    rows = np.arange(len(names), dtype=float)
    axes.hlines(rows, 1.0, 1e3, color=FAINT.light, linewidth=0.8, linestyle=":")
    for values, colour, text, mark in (
        (nominal, REFERENCE, "published coefficients", "s"),
        (fitted_on, FURTHER[0], "refitted, points fitted on", "o"),
        (held_out, FURTHER[5], "refitted, contractions held out", "D"),
    ):
        axes.plot(values, rows, mark, color=colour.light, markersize=6, label=text)
    axes.set_xscale("log")
    axes.set_yticks(rows, names)
    axes.invert_yaxis()
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(1.0, 1e3)
    axes.margins(y=0.1)
    label(axes, x="rms error in N")
    key(axes, columns=1)
    return figure
