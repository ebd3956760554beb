"""Mass flow of gas through a restriction after ISO 6358.

``mdot = C rho0 p1 sqrt(T0 / T1) psi(r)`` with ``r = p2 / p1``; the flow is choked, psi = 1, below
the critical ratio b, else ``psi = sqrt(1 - z^2)`` with ``z = (r - b) / (1 - b)``. The root has an
infinite slope at r = 1, so psi is continued as a straight line from r = 0.995 to zero.
"""

from __future__ import annotations

from workbench.model.regularisation import EXACT, Expression, Form, maximum, sqrt, where

REFERENCE_DENSITY = 1.185
"""Density rho0 of air at the reference atmosphere (ANR), kg/m^3."""

REFERENCE_TEMPERATURE = 293.15
"""Temperature T0 of the reference atmosphere (ANR), K."""

LAMINAR_RATIO = 0.995
"""Pressure ratio above which psi is a straight line."""


def flow_function(
    ratio: Expression, critical_ratio: Expression, *, form: Form = EXACT
) -> Expression:
    """Return psi(r), the flow relative to the choked one, 0..1.

    The regularised form replaces ``sqrt(y)``, ``y = 1 - z^2``, by ``y / (y^2 + e^2)^(1/4)``, with e
    such that the slope at r = 1 equals that of the exact form's straight line. It is up to 16 %
    below the exact form near r = 0.995, 0.4 % at y = 0.1 and less than 0.1 % for y > 0.21 (r < 0.91
    at b = 0.23).

    Args:
        ratio: Ratio r of the downstream to the upstream absolute pressure, 0..1; any shape.
        critical_ratio: Critical ratio b, below which the flow is choked.

    Source:
        ISO 6358-1.
    """
    # z^2 of a clipped z is C1 at the critical ratio, so choking needs no rounding of its own.
    z = maximum(ratio - critical_ratio, 0.0) / (1 - critical_ratio)
    y = 1 - z * z
    z_end = (LAMINAR_RATIO - critical_ratio) / (1 - critical_ratio)
    slope = sqrt(1 - z_end * z_end) / (1 - LAMINAR_RATIO)
    if form.regularised:
        e = (2 / ((1 - critical_ratio) * slope)) ** 2
        return y / sqrt(sqrt(y * y + e * e))
    # The root is kept off y = 0: the derivative of the branch not taken must be finite too.
    root = sqrt(maximum(y, 1 - z_end * z_end))
    return where(ratio > LAMINAR_RATIO, slope * (1 - ratio), root)


def orifice_flow(
    p_a: Expression,
    p_b: Expression,
    T_a: Expression,
    T_b: Expression,
    conductance: Expression,
    critical_ratio: Expression = 0.3,
    *,
    form: Form = EXACT,
) -> Expression:
    """Return the mass flow in kg/s from side a to side b, negative when it runs from b to a.

    Odd under an exchange of the sides. At zero flow its slope is the same from both sides but for
    the square root of the temperatures.

    Args:
        p_a: Absolute pressure of side a, Pa; any shape, as all others.
        p_b: Absolute pressure of side b, Pa.
        T_a: Temperature of side a, K.
        T_b: Temperature of side b, K.
        conductance: Sonic conductance C, m^3/(s Pa), the same in both directions.
        critical_ratio: Critical pressure ratio b; by default that of tubes and holes.

    Source:
        ISO 6358-1.
    """
    # Branches instead of max and min: at p_a = p_b the derivative of a maximum and of a minimum
    # would both be taken from the same side and cancel, leaving a flow without slope.
    forward = p_a >= p_b
    up, down = where(forward, p_a, p_b), where(forward, p_b, p_a)
    temperature = where(forward, T_a, T_b)
    choked = conductance * REFERENCE_DENSITY * up * sqrt(REFERENCE_TEMPERATURE / temperature)
    flow = choked * flow_function(down / up, critical_ratio, form=form)
    return where(forward, flow, -flow)
