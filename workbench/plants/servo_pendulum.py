"""A geared servo that carries a pendulum: back-EMF, saturation of the converter, gear friction.

M. Duclusaud, G. Passault, V. Padois, O. Ly, Extended Friction Models for the Physics Simulation of
Servo Actuators, ICRA 2025; the servo is a Dynamixel XL330.
"""

from __future__ import annotations

import casadi as ca

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations
from workbench.physics.friction import (
    coulomb_friction,
    load_dependent_friction,
    stribeck_friction,
    viscous_friction,
)
from workbench.plants.plant import Option, Plant

GRAVITY = 9.81
"""Acceleration of free fall, in m/s2."""

LOAD = Option(
    "load", 0.49, "kg", "mass at the end of the pendulum", lower=0.0, upper=5.0, keyword="load_kg"
)
LENGTH = Option("length", 0.1, "m", "length of the pendulum", lower=0.01, upper=1.0)


def _equations(m: Scope) -> Equations:
    duty = m.form.clip(m.u.gain * m.p.duty_gain * (m.u.goal - m.x.angle), -1.0, 1.0, 1e-3)
    voltage = m.port(
        "motor.voltage",
        duty * m.u.supply,
        unit="V",
        scale=5.0,
        signals={"speed": m.x.speed},
        description="mean voltage that the converter puts on the motor",
        disturbance=0.1,
    )
    # A servo without torque leaves the motor open: no current, so no braking by its own EMF.
    asked = m.p.torque_constant * (voltage - m.p.back_emf * m.x.speed)
    motor = m.u.enabled * m.form.clip(asked, -m.p.torque_limit, m.p.torque_limit, 1e-2)
    weight = m.p.load * GRAVITY * m.p.length * ca.sin(m.x.angle)
    torque = m.port(
        "joint.torque",
        motor - weight,
        unit="N m",
        scale=0.5,
        signals={
            "angle": m.x.angle,
            "speed": m.x.speed,
            "motor": motor,
            "weight": weight,
            "gear_load": m.form.absolute(motor + weight, 1e-3),
        },
        description="torque on the arm, positive with the angle",
        disturbance=0.02,
    )
    inertia = m.p.load * m.p.length**2 + m.p.rotor_inertia
    measurement = m.port(
        "angle.reading", m.x.angle, unit="rad", scale=1.0, signals={"speed": m.x.speed}
    )
    return {"angle": m.x.speed, "speed": torque / inertia}, {"angle": measurement}


def servo_pendulum(load_kg: float = 0.49, *, length: float = 0.1) -> Model:
    """Build the servo with its pendulum, hanging down at angle zero.

    ``J a = limited(k (V - e w)) - m g l sin(angle) - friction``, ``V = supply clip(gain duty (goal
    - angle))``; the torque is limited by the servo's largest current. Friction:
    Coulomb, viscous, break-away that fades with speed, and a part proportional to the load of the
    gear.

    Args:
        load_kg: Mass at the end of the pendulum, in kg, 0 to 5.
        length: Length of the pendulum, in m, 0.01 to 1.

    Returns:
        Model with the inputs ``goal`` (rad), ``gain`` (setting of the position loop), ``supply``
        (V), ``enabled`` (0 or 1), the output ``angle`` (rad) and ports at voltage and torque.
    """
    LOAD.check(load_kg)
    LENGTH.check(length)
    return Model(
        "servo pendulum",
        _equations,
        states=(
            State("angle", "rad", 1.0, start_rms=0.01),
            State("speed", "rad/s", 3.0, start_rms=0.1),
        ),
        inputs=(
            Input("goal", "rad", 1.0, "angle that the servo is asked for"),
            Input("gain", "1", 400.0, "setting of the servo's position loop", nominal=400.0),
            Input("supply", "V", 7.4, "supply voltage", nominal=7.4, lower=0.0, upper=15.0),
            Input("enabled", "1", 1.0, "whether the motor is on", nominal=1.0),
        ),
        # The encoder has 4096 steps per turn.
        outputs=(Output("angle", "rad", 1.0, resolution=1.534e-3, display_unit="deg"),),
        parameters=(
            Parameter(
                "load", "kg", value=load_kg, upper=5.0, lower=0.0, source="weighed", setting=0.5
            ),
            Parameter("length", "m", value=length, lower=0.01, upper=1.0, source="measured"),
            Parameter("duty_gain", "1/rad", 0.0, "share of the supply per setting and angle error",
                      2.877e-3, 1e-3, 6e-3,
                      "manufacturer: 4096 steps per turn, setting / 256, full at 885"),
            Parameter("torque_constant", "N m/V", 0.0, "torque over voltage at standstill",
                      0.08, 0.02, 0.3, fitted=True),
            Parameter("torque_limit", "N m", 0.0, "torque at the current limit",
                      0.5, 0.1, 1.5, fitted=True),
            Parameter("back_emf", "V s/rad", 0.0, "voltage over speed without load",
                      0.5, 0.05, 2.0, fitted=True),
            Parameter("rotor_inertia", "kg m2", 1e-3,
                      "inertia of rotor, gear and arm at the joint", 1e-3, 0.0, 2e-2, fitted=True),
        ),
        description="a position servo with a hanging mass",
    ).with_effect(
        coulomb_friction("joint.torque", level=0.02, transition_speed=0.005, upper=0.3),
        viscous_friction("joint.torque", coefficient=0.005, upper=0.2),
        stribeck_friction("joint.torque", break_away=0.02, stribeck_speed=0.5,
                          transition_speed=0.005, upper=0.3, typical=0.02),
        load_dependent_friction("joint.torque", coefficient=0.05, transition_speed=0.005,
                                upper=0.9, typical=0.1, name="gear_friction"),
    )  # fmt: skip


SERVO_PENDULUM = Plant(
    "pendulum", servo_pendulum, "geared position servo with a pendulum", options=(LOAD, LENGTH)
)
