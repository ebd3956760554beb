"""Gravity on a joint whose plane is not level."""

from __future__ import annotations

import casadi as ca

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression

GRAVITY = 9.81
"""Acceleration of gravity, m/s^2."""


def tilt_gravity(
    port: str = "joint.torque",
    *,
    tilt: float = 0.05,
    body_mass: float = 0.987,
    body_centre: tuple[float, float] = (0.205, 0.0176),
    load_centre: tuple[float, float] = (0.367, -0.024),
    name: str = "tilt_gravity",
) -> Effect:
    """Build the weight of a body and its load in a plane that is tilted out of the level.

    ``T = T - g sin(tilt) [(m_b x_b + m_l x_l) cos theta - (m_b y_b + m_l y_l) sin theta]``

    Args:
        port: Port of a torque, with the local signals ``angle`` and ``load``.
        tilt: Angle of the plane to the level about the arm's axis at angle zero, in rad.
        body_mass: Mass of the body without load, in kg.
        body_centre: Its centre of gravity (along, above), in m.
        load_centre: Centre of the load (along, above), in m.
        name: Name of the effect.

    Returns:
        Effect of size ``tilt``.

    Raises:
        WorkbenchError: If the tilt is outside its bounds.

    Example:
        >>> tilt_gravity(tilt=0.1).parameters[0].unit
        'rad'
    """

    def transform(at: PortView) -> Expression:
        angle, load = at.signals.angle, at.signals.load
        along = body_mass * body_centre[0] + load * load_centre[0]
        above = body_mass * body_centre[1] + load * load_centre[1]
        weight = GRAVITY * (along * ca.cos(angle) - above * ca.sin(angle))
        return at.value - ca.sin(at.p.tilt) * weight

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "tilt", "rad", 0.05, "angle of the plane to the level", tilt, -0.5, 0.5, fitted=True
            ),
        ),
        about=About(
            "T = -g sin(tilt) sum(m r cos(theta))",
            "statics of a heavy arm in an inclined plane",
            look_alikes=("constant_torque", "force_gain", "linear_spring"),
            separated_by="the same holding positions with another load: only a weight scales",
        ),
    )
