"""A load that is heavier or lighter than the notes say."""

from __future__ import annotations

import casadi as ca

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.tilt import GRAVITY


def load_error(
    ports: tuple[str, ...] = ("joint.inertia", "joint.torque"),
    *,
    mass: float = 0.5,
    centre: tuple[float, float] = (0.367, -0.024),
    inertia_per_mass: float = 0.0015,
    gravity_share: float = 0.0,
    name: str = "load_error",
) -> Effect:
    """Build a mass that the notes do not know, at the place of the load.

    ``J = J + mass (x^2 + y^2 + i)`` and, on a port of torque,
    ``T = T - gravity_share g mass (x cos theta - y sin theta)``.

    Args:
        ports: A port of inertia and, if weight matters, one of torque with the local signal
            ``angle``; told apart by their names' endings ``.inertia`` and ``.torque``.
        mass: Mass in excess of the notes, in kg; negative if the load is lighter.
        centre: Place of the load (along, above), in m.
        inertia_per_mass: Inertia about the load's own centre over mass, in m^2.
        gravity_share: 1 in a vertical plane, 0 in a level one, the sine of a tilt, dimensionless.
        name: Name of the effect.

    Returns:
        Effect of size ``mass``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> load_error(mass=-1.0).parameters[0].value
        -1.0
    """
    along, above = centre

    def transform(at: PortView) -> Expression:
        if at.port.endswith(".inertia"):
            return at.value + at.p.mass * (along**2 + above**2 + inertia_per_mass)
        angle = at.signals.angle
        lever = along * ca.cos(angle) - above * ca.sin(angle)
        return at.value - at.p.gravity_share * GRAVITY * at.p.mass * lever

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "mass", "kg", 0.5, "mass in excess of the notes", mass, -8.0, 8.0, fitted=True
            ),
            Parameter(
                "gravity_share",
                "1",
                1.0,
                "share of gravity in the plane of motion",
                gravity_share,
                -1.0,
                1.0,
            ),
        ),
        about=About(
            "J = J + mass r^2, T = T - share g mass x cos(theta)",
            "parallel-axis theorem",
            look_alikes=("loose_load", "force_gain"),
            separated_by="weigh the load; free swings with the load taken off",
        ),
    )
