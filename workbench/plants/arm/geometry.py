"""Geometry of the antagonistic arm: muscle lengths, moment arms and contractions.

Each muscle runs from a fixed anchor to a lever of 32 mm that turns with the arm. The anchors lie
44.4 mm to either side of the pivot's axis and 416 mm away; the muscles cross:

    L(theta)^2 = (44.4 + 32 cos theta)^2 + (416 - 32 sin theta)^2    (mm^2)

Muscle 1 shortens as the angle grows, L1 = L(theta); muscle 2 is its mirror image,
L2 = L(60 deg - theta).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from workbench.errors import check_choice
from workbench.model.regularisation import Expression, functions_of, sqrt

TRAVEL = math.radians(60.0)
"""Angle between the two stops, rad."""


@dataclass(frozen=True)
class ArmGeometry:
    """Give the lengths of both muscles from the arm's angle.

    Args:
        lever: Radius of the lever, m.
        anchor_offset: Distance of an anchor from the pivot's axis, m.
        anchor_distance: Distance of the anchors along the axis, m.
        fittings: Length between the anchors that is not fibre, m.
        nominal_length: Fibre length without pressure, m.
        printing: ``corrected`` or ``as_printed``. As printed, the constant holds r instead of r^2
            (175059 mm^2) and the angle beta = 120 deg + alpha of the sine does not belong to the
            cosine's alpha, so 423 mm is never reached. The printed length grows with alpha;
            muscle 1, which has to shorten with the angle, is therefore taken at 60 deg - theta.

    Source:
        The paper's Figure 4 and its equation for L, corrected from its own dimensions.

    Example:
        >>> g = ArmGeometry()
        >>> [round(1e3 * float(length), 2) for length in g.lengths(0.0)]
        [422.96, 392.96]
        >>> round(-1e3 * float(g.moment_arms(0.0)[0]), 1)
        31.5
    """

    lever: float = 0.032
    anchor_offset: float = 0.0444
    anchor_distance: float = 0.416
    fittings: float = 0.223
    nominal_length: float = 0.2
    printing: Literal["corrected", "as_printed"] = "corrected"

    def __post_init__(self) -> None:
        check_choice("printing", self.printing, ("corrected", "as_printed"))

    @property
    def _constants(self) -> tuple[float, float, float]:
        """Constant, cosine and sine coefficient of L^2 over a muscle's own angle, m^2."""
        squares = self.anchor_distance**2 + self.anchor_offset**2
        cosine, sine = 2 * self.anchor_offset * self.lever, 2 * self.anchor_distance * self.lever
        if self.printing == "corrected":
            return squares + self.lever**2, cosine, -sine
        # 32 mm added to mm^2, as the printed 175059 has it; sin(a + 120 deg), taken apart
        turned = math.radians(120.0)
        shifted = cosine - sine * math.sin(turned), -sine * math.cos(turned)
        return squares + self.lever * 1e-3, *shifted

    def _by_joint(self, angle: Expression) -> tuple[tuple[Expression, Expression], ...]:
        """Return length, m, and its slope over the angle, m/rad, of muscle 1 and of muscle 2.

        Both are waves over the angle itself, so that a model computes one cosine and one sine.
        """
        constant, cosine, sine = self._constants
        known, turned, found = functions_of(angle), (math.cos(TRAVEL), math.sin(TRAVEL)), []
        cos, sin = known.cos(angle), known.sin(angle)
        mirrored = turned[0] * cosine + turned[1] * sine, turned[1] * cosine - turned[0] * sine
        for a, b in ((cosine, sine), mirrored):
            length = sqrt(constant + a * cos + b * sin)
            found.append((length, (b * cos - a * sin) / (2 * length)))
        return tuple(reversed(found) if self.printing == "as_printed" else found)

    def lengths(self, angle: Expression) -> tuple[Expression, Expression]:
        """Return the lengths L1 and L2 of both muscles between anchors, m, at an angle, rad.

        ``L^2 = K + A cos a - B sin b``, b = 180 deg - a, with the angle a of the muscle's own
        lever: theta for muscle 1, 60 deg - theta for muscle 2. Source: the paper's equation for L.
        """
        (one, _), (two, _) = self._by_joint(angle)
        return one, two

    def moment_arms(self, angle: Expression) -> tuple[Expression, Expression]:
        """Return dL1/dtheta, negative, and dL2/dtheta, positive, m/rad, at an angle theta, rad.

        The joint torque of the muscles is ``-F1 dL1/dtheta - F2 dL2/dtheta``.
        """
        (_, one), (_, two) = self._by_joint(angle)
        return one, two

    def fibre_lengths(self, angle: Expression) -> tuple[Expression, Expression]:
        """Return the fibre lengths s of muscle 1 and 2, m, at an angle, rad."""
        one, two = self.lengths(angle)
        return one - self.fittings, two - self.fittings

    def contractions(self, angle: Expression) -> tuple[Expression, Expression]:
        """Return the contractions ``q = 200 mm - s`` of muscle 1 and 2, m, at an angle, rad.

        Source:
            The paper's nominal lengths: 423 mm between the anchors, 200 mm of fibre.
        """
        one, two = self.fibre_lengths(angle)
        return self.nominal_length - one, self.nominal_length - two
