"""The open-loop experiment of the paper's Figure 8, and what it looks like without its physics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.demo.moving_arm import moving_arm
from workbench.demo.part import Part, judged, section
from workbench.experiments.open_loop import OpenLoopExperiment, open_loop_experiment
from workbench.model import Model
from workbench.plants.arm import arm
from workbench.plants.arm.laws import constant_volume
from workbench.reports.pictures import Picture
from workbench.reports.style import FURTHER, INK, REFERENCE, SIMULATED, key, label, new_figure
from workbench.reports.tables import Cell, Table, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOAD_KG = 3.0

BANDS = (
    ("transit 3° → 57°", "transit_time_s", 0.5, 1.4, "s"),
    ("ripple", "ripple_frequency_Hz", 1.9, 2.6, "Hz"),
    ("dips per transit", "dips", 1, 3, ""),
    ("stop touched at", "touch_speed_deg_s", 0.0, 100.0, "°/s"),
)
"""Figures that the plant must show: name, key in the results, smallest, largest, unit."""


def variants() -> dict[str, Model]:
    """Build arms that lack one of the two things behind the ripple."""
    plant = arm(LOAD_KG)
    return {
        "linear valve": arm(LOAD_KG, valve_curve="linear"),
        "constant volume": plant.without("end_flattening").with_effect(constant_volume()),
    }


def open_loop_part() -> Part:
    """Run the open-loop experiment on the full plant and on its variants.

    Example:
        >>> open_loop_part().marks
        {'met': 4, 'missed': 0, 'open': 0}
    """
    experiment = open_loop_experiment(arm(LOAD_KG), duration=12.0)
    others = {n: open_loop_experiment(model, duration=12.0) for n, model in variants().items()}
    run = experiment.trajectory
    # One period is enough to see a transit each way, and large enough to see its ripple.
    seen = slice(int(np.searchsorted(run.time, 3.7)), int(np.searchsorted(run.time, 7.8)))
    runs = {**others, "full plant": experiment}
    figure = open_loop(
        run.time[seen],
        run["valve"][seen],
        {n: (e.trajectory["angle"][seen], e.trajectory["speed"][seen]) for n, e in runs.items()},
    )
    results = {name: _numbers(t) for name, t in {"full plant": experiment, **others}.items()}
    figures = results["full plant"]
    rows: list[tuple[str | Cell, ...]] = []
    for title, name, low, high, unit in BANDS:
        band = f"{f'{low:g} …' if low else 'below'} {high:g} {unit}".rstrip()
        beside = (Cell(number(results[other][name], unit=unit)) for other in others)
        rows.append((title, band, judged(figures[name], low, high, unit=unit), *beside))
    blocks = (
        Picture(
            "open-loop",
            figure,
            "One period of the experiment: valve voltage, angle and speed of the full plant, "
            "and of plants that lack one piece of physics. Dotted: the stops.",
            "pulses on the valve, the angle running between 0 and 60 degrees, and the speed",
        ),
        Table(
            "Figures of the open-loop experiment",
            ("figure", "must lie in", "full plant", *others),
            tuple(rows),
            "The bands hold for the full plant; the variants are shown for comparison.",
        ),
    )
    command = "workbench simulate --load 3 --pulses 0.9 --period 4 --duration 12 --out run.csv"
    told = section("open-loop", "Open-loop experiment", "open_loop", blocks, command, {"run": run})
    first = moving_arm(
        run,
        start=4.0,
        stop=12.0,
        caption=f"The arm itself, as simulated: pulses of ± 0.9 V on the valve drive {LOAD_KG:g} kg"
        f" from stop to stop in {number(figures['transit_time_s'], 2)} s, with a ripple of"
        f" {number(figures['ripple_frequency_Hz'], 2)} Hz in mid travel, as in the paper's Figure"
        " 8.",
    )
    return Part(told, {"load_kg": LOAD_KG, **results}, first)


def _numbers(experiment: OpenLoopExperiment) -> dict[str, float]:
    figures = experiment.figures
    return {
        "transit_time_s": figures.transit_time,
        "ripple_frequency_Hz": figures.ripple_frequency,
        "dips": figures.dips,
        "touch_speed_deg_s": math.degrees(figures.touch_speed),
        "top_speed_deg_s": float(np.degrees(np.max(np.abs(experiment.trajectory["speed"])))),
        "difference_to_tighter_run": experiment.trajectory.error,
    }


def open_loop(
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    runs: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]],
) -> Figure:
    """Draw pulses on the valve and runs from stop to stop, over time in s.

    Args:
        time: Sample times, shape (n,), in s.
        voltage: Valve voltage, shape (n,), in V.
        runs: Angle (rad) and speed (rad/s), shape (n,), of plants that lack something, by what they
            lack, and of the full plant last.
    """
    figure, (command, position, rate) = new_figure([0.75, 1.9, 1.5])
    t = np.asarray(time, dtype=float)
    command.step(t, voltage, where="post", color=INK.light, linewidth=1.1)
    for stop in (0.0, 60.0):
        position.axhline(stop, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    looks = [*((c.light, 0.8, 0.8) for c in FURTHER[: len(runs) - 1]), (SIMULATED.light, 1.7, 1.4)]
    drawn = []
    for (name, (angle, speed)), (shade, wide, thin) in zip(runs.items(), looks, strict=True):
        drawn += position.plot(t, np.degrees(angle), color=shade, linewidth=wide, label=name)
        rate.plot(t, np.degrees(speed), color=shade, linewidth=thin)
    handles = [drawn[-1], *drawn[:-1]]
    label(command, y="valve in V")
    label(position, y="angle in °")
    label(rate, x="time in s", y="speed in °/s")
    key(command, columns=2 if len(handles) > 3 else 3, handles=handles)
    return figure
