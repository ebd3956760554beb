"""Static force laws of a pneumatic muscle: tension from contraction and gauge pressure.

Four laws stand side by side: Tondu and Lopez (equations 1 and 2 of the paper), Petrovic
(equation 3), the paper's own law with the pressure-independent term phi(q) (equation 4) and
Sarosi's law for the same muscle type. Each gives the raw `tension`, which may be negative, and
`force`, the tension of a muscle that can only pull.

Arguments are SI (contraction in m, gauge pressure in Pa). Coefficients keep the units in which
they were published, and their names say so.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

from workbench.errors import check_choice
from workbench.model.regularisation import EXACT, Expression, Form, functions_of, sqrt, where

BAR = 1e5
"""Pascal in one bar."""

ATMOSPHERE = 101_325.0
"""Standard atmosphere, Pa."""

SLACK_WIDTH = 1.0
"""Tension over which a muscle goes slack, N."""


def slack(tension: Expression, *, width: float = SLACK_WIDTH) -> Expression:
    """Return the tension in N of a muscle that can only pull: max(0, tension), rounded at zero.

    ``F = (T + sqrt(T^2 + w^2)) / 2``. The rounding is physical (a membrane does not go slack at
    one point), so it is the same on the exact and the regularised form. It adds w/2 at T = 0 and
    w^2 / (4 |T|) far from it: 0.5 N, and 2.5 mN at 100 N, for w = 1 N. A width of zero is the
    hard clamp of line [3] of the paper's Figure 3.

    Args:
        tension: Unclamped tension, N; number, array of any shape or expression.
        width: Width w of the rounding, N.

    Source:
        Line [3] of the paper's Figure 3; the rounding is an engineering choice.
    """
    return 0.5 * (tension + sqrt(tension * tension + width * width))


CONTRACTIONS = (-0.5e-3, 33e-3)
"""Smallest and largest contraction for which the laws hold, m: D(q) has its minimum at 33.3 mm,
beyond which the quadratic turns back. The lower end allows the half millimetre of stretch that a
compressed stop permits; the laws are almost constant there."""

D_BAR_MM = (280.0, -2.2, 0.033)
"""D1, D2, D3 of the identified D(q), N/bar, N/(bar mm), N/(bar mm^2): the paper's Figure 7."""

PHI_MM = (61.62, -43.691, 2.0189, -0.053424, 0.00045804)
"""Polynomial of phi(q) in line [1] of the paper's Figure 3: N/mm^i for i = 0..4."""

PHI_FLOOR = -9.2101
"""Value of phi(q) below the switch, N."""

PHI_SWITCH = 1.7573250315586657e-3
"""Contraction at which the polynomial `PHI_MM` passes `PHI_FLOOR`, m."""

PHI_SWITCH_PRINTED = 1.6e-3
"""Contraction of the switch as printed, 1 - s/l_nom > 0.008, m."""

PHI_WIDTH = 0.05e-3
"""Half-width of the regularised form's blend of the two branches of phi(q), m."""


def _polynomial(x: Expression, coefficients: tuple[Expression, ...]) -> Expression:
    value = 0.0 * x
    for c in reversed(coefficients):
        value = value * x + c
    return value


def pressure_gain(
    contraction: Expression, coefficients: tuple[Expression, ...] = D_BAR_MM
) -> Expression:
    """Return D(q), the tension gained, in N/Pa: ``D(q) = D1 + D2 q + D3 q^2``, q in mm.

    Args:
        contraction: Contraction q, m; any shape.
        coefficients: D1, D2, D3 in N/bar, N/(bar mm), N/(bar mm^2).

    Source:
        Equation (3) of the paper.
    """
    return _polynomial(1e3 * contraction, coefficients) / BAR


