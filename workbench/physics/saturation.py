"""Saturation, clipping and rectification: signals that do not pass a limit.

A share between 0 and 1 is a smaller slope beyond the limit. Starting from share 0 rather than from
a limit out of reach makes the law visible to derivatives.
"""

from __future__ import annotations

import math
from dataclasses import replace

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, Own, drives, each, sensors, shape, share, size
from workbench.physics.place import DRIVES, EFFORTS, Place


def _above(at: PortView) -> Expression:
    return at.value - at.p.share * at.form.ramp(at.value - at.p.limit, 0.01 * at.scale)


def _beyond(at: PortView) -> Expression:
    ramp, limit, width = at.form.ramp, at.p.limit, 0.01 * at.scale
    return at.value - at.p.share * (ramp(at.value - limit, width) - ramp(-at.value - limit, width))


def _limit(at: Place, usual: float) -> tuple[Own, ...]:
    return (
        share("share of the excess that is cut"),
        shape("limit", at.unit, usual, "the limit", around=(0.05, 20.0), scale=at.scale)
        if usual > 0.0
        else shape("limit", at.unit, usual, "the limit", around=None, scale=at.scale),
    )


def _limited(at: Place) -> tuple[Own, ...]:
    return _limit(at, _limits(at)[0]["limit"])


def _limits(at: Place) -> list[dict[str, float]]:
    if at.seen is None:
        return [{"limit": k * at.scale} for k in (1.0, 0.5, 2.0)]
    # Without the limit the signal seems to pass it.
    return [{"limit": k * max(map(abs, at.seen))} for k in (0.8, 0.6, 0.95)]


saturation = Law(
    "saturation",
    "y = u - share (excess of u beyond the limit, above and below)",
    drives("flow"),
    _limited,
    _beyond,
    shapes=_limits,
    source="end of the range of a sensor or drive",
    look_alikes=("gain",),
    separated_by="levels on both sides of the limit: below it nothing is changed",
)

_NAMED = (".inflow", ".outflow")
"""Endings of flows whose name has their direction: cutting the negative part does nothing."""


def _lower_limits(at: Place) -> list[dict[str, float]]:
    if at.seen is not None:
        low, high = at.seen
        return [{"limit": low + k * (high - low)} for k in (0.2, 0.05, 0.4)]
    fractions = (0.5, 0.25) if at.name.endswith(_NAMED) else (-1.0, -0.5, 0.5)
    return [{"limit": k * at.scale} for k in fractions]


drive_saturation = replace(
    saturation,
    name="drive_saturation",
    where=each(*EFFORTS, needs=("speed",), only=lambda at: at.driven and at.role not in DRIVES),
    look_alikes=("quadratic_drag",),
)

lower_saturation = replace(
    saturation,
    name="lower_saturation",
    equation="y = u + share (excess of u below the limit)",
    where=drives(),
    parameters=lambda at: (
        share("share of the excess that is cut"),
        shape("limit", at.unit, at.scale, "the limit", around=None, scale=at.scale),
    ),
    transform=lambda at: (
        at.value + at.p.share * at.form.ramp(at.p.limit - at.value, 0.01 * at.scale)
    ),
    shapes=_lower_limits,
)


def _ends(at: Place) -> tuple[float, ...]:
    """Limits worth trying for a sensor: at the end of what it reads, or within its range."""
    if at.seen is not None:
        low, high = at.seen
        return high, high - 0.1 * (high - low), high - 0.3 * (high - low)
    if at.unit == "Pa":
        return tuple(k * at.scale for k in (4.0, 3.0, 5.0))
    top = at.signals["measured"].upper if "measured" in at.signals else math.inf
    top = top if math.isfinite(top) else 2.0 * at.scale
    if at.output and math.isfinite(at.output.upper):
        top = min(top, at.output.upper)
    return tuple(k * top for k in (0.75, 0.5, 0.9))


sensor_clipping = replace(
    saturation,
    name="sensor_clipping",
    where=sensors(together=False),
    equation="y = u - share (excess of u above the limit)",
    parameters=lambda at: _limit(at, _ends(at)[0]),
    transform=_above,
    shapes=lambda at: [{"limit": limit} for limit in _ends(at)],
    group="sensor",
    look_alikes=("sensor_gain",),
)

rectification = Law(
    "rectification",
    "y = u + share max(0, -u)",
    drives("flow", only=lambda at: at.role != "heat" and not at.name.endswith(_NAMED)),
    lambda at: (replace(share("share of the negative part cut"), fitted=True),),
    lambda at: at.value + at.p.share * at.form.ramp(-at.value, 0.01 * at.scale),
    source="check valve, diode, pump that does not suck",
    look_alikes=("saturation", "asymmetric_gain"),
    separated_by="negative commands",
)  # fmt: skip


def _both_signs(at: Place) -> bool:
    return "measured" in at.signals and at.signals["measured"].lower < 0.0


sensor_rectification = Law(
    "sensor_rectification",
    "y = u + share (|u| - u)",
    sensors(together=False, only=_both_signs),
    lambda at: (size("share", "1", 1.0, 1.0, "share of the magnitude in the reading"),),
    lambda at: at.value
    + at.p.share * (at.form.absolute(at.value, 0.01 * at.scale) - at.value),
    far=True,
    group="sensor",
    source="magnitude sensors: tachometers, flow meters, rectifiers",
    look_alikes=("sensor_gain", "sensor_clipping"),
    separated_by="the same motion to both sides of zero",
)  # fmt: skip
