"""Bode and Nyquist plots of a family of linear models and opened loops, with their margins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.arrays import Complex, Vector
from workbench.reports.style import BAND, FAINT, INK, REFERENCE, key, label, new_figure, ramp
from workbench.study.margins import crossings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SAME = 5e-3


def bode(
    frequency: npt.ArrayLike,
    responses: Mapping[str, npt.ArrayLike],
    *,
    unit: str,
    quantity: str = "magnitude",
    margins: bool = False,
) -> Figure:
    """Draw magnitude and phase of frequency responses over frequency.

    Args:
        frequency: Frequencies, shape (n,), in Hz.
        responses: Complex response, shape (n,), in ``unit``, by the name of its curve; an ordered
            family such as angles takes the colours of the ramp, and curves that lie on each other
            are drawn once.
        unit: Unit of the magnitude, such as ``°/V``.
        margins: Whether they are loop gains, so that gain and phase margins are marked.
    """
    figure, (magnitude, phase) = new_figure([2.2, 1.7])
    hertz = np.asarray(frequency, dtype=float)
    drawn = distinct(responses)
    for (name, values), colour in zip(drawn.items(), ramp(len(drawn)), strict=True):
        shade = colour.light
        degrees = np.degrees(np.unwrap(np.angle(values)))
        # Unwrapping starts anywhere; curves are comparable when all start within one turn.
        degrees -= 360.0 * np.ceil((degrees[0] - 1.0) / 360.0)
        magnitude.loglog(hertz, np.abs(values), label=name, color=shade, linewidth=1.3)
        phase.semilogx(hertz, degrees, color=shade, linewidth=1.3)
        if margins:
            _mark_margins(magnitude, phase, hertz, values, degrees, shade)
    if margins:
        magnitude.axhline(1.0, color=REFERENCE.light, linewidth=0.9, linestyle=":")
        phase.axhline(-180.0, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    _round_ticks(magnitude, phase)
    label(magnitude, y=quantity if unit == "1" else f"{quantity} in {unit}")
    label(phase, x="frequency in Hz", y="phase in °")
    key(magnitude, columns=4)
    return figure


def distinct(responses: Mapping[str, npt.ArrayLike]) -> dict[str, Complex]:
    """Put curves that lie on each other together, such as those of angles that mirror each other.

    Args:
        responses: Complex response, shape (n,), in any unit, by the name of its curve.

    Returns:
        One curve for each that can be seen, under the names of all that it stands for.

    Example:
        >>> list(distinct({"10°": [1.0, 2.0], "30°": [1.0, 3.0], "50°": [1.0, 2.001]}))
        ['10° and 50°', '30°']
    """
    groups: list[tuple[list[str], Complex]] = []
    for name, response in responses.items():
        values = np.asarray(response, dtype=complex)
        for names, first in groups:
            if np.all(np.abs(values - first) <= _SAME * np.abs(first)):
                names.append(name)
                break
        else:
            groups.append(([name], values))
    return {" and ".join(names): values for names, values in groups}


def _mark_margins(
    magnitude: Axes, phase: Axes, hertz: Vector, values: Complex, degrees: Vector, shade: str
) -> None:
    """Mark the smallest phase margin and the smallest gain margin of a loop gain."""
    line = {"color": shade, "marker": "o", "markersize": 4.0, "linewidth": 1.0}
    circle, at_circle, axis, at_axis = crossings(hertz, values)
    if circle.size:
        lines = np.interp(at_circle, hertz, degrees)
        # The phase margin is the distance to the nearest odd multiple of half a turn.
        edges = 360.0 * np.round((lines + 180.0) / 360.0) - 180.0
        i = int(np.argmin(np.abs(lines - edges)))
        phase.plot([at_circle[i]] * 2, [lines[i], edges[i]], markevery=[0], **line)  # type: ignore[arg-type]
    if axis.size:
        i = int(np.argmin(np.abs(np.log(np.abs(axis)))))
        magnitude.plot([at_axis[i]] * 2, [abs(axis[i]), 1.0], markevery=[0], **line)  # type: ignore[arg-type]


def _round_ticks(magnitude: Axes, phase: Axes) -> None:
    from matplotlib.ticker import LogLocator, MultipleLocator

    # Of many decades only some are written, so that their labels never touch.
    magnitude.yaxis.set_major_locator(LogLocator(numticks=6))
    low, high = phase.get_ylim()
    phase.yaxis.set_major_locator(MultipleLocator(90.0 * max(1, round((high - low) / 540.0))))


def nyquist(responses: Mapping[str, npt.ArrayLike], *, disk_margin: float | None = None) -> Figure:
    """Draw loop gains in the complex plane.

    Args:
        responses: Loop gain over frequency, shape (n,), dimensionless, by the name of its curve,
            an ordered family such as angles; curves that lie on each other are drawn once.
        disk_margin: Smallest disk margin alpha of the family, dimensionless: its disk about -1 is
            drawn.

    Returns:
        The figure: imaginary over real part, with the unit circle and the point -1; dots where a
        curve crosses the circle (phase margin) and the negative real axis (gain margin).
    """
    from matplotlib.patches import Circle

    figure, (axes,) = new_figure([3.6])
    if disk_margin is not None and 0.0 < disk_margin < 2.0:
        half = disk_margin / 2.0
        near, far = (1.0 - half) / (1.0 + half), (1.0 + half) / (1.0 - half)
        disk = Circle(
            (-0.5 * (near + far), 0.0),
            0.5 * (far - near),
            facecolor=BAND.light,
            edgecolor=FAINT.light,
            linewidth=0.9,
        )
        axes.add_patch(disk)
    axes.add_patch(
        Circle((0.0, 0.0), 1.0, fill=False, edgecolor=FAINT.light, linewidth=0.9, linestyle=":")
    )
    drawn = distinct(responses)
    for (name, values), shade in zip(drawn.items(), ramp(len(drawn)), strict=True):
        axes.plot(values.real, values.imag, color=shade.light, linewidth=1.4, label=name)
        circle, _, axis, _ = crossings(np.arange(1.0, len(values) + 1.0), values)
        marked = np.concatenate([circle, axis])
        axes.plot(marked.real, marked.imag, "o", color=shade.light, markersize=4.0)
    axes.plot([-1.0], [0.0], marker="+", color=INK.light, markersize=9, linestyle="none")
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(-3.2, 1.4)
    axes.set_ylim(-2.0, 1.4)
    label(axes, x="real part of the loop gain", y="imaginary part")
    key(axes, columns=4)
    return figure
