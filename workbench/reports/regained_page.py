"""The page of a redesign: speed lost to what was not known, and regained from what was found."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.evaluation.regained import WHICH, DesignRun
from workbench.evaluation.tolerance import tolerant_study
from workbench.reports.page import Page, Section, again
from workbench.reports.pictures import Picture
from workbench.reports.style import INK, colours, key, label, new_figure
from workbench.reports.tables import Table, number
from workbench.verification import Steps

STYLES = dict(zip(WHICH, (":", "--", "-"), strict=True))
"""Line style of each of the three designs."""


def regained_table(runs: Sequence[DesignRun]) -> Table:
    """Return what the three designs of each family reach."""
    return Table.of(
        "15° steps of three designs of each family",
        runs,
        {
            "controller": lambda run: run.family,
            "design": lambda run: run.which,
            "speed (rad/s)": lambda run: number(run.speed),
            "settled after, mean (s)": lambda run: number(float(np.mean(run.told["settling"]))),
            "overshoot, largest (%)": lambda run: number(100.0 * run.told["overshoot"]),
            "oscillation, largest (°)": lambda run: number(
                math.degrees(run.told["oscillation"]), 2
            ),
            "what the next faster design misses": lambda run: run.limit,
        },
    )


def regained_picture(runs: Sequence[DesignRun]) -> Picture:
    """Draw the first step of the three designs of each family."""
    (scenario,) = tolerant_study().scenarios.values()
    (signal,) = scenario.references.values()
    assert isinstance(signal, Steps)
    begin, (first, last) = signal.times[1], signal.values[:2]
    families = list(dict.fromkeys(run.family for run in runs))
    shades = colours(families)
    figure, rows = new_figure([2.2] * len(families))
    for axes, family in zip(rows, families, strict=True):
        for run in runs:
            if run.family != family:
                continue
            shown = (run.time > begin - 0.05) & (run.time < begin + 1.0)
            axes.plot(
                run.time[shown] - begin,
                np.degrees(run.angle[shown]),
                STYLES[run.which],
                color=shades[family].light,
                label=run.which,
            )
        axes.axhspan(
            *(math.degrees(last + sign * 0.02 * (last - first)) for sign in (-1, 1)),
            color="0.5",
            alpha=0.2,
            linewidth=0.0,
        )
        label(axes, y="angle in °")
        # Below the end of the step, where no curve is: above is the legend.
        axes.text(0.98, 0.08, family, transform=axes.transAxes, ha="right", color=INK.light)
    label(rows[-1], x="time since the step in s")
    key(rows[0])
    return Picture(
        "regained",
        figure,
        "Angle along the first step of the designs; within the band a step has settled.",
        "angle of three designs of each family along a step",
    )


def regained_page(runs: Sequence[DesignRun], machine: str, *, command: str = "") -> Page:
    """Build the page of designs on a machine that was found."""
    sections = (
        Section("steps", "Lost and regained", (regained_table(runs), regained_picture(runs))),
        *again(command),
    )
    return Page("Redesign", f"Designs for what was found in {machine}.", sections)
