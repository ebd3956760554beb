"""Ideal gas in an open chamber: rates of pressure and temperature, wall heat, entering enthalpy.

Chambers have the states absolute pressure p and temperature T; the mass follows from
``p V = m R T``. Flows are positive into the chamber. Any number of flows enters through two sums:
the net mass flow and the enthalpy flow ``sum_i mdot_i T_i``, each with its own temperature.
"""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import About, Effect, PortView
from workbench.model.regularisation import EXACT, Expression, Form
from workbench.physics.law import Fit, Law, Where, shape, share, size
from workbench.physics.survey import Survey

FLOW_WIDTH = 1e-6
"""Half-width over which the regularised form changes the temperature of a reversing flow, kg/s."""


GAS_CONSTANT = 287.05
"""R of dry air, J/(kg K)."""

HEAT_RATIO = 1.4
"""gamma = c_p / c_v of dry air, dimensionless."""


def chamber_rates(
    pressure: Expression,
    temperature: Expression,
    volume: Expression,
    volume_rate: Expression,
    mass_flow: Expression,
    enthalpy_flow: Expression,
    heat: Expression = 0.0,
    *,
    printed_work_sign: bool = False,
) -> tuple[Expression, Expression]:
    """Return the rates of pressure, Pa/s, and temperature, K/s, of an open chamber.

    ``m dT/dt = gamma sum(mdot_i T_i) - T sum(mdot_i) - p dV/dt / c_v + Q / c_v`` and
    ``p V = m R T``, which together give
    ``V dp/dt = gamma R sum(mdot_i T_i) - gamma p dV/dt + (gamma - 1) Q``.

    With the sign printed in line [15] (``+ p dV/dt / c_v``) the work of the gas enters as energy:
    a closed chamber without heat then follows p V^0.6 instead of p V^1.4.

    Args:
        pressure: Absolute pressure p, Pa; any shape, as all others.
        temperature: Temperature T, K.
        volume: Volume V, m^3.
        volume_rate: dV/dt, m^3/s.
        mass_flow: Net mass flow into the chamber, kg/s.
        enthalpy_flow: Sum of each inward mass flow times its temperature, kg K/s.
        heat: Heat flow Q into the gas, W.

    Source:
        Lines [13] to [15] of the paper's Figure 3, equations (5) and (6), sign of the work
        corrected by the first law.

    Example:
        >>> dp, dT = chamber_rates(2e5, 300.0, 1e-4, 1e-5, 0.0, 0.0)
        >>> round(dp), round(dT, 2)
        (-28000, -12.0)
    """
    work = pressure * volume_rate
    sign = -1.0 if printed_work_sign else 1.0
    inner = HEAT_RATIO * GAS_CONSTANT * enthalpy_flow + (HEAT_RATIO - 1) * (heat - sign * work)
    pressure_rate = (inner - work) / volume
    # m dT/dt = (inner / R) - T mdot, written with 1/m = R T / (p V)
    temperature_rate = (
        temperature / (pressure * volume) * (inner - GAS_CONSTANT * temperature * mass_flow)
    )
    return pressure_rate, temperature_rate


def port_enthalpy_flow(
    mass_flow: Expression,
    outside_temperature: Expression,
    chamber_temperature: Expression,
    *,
    form: Form = EXACT,
) -> Expression:
    """Return the enthalpy flow through a port over c_p, in kg K/s: mass flow times temperature.

    The gas carries the temperature of the side it comes from: outside while it enters
    (mass flow > 0), the chamber's while it leaves. The product is continuous; its slope has a kink
    at zero flow, which the regularised form rounds within 1e-6 kg/s.

    Args:
        mass_flow: Mass flow into the chamber, kg/s; any shape.
        outside_temperature: Temperature of the entering gas, K.
        chamber_temperature: Temperature of the leaving gas, K.

    Source:
        Line [11] of the paper's Figure 3.

    Example:
        >>> float(port_enthalpy_flow(0.01, 290.0, 320.0)), float(
        ...     port_enthalpy_flow(-0.01, 290.0, 320.0)
        ... )
        (2.9, -3.2)
    """
    inward = form.step(mass_flow, FLOW_WIDTH)
    return mass_flow * (chamber_temperature + inward * (outside_temperature - chamber_temperature))


def wall_heat(
    temperature: Expression,
    wall_temperature: Expression,
    *,
    coefficient: Expression,
    area: Expression,
) -> Expression:
    """Return the heat flow from the wall into the gas, ``Q = h S (T_wall - T)``, in W.

    Args:
        temperature: Gas temperature T, K; any shape.
        wall_temperature: Wall temperature, K.
        coefficient: Heat transfer coefficient h, W/(m^2 K).
        area: Wetted area S, m^2.

    Source:
        Line [15] of the paper's Figure 3.
    """
    return coefficient * area * (wall_temperature - temperature)


ISOTHERMAL = "Q = p dV/dt - R H"
"""Equation of gas that stays at the temperature of its wall."""


def chambers(*needs: str, isothermal: bool = False) -> Where:
    """Let a law act at all chambers together: of isothermal gas, or of any other.

    Args:
        needs: Signals that must be had there beside both temperatures.
    """

    def where(survey: Survey) -> Iterator[Fit]:
        found = survey.fitting("gas_heat", needs=("temperature", "wall_temperature", *needs))
        if found and survey.attached(ISOTHERMAL) == isothermal:
            yield "", tuple((q,) for q in found)

    return where


def _power(at: PortView) -> Expression:
    s = at.signals
    return GAS_CONSTANT * s.enthalpy_flow - s.pressure * s.volume_rate


# With the exponent n = gamma - departure: 0 leaves the plant's own heat balance, gamma - 1 lets the
# pressure follow isothermal compression.
polytropic_exchange = Law(
    "polytropic_exchange",
    "V dp/dt = n (R H - p dV/dt)",
    chambers("pressure", "enthalpy_flow", "volume_rate"),
    lambda at: (size("departure", "1", 0.2, 0.5, "gamma less the polytropic exponent"),),
    lambda at: at.value - at.p.departure / (HEAT_RATIO - 1.0) * _power(at),
    far=True,
    source="polytropic change of state; R. Clausius",
    look_alikes=("extra_heat_exchange", "braid_volume"),
    separated_by="fill and vent at two speeds: n stays, heat exchange fades when fast",
)


def _polytropic(at: PortView) -> Expression:
    s, gamma, n = at.signals, HEAT_RATIO, at.p.exponent
    work, mass = s.pressure * s.volume_rate, s.temperature * s.mass_flow
    of_mass = n * (GAS_CONSTANT * mass - work)
    heat = (of_mass - gamma * (GAS_CONSTANT * s.enthalpy_flow - work)) / (gamma - 1.0)
    return at.value + at.p.share * (heat - at.value)


# Between isothermal (n = 1) and adiabatic change (n = gamma) of what a chamber holds, whose heat
# balance it takes the place of.
polytropic_gas = Law(
    "polytropic_gas",
    "V dp/dt = n (R T sum(mdot) - p dV/dt)",
    chambers("pressure", "enthalpy_flow", "mass_flow", "volume_rate"),
    lambda at: (
        share("share of the law; 0 is its absence"),
        shape("exponent", "1", 1.2, "polytropic exponent", between=(0.9, 1.5)),
    ),
    _polytropic,
    shapes=lambda at: tuple({"exponent": n} for n in (1.2, 1.05, 1.35)),
    source="polytropic change of state, p (V/m)^n = const; R. Clausius",
    look_alikes=("polytropic_exchange", "extra_heat_exchange", "braid_volume"),
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
