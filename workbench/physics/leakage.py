"""Leakage: gas that escapes past closed edges, out of a chamber, or into the other one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.flow import REFERENCE_DENSITY, orifice_flow
from workbench.physics.law import Fit, Law, Own, by_end, by_number, each, shape, size, twins
from workbench.physics.place import Place
from workbench.physics.survey import Survey

centre_leakage = Law(
    "centre_leakage",
    "opening + fraction",
    twins("edge"),
    lambda at: (
        size("fraction", "1", 0.004, 0.014, "leakage of one edge, of full conductance",
             source="estimate; manufacturer states at most 25 l/min in all"),
    ),
    lambda at: at.value + at.p.fraction,
    source="5/3 servovalve with soft overlap",
    look_alikes=("edge_leakage", "dead_band"),
    separated_by="hold with the valve shut: how fast the mean pressure settles",
)  # fmt: skip

# Beyond the leakage that all edges have.
edge_leakage = Law(
    "edge_leakage",
    "opening of one edge + fraction",
    each("edge", label=by_end),
    lambda at: (size("fraction", "1", 0.004, 0.1, "leakage of the edge, of full conductance"),),
    lambda at: at.value + at.p.fraction,
    source="wear of a metering edge",
    look_alikes=("chamber_leakage", "cross_leakage", "valve_offset"),
    separated_by="hold with the valve shut and the supply off, then on",
)


def _conductance(at: Place) -> Own:
    # Beside that through which the usual flow passes at the usual pressure.
    full = at.scale / (REFERENCE_DENSITY * at.other("pressure").scale)
    return size("conductance", "m3/(s Pa)", 0.006 * full, 0.24 * full,
                "sonic conductance of the leak", scale=0.012 * full)  # fmt: skip


def _to_ambient(at: PortView) -> Expression:
    s = at.signals
    warmth = s.temperature, s.ambient_temperature
    return orifice_flow(s.pressure, s.ambient_pressure, *warmth, at.p.conductance, form=at.form)


chamber_leakage = Law(
    "chamber_leakage",
    "flow - C rho0 p sqrt(T0 / T) psi",
    each(
        "gas_flow",
        needs=("pressure", "temperature", "ambient_pressure", "ambient_temperature"),
        label=by_number,
    ),
    lambda at: (_conductance(at),),
    lambda at: at.value - _to_ambient(at),
    usual=True,
    source="ISO 6358",
    look_alikes=("cross_leakage", "edge_leakage", "creep"),
    separated_by="hold with the valve shut at different pressures, one muscle at a time",
)


def _pressures(at: Place) -> list[float]:
    """Gauge pressures, in Pa, from which on a leak may open: a part of what was seen."""
    pressure, ambient = at.other("pressure"), at.other("ambient_pressure").start
    low, high = pressure.seen or (ambient, ambient + 2.0 * pressure.scale)
    return [max(0.0, low + part * (high - low) - ambient) for part in (0.35, 0.55, 0.75)]


def _opened(at: PortView) -> Expression:
    s, p = at.signals, at.p
    beyond = (s.pressure - s.ambient_pressure - p.threshold) / p.width
    return at.form.clip(beyond, 0.0, 1.0, 0.1) * _to_ambient(at)


# A cracked tube, a loose clamp, a relief valve: shut up to a pressure, open beyond.
opening_leakage = replace(
    chamber_leakage,
    name="opening_leakage",
    equation="flow - C rho0 p sqrt(T0 / T) psi from a gauge pressure on",
    parameters=lambda at: (
        _conductance(at),
        shape("threshold", "Pa", _pressures(at)[1], "gauge pressure at which the leak opens",
              between=(0.0, 1e8), scale=0.1 * at.other("pressure").scale),
        shape("width", "Pa", 0.1 * at.other("pressure").scale,
              "how much more opens it fully", refined=True),
    ),
    transform=lambda at: at.value - _opened(at),
    usual=False,
    shapes=lambda at: [{"threshold": pressure} for pressure in _pressures(at)],
    tells="threshold",
    source="relief valve; ISO 6358",
    look_alikes=("chamber_leakage", "edge_leakage"),
    separated_by="hold with the valve shut at rising pressures: below one of them nothing is lost",
)  # fmt: skip

_LAG = 0.005
"""Time, in s, in which the cross leak follows the pressures, so that both chambers see one flow."""

_UNIT = 1e-10


def _pair(survey: Survey) -> Iterator[Fit]:
    found = survey.fitting("gas_flow", needs=("pressure", "temperature"))
    if len(found) == 2:
        yield "", (found,)


def _across(e: EffectView) -> Expression:
    a, b = (at.signals for at in e.at.values())
    return orifice_flow(a.pressure, b.pressure, a.temperature, b.temperature, _UNIT, form=e.form)


def _crossed(at: PortView) -> Expression:
    leak = at.p.conductance / _UNIT * at.x.flow
    return at.value - leak if at.index == 0 else at.value + leak


cross_leakage = replace(
    chamber_leakage,
    name="cross_leakage",
    equation="flow_1 - C q(p1, p2), flow_2 + C q(p1, p2)",
    where=_pair,
    transform=_crossed,
    states=lambda at: (State("flow", "kg/s", 1e-5, "leak at a conductance of 1e-10 m3/(s Pa)"),),
    rates=lambda e: {"flow": (_across(e) - e.x.flow) / _LAG},
    start=lambda e: {"flow": _across(e)},
    look_alikes=("chamber_leakage", "edge_leakage"),
    separated_by="hold with the valve shut at unequal pressures: their sum stays",
)
