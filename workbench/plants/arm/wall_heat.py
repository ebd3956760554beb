"""Heat that the gas in a muscle exchanges with its wall, with the area of the arm's muscles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.gas import wall_heat
from workbench.physics.gas_energy import ISOTHERMAL, chambers
from workbench.physics.law import Fit, Law, shape, share, size
from workbench.physics.place import Survey

AREA = 0.0126
"""Wetted area of one chamber, m^2."""

_EXCHANGE = "Q = h S (T_wall - T)"


def _at_walls(survey: Survey) -> Iterator[Fit]:
    # Heat flow that follows from constant temperature has no more or less of it.
    if not survey.attached(ISOTHERMAL):
        yield from chambers(survey)


def _wall(at: PortView, area: Expression) -> Expression:
    s = at.signals
    return wall_heat(s.temperature, s.wall_temperature, coefficient=at.p.coefficient, area=area)


heat_exchange = Law(
    "heat_exchange",
    _EXCHANGE,
    _at_walls,
    lambda at: (
        size("coefficient", "W/(m2 K)", 150.0, 1e5, "heat transfer coefficient", scale=100.0,
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
        size("coefficient", "W/(m2 K)", 200.0, 1e4, "heat transfer coefficient in excess",
             lower=-150.0),
    ),
    transform=lambda at: at.value + _wall(at, AREA),
    source="convection at the wall; beyond the range of the plant's own coefficient",
    look_alikes=("heat_exchange", "polytropic_exchange"),
)  # fmt: skip


def _isothermal(survey: Survey) -> Iterator[Fit]:
    if survey.attached(ISOTHERMAL):
        yield from chambers(survey)


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
