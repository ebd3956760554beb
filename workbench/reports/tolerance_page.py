"""The page of tolerant designs: what each reaches on machines that nobody modelled."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from workbench.evaluation.tolerance import SIMULATORS, tolerant_study
from workbench.model.units import from_si
from workbench.reports.figures.drawn_machines import (
    Measured,
    Tried,
    missed_table,
    reached_table,
    worst_table,
)
from workbench.reports.metrics_table import demand_text
from workbench.reports.page import Method, Page, Section, Words, again
from workbench.reports.pictures import Picture
from workbench.reports.style import colours, key, label, new_figure
from workbench.reports.tables import Table, number
from workbench.study.margins import analyse_loop
from workbench.study.study import Demand
from workbench.verification.requirements import score_of

Rows = Sequence[Mapping[str, Any]]

_TOLD = {
    "steady error": ("steady_error", "deg"),
    "valve at rest, rms": ("valve_at_rest", "V"),
    "valve travel": ("chatter", "V/s"),
}
"""What is told beside what is required: the key in a row, and the unit in which it is read."""


def _required() -> dict[str, Demand]:
    return {demand_text(demand): demand for demand in tolerant_study().demands}


def tables(rows: Rows) -> tuple[Table, ...]:
    """Return what each design reaches on each simulator, and what costs most."""
    own = {name: tried([row for row in rows if row["simulator"] == name]) for name in SIMULATORS}
    reached = (reached_table(r, lines(), f"Drawn machines on the {n}") for n, r in own.items() if r)
    return (*reached, missed_table(tried(rows)))


def lines() -> tuple[Measured, ...]:
    """Return what is told of the runs."""
    found = [Measured(what, d.requirement.unit, required=True) for what, d in _required().items()]
    return (*found, *(Measured(what, unit) for what, (_, unit) in _TOLD.items()))


def tried(rows: Rows) -> list[Tried]:
    """Return runs on drawn machines as they are told of."""
    return [
        Tried(name, f"{row['simulator']}, {row['draw']}", tuple(row["kinds"]), *_told(run))
        for row in rows
        for name, run in row["runs"].items()
    ]


def _told(run: Mapping[str, Any]) -> tuple[dict[str, list[float]], dict[str, float], str]:
    if "reason" in run:
        return {}, {}, run["reason"]
    values = {what: _shown(run[key], unit) for what, (key, unit) in _TOLD.items()}
    scores = {}
    for what, demand in _required().items():
        required = demand.requirement
        values[what] = _shown(run[required.metric], required.unit)
        scores[what] = score_of(required, max(values[what]))
    return values, scores, ""


def _shown(measured: Any, unit: str) -> list[float]:
    every = measured if isinstance(measured, list) else [measured]
    return [math.inf if v is None or math.isnan(v) else float(from_si(v, unit)) for v in every]


def margins_table(designs: Mapping[str, MarginedDesign[Controller]]) -> Table:
    """Return speed and margins of the designs, at the command and at each sensor, nominal plant."""
    study = tolerant_study()
    rows = [
        (name, loop, None if i else found)
        for name, found in designs.items()
        for i, loop in enumerate(
            analyse_loop(found.controller, study.controllers[name].linear(), every=True)
        )
    ]
    return Table.of(
        "Margins",
        rows,
        {
            "controller": lambda r: r[0],
            "speed (rad/s)": lambda r: number(r[2].speed) if r[2] else "",
            "opened at": lambda r: r[1].opened,
            "gain margin": lambda r: (
                f"{number(r[1].gain_margin_down)} to {number(r[1].gain_margin)}"
            ),
            "phase margin (°)": lambda r: number(math.degrees(r[1].phase_margin)),
            "delay margin (ms)": lambda r: number(1e3 * r[1].delay_margin),
            "disk margin": lambda r: number(r[1].disk_margin),
            "largest Ms of all corners": lambda r: number(r[2].sensitivity) if r[2] else "",
            "what the next faster design misses": lambda r: r[2].limit if r[2] else "",
        },
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
    runs = tried(rows)
    methods = (
        ("machines", "one kind of difference in turn, or three at random; seeded"),
        ("oscillation", "half the range in the last 0.6 s of a step, without its straight line"),
        ("settling time", "time until the angle stays within 2 % of the step"),
    )
    sections = (
        Section("reached", "What is reached", (*tables(rows), worst_table(runs))),
        Section("margins", "Margins", (margins_table(designs), Method(methods))),
        Section("trade", "Bandwidth against delay", (trade_picture(trades, designs),)),
        *again(command),
    )
    count = len({row["draw"] for row in rows})
    lead = f"{len(designs)} designs; drawn machines that none of them was told of: {count}."
    return Page("Tolerant designs", lead, sections, first=(Words(study.description),))
