"""Measured force maps of a muscle against the force laws."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.data_folder import external_data
from workbench.demo.force_law_fit import LAW_LENGTH, ForceMap, LawFit, compare_laws
from workbench.demo.part import Part
from workbench.recordings import read_table
from workbench.reports.figures.force_maps import force_map, law_errors
from workbench.reports.page import Method, Section, Words
from workbench.reports.pictures import Picture
from workbench.reports.tables import Table, number

FILE = "real/martens2017-festo-force-maps/dmsp-20-300_static_force.csv"
"""Path of the map inside the data folder."""

SHOWN_PRESSURES = (1.35e5, 3.12e5, 6e5)
"""Gauge pressures of the panels, in Pa."""

DRAWN_LAWS = ("tondu_lopez_k", "petrovic", "paper", "sarosi")


def read_force_map(folder: Path) -> ForceMap:
    """Read the measured force map of a DMSP-20 from a data folder.

    Raises:
        WorkbenchError: If the folder does not hold it.

    Example:
        >>> read_force_map(Path("nowhere"))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: data folder 'nowhere' does not exist; give ...
    """
    table = read_table(external_data(FILE, folder))
    return ForceMap(table["pressure"], table["length"], table["force"])


def force_maps_part(folder: Path | None) -> Part:
    """Compare every force law with a measured force map, if a data folder is given.

    Args:
        folder: The data folder, or None.

    Raises:
        WorkbenchError: If the folder does not hold the map.

    Example:
        >>> force_maps_part(None).results
        {}
    """
    if folder is None:
        text = Words(
            "Measured force maps of a real muscle are shown here when a folder with recordings of "
            "real machines is given: workbench demo --data FOLDER. Without it nothing on this "
            "page comes from a real muscle.",
            "note",
        )
        return Part(Section("force-maps", "Measured force maps", (text,)))
    points = read_force_map(folder)
    fits = compare_laws(points)
    results = {
        name: {
            "numbers_fitted": fit.numbers,
            "published_rms_N": fit.published_rms,
            "refitted_rms_N": fit.fitted_rms,
            "held_out_rms_N": fit.held_out_rms,
            "refitted_largest_N": fit.largest,
        }
        for name, fit in fits.items()
    }
    return Part(_section(points, fits), results)


def _section(points: ForceMap, fits: dict[str, LawFit]) -> Section:
    longest = float(points.length.max())
    scale = longest / LAW_LENGTH
    shown = [
        float(points.pressure[np.argmin(np.abs(points.pressure - p))]) for p in SHOWN_PRESSURES
    ]
    rows = [points.pressure == pressure for pressure in shown]
    fine = np.linspace(0.0, float(points.contraction.max()), 120)
    map_figure = force_map(
        [scale * points.contraction[r] for r in rows],
        [points.force[r] for r in rows],
        shown,
        scale * fine,
        {
            fits[name].title: [np.asarray(fits[name].law.force(fine, p)) for p in shown]
            for name in DRAWN_LAWS
        },
    )
    ordered = list(fits.values())
    error_figure = law_errors(
        [fit.title for fit in ordered],
        [fit.fitted_rms for fit in ordered],
        [fit.held_out_rms for fit in ordered],
        [fit.published_rms for fit in ordered],
    )
    best = min(ordered, key=lambda fit: fit.held_out_rms)
    largest = float(points.force.max())
    return Section(
        "force-maps",
        "Measured force maps of a DMSP-20",
        (
            Words(
                f"Static forces of a real muscle of the same type, {1e3 * longest:.0f} mm long, at "
                f"{len(np.unique(points.pressure))} pressures and "
                f"{len(np.unique(points.length))} lengths (M. Martens, I. Boblan, Actuators 2017), "
                "against every force law of the plant. The laws were published for a 200 mm "
                "muscle; they are compared at the same relative contraction, at which muscles of "
                "one diameter pull alike. Each law is then refitted to the map and judged on "
                "contractions that were left out of the fit."
            ),
            Words(
                f"Best on contractions left out: {best.title}, {best.held_out_rms:.0f} N rms or "
                f"{100 * best.held_out_rms / largest:.1f} % of the largest force. The numbers of "
                "the map were transcribed from a secondary source, so they support a comparison "
                "of laws, not a calibration.",
                "note",
            ),
            Picture(
                "force-map",
                map_figure,
                "Measured force over contraction at three pressures, and refitted laws.",
                "force falls with contraction; the laws with a pressure-independent part follow it",
            ),
            Picture(
                "law-errors",
                error_figure,
                "How far each law is from the map: as published, refitted, and on contractions "
                "that the refit has not seen.",
                "rms errors of six force laws on a logarithmic axis",
            ),
            Table(
                "Force laws against the map",
                (
                    "law",
                    "numbers fitted",
                    "published, rms in N",
                    "refitted, rms in N",
                    "held out, rms in N",
                    "refitted, largest in N",
                ),
                tuple(
                    (
                        fit.title,
                        str(fit.numbers),
                        number(fit.published_rms),
                        number(fit.fitted_rms),
                        number(fit.held_out_rms),
                        number(fit.largest),
                    )
                    for fit in ordered
                ),
                "The k of equation (2) is no published number but a fit to equation (4).",
            ),
            Method(
                (
                    ("published", "the law as published, on contractions up to 16.5 %, its range"),
                    (
                        "refitted",
                        "least squares of the force over all points; where the muscle is slack, "
                        "measurement and law are both zero",
                    ),
                    (
                        "held out",
                        "each inner contraction at which the muscle pulls is left out once, the "
                        "law is fitted to the others and judged on it; root of the mean square "
                        "over these contractions",
                    ),
                    ("equation (4)", "refitted with a quadratic φ(q) and without its switch"),
                )
            ),
        ),
    )
