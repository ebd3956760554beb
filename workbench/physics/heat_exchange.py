"""Heat exchange between the gas of a chamber and its wall."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.gas import wall_heat


def heat_exchange(
    ports: tuple[str, ...] = ("chamber_1.heat", "chamber_2.heat"),
    *,
    coefficient: float = 150.0,
    area: float = 0.0126,
    lower: float = 0.0,
    upper: float = 1e5,
    name: str = "heat_exchange",
) -> Effect:
    """Build heat exchange with a wall at ambient temperature; without it the gas is adiabatic.

    ``Q = coefficient area (T_wall - T)``

    Args:
        ports: Ports of the heat flow into chambers, with the local signals ``temperature`` and
            ``wall_temperature``.
        coefficient: Heat transfer coefficient, in W/(m^2 K).
        area: Wetted area of one chamber, in m^2.
        lower: Smallest plausible coefficient, in W/(m^2 K).
        upper: Largest plausible coefficient, in W/(m^2 K).
        name: Name of the effect.

    Returns:
        Effect adding the heat flow.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> heat_exchange(coefficient=200.0).parameters[0].value
        200.0
    """

    def transform(at: PortView) -> Expression:
        return at.value + wall_heat(
            at.signals.temperature,
            at.signals.wall_temperature,
            coefficient=at.p.coefficient,
            area=at.p.area,
        )

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "coefficient",
                "W/(m2 K)",
                100.0,
                value=coefficient,
                lower=lower,
                upper=upper,
                source="estimate; the paper's model has 200",
                fitted=True,
                description="heat transfer coefficient",
            ),
            Parameter("area", "m2", value=area, lower=1e-5, upper=1.0, source="paper, Figure 2"),
        ),
        about=About(
            "Q = h S (T_wall - T)",
            "line [15] of the paper's Figure 3",
            look_alikes=("polytropic_exchange",),
            separated_by="steps of pressure: how fast the pressure relaxes after the valve shuts",
        ),
    )
