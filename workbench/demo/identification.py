"""The isometric experiment of the paper's Figure 7 and the force law identified from it."""

from __future__ import annotations

import numpy as np

from workbench.demo.figures.force_lines import force_lines
from workbench.demo.part import Part
from workbench.experiments import IsometricRecord, isometric_experiment, isometric_experiment_on_arm
from workbench.physics.force_laws import PaperLaw
from workbench.plants.arm import arm
from workbench.plants.arm.static_identification import StaticForceFit, identify_static_force
from workbench.reports.page import Commands, Method, Section, Words
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, Table, interval, number

CONFIDENCE = 0.99

DRAWN = (0, 4, 5, 6, 7, 8, 10)
"""Ramps that are drawn, of those measured."""

PHI_AT_MM = (0.0, 5.0, 10.0, 20.0, 30.0)
"""Contractions at which phi is compared, in mm."""


def true_values(law: PaperLaw) -> dict[str, float]:
    """Return the numbers that an identification should find.

    Returns:
        Values by name, in the units of millimetre, bar and newton.
    """
    names = ("D1", "D2", "D3", *(f"phi_{i}" for i in range(len(law.phi_mm))), "switch")
    values = (*law.gain_bar_mm, *law.phi_mm, 1e3 * law.phi_switch)
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def identification_part() -> Part:
    """Run the isometric experiment, on one muscle and on the arm, and identify the force law.

    Example:
        >>> part = identification_part()
        >>> part.marks
        {'met': 14, 'missed': 0, 'open': 0}
    """
    law = PaperLaw()
    alone = isometric_experiment(law)
    fit = _fit(alone)
    pressed = _fit(isometric_experiment_on_arm(arm()))
    results = {
        "one muscle": _numbers(fit, law),
        "muscle 2 pressing the arm on its stop": _numbers(pressed, law),
        "phi_N": {f"{q:g} mm": _phi(fit, law, q) for q in PHI_AT_MM},
        "residual_rms_N": fit.residual_rms,
        "confidence": CONFIDENCE,
    }
    return Part(_section(alone, fit, pressed, law), results)


def _fit(record: IsometricRecord) -> StaticForceFit:
    return identify_static_force(
        record.pressure, record.contraction, record.force, confidence=CONFIDENCE
    )


def _numbers(fit: StaticForceFit, law: PaperLaw) -> dict[str, dict[str, float]]:
    true = true_values(law)
    return {
        name: {
            "identified": float(value),
            "low": fit.interval(name)[0],
            "high": fit.interval(name)[1],
            "true": true.get(name, float("nan")),
        }
        for name, value in zip(fit.names, fit.values, strict=True)
    }


def _phi(fit: StaticForceFit, law: PaperLaw, contraction_mm: float) -> dict[str, float]:
    q = 1e-3 * contraction_mm
    low, high = fit.phi_interval(q)
    return {
        "identified": float(fit.law.phi(q)),
        "low": float(low),
        "high": float(high),
        "true": float(law.phi(q)),
    }


def _section(
    record: IsometricRecord, fit: StaticForceFit, pressed: StaticForceFit, law: PaperLaw
) -> Section:
    own = [record.ramp == ramp for ramp in DRAWN]
    contractions = np.array([np.median(record.contraction[rows]) for rows in own])
    figure = force_lines(
        contractions,
        [record.pressure[rows] for rows in own],
        [record.force[rows] for rows in own],
        [
            np.asarray(fit.law.force(q, record.pressure[rows]))
            for q, rows in zip(contractions, own, strict=True)
        ],
    )
    return Section(
        "identification",
        "Static identification experiment",
        (
            Words(
                "The muscle is held at constant contraction while its pressure rises slowly from "
                "0 to 6 bar: the experiment of the paper's Figure 7. Every contraction gives a "
                "straight line; the lines cut the pressure axis the farther from the origin the "
                "more the muscle is contracted, which is what φ(q) describes. Fitting "
                "F = (D1 + D2 q + D3 q²) p + φ(q) to the noisy measurements returns the numbers "
                "that the plant was built with."
            ),
            Picture(
                "force-lines",
                figure,
                "Force over pressure at constant contractions: measurements as dots, the "
                "identified law as lines.",
                "a family of straight force lines, steeper for the longer muscle",
            ),
            _coefficients(fit, pressed, law),
            _phi_table(fit, law),
            Method(
                (
                    (
                        "identified",
                        f"least squares on {fit.used} measurements in which the muscle pulls "
                        f"({fit.slack} slack ones say only that the tension is not positive); "
                        f"{fit.residual_rms:.2f} N rms are left, the noise of pressure sensor and "
                        "load cell",
                    ),
                    (
                        "order of φ",
                        "the lowest whose error on contractions left out of the fit is within 3 % "
                        f"of the best: order {fit.order}",
                    ),
                    (
                        f"{100 * CONFIDENCE:g} % interval",
                        "from the covariance of the least-squares fit and Student's t; each "
                        "number's own interval",
                    ),
                    (
                        "on the arm",
                        "muscle 2 presses the arm on its lower stop at several angles; the force "
                        "follows from the load cell and the moment arms, the contraction from the "
                        "encoder",
                    ),
                )
            ),
            Commands(
                (
                    'python -c "from workbench.demo.identification import identification_part; '
                    'print(identification_part().results)"',
                )
            ),
        ),
    )


def _within(value: float, true: float, ends: tuple[float, float], digits: int) -> Cell:
    return Cell(number(value, digits), "met" if ends[0] <= true <= ends[1] else "missed")


def _coefficients(fit: StaticForceFit, pressed: StaticForceFit, law: PaperLaw) -> Table:
    true = true_values(law)
    rows = []
    for name, unit in zip(fit.names, fit.units, strict=True):
        ends = fit.interval(name)
        on_arm = dict(zip(pressed.names, pressed.values, strict=True)).get(name, float("nan"))
        rows.append(
            (
                name.replace("phi_", "φ, power ").replace("switch", "φ, switch"),
                unit.replace("mm2", "mm²").replace("mm3", "mm³").replace("mm4", "mm⁴"),
                number(true.get(name, float("nan")), 5),
                _within(float(fit.values[fit.names.index(name)]), true[name], ends, 5),
                interval(*ends, 5),
                number(float(on_arm), 5),
            )
        )
    return Table(
        "Identified force law",
        ("number", "unit", "true", "identified", f"{100 * CONFIDENCE:g} % interval", "on the arm"),
        tuple(rows),
        "Met: the interval holds the true number. The powers of φ depend on each other strongly; "
        "the next table compares φ itself.",
    )


def _phi_table(fit: StaticForceFit, law: PaperLaw) -> Table:
    rows = []
    for q in PHI_AT_MM:
        found = _phi(fit, law, q)
        ends = (found["low"], found["high"])
        rows.append(
            (
                f"{q:g}",
                number(found["true"], 4),
                _within(found["identified"], found["true"], ends, 4),
                interval(*ends, 4),
            )
        )
    return Table(
        "φ(q), the part of the force that does not depend on pressure",
        ("q in mm", "true, N", "identified, N", f"{100 * CONFIDENCE:g} % interval, N"),
        tuple(rows),
    )
