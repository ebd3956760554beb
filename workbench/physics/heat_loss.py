"""Heat that a store loses to what is around it."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.model.units import same_dimension
from workbench.physics.law import Fit, Law, Own, shape, size
from workbench.physics.place import Place, Survey, per

_FAR = 10.0
"""Distance of what is around from the temperature at the start, over the latter's typical size."""

_ZERO = 273.15
"""Absolute temperature at 0 degC, K."""


def heat_stores(survey: Survey) -> Iterator[Fit]:
    """Yield the last heat flow into each store: it carries all that came before.

    So does the rate of a temperature, or, where no heat flows in, what takes heat from it alone.
    """
    found = {
        q.store: survey.with_level(q) for q in survey.fitting("heat") if q.store and q.fills < 0.0
    } | {
        q.level.source: q
        for q in survey.fitting("heat", "flow", needs=("level",))
        if q.role == "heat" or same_dimension(q.level.unit, "K")
    }
    for place in found.values():
        yield f"_{place.port.group}", ((place,),)


def sense(at: Place) -> Own:
    """State whether what flows at a place fills a store, 1, or empties it, -1; dimensionless."""
    return shape("sense", "1", at.fills, "whether the port's flow fills or empties the store",
                 around=None, between=(-1.0, 1.0), source="", fitted=False)  # fmt: skip


def _around(at: Place) -> Own:
    start, reach = at.level.start, _FAR * at.level.scale
    return shape("ambient", at.level.unit, start, "temperature around", around=None,
                 between=(start - reach, start + reach), scale=at.level.scale)  # fmt: skip


def _conductance(at: Place, text: str, *, signed: bool = False) -> Own:
    usual = 0.1 * at.scale / at.level.scale
    return size("conductance", per(at.unit, at.level.unit), usual, 100 * usual, text,
                signed=signed)  # fmt: skip


# Signed: less loss than the equations have.
heat_loss = Law(
    "heat_loss",
    "Q = Q - conductance (T - ambient)",
    heat_stores,
    lambda at: (_conductance(at, "heat lost over difference", signed=True), _around(at), sense(at)),
    lambda at: at.value - at.p.sense * at.p.conductance * (at.signals.level - at.p.ambient),
    source="I. Newton 1701",
    look_alikes=("radiation", "second_store", "offset"),
    separated_by="let it cool from high: the temperature falls along an exponential",
)


def _radiated(at: PortView) -> Expression:
    around = at.p.ambient + at.p.zero
    warm, cool = (at.signals.level + at.p.zero) / around, 1.0
    return at.value - at.p.sense * at.p.conductance * around * (warm**4 - cool) / 4.0


# The conductance is that of small differences, 4 emissivity area sigma ambient^3.
radiation = Law(
    "radiation",
    "Q = Q - conductance T_a / 4 [(T / T_a)^4 - 1]",
    heat_stores,
    lambda at: (
        _conductance(at, "heat radiated over a small difference"),
        _around(at),
        shape("zero", at.level.unit, _ZERO if abs(at.level.start) < 0.5 * _ZERO else 0.0,
              "absolute temperature at zero of the scale", around=None, scale=_ZERO, fitted=False),
        sense(at),
    ),
    _radiated,
    source="J. Stefan 1879, L. Boltzmann 1884",
    look_alikes=("heat_loss", "second_store"),
    separated_by="hold two temperatures far apart: the loss grows faster than the difference",
)  # fmt: skip
