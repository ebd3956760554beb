"""Gas at constant temperature, and the energy balance that such a gas leaves out."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.gas import AIR, wall_heat

CHAMBER_HEAT = ("chamber_1.heat", "chamber_2.heat")
"""Ports of the heat flows into both chambers."""


def _isothermal_heat(at: PortView) -> Expression:
    s = at.signals
    return s.pressure * s.volume_rate - AIR.gas_constant * s.enthalpy_flow


def isothermal_gas(
    ports: tuple[str, ...] = CHAMBER_HEAT, *, name: str = "isothermal_gas"
) -> Effect:
    """Build gas that stays at the temperature of its wall, a common simplification.

    ``Q = p dV/dt - R H`` with the enthalpy flow H = sum(mdot T), so that
    ``V dp/dt = R H - p dV/dt`` and the temperature stays where it started.

    Args:
        ports: Ports of the heat flow into chambers, with the local signals ``pressure``,
            ``enthalpy_flow`` and ``volume_rate``.
        name: Name of the effect.

    Returns:
        Effect replacing the heat flow.

    Example:
        >>> isothermal_gas().ports
        ('chamber_1.heat', 'chamber_2.heat')
    """
    return Effect(
        name,
        ports,
        _isothermal_heat,
        about=About("Q = p dV/dt - R H", "simplification; isothermal change of state"),
    )


def gas_energy_balance(
    ports: tuple[str, ...] = CHAMBER_HEAT,
    *,
    share: float = 1.0,
    coefficient: float = 150.0,
    area: float = 0.0126,
    name: str = "gas_energy_balance",
) -> Effect:
    """Build gas that warms and cools, in place of gas at constant temperature.

    ``Q = Q + share [coefficient area (T_wall - T) - Q]``: what a plant with isothermal gas leaves
    out.

    Args:
        ports: Ports of the heat flow into chambers, with the local signals ``temperature`` and
            ``wall_temperature``.
        share: Share of the exchange with the wall, a fraction; 1 replaces the plant's heat flow.
        coefficient: Heat transfer coefficient, in W/(m2 K).
        area: Wetted area of one chamber, in m^2.
        name: Name of the effect.

    Returns:
        Effect of size ``share``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> gas_energy_balance().parameters[1].value
        150.0
    """

    def transform(at: PortView) -> Expression:
        wall = wall_heat(
            at.signals.temperature,
            at.signals.wall_temperature,
            coefficient=at.p.coefficient,
            area=area,
        )
        return at.value + at.p.share * (wall - at.value)

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("share", "1", 1.0, "share of the exchange with the wall", share, 0.0, 1.0),
            Parameter(
                "coefficient",
                "W/(m2 K)",
                100.0,
                "heat transfer coefficient",
                coefficient,
                0.0,
                1000.0,
                fitted=True,
            ),
        ),
        about=About(
            "Q + share (h S (T_wall - T) - Q)",
            "line [15] of the paper's Figure 3",
            look_alikes=("chamber_leakage",),
            separated_by="steps of pressure: how fast the pressure relaxes after the valve shuts",
        ),
    )
