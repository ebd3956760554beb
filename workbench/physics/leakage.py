"""Leakage: gas that escapes past closed edges or out of a chamber."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
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
        about=About("opening + fraction", "5/3 servovalve with soft overlap"),
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
            look_alikes=("centre_leakage",),
            separated_by="hold with the valve shut at different pressures",
        ),
    )
