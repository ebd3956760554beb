"""The picture that carries a diagnosis: the worst moment, the errors, and the law in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.diagnosis.location.missing_signal import MissingSignal
from workbench.model.units import readable
from workbench.reports.figures.diagnosis_law import draw_law
from workbench.reports.figures.diagnosis_runs import draw_error, draw_run, farthest_off, run_key
from workbench.reports.style import key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def diagnosis_answer(
    before: FreeRun,
    after: FreeRun | None,
    noise: Mapping[str, float],
    located: MissingSignal | None = None,
) -> Figure:
    """Draw the first output where the refitted model is farthest off, its error, and the law.

    Args:
        before: Free run of the refitted nominal model on a held-out recording.
        after: Free run of the extended model on it; None if nothing was found.
        noise: Noise of each output, in its SI unit.
        located: The signal that is missing; None leaves its panel out.
    """
    heights = [1.7, 1.3] if located is None else [1.5, 1.2, 1.7]
    figure, panels = new_figure(heights, share_x=False)
    draw_run(panels[0], before, after, 0, farthest_off(before))
    label(panels[0], x="time in s, where the refitted model is farthest off")
    draw_error(panels[1], before, noise, after, 0)
    label(panels[1], x="time in s", y=f"error in {readable(before.units[0])[0]}")
    key(panels[0], columns=3, handles=run_key(after))
    if located is not None:
        draw_law(panels[2], located)
    figure.align_ylabels()
    return figure
