"""Leakage: gas that escapes past closed edges or out of a chamber."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression
from workbench.physics.flow import orifice_flow

VALVE_EDGES = ("valve.supply_1", "valve.exhaust_1", "valve.supply_2", "valve.exhaust_2")
"""Ports of the four metering edges of a 5/3 valve."""


def centre_leakage(
    ports: tuple[str, ...] = VALVE_EDGES, *, fraction: float = 0.004, name: str = "centre_leakage"
) -> Effect:
    """Build the leakage of a valve's metering edges, the same at every spool position.

    ``opening = opening + fraction``

    Args:
        ports: Ports of edge openings, as fractions of full conductance.
        fraction: Leakage of one edge, as a fraction of full conductance, dimensionless.
        name: Name of the effect.

    Returns:
        Effect adding the fraction to each edge.

    Raises:
        WorkbenchError: If the fraction is outside its bounds.

    Example:
        >>> len(centre_leakage().ports)
        4
    """

    def transform(at: PortView) -> Expression:
        return at.value + at.p.fraction

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "fraction",
                "1",
                0.004,
                value=fraction,
                lower=0.0,
                upper=0.014,
                source="estimate; manufacturer states at most 25 l/min in all",
                fitted=True,
                description="leakage of one edge, of full conductance",
            ),
        ),
        about=About(
            "opening + fraction",
            "5/3 servovalve with soft overlap",
            look_alikes=("edge_leakage", "dead_band"),
            separated_by="hold with the valve shut: how fast the mean pressure settles",
        ),
    )


def chamber_leakage(
    port: str = "chamber_1.flow", *, conductance: float = 5e-11, name: str = "chamber_leakage"
) -> Effect:
    """Build a leak of one chamber to ambient.

    ``flow = flow - orifice_flow(p, p_ambient; conductance)`` with critical ratio 0.3.

    Args:
        port: Port of the mass flow into a chamber, with the local signals ``pressure``,
            ``temperature``, ``ambient_pressure`` and ``ambient_temperature``.
        conductance: Sonic conductance of the leak, in m^3/(s Pa).
        name: Name of the effect.

    Returns:
        Effect subtracting the leak.

    Raises:
        WorkbenchError: If the conductance is outside its bounds.

    Example:
        >>> chamber_leakage("chamber_2.flow").ports
        ('chamber_2.flow',)
    """

    def transform(at: PortView) -> Expression:
        s = at.signals
        return at.value - orifice_flow(
            s.pressure,
            s.ambient_pressure,
            s.temperature,
            s.ambient_temperature,
            at.p.conductance,
            0.3,
            face=at.face,
        )

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "conductance",
                "m3/(s Pa)",
                1e-10,
                value=conductance,
                lower=0.0,
                upper=2e-9,
                fitted=True,
                description="sonic conductance of the leak",
            ),
        ),
        about=About(
            "flow - C rho0 p sqrt(T0 / T) psi",
            "ISO 6358",
            look_alikes=("cross_leakage", "edge_leakage", "creep"),
            separated_by="hold with the valve shut at different pressures, one muscle at a time",
        ),
    )


def edge_leakage(
    port: str = "valve.supply_1", *, fraction: float = 0.004, name: str = "edge_leakage"
) -> Effect:
    """Build the leakage of one metering edge, worn more than the others.

    ``opening = opening + fraction`` at one edge.

    Args:
        port: Port of an edge's opening, as a fraction of full conductance.
        fraction: Leakage of the edge beyond that of all, as a fraction of full conductance.
        name: Name of the effect.

    Returns:
        Effect of size ``fraction``.

    Raises:
        WorkbenchError: If the fraction is outside its bounds.

    Example:
        >>> edge_leakage("valve.exhaust_2").ports
        ('valve.exhaust_2',)
    """

    def transform(at: PortView) -> Expression:
        return at.value + at.p.fraction

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "fraction",
                "1",
                0.004,
                "leakage of the edge, of full conductance",
                fraction,
                0.0,
                0.1,
                fitted=True,
            ),
        ),
        about=About(
            "opening of one edge + fraction",
            "wear of a metering edge",
            look_alikes=("chamber_leakage", "cross_leakage", "valve_offset"),
            separated_by="hold with the valve shut and the supply off, then on",
        ),
    )


_CROSS_LAG = 0.005
_CROSS_UNIT = 1e-10


def cross_leakage(
    ports: tuple[str, str] = ("chamber_1.flow", "chamber_2.flow"),
    *,
    conductance: float = 5e-11,
    name: str = "cross_leakage",
) -> Effect:
    """Build a leak from one chamber into the other, past a worn spool.

    ``flow_1 = flow_1 - conductance q``, ``flow_2 = flow_2 + conductance q`` with q the flow of an
    ISO 6358 restriction of unit conductance and critical ratio 0.3 from chamber 1 to 2, which
    follows the pressures within 5 ms so that both chambers see the same flow.

    Args:
        ports: Ports of the mass flows into both chambers, with the local signals ``pressure`` and
            ``temperature``.
        conductance: Sonic conductance of the leak, in m3/(s Pa).
        name: Name of the effect.

    Returns:
        Effect of size ``conductance`` with one state.

    Raises:
        WorkbenchError: If the conductance is outside its bounds.

    Example:
        >>> cross_leakage().states[0].unit
        'kg/s'
    """

    def transform(at: PortView) -> Expression:
        leak = at.p.conductance / _CROSS_UNIT * at.x.flow
        return at.value - leak if at.port == ports[0] else at.value + leak

    def flow(effect: EffectView) -> Expression:
        a, b = (effect.at[port].signals for port in ports)
        return orifice_flow(
            a.pressure, b.pressure, a.temperature, b.temperature, _CROSS_UNIT, 0.3, face=effect.face
        )

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        return {"flow": (flow(effect) - effect.x.flow) / _CROSS_LAG}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {"flow": flow(effect)}

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "conductance",
                "m3/(s Pa)",
                1e-10,
                "sonic conductance of the leak",
                conductance,
                0.0,
                2e-9,
                fitted=True,
            ),
        ),
        states=(State("flow", "kg/s", 1e-5, "leak at a conductance of 1e-10 m3/(s Pa)"),),
        rates=rates,
        start=start,
        about=About(
            "flow_1 - C q(p1, p2), flow_2 + C q(p1, p2)",
            "ISO 6358",
            look_alikes=("chamber_leakage", "edge_leakage"),
            separated_by="hold with the valve shut at unequal pressures: their sum stays",
        ),
    )
