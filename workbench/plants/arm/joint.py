"""The joint of the arm: inertia and gravity of the arm with its plates, friction, stops.

The arm has 0.987 kg with its centre of gravity at (205, 17.6) mm; each plate of 1 kg sits at
(367, -24) mm, both relative to the pivot with the arm horizontal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from workbench.errors import check_range
from workbench.model import About, Effect, Parameter, Scope, State
from workbench.model.regularisation import Expression, functions_of, is_symbolic, where
from workbench.physics.friction import coulomb_friction, viscous_friction
from workbench.plants.arm.geometry import TRAVEL, ArmGeometry

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
        >>> round(float(ArmBody().gravity_torque(0.0, 8)), 1)
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

    def gravity_torque(self, angle: Expression, load: Expression) -> Expression:
        """Return the torque in N m with which gravity pulls the arm towards smaller angles.

        ``9.81 [0.987 (0.205 cos t - 0.0176 sin t) + n (0.367 cos t + 0.024 sin t)]`` in the
        vertical plane, where the angle t is the elevation.

        Args:
            angle: Arm angle, rad; any shape.
            load: Mass of the plates n, kg, 0..8; number or expression.
        """
        arm = self.arm_mass * lever(angle, self.arm_centre)
        return self.gravity * (arm + check_load(load) * lever(angle, self.plate_centre))


def lever(angle: Expression, centre: tuple[float, float]) -> Expression:
    """Return how far a centre of gravity is from the pivot along the level, in m.

    Args:
        angle: Elevation of the arm, rad; any shape.
        centre: The centre along and above the arm, m.
    """
    known = functions_of(angle)
    return centre[0] * known.cos(angle) - centre[1] * known.sin(angle)


def check_load(load: Expression) -> Expression:
    """Return the load, kg, if the arm can carry it; a symbolic load passes unchecked."""
    if is_symbolic(load):
        return load
    return check_range("load", load, 0.0, MAXIMUM_LOAD, "kg", fix="the arm carries 0 to 8 plates")


STATES = (
    State("angle", "rad", 1.0, "arm angle", math.radians(30.0), math.radians(-1.0),
          math.radians(61.0)),
    State("speed", "rad/s", 1.0, "arm speed", start_rms=0.01),
)  # fmt: skip

PARAMETERS = (
    # Name, unit, scale (0 for that of the value), meaning, value, bounds, source.
    Parameter("load", "kg", 1.0, "mass of the plates", 0.0, 0.0, MAXIMUM_LOAD,
              "chosen by the user", setting=2.0),
    Parameter("arm_inertia", "kg m2", 0.0, "inertia of the bare arm about the joint",
              0.0556, 0.8 * 0.0556, 1.2 * 0.0556, "computed from the paper's dimensions",
              fitted=True),
    Parameter("lower_stop", "rad", 1.0, "angle of the lower stop", 0.0, 0.0, TRAVEL, "paper"),
    Parameter("upper_stop", "rad", 0.0, "angle of the upper stop", TRAVEL, 0.0, TRAVEL, "paper"),
    Parameter("stop_stiffness", "N m/rad", 0.0, "stiffness of a stop", 2e4, 1e3, 1e6, "estimate",
              fixed=True),
    Parameter("stop_damping", "N m s/rad", 0.0, "damping of a stop", 60.0, 0.0, 1e3, "estimate",
              fixed=True),
    Parameter("load_cell_arm", "m", 0.0, "lever of the load cell on the lower stop",
              0.367, 0.05, 0.5, "estimate: under the plates"),
)  # fmt: skip


def joint(
    m: Scope, *, forces: tuple[Expression, Expression], geometry: ArmGeometry, body: ArmBody
) -> tuple[dict[str, Expression], Expression]:
    """Write down the equations of the joint.

    ``J d2theta/dt2 = -F1 dL1/dtheta - F2 dL2/dtheta + stops``; gravity, damper and friction attach
    to the port ``joint.torque``.

    Args:
        forces: Pulling forces of muscle 1 and 2, in N.

    Returns:
        Rates of ``angle``, in rad/s, and ``speed``, in rad/s^2, by name; and the force on the load
        cell of the lower stop, in N.

    Source:
        The paper's Figure 4 and its description of arm, plates and stops.
    """
    x, p = m.x, m.p
    lower = _stop(m, "lower_stop", p.lower_stop - x.angle, -x.speed)
    upper = _stop(m, "upper_stop", x.angle - p.upper_stop, x.speed)
    slope_1, slope_2 = geometry.moment_arms(x.angle)
    torque = m.port(
        "joint.torque",
        -forces[0] * slope_1 - forces[1] * slope_2,
        unit="N m",
        scale=10.0,
        description="torque on the arm, positive with the angle, without the stops",
        signals={
            "angle": x.angle,
            "speed": x.speed,
            "load": p.load,
            "force_1": forces[0],
            "force_2": forces[1],
        },
        disturbance=0.1,
    )
    inertia = m.port(
        "joint.inertia",
        p.arm_inertia + body.inertia(p.load) - body.inertia(0.0),
        unit="kg m2",
        scale=1.0,
        description="inertia about the joint",
        signals={"load": p.load},
    )
    rates = {"angle": x.speed, "speed": (torque + lower - upper) / inertia}
    return rates, lower / p.load_cell_arm


def _stop(m: Scope, name: str, penetration: Expression, speed: Expression) -> Expression:
    p = m.p
    push = m.form.ramp(p.stop_stiffness * penetration + p.stop_damping * speed, 1.0)
    touching = m.form.step(penetration, 1e-5)
    torque = where(penetration > 0, push, 0.0) if not m.form.regularised else touching * push
    return m.port(
        f"{name}.torque",
        torque,
        unit="N m",
        scale=10.0,
        description="torque with which the stop pushes the arm back",
        signals={"penetration": penetration, "speed": speed},
        # Stops give way by other laws than a spring and a damper side by side.
        relative_disturbance=0.02,
    )


def gravity() -> Effect:
    """Build the weight of arm and plates, for motion in the vertical plane.

    ``T = T - g [m_arm (x cos theta - y sin theta) + load (x_p cos theta + y_p sin theta)]``
    """
    masses = ArmBody()
    return Effect(
        "gravity",
        ("joint.torque",),
        lambda at: at.value - masses.gravity_torque(at.signals.angle, at.signals.load),
        about=About("T - g sum(m r)", "statics of the paper's Figure 4"),
    )


def damper_and_bearing() -> tuple[Effect, Effect]:
    """Build the damper of the joint and the Coulomb friction of its bearing."""
    return (
        viscous_friction(
            "joint.torque", coefficient=0.3, lower=0.05, upper=1.0, source="estimate", name="damper"
        ),
        coulomb_friction(
            "joint.torque",
            level=0.3,
            transition_speed=0.02,
            lower=0.05,
            upper=1.0,
            source="estimate",
            name="bearing_friction",
        ),
    )
