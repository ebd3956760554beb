"""Energy of the gas in a chamber: polytropic work, constant temperature."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import About, Effect, PortView
from workbench.model.regularisation import Expression
from workbench.physics.gas import AIR
from workbench.physics.law import Fit, Law, size
from workbench.physics.place import Survey

ISOTHERMAL = "Q = p dV/dt - R H"
"""Equation of gas that stays at the temperature of its wall."""


def chambers(survey: Survey, *needs: str) -> Iterator[Fit]:
    """Yield all chambers together, where some signals can be had beside both temperatures."""
    found = survey.fitting("gas_heat", needs=("temperature", "wall_temperature", *needs))
    if found:
        yield "", tuple((q,) for q in found)


def _worked(survey: Survey) -> Iterator[Fit]:
    if not survey.attached(ISOTHERMAL):
        yield from chambers(survey, "pressure", "enthalpy_flow", "volume_rate")


def _power(at: PortView) -> Expression:
    s = at.signals
    return AIR.gas_constant * s.enthalpy_flow - s.pressure * s.volume_rate


# With the exponent n = gamma - departure: 0 leaves the plant's own heat balance, gamma - 1 lets the
# pressure follow isothermal compression.
polytropic_exchange = Law(
    "polytropic_exchange",
    "V dp/dt = n (R H - p dV/dt)",
    _worked,
    lambda at: (size("departure", "1", 0.2, 0.5, "gamma less the polytropic exponent"),),
    lambda at: at.value - at.p.departure / (AIR.heat_ratio - 1.0) * _power(at),
    far=True,
    source="polytropic change of state; R. Clausius",
    look_alikes=("extra_heat_exchange", "braid_volume"),
    separated_by="fill and vent at two speeds: n stays, heat exchange fades when fast",
)


def isothermal_gas(ports: tuple[str, ...]) -> Effect:
    """Build gas that stays at the temperature of its wall, a common simplification.

    ``Q = p dV/dt - R H`` with the enthalpy flow H = sum(mdot T), so that
    ``V dp/dt = R H - p dV/dt`` and the temperature stays where it started.

    Args:
        ports: Ports of the heat flow into chambers, with the local signals ``pressure``,
            ``enthalpy_flow`` and ``volume_rate``.
    """
    about = About(ISOTHERMAL, "simplification; isothermal change of state")
    return Effect("isothermal_gas", ports, lambda at: -_power(at), about=about)
