"""Heat of the gas in a chamber: exchange with its wall, polytropic work, constant temperature."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from workbench.model import About, Effect, PortView
from workbench.model.regularisation import Expression
from workbench.physics.gas import AIR, wall_heat
from workbench.physics.law import Fit, Law, shape, share, size
from workbench.physics.place import Survey

AREA = 0.0126
"""Wetted area of one chamber, m^2."""

_ISOTHERMAL = "Q = p dV/dt - R H"
_EXCHANGE = "Q = h S (T_wall - T)"


def _chambers(survey: Survey, *needs: str) -> Iterator[Fit]:
    found = survey.fitting("gas_heat", needs=("temperature", "wall_temperature", *needs))
    if found:
        yield "", tuple((q,) for q in found)


def _at_walls(survey: Survey) -> Iterator[Fit]:
    # Heat flow that follows from constant temperature has no more or less of it.
    if not survey.attached(_ISOTHERMAL):
        yield from _chambers(survey)


def _wall(at: PortView, area: Expression) -> Expression:
    s = at.signals
    return wall_heat(s.temperature, s.wall_temperature, coefficient=at.p.coefficient, area=area)


heat_exchange = Law(
    "heat_exchange",
    _EXCHANGE,
    _at_walls,
    lambda at: (
        size("coefficient", "W/(m2 K)", 150.0, 20.0, 1e5, "heat transfer coefficient", scale=100.0,
             source="estimate; the paper's model has 200"),
        shape("area", "m2", AREA, "wetted area of one chamber", around=None, between=(1e-5, 1.0),
              source="paper, Figure 2", fitted=False),
    ),
    lambda at: at.value + _wall(at, at.p.area),
    source="line [15] of the paper's Figure 3",
    look_alikes=("polytropic_exchange",),
    separated_by="steps of pressure: how fast the pressure relaxes after the valve shuts",
)  # fmt: skip


def _beside_exchange(survey: Survey) -> Iterator[Fit]:
    if survey.attached(_EXCHANGE):
        yield from _at_walls(survey)


# Large, it is isothermal; the negative of the plant's own, adiabatic.
extra_heat_exchange = replace(
    heat_exchange,
    name="extra_heat_exchange",
    equation="Q + h S (T_wall - T)",
    where=_beside_exchange,
    parameters=lambda at: (
        size("coefficient", "W/(m2 K)", 200.0, 50.0, 1e4, "heat transfer coefficient in excess",
             lower=-150.0),
    ),
    transform=lambda at: at.value + _wall(at, AREA),
    source="convection at the wall; beyond the range of the plant's own coefficient",
    look_alikes=("heat_exchange", "polytropic_exchange"),
)  # fmt: skip


def _worked(survey: Survey) -> Iterator[Fit]:
    if not survey.attached(_ISOTHERMAL):
        yield from _chambers(survey, "pressure", "enthalpy_flow", "volume_rate")


def _power(at: PortView) -> Expression:
    s = at.signals
    return AIR.gas_constant * s.enthalpy_flow - s.pressure * s.volume_rate


# With the exponent n = gamma - departure: 0 leaves the plant's own heat balance, gamma - 1 lets the
# pressure follow isothermal compression.
polytropic_exchange = Law(
    "polytropic_exchange",
    "V dp/dt = n (R H - p dV/dt)",
    _worked,
    lambda at: (size("departure", "1", 0.2, 0.03, 0.5, "gamma less the polytropic exponent"),),
    lambda at: at.value - at.p.departure / (AIR.heat_ratio - 1.0) * _power(at),
    far=True,
    source="polytropic change of state; R. Clausius",
    look_alikes=("extra_heat_exchange", "braid_volume"),
    separated_by="fill and vent at two speeds: n stays, heat exchange fades when fast",
)


def isothermal_gas(
    ports: tuple[str, ...] = ("chamber_1.heat", "chamber_2.heat"), *, name: str = "isothermal_gas"
) -> Effect:
    """Build gas that stays at the temperature of its wall, a common simplification.

    ``Q = p dV/dt - R H`` with the enthalpy flow H = sum(mdot T), so that
    ``V dp/dt = R H - p dV/dt`` and the temperature stays where it started.

    Args:
        ports: Ports of the heat flow into chambers, with the local signals ``pressure``,
            ``enthalpy_flow`` and ``volume_rate``.
    """
    about = About(_ISOTHERMAL, "simplification; isothermal change of state")
    return Effect(name, ports, lambda at: -_power(at), about=about)


def _isothermal(survey: Survey) -> Iterator[Fit]:
    if survey.attached(_ISOTHERMAL):
        yield from _chambers(survey)


gas_energy_balance = Law(
    "gas_energy_balance",
    "Q + share (h S (T_wall - T) - Q)",
    _isothermal,
    lambda at: (
        share("share of the exchange with the wall"),
        shape("coefficient", "W/(m2 K)", 150.0, "heat transfer coefficient", around=None,
              between=(0.0, 1000.0), scale=100.0, source=""),
    ),
    lambda at: at.value + at.p.share * (_wall(at, AREA) - at.value),
    source="line [15] of the paper's Figure 3",
    look_alikes=("chamber_leakage",),
    separated_by="steps of pressure: how fast the pressure relaxes after the valve shuts",
)  # fmt: skip
