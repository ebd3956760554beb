"""Opening of a proportional servovalve against its spool voltage, and the inverse.

A 5/3 valve has four metering edges. A spool voltage above the centre opens supply to chamber 1 and
chamber 2 to exhaust; below the centre, the other two. The curve is that of one edge against the
distance from the centre: very flat near the centre (soft overlap), steep from 1 V on.
"""

from __future__ import annotations

from dataclasses import dataclass

from workbench.model.face import EXACT, Expression, Face

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
"""Half-width over which the smooth face rounds the corners of the curve, V."""

LEAKAGE = 0.004
"""Conductance of each edge that stays when it is shut, as a fraction of the full one."""


@dataclass(frozen=True)
class ValveCurve:
    """Hold the curve of one metering edge; straight lines run between its points.

    Args:
        voltage: Increasing distances from the centre, V, starting at 0.
        fraction: Increasing fractions of the full conductance, starting at 0.

    Source:
        Manufacturer's flow curve; straight lines between its points are part of the nominal plant.

    Example:
        >>> MPYE.voltage[-1], MPYE.fraction[-1], LINEAR.fraction
        (5.0, 1.0, (0.0, 1.0))
    """

    voltage: tuple[float, ...] = OPENING_V
    fraction: tuple[float, ...] = OPENING_FRACTION


MPYE = ValveCurve()
"""Curve of the MPYE-5-1/8-HF."""

LINEAR = ValveCurve(voltage=(0.0, 5.0), fraction=(0.0, 1.0))
"""A valve whose opening is proportional to the voltage, for comparison."""


def opening(
    voltage_from_centre: Expression, *, curve: ValveCurve = MPYE, face: Face = EXACT
) -> Expression:
    """Return the opening of the edge that a positive voltage opens.

    Args:
        voltage_from_centre: Spool voltage minus the centre voltage, V; any shape. Negative
            voltages keep the edge shut, voltages beyond the curve's end leave it fully open.
        curve: Curve of one edge.
        face: Exact, or smooth with corners rounded within 0.04 V.

    Returns:
        Fraction of the full conductance, 0..1, without leakage.

    Source:
        Manufacturer's flow curve.

    Example:
        >>> round(float(opening(0.9)), 3), float(opening(-0.9))
        (0.056, 0.0)
    """
    return face.table(voltage_from_centre, curve.voltage, curve.fraction, VOLTAGE_WIDTH)


def signed_opening(
    voltage_from_centre: Expression, *, curve: ValveCurve = MPYE, face: Face = EXACT
) -> Expression:
    """Return the opening with the sign of the voltage: positive fills chamber 1.

    Args:
        voltage_from_centre: Spool voltage minus the centre voltage, V; any shape.
        curve: Curve of one edge.
        face: Exact or smooth.

    Returns:
        Signed fraction of the full conductance, -1..1, without leakage.

    Source:
        Manufacturer's flow curve, the same on both sides of the centre.

    Example:
        >>> round(float(signed_opening(-0.9)), 3)
        -0.056
    """
    return opening(voltage_from_centre, curve=curve, face=face) - opening(
        -voltage_from_centre, curve=curve, face=face
    )


def edge_openings(
    spool_V: Expression,
    leakage: Expression = LEAKAGE,
    *,
    curve: ValveCurve = MPYE,
    face: Face = EXACT,
) -> tuple[Expression, Expression, Expression, Expression]:
    """Return the openings of the four metering edges.

    Args:
        spool_V: Spool position as a voltage from the centre, V; any shape.
        leakage: Fraction of the full conductance added to every edge.
        curve: Curve of one edge.
        face: Exact or smooth.

    Returns:
        Fractions of the full conductance of the edges supply to 1, 1 to exhaust, supply to 2 and
        2 to exhaust. A positive spool opens the first and the last.

    Source:
        5/3 servovalve, manufacturer's flow curve and leakage.

    Example:
        >>> [round(float(o), 3) for o in edge_openings(0.9)]
        [0.06, 0.004, 0.004, 0.06]
    """
    positive = opening(spool_V, curve=curve, face=face) + leakage
    negative = opening(-spool_V, curve=curve, face=face) + leakage
    return positive, negative, negative, positive


def inverse_opening(
    fraction: Expression, *, curve: ValveCurve = MPYE, face: Face = EXACT
) -> Expression:
    """Return the voltage from the centre that gives a signed opening.

    Monotone, odd and continuous. A controller that decides the opening and then inverts the curve
    sees a plant without the flat place at the centre. Openings beyond 1 give the full voltage.

    Args:
        fraction: Signed fraction of the full conductance without leakage, -1..1; any shape.
        curve: Curve of one edge.
        face: Exact, or smooth with corners rounded within 0.4 of the closest spacing of fractions.

    Returns:
        Voltage from the centre, V.

    Source:
        Inverse of the manufacturer's flow curve.

    Example:
        >>> round(float(inverse_opening(0.056)), 3), round(float(inverse_opening(-2.0)), 3)
        (0.9, -5.0)
    """
    spacing = min(b - a for a, b in zip(curve.fraction[:-1], curve.fraction[1:], strict=True))
    width = 0.4 * spacing
    return face.table(fraction, curve.fraction, curve.voltage, width) - face.table(
        -fraction, curve.fraction, curve.voltage, width
    )
