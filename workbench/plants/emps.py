"""EMPS, the electro-mechanical positioning system: a carriage on a ball screw, driven by a force.

A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019 Workshop on Nonlinear
System Identification Benchmarks, Eindhoven.
"""

from __future__ import annotations

from dataclasses import replace

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.regularisation import Expression
from workbench.model.trace import Equations
from workbench.physics.friction import coulomb_friction, viscous_friction
from workbench.plants.plant import Plant
from workbench.plants.servo_axis import carriage

GAIN = 35.15065188248547
"""Motor force over the controller's output, in N/V."""

POSITION_GAIN = 160.18
"""Speed asked for over position error, in 1/s."""

SPEED_GAIN = 243.45
"""Controller's output over speed error, in V s/m."""


def _equations(m: Scope) -> Equations:
    return carriage(m, m.u.force - m.p.offset, disturbance=5.0)


def loop_force(m: Scope) -> Expression:
    """Return the force, in N, of the motor that the controller of the recordings drives."""
    wanted = POSITION_GAIN * (m.u.goal - m.x.position)
    return GAIN * (SPEED_GAIN * (wanted - m.x.speed) + m.u.pulse)


def _in_loop(m: Scope) -> Equations:
    return carriage(m, loop_force(m) - m.p.offset, disturbance=5.0)


def emps() -> Model:
    """Build the EMPS axis: mass, viscous and dry friction, and an offset of the drive.

    ``mass a = force - offset - viscous speed - dry sign(speed)``. The force is the motor's gain
    times the controller's output; position is the only measurement, and the force reaches it
    through two integrations, so that a simulation drifts unless the measurements correct it.

    Returns:
        Model with the input ``force`` (N), the output ``position`` (m) and the port ``axis.force``.
    """
    return Model(
        "EMPS axis",
        _equations,
        states=(
            State("position", "m", 0.1, start_rms=1e-3),
            State("speed", "m/s", 0.1, start_rms=0.05),
        ),
        inputs=(Input("force", "N", 100.0, lower=-352.0, upper=352.0),),
        outputs=(Output("position", "m", 0.1, resolution=5e-8, noise_rms=1e-7, display_unit="mm"),),
        parameters=(
            Parameter("mass", "kg", value=90.0, lower=40.0, upper=160.0, fitted=True),
            Parameter("offset", "N", 1.0, value=0.0, lower=-20.0, upper=20.0, fitted=True),
        ),
        description="carriage on a ball screw, driven by a force",
    ).with_effect(
        viscous_friction("axis.force", coefficient=250.0, upper=1000.0),
        coulomb_friction("axis.force", level=15.0, transition_speed=1e-3, upper=100.0),
    )


def emps_in_loop() -> Model:
    """Build the EMPS axis in the loop of its controller: position and speed, both proportional.

    ``force = gain (speed_gain (position_gain (goal - position) - speed) + pulse)``, the loop that
    ran during the recordings. In it the position cannot drift, so that a simulation shows what the
    friction does to the motion.

    Returns:
        The axis with the inputs ``goal`` (m) and ``pulse`` (V, added to the controller's output).
    """
    return replace(
        emps(),
        name="EMPS axis in its loop",
        equations=_in_loop,
        inputs=(
            Input("goal", "m", 0.1, "position asked for"),
            Input("pulse", "V", 5.0, "added to the controller's output"),
        ),
    )


EMPS = Plant("emps", emps, "EMPS, a carriage on a ball screw, driven by a force")
EMPS_IN_LOOP = Plant("emps-in-loop", emps_in_loop, "EMPS in the loop of its position controller")
