"""Mass flow of gas through a restriction after ISO 6358.

``mdot = C rho0 p1 sqrt(T0 / T1) psi(r)`` with ``r = p2 / p1``; the flow is choked, psi = 1, below
the critical ratio b, else ``psi = sqrt(1 - z^2)`` with ``z = (r - b) / (1 - b)``. The root has an
infinite slope at r = 1, so psi is continued as a straight line from r = 0.995 to zero.
"""

from __future__ import annotations

from workbench.model.regularisation import EXACT, Expression, Form, maximum, minimum, sqrt, where

__all__ = ["flow_function", "iso6358", "mass_flow_from_litres", "orifice_flow"]

REFERENCE_DENSITY = 1.185
"""Density rho0 of air at the reference atmosphere (ANR), kg/m^3."""

REFERENCE_TEMPERATURE = 293.15
"""Temperature T0 of the reference atmosphere (ANR), K."""

LAMINAR_RATIO = 0.995
"""Pressure ratio above which psi is a straight line."""


def _laminar_slope(critical_ratio: Expression) -> Expression:
    z = (LAMINAR_RATIO - critical_ratio) / (1 - critical_ratio)
    return sqrt(1 - z * z) / (1 - LAMINAR_RATIO)


def _flow_function(r: Expression, critical_ratio: Expression, form: Form) -> Expression:
    # without the limit at 1: there the derivative of a minimum is half of either side's
    # z^2 of a clipped z is C1 at the critical ratio, so choking needs no rounding of its own
    z = maximum(r - critical_ratio, 0.0) / (1 - critical_ratio)
    y = 1 - z * z
    slope = _laminar_slope(critical_ratio)
    if form.regularised:
        e = (2 / ((1 - critical_ratio) * slope)) ** 2
        return y / sqrt(sqrt(y * y + e * e))
    # the root is kept off y = 0 because the derivative of the branch not taken must be finite too
    z_end = (LAMINAR_RATIO - critical_ratio) / (1 - critical_ratio)
    root = sqrt(maximum(y, 1 - z_end * z_end))
    return where(r > LAMINAR_RATIO, slope * (1 - r), root)


def _choked_flow(p_up: Expression, T_up: Expression, conductance: Expression) -> Expression:
    return conductance * REFERENCE_DENSITY * p_up * sqrt(REFERENCE_TEMPERATURE / T_up)


def flow_function(
    ratio: Expression, critical_ratio: Expression, *, form: Form = EXACT
) -> Expression:
    """Return psi(r), the flow relative to the choked one.

    The regularised form replaces ``sqrt(y)``, ``y = 1 - z^2``, by ``y / (y^2 + e^2)^(1/4)``, with e
    such that the slope at r = 1 equals that of the exact form's straight line. It is up to 16 %
    below the exact form near r = 0.995, 0.4 % at y = 0.1 and less than 0.1 % for y > 0.21 (r < 0.91
    at b = 0.23).

    Args:
        ratio: Ratio r of the downstream to the upstream absolute pressure, 0..1; any shape.
            Larger values count as 1.
        critical_ratio: Critical ratio b, below which the flow is choked.

    Returns:
        psi, 0..1, of the shape of ``ratio``.

    Source:
        ISO 6358-1.
    """
    return _flow_function(minimum(ratio, 1.0), critical_ratio, form)


def iso6358(
    p_up: Expression,
    p_down: Expression,
    T_up: Expression,
    conductance: Expression,
    critical_ratio: Expression,
    *,
    form: Form = EXACT,
) -> Expression:
    """Return the mass flow from the upstream to the downstream side.

    Args:
        p_up: Upstream absolute pressure, Pa; any shape, as all others.
        p_down: Downstream absolute pressure, Pa; not above ``p_up`` (the flow is zero there).
        T_up: Upstream temperature, K.
        conductance: Sonic conductance C, m^3/(s Pa) of the reference atmosphere.
        critical_ratio: Critical pressure ratio b.

    Returns:
        Mass flow, kg/s, not negative.

    Source:
        ISO 6358-1, reference atmosphere 293.15 K and 1.185 kg/m^3.

    Example:
        >>> round(float(iso6358(7.01325e5, 1.01325e5, 293.15, 2.9e-8, 0.23)), 4)
        0.0241
    """
    psi = flow_function(p_down / p_up, critical_ratio, form=form)
    return _choked_flow(p_up, T_up, conductance) * psi


def orifice_flow(
    p_a: Expression,
    p_b: Expression,
    T_a: Expression,
    T_b: Expression,
    conductance: Expression,
    critical_ratio: Expression,
    *,
    form: Form = EXACT,
) -> Expression:
    """Return the mass flow from side a to side b, negative when it runs from b to a.

    Odd under an exchange of the sides. At zero flow its slope is the same from both sides but for
    the square root of the temperatures.

    Args:
        p_a: Absolute pressure of side a, Pa; any shape, as all others.
        p_b: Absolute pressure of side b, Pa.
        T_a: Temperature of side a, K.
        T_b: Temperature of side b, K.
        conductance: Sonic conductance C, m^3/(s Pa), the same in both directions.
        critical_ratio: Critical pressure ratio b.

    Returns:
        Mass flow, kg/s.

    Source:
        ISO 6358-1.
    """
    # Branches instead of max and min: at p_a = p_b the derivative of a maximum and of a minimum
    # would both be taken from the same side and cancel, leaving a flow without slope.
    forward = p_a >= p_b
    up, down = where(forward, p_a, p_b), where(forward, p_b, p_a)
    choked = _choked_flow(up, where(forward, T_a, T_b), conductance)
    flow = choked * _flow_function(down / up, critical_ratio, form)
    return where(forward, flow, -flow)


def mass_flow_from_litres(volume_flow_l_min: float) -> float:
    """Return the mass flow of a volume flow in l/min of the reference atmosphere (ANR).

    Args:
        volume_flow_l_min: Volume flow, l/min ANR.

    Source:
        ISO 8778 reference atmosphere with 1.185 kg/m^3.

    Example:
        >>> round(mass_flow_from_litres(700.0), 4)
        0.0138
    """
    return volume_flow_l_min / 60e3 * REFERENCE_DENSITY
