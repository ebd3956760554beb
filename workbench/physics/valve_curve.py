"""Opening of a proportional servovalve against its spool voltage.

A 5/3 valve has four metering edges. A spool voltage above the centre opens supply to chamber 1 and
chamber 2 to exhaust; below the centre, the other two. The curve is that of one edge against the
distance from the centre: very flat near the centre (soft overlap), steep from 1 V on.
"""

from __future__ import annotations

from dataclasses import dataclass

from workbench.model.regularisation import EXACT, Expression, Form

OPENING_V: tuple[float, ...] = (
    0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0,
    1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0,
)  # fmt: skip
"""Distance from the centre, V."""

OPENING_FRACTION: tuple[float, ...] = (
    0.0, 0.002, 0.005, 0.008, 0.012, 0.017, 0.023, 0.030, 0.041, 0.056, 0.071,
    0.107, 0.17, 0.24, 0.30, 0.36, 0.49, 0.64, 0.75, 0.86, 0.97, 1.0,
)  # fmt: skip
"""Fraction of the full conductance: manufacturer's curve of the MPYE-5-1/8-HF, type average."""

VOLTAGE_WIDTH = 0.04
"""Half-width over which the regularised form rounds the corners of the curve, V."""


@dataclass(frozen=True)
class ValveCurve:
    """Hold the curve of one metering edge; straight lines run between its points.

    Args:
        voltage: Increasing distances from the centre, V, starting at 0.
        fraction: Increasing fractions of the full conductance, starting at 0.

    Source:
        Manufacturer's flow curve; straight lines between its points are part of the nominal plant.
    """

    voltage: tuple[float, ...] = OPENING_V
    fraction: tuple[float, ...] = OPENING_FRACTION


MPYE = ValveCurve()
"""Curve of the MPYE-5-1/8-HF."""

LINEAR = ValveCurve(voltage=(0.0, 5.0), fraction=(0.0, 1.0))
"""A valve whose opening is proportional to the voltage, for comparison."""


def opening(
    voltage_from_centre: Expression, *, curve: ValveCurve = MPYE, form: Form = EXACT
) -> Expression:
    """Return the opening, a fraction, of the edge that a positive voltage opens, without leakage.

    Args:
        voltage_from_centre: Spool voltage minus the centre voltage, V; any shape. Negative
            voltages keep the edge shut, voltages beyond the curve's end leave it fully open.
        form: Exact, or regularised with corners rounded within 0.04 V.

    Source:
        Manufacturer's flow curve.
    """
    return form.table(voltage_from_centre, curve.voltage, curve.fraction, VOLTAGE_WIDTH)
