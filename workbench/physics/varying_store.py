"""Stores whose capacity changes with what they hold: coils, capacitors, heat capacities, masses.

At the port that carries the whole rate, a capacity that falls to C / r is a signal of r times the
size. Unlike ``1 / (1 + z)`` the factor is positive for every z.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from workbench.model import PortView
from workbench.model.regularisation import Expression, maximum
from workbench.physics.law import Law, Own, each, size
from workbench.physics.place import Local, Place, per


def _over(z: Expression) -> Expression:
    """Return 1 / (1 + z) for positive z and 1 - z for negative: one line through z = 0."""
    return 1.0 / (1.0 + maximum(z, 0.0)) + maximum(-z, 0.0)


def _growth(of: Callable[[Place], Local], *, signed: bool) -> Callable[[Place], tuple[Own, ...]]:
    def parameters(at: Place) -> tuple[Own, ...]:
        usual = 0.2 / of(at).scale ** 2
        return (
            size("growth", per("1", of(at).unit, 2), usual, 50.0 * usual,
                 "relative change over the square", signed=signed),
        )  # fmt: skip

    return parameters


def _less(at: PortView) -> Expression:
    return at.value * (1.0 + at.p.growth * at.signals.speed**2)


saturating_inductance = Law(
    "saturating_inductance",
    "L = L_0 / (1 + growth i^2)",
    each("circuit", needs=("speed",), only=lambda at: at.whole),
    _growth(lambda at: at.speed, signed=False),
    _less,
    source="O. Froelich 1881, magnetisation of iron",
    look_alikes=("viscous_friction", "cubic_drag", "varying_capacitance"),
    separated_by="steps of the voltage at a small and at a large current: the rise is steeper",
)


def _stored(at: PortView) -> Expression:
    return at.value * _over(at.p.growth * at.signals.level**2)


varying_capacitance = replace(
    saturating_inductance,
    name="varying_capacitance",
    equation="C = C_0 (1 + growth u^2)",
    where=each("current", needs=("level",), only=lambda at: at.whole),
    parameters=_growth(lambda at: at.level, signed=True),
    transform=_stored,
    source="ceramic of high permittivity, junction of a diode",
    look_alikes=("saturating_inductance", "linear_outflow"),
    separated_by="the same current into the capacitor at a small and at a large voltage",
)
