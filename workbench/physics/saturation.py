"""Saturation, clipping and rectification: signals that do not pass a limit."""

from __future__ import annotations

import math

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression


def saturation(
    ports: tuple[str, ...] = ("pressure_1.reading",),
    *,
    share: float = 1.0,
    limit: float = 5e5,
    side: str = "above",
    unit: str = "Pa",
    scale: float = 1e5,
    corner: float = 0.01,
    lower: float = -math.inf,
    upper: float = math.inf,
    look_alikes: tuple[str, ...] = ("sensor_gain",),
    name: str = "saturation",
) -> Effect:
    """Build a limit that a signal does not pass, in part or in whole.

    ``y = u - share max(0, u - limit)`` above, ``y = u + share max(0, limit - u)`` below. A share
    between 0 and 1 is a smaller slope beyond the limit. Starting from share 0 rather than from a
    limit out of reach makes the effect visible to derivatives.

    Args:
        ports: Ports that have the same limit.
        share: Share of the excess that is cut, a fraction; 1 is a hard limit, 0 its absence.
        limit: The limit, in ``unit``.
        side: ``"above"`` to cut what is larger, ``"below"`` to cut what is smaller.
        unit: Unit of the ports.
        scale: Typical size of the signal, in ``unit``.
        corner: Half-width of the corner that the smooth face rounds, a fraction of ``scale``.
        lower: Smallest plausible limit, in ``unit``.
        upper: Largest plausible limit, in ``unit``.
        look_alikes: Names of effects that the same data may not separate.
        name: Name of the effect.

    Returns:
        Effect of size ``share``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> saturation(limit=4e5).parameters[1].value
        400000.0
    """
    sign = 1.0 if side == "above" else -1.0

    def transform(at: PortView) -> Expression:
        excess = at.face.ramp(sign * (at.value - at.p.limit), corner * scale)
        return at.value - sign * at.p.share * excess

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("share", "1", 1.0, "share of the excess that is cut", share, 0.0, 1.0),
            Parameter(
                "limit", unit, scale, "the limit", limit, lower, upper, "estimate", fitted=True
            ),
        ),
        about=About(
            f"y = u - share (excess of u {side} the limit)",
            "end of the range of a sensor or drive",
            look_alikes,
            separated_by="levels on both sides of the limit: below it nothing is changed",
        ),
    )


def rectification(
    ports: tuple[str, ...] = ("pump.flow",),
    *,
    share: float = 1.0,
    scale: float = 1.0,
    name: str = "rectification",
) -> Effect:
    """Build a one-way signal: negative values are cut, in part or in whole.

    ``y = u + share max(0, -u)``: a check valve, a pump that does not suck, an ideal diode.

    Args:
        ports: Ports on which it acts.
        share: Share of the negative part that is cut, a fraction; 1 is the law, 0 its absence.
        scale: Typical size of the signal, in SI.
        name: Name of the effect.

    Returns:
        Effect of size ``share``.

    Raises:
        WorkbenchError: If the share is outside its bounds.

    Example:
        >>> rectification(("pump.command",)).parameters[0].name
        'share'
    """

    def transform(at: PortView) -> Expression:
        return at.value + at.p.share * at.face.ramp(-at.value, 0.01 * scale)

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "share", "1", 1.0, "share of the negative part cut", share, 0.0, 1.0, fitted=True
            ),
        ),
        about=About(
            "y = u + share max(0, -u)",
            "check valve, diode",
            look_alikes=("saturation", "asymmetric_gain"),
            separated_by="negative commands",
        ),
    )
