"""The page of tolerant designs: what each reaches on machines that nobody modelled."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from workbench.evaluation.tolerance import SIMULATORS, tolerant_study
from workbench.reports.page import Method, Page, Section, Words, again
from workbench.reports.pictures import Picture
from workbench.reports.style import colours, key, label, new_figure
from workbench.reports.tables import Table, number
from workbench.study.linear_loop import analyse_loop

Rows = Sequence[Mapping[str, Any]]

CALM, OVERSHOOT, SLOWEST = math.radians(0.2), 0.10, 0.8
"""Largest residual oscillation (rad), overshoot (fraction) and settling time (s) to be reached."""

LEAST_CALM = 12
"""Runs that are listed as the least calm ones."""


def reached_table(rows: Rows, simulator: str) -> Table:
    """Return what each design reaches over the drawn machines of a simulator."""
    own = [row for row in rows if row["simulator"] == simulator]
    cells = []
    for name in own[0]["runs"] if own else ():
        runs = [row["runs"][name] for row in own]
        told = [run for run in runs if "reason" not in run]
        slow = [_finite(v) for run in told for v in run["settling"]]
        kept = (
            sum(run["oscillation"] <= CALM for run in told),
            sum(not run["stop"] for run in told),
            sum(run["overshoot"] <= OVERSHOOT for run in told),
            sum(max(map(_finite, run["settling"])) <= SLOWEST for run in told),
        )
        calm, free, small, within = (f"{count} of {len(runs)}" for count in kept)
        steady = [v for run in told for v in run["steady"]]
        cells.append(
            (
                name,
                calm,
                number(math.degrees(max(run["oscillation"] for run in told))),
                free,
                small,
                number(100.0 * max(run["overshoot"] for run in told)),
                within,
                number(float(np.median(slow))),
                number(math.degrees(float(np.median(steady))), 2),
                number(float(np.median([run["chatter"] for run in told]))),
            )
        )
    return Table(
        f"{len(own)} drawn machines on the {simulator}",
        (
            "controller",
            f"oscillation at most {math.degrees(CALM):g}°",
            "largest (°)",
            "no stop hit",
            f"overshoot at most {100 * OVERSHOOT:g} %",
            "largest (%)",
            f"15° settled in {SLOWEST:g} s",
            "median (s)",
            "steady error, median (°)",
            "valve travel, median (V/s)",
        ),
        tuple(cells),
        "A step that has not settled before the next one counts as infinitely slow.",
    )


def least_calm_table(rows: Rows) -> Table:
    """Return the runs that oscillate most, and what differed in them."""
    every = [
        (run["oscillation"], name, row, run)
        for row in rows
        for name, run in row["runs"].items()
        if "reason" not in run
    ]
    every.sort(key=lambda one: -one[0])
    return Table(
        "The least calm runs",
        ("controller", "simulator", "what differed", "oscillation (°)", "overshoot (%)"),
        tuple(
            (
                name,
                row["simulator"],
                ", ".join(row["kinds"]),
                number(math.degrees(size)),
                number(100.0 * run["overshoot"]),
            )
            for size, name, row, run in every[:LEAST_CALM]
        ),
    )


def margins_table(designs: Mapping[str, MarginedDesign[Controller]]) -> Table:
    """Return speed and margins of the designs, at the command and at each sensor, nominal plant."""
    study = tolerant_study()
    cells: list[tuple[str, ...]] = []
    for name, found in designs.items():
        recipe = study.controllers[name]
        for loop in analyse_loop(found.controller, recipe.linear(), every=True):
            first = not cells or cells[-1][0] != name
            cells.append(
                (
                    name,
                    number(found.speed) if first else "",
                    loop.opened,
                    f"{number(loop.gain_margin_down)} to {number(loop.gain_margin)}",
                    number(math.degrees(loop.phase_margin)),
                    number(1e3 * loop.delay_margin),
                    number(loop.disk_margin),
                    number(found.sensitivity) if first else "",
                    found.limit if first else "",
                )
            )
    return Table(
        "Margins",
        (
            "controller",
            "speed (rad/s)",
            "opened at",
            "gain margin",
            "phase margin (°)",
            "delay margin (ms)",
            "disk margin",
            "largest Ms of all corners",
            "what the next faster design misses",
        ),
        tuple(cells),
        "Gain, phase, delay and disk margins are those of the nominal plant at its design point.",
    )


Trades = Mapping[str, Sequence[tuple[float, float]]]
"""Largest delay, in s, and speed, in rad/s, of the fastest designs by controller."""


def trade_picture(trades: Trades, designs: Mapping[str, MarginedDesign[Controller]]) -> Picture:
    """Draw the speed of each family against the delay that it must bear."""
    shades = colours(trades)
    figure, (axes,) = new_figure([3.0])
    bears = tolerant_study().controllers
    for name, points in trades.items():
        delays, speeds = 1e3 * np.array([d for d, _ in points]), [speed for _, speed in points]
        axes.plot(delays, speeds, color=shades[name].light, label=name, marker=".")
        if (fastest := bears[name].fastest) is not None:
            own = 1e3 * fastest.uncertainty.delay[1]
            axes.plot([own], [designs[name].speed], "o", color=shades[name].light, fillstyle="none")
    axes.set_ylim(bottom=0.0)
    label(axes, x="largest delay that is tolerated in ms", y="speed of the design in rad/s")
    key(axes, columns=3)
    return Picture(
        "bandwidth-against-delay",
        figure,
        "Speed of the fastest design of each family within its limits, against the delay that it"
        " must bear, the lag of the sensors growing with it; rings are the designs of this page.",
        "speed of each family over the tolerated delay",
    )


def tolerance_page(
    rows: Rows,
    designs: Mapping[str, MarginedDesign[Controller]],
    trades: Trades,
    *,
    command: str = "",
) -> Page:
    """Build the page of tolerant designs on drawn machines."""
    study = tolerant_study()
    tables = [reached_table(rows, name) for name in SIMULATORS]
    tables = [table for table in tables if table.rows]
    methods = (
        ("machines", "one of 13 kinds of variation in turn, or three at random; seeded"),
        ("oscillation", "half the range in the last 0.6 s of a step, without its straight line"),
        ("settling", "time until the angle stays within 2 % of a step of 15°"),
    )
    sections = (
        Section("reached", "What is reached", (*tables, least_calm_table(rows))),
        Section("margins", "Margins", (margins_table(designs), Method(methods))),
        Section("trade", "Bandwidth against delay", (trade_picture(trades, designs),)),
        *again(command),
    )
    count = len({row["draw"] for row in rows})
    lead = f"{len(designs)} designs on {count} machines that none of them was told of."
    return Page("Tolerant designs", lead, sections, first=(Words(study.description),))


def _finite(value: float | None) -> float:
    return math.inf if value is None or math.isnan(value) else value