class ForceLaw(ABC):
    """Describe a static force law: a raw tension, and the force of a muscle that only pulls.

    A law of one's own is a frozen dataclass that derives from this class, has a field
    ``slack_width`` (N) and defines `tension`.

    Example:
        >>> @dataclass(frozen=True)
        ... class Piston(ForceLaw):
        ...     area: float = 3e-4
        ...     slack_width: float = SLACK_WIDTH
        ...
        ...     def tension(self, contraction, gauge_pressure, *, form=EXACT):
        ...         return self.area * gauge_pressure
        >>> round(float(Piston().force(0.0, 1e5)), 1)
        30.0
    """

    slack_width: float

    @abstractmethod
    def tension(
        self, contraction: Expression, gauge_pressure: Expression, *, form: Form = EXACT
    ) -> Expression:
        """Return the unclamped tension in N, which may be negative.

        Args:
            contraction: Contraction q, m; number, array or expression.
            gauge_pressure: Gauge pressure p, Pa; of a shape that fits ``contraction``.
            form: Exact or regularised; a law without a kink is the same on both.
        """

    def force(
        self, contraction: Expression, gauge_pressure: Expression, *, form: Form = EXACT
    ) -> Expression:
        """Return the pulling force, N, of the arguments of `tension`: through the slack clamp.

        Args:
            contraction: Contraction q, m.
            gauge_pressure: Gauge pressure p, Pa.
        """
        return slack(self.tension(contraction, gauge_pressure, form=form), width=self.slack_width)


@dataclass(frozen=True)
class PaperLaw(ForceLaw):
    """Give the tension of equation (4): ``F = D(q) p + phi(q)``.

    Args:
        gain_bar_mm: D1, D2, D3 in N/bar, N/(bar mm), N/(bar mm^2).
        phi_mm: Polynomial of phi, N/mm^i, from i = 0.
        phi_floor: Value of phi before the switch, N.
        phi_switch: Contraction of the switch of phi, m.
        reference_pressure: Added to the gauge pressure, Pa: zero in the corrected law; one
            atmosphere in the printed one, which multiplies D by the absolute pressure.
        slack_width: Rounding of the slack clamp, N.

    Source:
        Equation (4), lines [1] to [3] of the paper's Figure 3.

    Example:
        >>> law = PaperLaw.variant("corrected")
        >>> round(float(law.force(0.0, 6e5)), 1)
        1670.8
        >>> round(float(PaperLaw.variant("as_printed").force(0.0, 0.0)), 1)
        274.5
    """

    gain_bar_mm: tuple[Expression, Expression, Expression] = D_BAR_MM
    phi_mm: tuple[Expression, ...] = PHI_MM
    phi_floor: Expression = PHI_FLOOR
    phi_switch: Expression = PHI_SWITCH
    reference_pressure: float = 0.0
    slack_width: float = SLACK_WIDTH

    @classmethod
    def variant(cls, name: Literal["corrected", "as_printed"] = "corrected") -> PaperLaw:
        """Return a named variant of the law.

        Args:
            name: ``corrected``, or ``as_printed``: switch at 1.6 mm, absolute pressure.
        """
        check_choice("force law variant", name, ("corrected", "as_printed"))
        if name == "as_printed":
            return cls(phi_switch=PHI_SWITCH_PRINTED, reference_pressure=ATMOSPHERE)
        return cls()

    def phi(self, contraction: Expression, *, form: Form = EXACT) -> Expression:
        """Return phi, the part of the tension that does not depend on pressure, in N.

        ``phi = sum_i c_i q^i`` beyond the switch, the floor before it. The branch is needed: at
        q = 0 the polynomial gives +61.6 N, force without pressure. Regularised, the branches are
        blended over 0.05 mm on either side of the switch, where the forms differ by up to 0.2 N
        (half the jump, where there is one: the printed 1.6 mm makes phi jump by 5.88 N).

        Args:
            contraction: Contraction q, m; any shape.

        Source:
            Line [1] of the paper's Figure 3, with the switch moved to where the branches meet.
        """
        above = _polynomial(1e3 * contraction, self.phi_mm)
        if form.regularised:
            share = form.step(contraction - self.phi_switch, PHI_WIDTH)
            return self.phi_floor + share * (above - self.phi_floor)
        return where(contraction > self.phi_switch, above, self.phi_floor)

    def tension(
        self, contraction: Expression, gauge_pressure: Expression, *, form: Form = EXACT
    ) -> Expression:
        pressure = gauge_pressure + self.reference_pressure
        return pressure_gain(contraction, self.gain_bar_mm) * pressure + self.phi(
            contraction, form=form
        )


@dataclass(frozen=True)
class Petrovic(ForceLaw):
    """Give the tension of equation (3): ``F = (D1 + D2 q + D3 q^2) p``, without phi.

    Args:
        gain_bar_mm: D1, D2, D3 in N/bar, N/(bar mm), N/(bar mm^2).
        slack_width: Rounding of the slack clamp, N.

    Source:
        Equation (3) of the paper, after Petrovic (2002).
    """

    gain_bar_mm: tuple[Expression, Expression, Expression] = D_BAR_MM
    slack_width: float = SLACK_WIDTH

    def tension(
        self, contraction: Expression, gauge_pressure: Expression, *, form: Form = EXACT
    ) -> Expression:
        return pressure_gain(contraction, self.gain_bar_mm) * gauge_pressure


