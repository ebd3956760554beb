"""Other shapes of the static force of the arm's muscles: another law, slopes, the term phi(q)."""

from __future__ import annotations

from dataclasses import replace

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.force_laws import PaperLaw, Sarosi
from workbench.physics.law import Law, size, twins

REFERENCE_CONTRACTION = 0.03
"""Contraction at which the correction has its full size, m."""

REFERENCE_PRESSURE = 3e5
"""Gauge pressure in the middle of the range, Pa."""

_SAROSI, _PAPER = Sarosi(), PaperLaw()


def _other(at: PortView) -> Expression:
    s = at.signals
    tension = _SAROSI.tension(s.contraction, s.gauge_pressure, form=at.form)
    return at.value + at.p.share * (tension - at.value)


force_shape = Law(
    "force_shape",
    "T = T + share (T_law(q, p) - T)",
    twins("muscle_tension", needs=("contraction", "gauge_pressure")),
    lambda at: (size("share", "1", 0.5, 1.5, "share of the other law", lower=-0.5),),
    _other,
    source="J. Sarosi, Tehnicki vjesnik 22 (2015), for the DMSP-20-200N",
    look_alikes=("contraction_force_correction", "linear_spring", "series_elasticity"),
    separated_by="isometric pressure ramps at several contractions with a load cell",
)

# Unchanged in the middle of the travel, by the gain more at its end and less at its start.
contraction_force_correction = replace(
    force_shape,
    name="contraction_force_correction",
    equation="T = T [1 + gain (2 q / q_end - 1)]",
    parameters=lambda at: (size("gain", "1", 0.1, 0.6, "relative change at 30 mm", signed=True),),
    transform=lambda at: (
        at.value * (1.0 + at.p.gain * (2.0 * at.signals.contraction / REFERENCE_CONTRACTION - 1.0))
    ),
    source="first-order correction of the force over contraction; scatter between muscles",
    look_alikes=("force_shape", "linear_spring", "series_elasticity"),
)

pressure_force_correction = replace(
    force_shape,
    name="pressure_force_correction",
    equation="T = T [1 + gain (p / p_mid - 1)]",
    parameters=lambda at: (size("gain", "1", 0.05, 0.4, "relative change at 6 bar", signed=True),),
    transform=lambda at: (
        at.value * (1.0 + at.p.gain * (at.signals.gauge_pressure / REFERENCE_PRESSURE - 1.0))
    ),
    source="first-order correction of the force over pressure; dead pressure of the tube",
    look_alikes=("force_shape", "sensor_gain", "force_gain"),
    separated_by="the same angle held at low and at high mean pressure",
)

phi_term = replace(
    force_shape,
    name="phi_term",
    equation="T + phi(q)",
    parameters=lambda at: (size("share", "1", 1.0, 2.0, "share of phi(q)", scale=0.5),),
    transform=lambda at: at.value + at.p.share * _PAPER.phi(at.signals.contraction, form=at.form),
    source="equation (4) and line [1] of the paper's Figure 3",
    look_alikes=("linear_spring", "contraction_force_correction"),
    separated_by="the same angle held at low and at high mean pressure",
)
