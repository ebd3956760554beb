"""Entries for forces and torques that move something: friction, hysteresis, springs, ripple."""

from __future__ import annotations

import math
from collections.abc import Iterator

from workbench.model import Model
from workbench.physics.catalogue import friction
from workbench.physics.catalogue.moved import Motion, motions
from workbench.physics.delay import command_delay
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.load_error import load_error
from workbench.physics.loose_load import loose_load
from workbench.physics.offset_gain import offset
from workbench.physics.position_torque import local_catch, local_friction, ripple
from workbench.physics.saturation import saturation
from workbench.physics.stiffness import cubic_stiffness, linear_spring
from workbench.physics.stop_compliance import stop_compliance
from workbench.physics.tilt import tilt_gravity

_TEETH = (6.0, 9.0, 12.0, 15.0, 18.0, 21.0, 24.0, 27.0, 30.0, 36.0, 42.0, 50.0, 60.0)
_PITCHES = (0.005, 0.01, 0.02)
_PLACES = 6


def entries(model: Model) -> Iterator[Hypothesis]:
    """Yield what forces and torques may lack: friction, springs, ripple, loads, stops.

    Args:
        model: The model.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> [entry.name for entry in entries(servo_axis())][:3]
        ['coulomb_friction', 'viscous_friction', 'stribeck_friction']
    """
    for motion in motions(model):
        yield from friction.entries(motion)
        yield from _forces(motion)
        if motion.coordinate:
            yield from _springs(motion)
            yield from _places(motion)
        # A force that comes from a drive rather than from muscles has a drive's faults too.
        if not any(q.name.startswith("valve.") for q in model.ports):
            yield from _drive(motion)
    yield from _loads(model)
    stops = tuple(q.name for q in model.ports if "penetration" in q.signals)
    if stops:
        yield Hypothesis(stop_compliance(stops, stiffness=0.0), "stiffness", 50.0, 5.0)


def _forces(m: Motion) -> Iterator[Hypothesis]:
    kind = "constant_torque" if m.port.unit == "N m" else "constant_force"
    yield Hypothesis(
        offset(
            (m.port.name,),
            amount=0.0,
            unit=m.port.unit,
            upper=0.5 * m.port.scale,
            typical=0.05 * m.port.scale,
            look_alikes=("tilt_gravity", "force_gain", "linear_spring", "valve_offset"),
            separated_by="hold several positions at two mean pressures and with two loads",
            name=f"{kind}{m.suffix}",
        ),
        "amount",
        0.05 * m.port.scale,
        0.005 * m.port.scale,
        law=kind,
    )
    if {"angle", "load"} <= set(m.port.signals):
        yield Hypothesis(
            tilt_gravity(m.port.name, tilt=0.0, name=f"tilt_gravity{m.suffix}"),
            "tilt",
            0.05,
            0.005,
            law="tilt_gravity",
        )


def _drive(m: Motion) -> Iterator[Hypothesis]:
    scale = m.port.scale
    yield Hypothesis(
        command_delay(
            m.port.name,
            time=0.0,
            unit=m.port.unit,
            scale=scale,
            look_alikes=("clock_shift", "sensor_delay"),
            separated_by="steps of the command beside a force sensor",
            name=f"drive_delay{m.suffix}",
        ),
        "time",
        0.005,
        0.0005,
        law="drive_delay",
        far=True,
    )
    yield Hypothesis(
        saturation(
            (m.port.name,),
            share=0.0,
            limit=scale,
            unit=m.port.unit,
            scale=scale,
            look_alikes=("quadratic_drag",),
            name=f"drive_saturation{m.suffix}",
        ),
        "share",
        1.0,
        0.5,
        law="drive_saturation",
        shapes=tuple({"limit": share * scale} for share in (1.0, 0.5, 2.0)),
    )