@dataclass(frozen=True)
class TonduLopez(ForceLaw):
    """Give the tension of equations (1) and (2), from the virtual work of a braided cylinder.

    ``F = pi r0^2 p [a (1 - k e)^2 - b]``, ``e = q / l0``, ``a = 3 / tan(alpha0)^2``,
    ``b = 1 / sin(alpha0)^2``, and ``k = k_exponential exp(-p / 1 bar) + k_constant``.

    Args:
        k_constant: Constant part of the correction for flattened ends, a factor.
        k_exponential: Factor of the part that decays with gauge pressure; zero for a constant k.
        nominal_length: l0, m.
        nominal_diameter: 2 r0, m.
        fibre_angle: alpha0 between fibre and axis, rad.
        slack_width: Rounding of the slack clamp, N.

    Source:
        Equations (1) and (2) of the paper; Tondu and Lopez (2000). The paper gives no k: those of
        `constant_k` and `pressure_dependent_k` are least-squares fits to equation (4).
    """

    k_constant: Expression = 1.0
    k_exponential: Expression = 0.0
    nominal_length: float = 0.2
    nominal_diameter: float = 0.02
    fibre_angle: float = math.radians(25.0)
    slack_width: float = SLACK_WIDTH

    @classmethod
    def constant_k(cls) -> TonduLopez:
        """Return equation (2) with a constant k, fitted to equation (4).

        The fit runs over 0..30 mm and 1..6 bar where equation (4) pulls; it leaves 106 N rms.
        """
        return cls(k_constant=1.1032)

    @classmethod
    def pressure_dependent_k(cls) -> TonduLopez:
        """Return equation (2) with ``k = 13.234 exp(-p) + 0.8566``, fitted to equation (4).

        The fit runs over 0..30 mm and 1..6 bar where equation (4) pulls; it leaves 39 N rms.
        """
        return cls(k_constant=0.8566, k_exponential=13.234)

    def shape_factor(self, gauge_pressure: Expression) -> Expression:
        """Return the factor k by which the flattened ends change the contraction.

        Args:
            gauge_pressure: Gauge pressure p, Pa; any shape.
        """
        scaled = gauge_pressure / BAR
        return self.k_constant + self.k_exponential * functions_of(scaled).exp(-scaled)

    def tension(
        self, contraction: Expression, gauge_pressure: Expression, *, form: Form = EXACT
    ) -> Expression:
        area = math.pi * self.nominal_diameter**2 / 4
        a = 3 / math.tan(self.fibre_angle) ** 2
        b = 1 / math.sin(self.fibre_angle) ** 2
        ratio = 1 - self.shape_factor(gauge_pressure) * contraction / self.nominal_length
        return area * gauge_pressure * (a * ratio * ratio - b)


@dataclass(frozen=True)
class Sarosi(ForceLaw):
    """Give the tension of Sarosi's law, fitted to a Festo DMSP-20-200N.

    ``F = (a p + b) exp(c kappa) + d kappa p + e p + f`` with p in bar gauge and the relative
    contraction kappa in per cent of the nominal length.

    Args:
        a: N/bar.
        b: N.
        c: 1/%.
        d: N/(bar %).
        e: N/bar.
        f: N.
        nominal_length: Length to which kappa refers, m.
        slack_width: Rounding of the slack clamp, N.

    Source:
        Sarosi, Tehnicki vjesnik 22 (2015), coefficients for the DMSP-20-200N.
    """

    a: Expression = -4.0018
    b: Expression = 292.462
    c: Expression = -0.32931
    d: Expression = -9.33564
    e: Expression = 294.054
    f: Expression = -280.498
    nominal_length: float = 0.2
    slack_width: float = SLACK_WIDTH

    def tension(
        self, contraction: Expression, gauge_pressure: Expression, *, form: Form = EXACT
    ) -> Expression:
        kappa = 100 * contraction / self.nominal_length
        p = gauge_pressure / BAR
        decay = functions_of(self.c * kappa).exp(self.c * kappa)
        return (self.a * p + self.b) * decay + self.d * kappa * p + self.e * p + self.f
