"""Measured force maps of a muscle against the force laws."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.data_folder import external_data
from workbench.demo.force_map_page import errors_figure, map_figure
from workbench.demo.force_map_study import FAMILIES, ForceMap, MapStudy, study_map
from workbench.demo.part import Part
from workbench.recordings import read_table
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
    """
    table = read_table(external_data(FILE, folder))
    return ForceMap(table["pressure"], table["length"], table["force"])


def force_maps_part(folder: Path | None) -> Part:
    """Compare every force law with a measured force map, if a data folder is given.

    Args:
        folder: The data folder, or None.

    Raises:
        WorkbenchError: If the folder does not hold the map.
    """
    if folder is None:
        text = Words(
            "Measured force maps of a real muscle are shown here when a folder with recordings of "
            "real machines is given: workbench demo --data FOLDER. Without it nothing on this "
            "page comes from a real muscle.",
            "note",
        )
        return Part(Section("force-maps", "Measured force maps", (text,)))
    study = study_map(read_force_map(folder), "DMSP-20", families=FAMILIES)
    results = {
        law.name: {
            "numbers_fitted": len(law.values),
            "published_rms_N": law.published_rms,
            "refitted_rms_N": law.fitted_rms,
            "held_out_rms_N": law.length_rms,
            "refitted_largest_N": law.largest,
        }
        for law in study.laws
    }
    return Part(_section(study), results)


def _section(study: MapStudy) -> Section:
    points, best = study.points, study.best
    percent = 100 * best.length_rms / study.largest_force
    shown = [
        float(points.pressure[np.argmin(np.abs(points.pressure - p))]) for p in SHOWN_PRESSURES
    ]
    return Section(
        "force-maps",
        "Measured force maps of a DMSP-20",
        (
            Words(
                "Static forces of a real muscle of the same type, "
                f"{1e3 * points.length.max():.0f} mm long, at "
                f"{len(np.unique(points.pressure))} pressures and "
                f"{len(np.unique(points.length))} lengths (M. Martens, I. Boblan, Actuators 2017), "
                "against every force law of the plant. The laws were published for a 200 mm "
                "muscle; they are compared at the same relative contraction, at which muscles of "
                "one diameter pull alike. Each law is then refitted to the map and judged on "
                "contractions that were left out of the fit."
            ),
            Words(
                f"Best on contractions left out: {best.title}, {best.length_rms:.0f} N rms or "
                f"{percent:.1f} % of the largest force. The numbers of the map were "
                "transcribed from a secondary source, so they support a comparison "
                "of laws, not a calibration.",
                "note",
            ),
            Picture(
                "force-map",
                map_figure(study, shown, DRAWN_LAWS),
                "Measured force over contraction at three pressures, and refitted laws.",
                "force falls with contraction; the laws with a pressure-independent part follow it",
            ),
            Picture(
                "law-errors",
                errors_figure(study, published=True),
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
                        law.title,
                        str(len(law.values)),
                        number(law.published_rms),
                        number(law.fitted_rms),
                        number(law.length_rms),
                        number(law.largest),
                    )
                    for law in study.laws
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
