"""Force laws on measured force maps of a muscle: the page of a map, and the demonstration's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.data_folder import external_data
from workbench.demo.force_map_study import (
    FAMILIES,
    LAW_LENGTH,
    ForceMap,
    LawOnMap,
    MapStudy,
    study_map,
)
from workbench.demo.part import Part, method, words
from workbench.recordings import read_table
from workbench.reports.page import Block, Method, Page, Section, Words, again
from workbench.reports.pictures import Picture
from workbench.reports.style import (
    FAINT,
    FURTHER,
    INK,
    MEASURED,
    REFERENCE,
    key,
    label,
    named_line,
    new_figure,
)
from workbench.reports.tables import Table, interval, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILE = "real/martens2017-festo-force-maps/dmsp-20-300_static_force.csv"
"""Path of the demonstration's map inside the data folder."""

_SHOWN_PRESSURES = (0.25, 0.6, 1.0)
"""Ranks of the pressures that are drawn, among those measured."""


def read_force_map(file: Path) -> ForceMap:
    """Read static forces from a table with pressure, length and force, units in its header."""
    table = read_table(file)
    return ForceMap(table["pressure"], table["length"], table["force"])


def force_maps_part(folder: Path | None) -> Part:
    """Compare every force law with the measured map of a DMSP-20, if a data folder is given."""
    if folder is None:
        text = words("force_maps", "none", weight="note")
        return Part(Section("force-maps", "Measured force maps", (text,)))
    study = study_map(read_force_map(external_data(FILE, folder)), "DMSP-20", families=FAMILIES)
    about = (words("force_maps", "about"), words("force_maps", "source", weight="note"))
    blocks = (Words(_points(study)), *about, *_blocks(study, published=True))
    return Part(Section("force-maps", "Measured force maps of a DMSP-20", blocks), study.table())


def force_map_page(study: MapStudy, *, command: str) -> Page:
    """Lay out the comparison of force laws on a map."""
    title = "Laws on points that the fit has not seen"
    sections = (Section("laws", title, _blocks(study)), *again(command))
    return Page(f"Force laws on {study.name}", _points(study), sections)


def _points(study: MapStudy) -> str:
    points = study.points
    return (
        f"{len(points.force)} measured forces of one muscle of {1e3 * points.length.max():.0f} mm"
        f" at {len(np.unique(points.pressure))} pressures and {len(np.unique(points.length))}"
        " lengths, against every force law."
    )


def _blocks(study: MapStudy, *, published: bool = False) -> tuple[Block, ...]:
    """Show the laws on a map, beside them the published numbers if they are for such a muscle."""
    rows = [
        (law.title, str(i + 1), number(float(v), 5), interval(v - 1.96 * s, v + 1.96 * s, 4))
        for law in study.laws
        for i, (v, s) in enumerate(zip(law.values, law.std, strict=True))
    ]
    return (
        Words(study.headline),
        errors_table(study, published=published),
        Picture(
            "force-map",
            _draw_map(study),
            "Measured force over contraction at three pressures, and fitted laws.",
            "the laws with a cubic phi and Sárosi's follow the points, the others do not",
        ),
        Picture(
            "law-errors",
            _draw_errors(study, published=published),
            "Errors on the points fitted on and on lengths held out.",
            "rms errors of the force laws on a logarithmic axis",
        ),
        Table(
            "Fitted numbers",
            ("law", "number", "estimate", "95 % interval"),
            tuple(rows),
            "In the units of each law: bar, mm of a 200 mm muscle, N; m and rad in equations (1),"
            " (2).",
        ),
        Method(method("force_maps").entries[0 if published else 1 :]),
    )


def errors_table(study: MapStudy, *, published: bool = False) -> Table:
    """List the errors of every law, those of its published numbers too if they are for the map."""
    percent = 100 / study.largest_force
    columns: dict[str, Callable[[LawOnMap], str]] = {
        "law": lambda law: law.title,
        "numbers": lambda law: str(len(law.values)),
        "published, rms in N": lambda law: number(law.published_rms_N),
        "fitted, rms in N": lambda law: number(law.fitted_rms_N),
        "fitted, largest in %": lambda law: number(percent * law.fitted_largest_N),
        "lengths held out, rms in N": lambda law: number(law.lengths_held_out_rms_N),
        "lengths held out, largest in %": lambda law: number(
            percent * law.lengths_held_out_largest_N
        ),
        "pressures held out, rms in N": lambda law: number(law.pressures_held_out_rms_N),
    }
    if not published:
        del columns["published, rms in N"]
    return Table.of(
        "Errors",
        study.laws,
        columns,
        f"Largest errors in % of the largest force, {study.largest_force:.0f} N.",
    )


def _draw_map(study: MapStudy) -> Figure:
    """Draw measured force over contraction with some laws (all would hide it) at some pressures."""
    points, every = study.points, np.unique(study.points.pressure)
    pressures = [float(every[round(x * (len(every) - 1))]) for x in _SHOWN_PRESSURES]
    paper = [law for law in study.laws if law.name.startswith("paper")][-1]
    laws = [study.law("tondu_lopez_kp"), study.law("petrovic"), paper, study.law("sarosi")]
    scale = 1e3 * float(points.length.max()) / LAW_LENGTH
    fine = np.linspace(0.0, float(points.contraction.max()), 120)
    figure, panels = new_figure([1.45] * len(pressures))
    for axes, pressure in zip(panels, pressures, strict=True):
        rows = points.pressure == pressure
        axes.axhline(0.0, color=REFERENCE.light, linewidth=0.9)
        for law, shade in zip(laws, FURTHER, strict=False):
            force = np.asarray(law.law.force(fine, pressure))
            axes.plot(scale * fine, force, color=shade.light, linewidth=1.2)
        measured = points.force[rows]
        axes.plot(scale * points.contraction[rows], measured, "o", color=MEASURED.light, ms=4)
        look: dict[str, Any] = {"ha": "right", "color": INK.light, "fontsize": 9}
        axes.text(0.985, 0.88, f"{pressure / 1e5:.3g} bar", transform=axes.transAxes, **look)
        axes.margins(x=0.02)
        axes.set_ylim(bottom=min(-30.0, 1.3 * float(np.min(measured))))
        label(axes, x="contraction in mm" if axes is panels[-1] else None, y="force in N")
    handles = [named_line("measured", MEASURED, marker="o")]
    handles += [named_line(w.title, c, width=1.2) for w, c in zip(laws, FURTHER, strict=False)]
    key(panels[0], columns=2, handles=handles)
    return figure


def _draw_errors(study: MapStudy, *, published: bool) -> Figure:
    laws = study.laws
    figure, (axes,) = new_figure([0.36 * len(laws) + 0.4])
    rows = np.arange(len(laws), dtype=float)
    axes.hlines(rows, 1.0, 1e3, color=FAINT.light, linewidth=0.8, linestyle=":")
    for values, colour, text, mark in (
        ([w.published_rms_N for w in laws], REFERENCE, "published coefficients", "s"),
        ([w.fitted_rms_N for w in laws], FURTHER[0], "fitted, points fitted on", "o"),
        ([w.lengths_held_out_rms_N for w in laws], FURTHER[5], "fitted, lengths held out", "D"),
    )[0 if published else 1 :]:
        axes.plot(values, rows, mark, color=colour.light, markersize=6, label=text)
    axes.set_xscale("log")
    axes.set_yticks(rows, [law.title for law in laws])
    axes.invert_yaxis()
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(1.0, 1e3)
    axes.margins(y=0.1)
    label(axes, x="rms error in N")
    key(axes, columns=1)
    return figure