def _springs(m: Motion) -> Iterator[Hypothesis]:
    stiffness = 0.1 * m.port.scale / m.position
    yield Hypothesis(
        linear_spring(
            m.port.name,
            stiffness=0.0,
            rest=m.middle,
            coordinate=m.coordinate,
            unit=m.port.unit,
            coordinate_unit=m.coordinate_unit,
            upper=20 * stiffness,
            typical=stiffness,
            name=f"linear_spring{m.suffix}",
        ),
        "stiffness",
        stiffness,
        0.1 * stiffness,
        law="linear_spring",
    )
    cubic = 0.5 * m.port.scale / m.position**3
    yield Hypothesis(
        cubic_stiffness(
            m.port.name,
            stiffness=0.0,
            rest=m.middle,
            coordinate=m.coordinate,
            unit=m.port.unit,
            coordinate_unit=m.coordinate_unit,
            upper=100 * cubic,
            typical=cubic,
            name=f"cubic_stiffness{m.suffix}",
        ),
        "stiffness",
        cubic,
        0.1 * cubic,
        law="cubic_stiffness",
    )


def _places(m: Motion) -> Iterator[Hypothesis]:
    rotary = m.coordinate_unit == "rad"
    turns = _TEETH if rotary else tuple(2 * math.pi / pitch for pitch in _PITCHES)
    grid = tuple(
        {"frequency": frequency, "phase": phase} for frequency in turns for phase in (0.0, 1.5708)
    )
    size, least, most = 0.03 * m.port.scale, 0.005 * m.port.scale, 0.5 * m.port.scale
    yield Hypothesis(
        ripple(
            m.port.name,
            amplitude=0.0,
            frequency=turns[len(turns) // 2],
            coordinate=m.coordinate,
            unit=m.port.unit,
            coordinate_unit=m.coordinate_unit,
            upper=most,
            typical=size,
            name=f"ripple{m.suffix}",
        ),
        "amplitude",
        size,
        least,
        law="ripple",
        shapes=grid,
    )
    lower, upper = m.travel
    width = (upper - lower) / (2 * _PLACES)
    centres = tuple({"centre": lower + width * (2 * i + 1)} for i in range(_PLACES))
    reach = max(abs(lower), abs(upper))
    yield Hypothesis(
        local_catch(
            m.port.name,
            height=0.0,
            centre=m.middle,
            width=width,
            coordinate=m.coordinate,
            unit=m.port.unit,
            coordinate_unit=m.coordinate_unit,
            upper=most,
            typical=2 * size,
            reach=reach,
            name=f"local_catch{m.suffix}",
        ),
        "height",
        2 * size,
        2 * least,
        law="local_catch",
        shapes=centres,
    )
    yield Hypothesis(
        local_friction(
            m.port.name,
            level=0.0,
            centre=m.middle,
            width=width,
            transition_speed=0.02 * m.speed,
            coordinate=m.coordinate,
            unit=m.port.unit,
            coordinate_unit=m.coordinate_unit,
            upper=most,
            typical=2 * size,
            reach=reach,
            name=f"local_friction{m.suffix}",
        ),
        "level",
        2 * size,
        2 * least,
        law="local_friction",
        shapes=centres,
    )


def _loads(model: Model) -> Iterator[Hypothesis]:
    ports = {q.name: q for q in model.ports}
    inertia = ports.get("joint.inertia")
    torque = ports.get("joint.torque")
    if inertia is None or torque is None or "load" not in inertia.signals:
        return
    vertical = any(effect.name == "gravity" for effect in model.effects)
    where = (inertia.name, torque.name) if vertical else (inertia.name,)
    yield Hypothesis(
        load_error(where, mass=0.0, gravity_share=1.0 if vertical else 0.0), "mass", 0.5, 0.05
    )
    if {"angle", "speed", "load"} <= set(torque.signals):
        yield Hypothesis(
            loose_load((inertia.name, torque.name), share=0.0),
            "share",
            1.0,
            0.1,
            shapes=tuple({"frequency": f} for f in (40.0, 20.0, 10.0, 100.0)),
            whole=True,
            far=True,
        )
