"""The two polynomials of the identified force law: D(q) per pressure and phi(q) without it.

Both were fitted to isometric pressure ramps of a DMSP-20-200N. Contractions are in m; the
coefficients keep the units in which they were published, mm and bar, and their names say so.
"""

from __future__ import annotations

import numpy as np

from workbench.model.regularisation import EXACT, Expression, Form, where


def _polynomial(x: Expression, coefficients: tuple[Expression, ...]) -> Expression:
    value = 0.0 * x
    for c in reversed(coefficients):
        value = value * x + c
    return value


def pressure_gain(
    contraction: Expression, coefficients: tuple[Expression, ...] = (280.0, -2.2, 0.033)
) -> Expression:
    """Return D(q), the tension gained per pascal.

    ``D(q) = D1 + D2 q + D3 q^2`` with q in mm and D in N/bar.

    Args:
        contraction: Contraction q, m; any shape.
        coefficients: D1, D2, D3 in N/bar, N/(bar mm), N/(bar mm^2).

    Returns:
        Gain, N/Pa, of the shape of ``contraction``.

    Source:
        Equation (3) of the paper, identified values of its Figure 7.
    """
    return _polynomial(1e3 * contraction, coefficients) / 1e5


PHI_MM = (61.62, -43.691, 2.0189, -0.053424, 0.00045804)
"""Polynomial of phi(q) in line [1] of Figure 3: N/mm^i for i = 0..4."""

PHI_ROUNDED_MM = (61.62, -43.69, 2.02, -0.053, 0.00046)
"""The same polynomial as rounded in the paper's text; 14 N off at 30 mm."""

PHI_FLOOR = -9.2101
"""Value of phi(q) below the switch, N."""

PHI_SWITCH = 1.7573250315586657e-3
"""Contraction at which the polynomial `PHI_MM` passes `PHI_FLOOR`, m."""

PHI_SWITCH_PRINTED = 1.6e-3
"""Contraction of the switch as printed, 1 - s/l_nom > 0.008, m."""

PHI_WIDTH = 0.05e-3
"""Half-width of the regularised form's blend of the two branches of phi(q), m."""


def phi(
    contraction: Expression,
    *,
    coefficients: tuple[Expression, ...] = PHI_MM,
    floor: Expression = PHI_FLOOR,
    switch: Expression = PHI_SWITCH,
    form: Form = EXACT,
) -> Expression:
    """Return the part of the tension that does not depend on pressure.

    ``phi = sum_i c_i q^i`` beyond the switch, ``floor`` before it. The branch is needed: at q = 0
    the polynomial gives +61.6 N, force without pressure. Regularised, the branches are blended over
    0.05 mm on either side of the switch, where the forms differ by up to 0.2 N (half the jump,
    where there is one).

    Args:
        contraction: Contraction q, m; any shape.
        coefficients: Polynomial, N/mm^i, from i = 0.
        floor: Value before the switch, N.
        switch: Contraction of the switch, m; the printed 1.6 mm makes phi jump by 5.88 N.

    Returns:
        phi, N, of the shape of ``contraction``.

    Source:
        Line [1] of the paper's Figure 3, with the switch moved to where the branches meet.
    """
    above = _polynomial(1e3 * contraction, coefficients)
    if form.regularised:
        return floor + form.step(contraction - switch, PHI_WIDTH) * (above - floor)
    return where(contraction > switch, above, floor)


def continuous_switch(
    coefficients: tuple[float, ...] = PHI_MM, *, floor: float = PHI_FLOOR
) -> float:
    """Return the contraction at which the polynomial of phi first passes its floor.

    Args:
        coefficients: Polynomial, N/mm^i, from i = 0.
        floor: Value of phi before the switch, N.

    Returns:
        Contraction, m: the smallest root in 0..33 mm; 0 if the polynomial starts below the floor
        or never reaches it.

    Source:
        Continuity of line [1] of the paper's Figure 3.
    """
    shifted = np.array(coefficients[::-1], dtype=float)
    shifted[-1] -= floor
    if shifted[-1] <= 0.0:
        return 0.0
    roots = np.roots(shifted)
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real >= 0.0) & (real <= 33.0)]
    return float(inside.min()) / 1e3 if inside.size else 0.0
