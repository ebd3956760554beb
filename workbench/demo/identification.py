"""The isometric experiment of the paper's Figure 7 and the force law identified from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.demo.part import Part, judged, section
from workbench.experiments import IsometricRecord, isometric_experiment, isometric_experiment_on_arm
from workbench.physics.force_laws import ForceLaw, PaperLaw
from workbench.plants.arm import arm
from workbench.plants.arm.static_identification import StaticForceFit, identify_static_force
from workbench.reports.pictures import Picture
from workbench.reports.style import MEASURED, key, label, named_line, new_figure, ramp
from workbench.reports.tables import Cell, Table, interval, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CONFIDENCE = 0.99

DRAWN = (0, 4, 5, 6, 7, 8, 10)
"""Ramps that are drawn, of those measured."""

PHI_AT_MM = (0.0, 5.0, 10.0, 20.0, 30.0)
"""Contractions at which phi is compared, in mm."""

_DOTS = 16
"""Measured points shown per line: enough to see the line, few enough to see the dots."""

Numbers = dict[str, dict[str, float]]


def identification_part() -> Part:
    """Run the isometric experiment, on one muscle and on the arm, and identify the force law.

    Example:
        >>> part = identification_part()
        >>> part.marks
        {'met': 14, 'missed': 0, 'open': 0}
    """
    law = PaperLaw()
    alone = isometric_experiment(law)
    fit, pressed = _fit(alone), _fit(isometric_experiment_on_arm(arm()))
    found, on_arm = _numbers(fit, law), _numbers(pressed, law)
    phi = {
        f"{q:g} mm": _beside(fit.law.phi(1e-3 * q), *fit.phi_interval(1e-3 * q), law.phi(1e-3 * q))
        for q in PHI_AT_MM
    }
    law_of_phi = Table(
        "φ(q), the part of the force that does not depend on pressure",
        ("q in mm", "true, N", "identified, N", f"{100 * CONFIDENCE:g} % interval, N"),
        tuple((q.removesuffix(" mm"), *_within(own, 4)) for q, own in phi.items()),
    )
    results = {
        "one muscle": found,
        "muscle 2 pressing the arm on its stop": on_arm,
        "phi_N": phi,
        "residual_rms_N": fit.residual_rms,
        "confidence": CONFIDENCE,
    }
    command = (
        'python -c "from workbench.demo.identification import identification_part; '
        'print(identification_part().results)"'
    )
    lines = Picture(
        "force-lines",
        force_lines(alone, fit.law),
        "Force over pressure at constant contractions: measurements as dots, the identified law as"
        " lines.",
        "a family of straight force lines, steeper for the longer muscle",
    )
    blocks = (lines, _coefficients(fit, found, on_arm), law_of_phi)
    title, of = "Static identification experiment", {"fit": fit, "confidence": 100 * CONFIDENCE}
    return Part(section("identification", title, "identification", blocks, command, of), results)


def _fit(record: IsometricRecord) -> StaticForceFit:
    return identify_static_force(
        record.pressure, record.contraction, record.force, confidence=CONFIDENCE
    )


def _numbers(fit: StaticForceFit, law: PaperLaw) -> Numbers:
    """Return what was identified beside what should be, in units of millimetre, bar and newton."""
    names = ("D1", "D2", "D3", *(f"phi_{i}" for i in range(len(law.phi_mm))), "switch")
    true = dict(zip(names, (*law.gain_bar_mm, *law.phi_mm, 1e3 * law.phi_switch), strict=True))
    return {
        name: _beside(value, *fit.interval(name), true.get(name, float("nan")))
        for name, value in zip(fit.names, fit.values, strict=True)
    }


def _beside(*values: npt.ArrayLike) -> dict[str, float]:
    names = ("identified", "low", "high", "true")
    return {name: float(np.asarray(v)) for name, v in zip(names, values, strict=True)}


def _within(found: dict[str, float], digits: int) -> tuple[str, Cell, str]:
    """Write the true number, the identified one with its mark, and its interval."""
    ends = found["low"], found["high"]
    mark = judged(found["true"], *ends).mark
    text = number(found["identified"], digits)
    return number(found["true"], digits), Cell(text, mark), interval(*ends, digits)


def _coefficients(fit: StaticForceFit, found: Numbers, on_arm: Numbers) -> Table:
    return Table(
        "Identified force law",
        ("number", "unit", "true", "identified", f"{100 * CONFIDENCE:g} % interval", "on the arm"),
        tuple(
            (
                name.replace("phi_", "φ, power ").replace("switch", "φ, switch"),
                unit.replace("mm2", "mm²").replace("mm3", "mm³").replace("mm4", "mm⁴"),
                *_within(found[name], 5),
                number(on_arm.get(name, {}).get("identified", float("nan")), 5),
            )
            for name, unit in zip(fit.names, fit.units, strict=True)
        ),
        "Met: the interval holds the true number. The powers of φ depend on each other strongly; "
        "the next table compares φ itself.",
    )


def force_lines(record: IsometricRecord, fitted: ForceLaw) -> Figure:
    """Draw force over gauge pressure at constant contractions, with the law fitted to it."""
    figure, (axes,) = new_figure([3.6])
    handles = []
    for drawn, colour in zip(DRAWN, ramp(len(DRAWN)), strict=True):
        own = record.ramp == drawn
        contraction, force = float(np.median(record.contraction[own])), record.force[own]
        bar = record.pressure[own] / 1e5
        law = np.asarray(fitted.force(contraction, record.pressure[own]))
        order = np.argsort(bar)
        step = max(1, len(bar) // _DOTS)
        axes.plot(bar[::step], force[::step], ".", color=colour.light, markersize=4.5)
        axes.plot(bar[order], law[order], color=colour.light, linewidth=1.1)
        handles.append(named_line(f"{1e3 * contraction:.3g} mm", colour))
    handles.append(named_line("measured", MEASURED, marker="."))
    label(axes, x="gauge pressure in bar", y="force in N")
    key(axes, columns=4, handles=handles)
    axes.set_ylim(bottom=min(0.0, float(np.min(record.force[np.isin(record.ramp, DRAWN)]))))
    return figure
