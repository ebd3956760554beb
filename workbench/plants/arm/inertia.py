"""Inertia and gravity of the arm with its plates.

The arm has 0.987 kg with its centre of gravity at (205, 17.6) mm; each plate of 1 kg sits at
(367, -24) mm, both relative to the pivot with the arm horizontal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from workbench.errors import check_choice, check_range
from workbench.model.regularisation import Expression, is_symbolic

Plane = Literal["horizontal", "vertical"]
"""Plane in which the arm moves."""

MAXIMUM_LOAD = 8.0
"""Largest load the arm carries, kg."""


@dataclass(frozen=True)
class ArmBody:
    """Give inertia and gravity torque of the arm for a load at its tip.

    Args:
        arm_inertia: Moment of inertia of the bare arm about the pivot, kg m^2.
        arm_mass: Mass of the bare arm, kg.
        arm_centre: Centre of gravity of the bare arm (along, above), m.
        plate_centre: Centre of the plates (along, above), m.
        plate_inertia: Moment of inertia of a plate about its own centre per mass, m^2.
        gravity: Acceleration of gravity, m/s^2.

    Source:
        Dimensions and masses stated in the paper; the inertia of the bare arm and of a plate about
        its own centre are computed from a rectangular body.

    Example:
        >>> [round(ArmBody().inertia(load), 3) for load in (0, 3, 8)]
        [0.056, 0.466, 1.15]
        >>> round(float(ArmBody().gravity_torque(0.0, 8, plane="vertical")), 1)
        30.8
    """

    arm_inertia: Expression = 0.0556
    arm_mass: float = 0.987
    arm_centre: tuple[float, float] = (0.205, 0.0176)
    plate_centre: tuple[float, float] = (0.367, -0.024)
    plate_inertia: float = 0.0015
    gravity: float = 9.81

    def inertia(self, load: Expression) -> Expression:
        """Return the inertia about the pivot, ``0.0556 + n (0.367^2 + 0.024^2 + 0.0015)``, kg m^2.

        It is the parallel-axis theorem with the paper's dimensions; the load n is 0 to 8 kg.
        """
        along, above = self.plate_centre
        return self.arm_inertia + check_load(load) * (along**2 + above**2 + self.plate_inertia)

    def gravity_torque(
        self, angle: Expression, load: Expression, *, plane: Plane = "vertical"
    ) -> Expression:
        """Return the torque in N m with which gravity pulls the arm towards smaller angles.

        ``9.81 [0.987 (0.205 cos t - 0.0176 sin t) + n (0.367 cos t + 0.024 sin t)]`` in the
        vertical plane, where the angle t is the elevation; zero in the horizontal plane.

        Args:
            angle: Arm angle, rad; any shape.
            load: Mass of the plates n, kg, 0..8; number or expression.

        Raises:
            WorkbenchError: If the plane is unknown or the load is a number outside 0..8 kg.
        """
        check_choice("plane", plane, ("horizontal", "vertical"))
        load = check_load(load)
        if plane == "horizontal":
            return 0.0 * angle
        cosine = ca.cos(angle) if is_symbolic(angle) else np.cos(angle)
        sine = ca.sin(angle) if is_symbolic(angle) else np.sin(angle)
        arm = self.arm_mass * (self.arm_centre[0] * cosine - self.arm_centre[1] * sine)
        plates = load * (self.plate_centre[0] * cosine - self.plate_centre[1] * sine)
        return self.gravity * (arm + plates)


def check_load(load: Expression) -> Expression:
    """Return the load, kg, if the arm can carry it; a symbolic load passes unchecked."""
    if is_symbolic(load):
        return load
    return check_range("load", load, 0.0, MAXIMUM_LOAD, "kg", fix="the arm carries 0 to 8 plates")
