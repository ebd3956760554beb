"""Volumes and restrictions in the air lines: tubes to the chambers and exhaust silencers.

Mass is conserved at the shares 0 and 1 only: the law is there or not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.flow import orifice_flow
from workbench.physics.gas import AIR
from workbench.physics.law import Fit, Law, Own, Site, by_number, shape, share
from workbench.physics.place import Place, Survey

_CRITICAL_RATIO = 0.3


def _volume_and_restriction(conductance: float) -> Callable[[Place], tuple[Own, ...]]:
    own = (
        shape("volume", "m3", 1e-5, "gas volume", around=None, between=(1e-6, 1e-3), source=""),
        shape("conductance", "m3/(s Pa)", conductance, "sonic conductance", around=None,
              between=(1e-9, 1e-6), scale=1e-8, source=""),
        share("share of the law; 0 is its absence"),
    )  # fmt: skip
    return lambda at: own


def _stiffness(e: EffectView, temperature: Expression) -> Expression:
    return AIR.heat_ratio * AIR.gas_constant * temperature / e.p.volume


def _numbers(sites: list[Site]) -> Iterator[Fit]:
    """Yield each site by the number of its component, and both of two together."""
    for site in sites:
        yield f"_{by_number(site[0])}", (site,)
    if len(sites) == 2:
        yield "s", tuple(sites)


def _tubes(survey: Survey) -> Iterator[Fit]:
    chambers = {by_number(q): q for q in survey.fitting("gas_flow")}
    return _numbers(
        [
            (q, chambers[by_number(q)])
            for q in survey.fitting("line_pressure")
            if by_number(q) in chambers
        ]
    )


def _through(at: PortView) -> Expression:
    s = at.signals
    return orifice_flow(
        at.x.pressure, s.pressure, s.temperature, s.temperature, at.p.conductance,
        _CRITICAL_RATIO, form=at.form,
    )  # fmt: skip


def _tube(at: PortView) -> Expression:
    passed = at.x.pressure if at.index == 0 else _through(at)
    return at.value + at.p.share * (passed - at.value)


def _tube_rates(e: EffectView) -> dict[str, Expression]:
    _, chamber = e.at.values()
    filled = chamber.value - _through(chamber)
    return {"pressure": _stiffness(e, chamber.signals.temperature) * filled}


# The valve sees the pressure of the tube, the chamber receives the flow through the restriction;
# tube and chamber have the same temperature.
line = Law(
    "line",
    "dp/dt = gamma R T (flow_valve - flow_chamber) / V",
    _tubes,
    _volume_and_restriction(4e-8),
    _tube,
    states=lambda at: (
        State("pressure", "Pa", 1e5, "pressure in the tube", initial=4e5, lower=0.0),
    ),
    rates=_tube_rates,
    start=lambda e: {"pressure": e.here.value},
    shapes=lambda at: ({"conductance": 1.5e-8}, {"conductance": 4e-8}),
    stiff=True,
    far=True,
    source="lumped volume on every port of the paper's valve; ISO 6358 restriction",
    look_alikes=("spool_bandwidth", "sensor_lag"),
    separated_by="fast valve pulses with a flow meter",
)


def _blown(e: EffectView) -> dict[str, Expression]:
    at = e.here
    temperature = at.signals.temperature
    out = orifice_flow(
        e.x.pressure, at.value, temperature, temperature, e.p.conductance, _CRITICAL_RATIO,
        form=e.form,
    )  # fmt: skip
    drawn = e.values[f"{at.group}.flow"]
    return {"pressure": _stiffness(e, temperature) * (drawn - out)}


silencer = Law(
    "silencer",
    "dp/dt = gamma R T (flow_exhaust - flow_ambient) / V",
    lambda survey: _numbers([(q,) for q in survey.fitting("exhaust_pressure")]),
    _volume_and_restriction(6e-8),
    lambda at: at.value + at.p.share * (at.x.pressure - at.value),
    states=lambda at: (
        State("pressure", "Pa", 1e5, "pressure in the silencer", initial=1.01325e5, lower=0.0),
    ),
    rates=_blown,
    start=lambda e: {"pressure": e.here.value},
    shapes=lambda at: ({"conductance": 1e-8}, {"conductance": 6e-8}),
    stiff=True,
    source="silencers of the paper's valve; ISO 6358 restriction",
    look_alikes=("asymmetric_gain", "edge_gain"),
    separated_by="venting from high pressure against filling",
)
