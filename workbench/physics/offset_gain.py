"""A signal that is off by a constant, by a factor, or by a factor on one side only."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression


def offset(
    ports: tuple[str, ...] = ("valve.command",),
    *,
    amount: float = 0.05,
    unit: str = "V",
    upper: float = 1.0,
    typical: float = 0.05,
    look_alikes: tuple[str, ...] = (),
    separated_by: str = "hold still at several positions: an offset is the same everywhere",
    name: str = "offset",
) -> Effect:
    """Build a constant that is added to a signal: a zero error, a constant force or torque.

    ``y = u + amount``

    Args:
        ports: Ports that are all off by the same amount.
        amount: The constant, in ``unit``.
        unit: Unit of the ports.
        upper: Largest plausible magnitude, in ``unit``.
        typical: Usual magnitude, in ``unit``; scales the fit.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from them.
        name: Name of the effect.

    Returns:
        Effect of size ``amount``.

    Raises:
        WorkbenchError: If the amount is outside its bounds.

    Example:
        >>> offset(("pressure_1.reading",), amount=2e3, unit="Pa", upper=3e4).ports
        ('pressure_1.reading',)
    """

    def transform(at: PortView) -> Expression:
        return at.value + at.p.amount

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("amount", unit, typical, "the constant", amount, -upper, upper, fitted=True),
        ),
        about=About("y = u + amount", "zero error", look_alikes, separated_by),
    )


def gain(
    ports: tuple[str, ...] = ("pressure_1.reading",),
    *,
    excess: float = 0.02,
    upper: float = 0.5,
    typical: float = 0.02,
    look_alikes: tuple[str, ...] = (),
    separated_by: str = "compare with a reference at two levels of the signal",
    name: str = "gain",
) -> Effect:
    """Build a factor on a signal: a span error, a weaker muscle, a narrower edge.

    ``y = (1 + excess) u``

    Args:
        ports: Ports that all have the same factor.
        excess: Factor less one, dimensionless.
        upper: Largest plausible magnitude, dimensionless.
        typical: Usual magnitude, dimensionless; scales the fit.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from them.
        name: Name of the effect.

    Returns:
        Effect of size ``excess``.

    Raises:
        WorkbenchError: If the excess is outside its bounds.

    Example:
        >>> gain(("muscle_1.force",), excess=-0.05).parameters[0].value
        -0.05
    """

    def transform(at: PortView) -> Expression:
        return at.value * (1.0 + at.p.excess)

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "excess", "1", typical, "factor less one", excess, -upper, upper, fitted=True
            ),
        ),
        about=About("y = (1 + excess) u", "span error", look_alikes, separated_by),
    )


def asymmetric_gain(
    ports: tuple[str, ...] = ("valve.spool",),
    *,
    difference: float = 0.1,
    centre: float = 0.0,
    unit: str = "V",
    width: float = 0.02,
    upper: float = 1.0,
    typical: float = 0.1,
    name: str = "asymmetric_gain",
) -> Effect:
    """Build a signal that counts more on one side of its centre than on the other.

    ``y = u + (difference / 2) |u - centre|``: factor 1 + difference / 2 above the centre and
    1 - difference / 2 below.

    Args:
        ports: Ports on which it acts.
        difference: Factor above the centre less that below, dimensionless.
        centre: Where the two sides meet, in ``unit``.
        unit: Unit of the ports.
        width: Neighbourhood of the centre that the smooth face rounds, in ``unit``.
        upper: Largest plausible magnitude of the difference, dimensionless.
        typical: Usual magnitude of the difference, dimensionless; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``difference``.

    Raises:
        WorkbenchError: If the difference is outside its bounds.

    Example:
        >>> asymmetric_gain().name
        'asymmetric_gain'
    """

    def transform(at: PortView) -> Expression:
        return at.value + 0.5 * at.p.difference * at.face.absolute(at.value - at.p.centre, width)

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "difference",
                "1",
                typical,
                "factor above the centre less that below",
                difference,
                -upper,
                upper,
                fitted=True,
            ),
            Parameter("centre", unit, 1.0, "where the two sides meet", centre),
        ),
        about=About(
            "y = u + (difference / 2) |u - centre|",
            "unequal edges of a valve, unequal sides of an amplifier",
            look_alikes=("valve_offset", "silencer", "edge_gain"),
            separated_by="steps of several sizes to both sides: an offset fades for large ones",
        ),
    )
