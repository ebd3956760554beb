"""The page of tolerant designs: what each reaches on machines that nobody modelled."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from workbench.evaluation.tolerance import SIMULATORS, tolerant_study
from workbench.reports.page import Method, Page, Section, Words, again
from workbench.reports.pictures import Picture
from workbench.reports.style import colours, key, label, new_figure
from workbench.reports.tables import Cell, Table, number
from workbench.study.linear_loop import analyse_loop

Rows = Sequence[Mapping[str, Any]]

CALM, OVERSHOOT, SLOWEST = math.radians(0.2), 0.10, 0.8
"""Largest residual oscillation (rad), overshoot (fraction) and settling time (s) to be reached."""

LEAST_CALM = 12
"""Runs that are listed as the least calm ones."""


def _missed(run: Mapping[str, Any]) -> bool:
    """Tell whether a run misses a limit, as one that could not be done does."""
    return "reason" in run or not (
        run["oscillation"] <= CALM
        and not run["stop"]
        and run["overshoot"] <= OVERSHOOT
        and max(map(_finite, run["settling"])) <= SLOWEST
    )


def reached_table(rows: Rows, simulator: str) -> Table:
    """Return what each design reaches over the drawn machines of a simulator, a column for each."""
    own = [row for row in rows if row["simulator"] == simulator]
    names = tuple(own[0]["runs"]) if own else ()
    runs = {name: [row["runs"][name] for row in own] for name in names}
    told = {name: [run for run in runs[name] if "reason" not in run] for name in names}

    def kept(holds: Callable[[Mapping[str, Any]], bool]) -> tuple[Cell, ...]:
        counts = {name: sum(map(holds, told[name])) for name in names}
        return tuple(
            Cell(f"{n} of {len(own)}", "met" if n == len(own) else "missed")
            for n in counts.values()
        )

    def typical(
        of: Callable[..., Any], values: Callable[[Mapping[str, Any]], Sequence[float]], digits: int
    ) -> tuple[str, ...]:
        every = {name: [v for run in told[name] for v in values(run)] for name in names}
        return tuple(number(float(of(v)), digits) if v else "" for v in every.values())

    def settling(run: Mapping[str, Any]) -> list[float]:
        return [_finite(v) for v in run["settling"]]

    lines: dict[str, tuple[Cell | str, ...]] = {
        "all of the limits": kept(lambda run: not _missed(run)),
        "no stop hit": kept(lambda run: not run["stop"]),
        f"oscillation at most {math.degrees(CALM):g}°": kept(
            lambda run: bool(run["oscillation"] <= CALM)
        ),
        "  largest (°)": typical(max, lambda run: [math.degrees(run["oscillation"])], 3),
        f"overshoot at most {100 * OVERSHOOT:g} %": kept(
            lambda run: bool(run["overshoot"] <= OVERSHOOT)
        ),
        "  largest (%)": typical(max, lambda run: [100.0 * run["overshoot"]], 3),
        f"15° settled in {SLOWEST:g} s": kept(lambda run: max(settling(run)) <= SLOWEST),
        "  median (s)": typical(np.median, settling, 3),
        "steady error, median (°)": typical(np.median, lambda run: np.degrees(run["steady"]), 2),
        "valve at rest, rms, median (V)": typical(np.median, lambda run: [run["valve_at_rest"]], 2),
        "valve travel, median (V/s)": typical(np.median, lambda run: [run["chatter"]], 3),
    }
    return Table(
        f"Drawn machines on the {simulator}: {len(own)}",
        ("", *names),
        tuple((what, *cells) for what, cells in lines.items()) if own else (),
        "A step that has not settled before the next one counts as infinitely slow.",
    )


def missed_table(rows: Rows) -> Table:
    """Return on how many machines with each kind of variation a design misses a limit."""
    names = tuple(rows[0]["runs"]) if rows else ()
    kinds = dict.fromkeys(kind for row in rows for kind in row["kinds"])
    with_it = {kind: [row for row in rows if kind in row["kinds"]] for kind in kinds}
    missed = {
        kind: [sum(_missed(row["runs"][name]) for row in own) for name in names]
        for kind, own in with_it.items()
    }
    worst = sorted(kinds, key=lambda kind: -sum(missed[kind]) / len(with_it[kind]))
    return Table(
        "Runs that miss a limit, by what differed",
        ("what differed, alone or with two others", "runs", *names),
        tuple((kind, str(len(with_it[kind])), *map(str, missed[kind])) for kind in worst),
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
        Section(
            "reached", "What is reached", (*tables, missed_table(rows), least_calm_table(rows))
        ),
        Section("margins", "Margins", (margins_table(designs), Method(methods))),
        Section("trade", "Bandwidth against delay", (trade_picture(trades, designs),)),
        *again(command),
    )
    count = len({row["draw"] for row in rows})
    lead = f"{len(designs)} designs; drawn machines that none of them was told of: {count}."
    return Page("Tolerant designs", lead, sections, first=(Words(study.description),))


def _finite(value: float | None) -> float:
    return math.inf if value is None or math.isnan(value) else value
