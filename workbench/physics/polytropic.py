"""Other thermal behaviour of the gas: polytropic work, more or less heat exchange."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.gas import AIR, wall_heat

CHAMBER_HEAT = ("chamber_1.heat", "chamber_2.heat")
"""Ports of the heat flows into both chambers."""


def polytropic_exchange(
    ports: tuple[str, ...] = CHAMBER_HEAT,
    *,
    departure: float = 0.2,
    name: str = "polytropic_exchange",
) -> Effect:
    """Build gas that is compressed polytropically instead of adiabatically.

    With n = gamma - departure, ``Q = -departure / (gamma - 1) (R H - p dV/dt)``, so that
    ``V dp/dt = n (R H - p dV/dt)`` with the enthalpy flow H = sum(mdot T): departure 0
    leaves the plant's own heat balance, gamma - 1 lets the pressure follow isothermal compression.

    Args:
        ports: Ports of the heat flow into chambers, with the local signals ``pressure``,
            ``enthalpy_flow`` and ``volume_rate``.
        departure: gamma less the polytropic exponent, dimensionless.
        name: Name of the effect.

    Returns:
        Effect of size ``departure``.

    Raises:
        WorkbenchError: If the departure is outside its bounds.

    Example:
        >>> polytropic_exchange().parameters[0].upper
        0.5
    """

    def transform(at: PortView) -> Expression:
        s = at.signals
        power = AIR.gas_constant * s.enthalpy_flow - s.pressure * s.volume_rate
        return at.value - at.p.departure / (AIR.heat_ratio - 1.0) * power

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "departure",
                "1",
                0.2,
                "gamma less the polytropic exponent",
                departure,
                0.0,
                0.5,
                fitted=True,
            ),
        ),
        about=About(
            "V dp/dt = n (R H - p dV/dt)",
            "polytropic change of state; R. Clausius",
            look_alikes=("extra_heat_exchange", "braid_volume"),
            separated_by="fill and vent at two speeds: n stays, heat exchange fades when fast",
        ),
    )


def extra_heat_exchange(
    ports: tuple[str, ...] = CHAMBER_HEAT,
    *,
    coefficient: float = 500.0,
    area: float = 0.0126,
    lower: float = -150.0,
    upper: float = 1e4,
    name: str = "extra_heat_exchange",
) -> Effect:
    """Build heat exchange beyond what the plant has: large is isothermal, its negative adiabatic.

    ``Q = Q + coefficient area (T_wall - T)``

    Args:
        ports: Ports of the heat flow into chambers, with the local signals ``temperature`` and
            ``wall_temperature``.
        coefficient: Heat transfer coefficient in excess of the plant's, in W/(m2 K).
        area: Wetted area of one chamber, in m^2.
        lower: Smallest plausible coefficient, in W/(m2 K): minus the plant's own.
        upper: Largest plausible coefficient, in W/(m2 K).
        name: Name of the effect.

    Returns:
        Effect of size ``coefficient``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> extra_heat_exchange(coefficient=-150.0).parameters[0].value
        -150.0
    """

    def transform(at: PortView) -> Expression:
        return at.value + wall_heat(
            at.signals.temperature,
            at.signals.wall_temperature,
            coefficient=at.p.coefficient,
            area=area,
        )

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "coefficient",
                "W/(m2 K)",
                200.0,
                "heat transfer coefficient in excess",
                coefficient,
                lower,
                upper,
                fitted=True,
            ),
        ),
        about=About(
            "Q + h S (T_wall - T)",
            "convection at the wall; beyond the range of the plant's own coefficient",
            look_alikes=("heat_exchange", "polytropic_exchange"),
            separated_by="steps of pressure: how fast the pressure relaxes after the valve shuts",
        ),
    )
