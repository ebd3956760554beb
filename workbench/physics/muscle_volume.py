"""Gas volume of a pneumatic muscle: a braided cylinder with flattened ends.

The inextensible fibre of length b makes n turns, so the diameter follows from the fibre length s
along the axis: ``d = sqrt(b^2 - s^2) / (pi n)``. At both ends the membrane closes down from d to
the nominal d0 of the fitting over a height h: a spherical segment in place of a cylinder.

With the two radii of the segment as they are, the ends take away exactly

    V(s) - (pi d^2 / 4) s = -(2 pi / 3) h^3,    h^2 = (d^2 - d0^2) / 4,

because ``h^2`` is also the difference of the squared radii. In this form dV/ds is finite and
continuous at d = d0, although h itself has an infinite slope there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from workbench.errors import check_choice
from workbench.model import PortView
from workbench.model.regularisation import EXACT, Expression, Form, maximum, sqrt
from workbench.physics.law import Fit, Law, size, twins
from workbench.physics.survey import Survey

END_HEIGHT_FLOOR = 1e-7
"""Height of the ends while d <= d0, m: the 0.0001 mm branch of line [8]. It keeps second
derivatives of h^3 finite at the nominal length and changes the volume by less than 1e-20 m^3."""

END_WIDTH = 1e-7
"""Half-width over which the regularised form rounds max(0, h^2), m^2: 0.02 mm of contraction."""


@dataclass(frozen=True)
class BraidedCylinder:
    """Give the volume of a muscle from its fibre length.

    Args:
        nominal_length: Fibre length l of the muscle without pressure, m.
        nominal_diameter: Diameter d0 of the muscle without pressure, m.
        fibre_angle: Angle alpha0 between fibre and axis without pressure, rad.
        printing: ``corrected`` or ``as_printed``. As printed, n has the unit of a length, the
            square root is missing from d, the end has the larger radius twice, and the ends are
            added to a cylinder that already contains them.

    Source:
        Lines [6] to [10] of the paper's Figure 3.

    Example:
        >>> muscle = BraidedCylinder()
        >>> round(muscle.turns, 3), round(1e3 * muscle.fibre, 2)
        (1.484, 220.68)
        >>> round(1e3 * float(muscle.diameter(0.17)), 1), round(1e6 * float(muscle.volume(0.17)), 1)
        (30.2, 118.5)
        >>> round(1e6 * float(BraidedCylinder(printing="as_printed").volume(0.17)))
        352
    """

    nominal_length: float = 0.2
    nominal_diameter: float = 0.02
    fibre_angle: float = math.radians(25.0)
    printing: Literal["corrected", "as_printed"] = "corrected"

    def __post_init__(self) -> None:
        check_choice("printing", self.printing, ("corrected", "as_printed"))

    @property
    def fibre(self) -> float:
        """Length b of one fibre, m: ``l / cos(alpha0)``."""
        return self.nominal_length / math.cos(self.fibre_angle)

    @property
    def turns(self) -> float:
        """Turns n of one fibre: ``l tan(alpha0) / (pi d0)``; as printed, a length in m."""
        if self.printing == "as_printed":
            tangent = math.tan(self.fibre_angle)
            return (tangent * self.nominal_length) ** 2 / (math.pi * self.nominal_diameter)
        return self.nominal_length * math.tan(self.fibre_angle) / (math.pi * self.nominal_diameter)

    def squared_radius(self, fibre_length: Expression) -> Expression:
        """Return the squared radius of the middle, d^2 / 4, m^2, at a fibre length s, m."""
        reduced = (self.fibre**2 - fibre_length * fibre_length) / (2 * math.pi * self.turns)
        if self.printing == "as_printed":
            return reduced * reduced
        return reduced / (2 * math.pi * self.turns)

    def diameter(self, fibre_length: Expression) -> Expression:
        """Return the diameter d of the middle (line [6]), m, at a fibre length s, m."""
        return 2 * sqrt(self.squared_radius(fibre_length))

    def _squared_height(self, fibre_length: Expression, form: Form) -> Expression:
        excess = self.squared_radius(fibre_length) - self.nominal_diameter**2 / 4
        if form.regularised:
            return form.ramp(excess, END_WIDTH) + END_HEIGHT_FLOOR**2
        return maximum(excess, END_HEIGHT_FLOOR**2)

    def end_volume(self, fibre_length: Expression, *, form: Form = EXACT) -> Expression:
        """Return the volume of one flattened end (line [9]), m^3, at a fibre length s, m.

        ``(pi h / 6) (3 R^2 + 3 R0^2 + h^2)`` with the two radii R = d/2 and R0 = d0/2; as printed,
        with R twice.
        """
        radius2 = self.squared_radius(fibre_length)
        other2 = radius2 if self.printing == "as_printed" else self.nominal_diameter**2 / 4
        height2 = self._squared_height(fibre_length, form)
        return math.pi * sqrt(height2) / 6 * (3 * radius2 + 3 * other2 + height2)

    def cylinder_volume(self, fibre_length: Expression) -> Expression:
        """Return the volume without flattening (line [7]), m^3, at a fibre length s, m."""
        return math.pi * self.squared_radius(fibre_length) * fibre_length

    def end_flattening(self, fibre_length: Expression, *, form: Form = EXACT) -> Expression:
        """Return what the flattened ends add to the cylinder's volume, m^3, at a fibre length s, m.

        Corrected ``-(2 pi / 3) h^3``, negative; as printed, both end volumes on top. Exact and
        regularised form differ within 0.02 mm of the nominal length.

        Source:
            Lines [8] to [10] of the paper's Figure 3.
        """
        if self.printing == "as_printed":
            return 2 * self.end_volume(fibre_length, form=form)
        height2 = self._squared_height(fibre_length, form)
        return -(2 * math.pi / 3) * height2 * sqrt(height2)

    def volume(self, fibre_length: Expression, *, form: Form = EXACT) -> Expression:
        """Return the gas volume with flattened ends, without fittings and line, m^3, at s, m.

        Source:
            Lines [6] to [10] of the paper's Figure 3.
        """
        return self.cylinder_volume(fibre_length) + self.end_flattening(fibre_length, form=form)


_BRAID = BraidedCylinder()
_muscles = twins("muscle_volume", needs=("fibre_length",))


def _constant(survey: Survey) -> Iterator[Fit]:
    if any(e.about.equation.startswith("V = constant") for e in survey.model.effects):
        yield from _muscles(survey)


def _braid(at: PortView) -> Expression:
    volume = _BRAID.volume(at.signals.fibre_length, form=at.form)
    return at.value + at.p.share * (volume - at.value)


braid_volume = Law(
    "braid_volume",
    "V = V + share (V_braid(s) - V)",
    _constant,
    lambda at: (size("share", "1", 1.0, 1.5, "share of the braid's volume"),),
    _braid,
    source="lines [6] to [10] of the paper's Figure 3",
    look_alikes=("flattened_ends",),
    separated_by="fast swings with the valve shut: the pressures follow the volume",
)


# V = V - share (2 pi / 3) h^3, with h the height of a flattened end.
flattened_ends = replace(
    braid_volume,
    name="flattened_ends",
    equation="V + dV_ends(s)",
    where=_muscles,
    parameters=lambda at: (size("share", "1", 1.0, 2.0, "share of the flattening"),),
    transform=lambda at: (
        at.value + at.p.share * _BRAID.end_flattening(at.signals.fibre_length, form=at.form)
    ),
    source="lines [8] to [10] of the paper's Figure 3",
    look_alikes=("braid_volume",),
    separated_by="fast swings with the valve shut near full contraction",
)
