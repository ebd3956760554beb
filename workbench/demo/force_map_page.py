"""The page of force laws on a measured force map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from workbench.demo.figures.force_maps import force_map, law_errors
from workbench.demo.force_map_study import LAW_LENGTH, MapStudy
from workbench.reports.page import Method, Page, Section, Words, again
from workbench.reports.pictures import Picture
from workbench.reports.tables import Table, interval, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = ("tondu_lopez_kp", "petrovic", "paper_3", "sarosi")
"""Laws drawn beside the map; all of them would hide it."""


def force_map_page(study: MapStudy, *, command: str) -> Page:
    """Lay out the comparison of force laws on a map.

    Example:
        >>> from workbench.demo.force_map_study import made_up_map, study_map
        >>> force_map_page(study_map(made_up_map(), "made up"), command="again").title
        'Force laws on made up'
    """
    percent = 100 / study.largest_force
    best = study.best
    return Page(
        f"Force laws on {study.name}",
        f"{len(study.points.force)} measured forces of one muscle at"
        f" {len(np.unique(study.points.pressure))} pressures and"
        f" {len(np.unique(study.points.length))} lengths, against every force law.",
        (
            Section(
                "laws",
                "Laws on points that the fit has not seen",
                (
                    Words(
                        f"Best on lengths left out: {best.title}, {best.length_rms:.1f} N rms, at"
                        f" most {percent * best.length_largest:.1f} % of the largest force. Without"
                        f" phi, equation (3) errs {study.need_for_phi:.1f} times as much as"
                        " equation (4): the force of the tube that does not depend on pressure is"
                        " really there."
                    ),
                    _errors(study),
                    *_pictures(study),
                    _numbers(study),
                    Method(
                        (
                            ("fit", "least squares of the force; a measured zero is a slack muscle"
                             " and asks only that the law has no positive tension there"),
                            ("lengths held out", "each inner length at which it pulls, once"),
                            ("pressures held out", "five random groups of pressures, each once"),
                            ("intervals", "95 %, from the scatter about the fit; they do not hold"
                             " for a law that is wrong"),
                        )
                    ),
                ),
            ),
            *again(command),
        ),
    )  # fmt: skip


def _errors(study: MapStudy) -> Table:
    percent = 100 / study.largest_force
    return Table(
        "Errors",
        (
            "law",
            "numbers",
            "fitted, rms in N",
            "fitted, largest in %",
            "lengths held out, rms in N",
            "lengths held out, largest in %",
            "pressures held out, rms in N",
        ),
        tuple(
            (
                law.title,
                str(len(law.values)),
                number(law.fitted_rms),
                number(percent * law.largest),
                number(law.length_rms),
                number(percent * law.length_largest),
                number(law.pressure_rms),
            )
            for law in study.laws
        ),
        f"Largest errors in % of the largest force, {study.largest_force:.0f} N.",
    )


def _numbers(study: MapStudy) -> Table:
    return Table(
        "Fitted numbers",
        ("law", "number", "estimate", "95 % interval"),
        tuple(
            (law.title, str(i + 1), number(float(v), 5), interval(v - 1.96 * s, v + 1.96 * s, 4))
            for law in study.laws
            for i, (v, s) in enumerate(zip(law.values, law.std, strict=True))
        ),
        "In the units of each law: bar, mm of a 200 mm muscle, N; m and rad in equations (1), (2).",
    )


def _pictures(study: MapStudy) -> tuple[Picture, ...]:
    every = np.unique(study.points.pressure)
    shown = [float(every[round(x * (len(every) - 1))]) for x in (0.25, 0.6, 1.0)]
    return (
        Picture(
            "force-map",
            map_figure(study, shown, DRAWN),
            "Measured force over contraction at three pressures, and fitted laws.",
            "the laws with a cubic phi and Sárosi's follow the points, the others do not",
        ),
        Picture(
            "law-errors",
            errors_figure(study),
            "Errors on the points fitted on and on lengths held out.",
            "rms errors of the force laws on a logarithmic axis",
        ),
    )


def map_figure(study: MapStudy, pressures: Sequence[float], laws: Sequence[str]) -> Figure:
    """Draw the points at some gauge pressures and fitted laws beside them.

    Args:
        pressures: Gauge pressures, in Pa.
    """
    points = study.points
    scale = float(points.length.max()) / LAW_LENGTH
    rows = [points.pressure == pressure for pressure in pressures]
    fine = np.linspace(0.0, float(points.contraction.max()), 120)
    return force_map(
        [scale * points.contraction[r] for r in rows],
        [points.force[r] for r in rows],
        pressures,
        scale * fine,
        {
            law.title: [np.asarray(law.law.force(fine, p)) for p in pressures]
            for law in (study.law(name) for name in laws)
        },
    )


def errors_figure(study: MapStudy, *, published: bool = False) -> Figure:
    """Draw the errors of all laws, those of the published numbers too if they are for the map."""
    laws = study.laws
    return law_errors(
        [law.title for law in laws],
        [law.fitted_rms for law in laws],
        [law.length_rms for law in laws],
        [law.published_rms if published else float("nan") for law in laws],
    )
