"""Parameters of the rig that change while it runs: with time, or with where it is.

They are set once per sample.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from workbench.evaluation.rig import plant


class Now(NamedTuple):
    """Where the rig is at a sample.

    Args:
        pressure_1: Gauge pressure of muscle 1, in Pa.
    """

    time: float
    angle: float
    speed: float
    pressure_1: float


Law = Callable[[Now], float]


_OF_COULOMB = ("coulomb_drift", "coulomb_asymmetry", "local_friction", "dwell_friction")


def varying(p: dict[str, float]) -> dict[str, Law]:
    """Return the laws of the parameters that change, by the parameter that each sets."""
    p = dict(p)
    laws: dict[str, Law] = {"external_torque": _torque(p)}
    for name, change in p.items():
        if name.startswith("onset_") and change != 0.0:
            own = name.removeprefix("onset_")
            laws[own] = _after(p["onset"], p[own], change)
    if any(p[name] for name in _OF_COULOMB):
        laws["coulomb"] = _coulomb(p, laws.get("coulomb", lambda now: p["coulomb"]))
    if p["viscous_asymmetry"]:
        laws["viscous"] = lambda now: (
            p["viscous"] * (1.0 + p["viscous_asymmetry"] * math.copysign(1.0, now.speed))
        )
    if p["supply_drift"] or p["supply_ripple"] or p["supply_relay"]:
        ripple = 2.0 * math.pi * p["supply_ripple_frequency"]
        laws["supply_pressure"] = lambda now: (
            max(0.0, p["supply_pressure"] + p["supply_drift"] * now.time)
            + p["supply_ripple"] * math.sin(ripple * now.time)
            - p["supply_relay"] * (now.time / p["supply_relay_time"] % 1.0)
        )
    if p["force_fade"]:
        laws["force_gain"] = lambda now: (
            p["force_gain"]
            * (1.0 - p["force_fade"] * (1.0 - math.exp(-now.time / p["force_fade_time"])))
        )
    if p["pressure_drift"]:
        laws["pressure_offset_1"] = lambda now: (
            p["pressure_offset_1"] + p["pressure_drift"] * now.time
        )
    if p["leak_threshold"]:
        laws["leak_1"] = lambda now: p["leak_1"] * (now.pressure_1 > p["leak_threshold"])
    return laws


def _after(time: float, before: float, change: float) -> Law:
    return lambda now: before + change * (now.time >= time)


def _coulomb(p: dict[str, float], base: Law) -> Law:
    moved = 0.0

    def dwelt(now: Now) -> float:
        """Return the part of its last strength that a contact has, by how long it rested."""
        nonlocal moved
        if abs(now.speed) > p["dwell_speed"]:
            moved = now.time
        return 1.0 - math.exp(-(now.time - moved) / p["dwell_time"])

    def law(now: Now) -> float:
        away = (now.angle - p["local_angle"]) / p["local_width"]
        level = max(0.0, base(now) + p["coulomb_drift"] * now.time)
        level *= 1.0 + p["coulomb_asymmetry"] * math.copysign(1.0, now.speed)
        level += p["dwell_friction"] * dwelt(now)
        return level + p["local_friction"] * math.exp(-away * away)

    return law


def _torque(p: dict[str, float]) -> Law:
    def law(now: Now) -> float:
        middle = now.angle - plant.SPAN / 2.0
        low, high = p["pad_reach"] - now.angle, now.angle - (plant.SPAN - p["pad_reach"])
        return (
            p["external_torque"]
            - p["cubic_spring"] * middle**3
            + p["pad_stiffness"] * (max(0.0, low) - max(0.0, high))
            + p["hum_torque"] * math.sin(2.0 * math.pi * p["hum_frequency"] * now.time)
        )

    return law
