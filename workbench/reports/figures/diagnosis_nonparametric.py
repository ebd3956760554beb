"""A nonparametric term: the located signal over its argument with the fitted curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workbench.diagnosis.nonparametric.result import Argument
from workbench.errors import WorkbenchError
from workbench.model.units import readable
from workbench.reports.figures.diagnosis_runs import AFTER
from workbench.reports.figures.diagnosis_units import titled
from workbench.reports.style import FAINT, MEASURED, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def diagnosis_nonparametric(argument: Argument, *, place: str, unit: str) -> Figure:
    """Draw the classes of the located signal with their band, and the fitted curve on them.

    Args:
        argument: An argument of the term with its classes.
        place: Port or ports at which the term acts.
        unit: Unit of the curve; ``"1"`` for a fraction of the port's signal.

    Raises:
        WorkbenchError: If nothing was fitted over the argument.
    """
    if argument.bins is None:
        raise WorkbenchError(
            f"no curve over {argument.name} was fitted, so that there is nothing to draw; draw the"
            " located signal instead"
        )
    figure, (axes,) = new_figure([2.7])
    bins, (shown, factor) = argument.bins, ("%", 100.0) if unit == "1" else readable(unit)
    x = bins.x * readable(argument.unit)[1]
    mean, std, curve = (factor * values for values in (bins.mean, bins.std, bins.curve))
    axes.fill_between(
        x,
        mean - std,
        mean + std,
        color=FAINT.light,
        alpha=0.45,
        linewidth=0,
        label="its scatter in a class",
    )
    axes.plot(x, mean, ".", color=MEASURED.light, markersize=6.0, label="from the measurements")
    axes.plot(x, curve, color=AFTER.light, linewidth=1.4, label="fitted curve")
    axes.axhline(0.0, color=FAINT.light, linewidth=0.9, zorder=1)
    axes.margins(x=0.03)
    name = place.replace("_", " ")
    label(
        axes,
        x=titled(argument.name, argument.unit),
        y=f"{'change of ' if unit == '1' else ''}{name} in {shown}",
    )
    handles, _ = axes.get_legend_handles_labels()
    # The measurements come first, as they do in every picture.
    key(axes, columns=3, handles=[*handles[1:], handles[0]])  # type: ignore[list-item]
    return figure
