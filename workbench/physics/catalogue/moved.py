"""Ports of forces and torques that move something, with the typical sizes of the motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.model import Model, Port

COORDINATES = {"N m": "rad", "N": "m"}
"""Unit of the position that a force or torque moves."""


@dataclass(frozen=True)
class Motion:
    """A port of a force or torque with the units and sizes of its motion.

    Args:
        port: The port.
        suffix: What tells it from other such ports of the model, or nothing.
        coordinate: Name of the local signal that is the position, or nothing.
        coordinate_unit: Unit of the position: ``"rad"`` or ``"m"``.
        speed: Typical speed, in that unit per s.
        position: Typical position, in that unit.
        travel: Ends of the travel, in that unit.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> motions(servo_axis())[0].speed_unit
        'm/s'
    """

    port: Port
    suffix: str
    coordinate: str
    coordinate_unit: str
    speed: float
    position: float
    travel: tuple[float, float]

    @property
    def middle(self) -> float:
        """Middle of the travel, in the unit of the position."""
        return 0.5 * (self.travel[0] + self.travel[1])

    @property
    def speed_unit(self) -> str:
        """Unit of the speed."""
        return f"{self.coordinate_unit}/s"


def motions(model: Model) -> tuple[Motion, ...]:
    """Return the ports of forces and torques that move something, those of stops apart.

    Args:
        model: The model.

    Example:
        >>> from workbench.plants.arm import arm
        >>> [motion.port.name for motion in motions(arm())]
        ['joint.torque']
    """
    ports = [
        q
        for q in model.ports
        if q.unit in COORDINATES and "speed" in q.signals and "penetration" not in q.signals
    ]
    result = []
    for port in ports:
        unit = COORDINATES[port.unit]
        found = [name for name in ("angle", "position") if name in port.signals]
        states = {q.unit: q for q in reversed(model.states) if q.unit in (unit, f"{unit}/s")}
        place = states.get(unit)
        scale = place.scale if place else 1.0
        lower = place.lower if place and math.isfinite(place.lower) else -scale
        upper = place.upper if place and math.isfinite(place.upper) else scale
        result.append(
            Motion(
                port,
                f"_{port.group}" if len(ports) > 1 else "",
                found[0] if found else "",
                unit,
                states[f"{unit}/s"].scale if f"{unit}/s" in states else 1.0,
                scale,
                (lower, upper),
            )
        )
    return tuple(result)
