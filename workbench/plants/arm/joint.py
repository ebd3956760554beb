"""The joint as a component: arm with plates, gravity, damper, bearing friction and stops."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from workbench.model import About, Effect, Parameter, PortView, Scope, State
from workbench.model.regularisation import Expression, where
from workbench.physics.friction import coulomb_friction, viscous_friction
from workbench.plants.arm.geometry import TRAVEL, ArmGeometry
from workbench.plants.arm.inertia import MAXIMUM_LOAD, ArmBody, Plane

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


@dataclass(frozen=True)
class JointMotion:
    """Rates of the joint and the force on the load cell.

    Args:
        rates: Rates of ``angle``, in rad/s, and ``speed``, in rad/s^2, by name.
        load_cell: Force on the load cell of the lower stop, in N.
    """

    rates: Mapping[str, Expression]
    load_cell: Expression


def joint(
    m: Scope, *, forces: tuple[Expression, Expression], geometry: ArmGeometry, body: ArmBody
) -> JointMotion:
    """Write down the equations of the joint.

    ``J d2theta/dt2 = -F1 dL1/dtheta - F2 dL2/dtheta + stops``; gravity, damper and friction attach
    to the port ``joint.torque``.

    Args:
        forces: Pulling forces of muscle 1 and 2, in N.

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
    return JointMotion(
        {"angle": x.speed, "speed": (torque + lower - upper) / inertia}, lower / p.load_cell_arm
    )


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
        # A contact of some milliseconds is sampled too coarsely to be predicted to the noise.
        relative_disturbance=0.1,
    )


def gravity(plane: Plane, body: ArmBody | None = None, *, name: str = "gravity") -> Effect:
    """Build the weight of arm and plates, the paper's unless another body is given.

    ``T = T - g [m_arm (x cos theta - y sin theta) + load (x_p cos theta + y_p sin theta)]`` in the
    vertical plane, nothing in the horizontal one.
    """
    masses = body or ArmBody()

    def transform(at: PortView) -> Expression:
        return at.value - masses.gravity_torque(at.signals.angle, at.signals.load, plane=plane)

    return Effect(
        name,
        ("joint.torque",),
        transform,
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
