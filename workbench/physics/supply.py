"""The air supply, and volumes and restrictions in the air lines: tubes to chambers, silencers.

The supply is a reservoir behind a regulator, whose pressure falls while flow is drawn; the model
publishes the flow drawn from the port ``supply.pressure`` as ``supply.flow``. In a line mass is
conserved at the shares 0 and 1 only: the law is there or not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.drift import offset_jump, sensor_drift, warming
from workbench.physics.flow import orifice_flow
from workbench.physics.gas import GAS_CONSTANT, HEAT_RATIO
from workbench.physics.law import Fit, Law, Own, Site, by_number, each, shape, share, size
from workbench.physics.place import Place
from workbench.physics.survey import Survey


def _there_or_not(*own: Own) -> Callable[[Place], tuple[Own, ...]]:
    return lambda at: (*own, share("share of the law; 0 is its absence"))


def _volume_and_restriction(conductance: float) -> tuple[Own, Own]:
    return (
        shape("volume", "m3", 1e-5, "gas volume", between=(1e-6, 1e-3), source=""),
        shape("conductance", "m3/(s Pa)", conductance, "sonic conductance", between=(1e-9, 1e-6),
              scale=1e-8, source=""),
    )  # fmt: skip


def _stiffness(e: EffectView, temperature: Expression) -> Expression:
    return HEAT_RATIO * GAS_CONSTANT * temperature / e.p.volume


def _numbers(sites: list[Site]) -> Iterator[Fit]:
    """Yield each site by the number of its component, and both of two together."""
    for site in sites:
        yield f"_{by_number(site[0])}", (site,)
    if len(sites) == 2:
        yield "s", tuple(sites)


def _tubes(survey: Survey) -> Iterator[Fit]:
    chambers, temperatures = (
        {by_number(q): q for q in survey.fitting(role)} for role in ("gas_flow", "line_temperature")
    )
    sites: list[Site] = []
    for q in survey.fitting("line_pressure"):
        if (chamber := chambers.get(number := by_number(q))) is not None:
            warm = temperatures.get(number)
            sites.append((q, chamber) if warm is None else (q, chamber, warm))
    return _numbers(sites)


def _in_tube(at: PortView, temperature: Expression) -> Expression:
    """Temperature of the gas in the tube, of which a share has that of the wall."""
    return temperature + at.p.wall * (at.signals.ambient_temperature - temperature)


def _through(at: PortView) -> Expression:
    s = at.signals
    warmth = _in_tube(at, s.temperature), s.temperature
    return orifice_flow(at.x.pressure, s.pressure, *warmth, at.p.conductance, form=at.form)


def _tube(at: PortView) -> Expression:
    if at.index == 2:
        passed = _in_tube(at, at.value)
    else:
        passed = _through(at) if at.index else at.x.pressure
    return at.value + at.p.share * (passed - at.value)


def _tube_rates(e: EffectView) -> dict[str, Expression]:
    _, chamber, *_ = e.at.values()
    filled = chamber.value - _through(chamber)
    exponent = 1.0 + (HEAT_RATIO - 1.0) * (1.0 - e.p.wall)
    temperature = _in_tube(chamber, chamber.signals.temperature)
    return {"pressure": exponent * GAS_CONSTANT * temperature / e.p.volume * filled}


# The valve sees the gas of the tube, the chamber receives the flow through the restriction. In a
# wide, short tube the gas is as warm as in the chamber; in a narrow, long one it takes most of the
# wall's temperature on its way: at 1 g/s and 0.5 m of 4 mm, alpha A / (m c_p) = 2.
line = Law(
    "line",
    "dp/dt = n R T (flow_valve - flow_chamber) / V, T = T_c + wall (T_w - T_c),"
    " n = gamma - wall (gamma - 1)",
    _tubes,
    _there_or_not(
        *_volume_and_restriction(4e-8),
        shape("wall", "1", 0.0, "how much of its wall's temperature the gas in the tube takes",
              between=(0.0, 1.0), scale=0.5, source="", refined=True),
    ),
    _tube,
    states=lambda at: (
        State("pressure", "Pa", 1e5, "pressure in the tube", initial=4e5, lower=0.0),
    ),
    rates=_tube_rates,
    start=lambda e: {"pressure": e.here.value},
    shapes=lambda at: [
        {"conductance": conductance, "wall": wall}
        for wall in (0.0, 1.0)
        for conductance in (1.5e-8, 4e-8)
    ],
    stiff=True,
    far=True,
    usual=True,
    source="lumped volume on every port of the paper's valve; ISO 6358 restriction",
    look_alikes=("spool_bandwidth", "sensor_lag"),
    separated_by="fast valve pulses with a flow meter",
)  # fmt: skip


def _blown(e: EffectView) -> dict[str, Expression]:
    warmth = e.here.signals.temperature
    out = orifice_flow(e.x.pressure, e.here.value, warmth, warmth, e.p.conductance, form=e.form)
    return {"pressure": _stiffness(e, warmth) * (_drawn(e) - out)}


silencer = Law(
    "silencer",
    "dp/dt = gamma R T (flow_exhaust - flow_ambient) / V",
    lambda survey: _numbers([(q,) for q in survey.fitting("exhaust_pressure")]),
    _there_or_not(*_volume_and_restriction(6e-8)),
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


def _where(survey: Survey) -> Iterator[Fit]:
    for place in survey.fitting("supply_pressure"):
        if f"{place.port.group}.flow" in survey.trace.signal_names:
            yield "", ((place,),)


def _drawn(e: EffectView) -> Expression:
    return e.values[f"{e.here.group}.flow"]


def _fed(e: EffectView) -> dict[str, Expression]:
    warmth = e.here.signals.temperature
    feed = orifice_flow(e.here.value, e.x.pressure, warmth, warmth, e.p.conductance, form=e.form)
    return {"pressure": _stiffness(e, warmth) * (feed - _drawn(e))}


_RESERVOIR = shape("volume", "m3", 5e-4, "reservoir volume", between=(1e-5, 0.1), source="")

supply_droop = Law(
    "supply_droop",
    "dp/dt = gamma R T (flow_feed - flow_drawn) / V",
    _where,
    _there_or_not(
        _RESERVOIR,
        shape("conductance", "m3/(s Pa)", 1e-8, "sonic conductance of the feed",
              between=(1e-10, 1e-6), source=""),
    ),
    lambda at: at.value + at.p.share * (at.x.pressure - at.value),
    states=lambda at: (
        State("pressure", "Pa", 1e5, "pressure of the reservoir", initial=7e5, lower=0.0),
    ),
    rates=_fed,
    start=lambda e: {"pressure": e.here.value},
    shapes=lambda at: ({"conductance": 1e-8}, {"conductance": 3e-9}),
    usual=True,
    source="lumped reservoir; ISO 6358 restriction",
    look_alikes=("regulator_droop",),
    separated_by="fill both muscles in quick succession",
)  # fmt: skip


def _refilled(e: EffectView) -> dict[str, Expression]:
    refill = e.p.gain * (e.here.value - e.x.pressure)
    stiffness = GAS_CONSTANT * e.here.signals.temperature / e.p.volume
    return {"pressure": stiffness * (refill - _drawn(e))}


# The regulator opens in proportion to the pressure that is missing; the large reservoir stays at
# the temperature of its wall.
reservoir_droop = replace(
    supply_droop,
    name="reservoir_droop",
    equation="dp/dt = R T (gain (p_0 - p) - flow_drawn) / V",
    parameters=_there_or_not(
        _RESERVOIR,
        shape("gain", "kg/(s Pa)", 5e-9, "refilling flow per missing pressure",
              between=(1e-11, 1e-6), source=""),
    ),
    rates=_refilled,
    shapes=lambda at: ({"gain": 5e-9}, {"gain": 3e-8}),
    source="lumped reservoir behind a proportional regulator",
    look_alikes=("supply_droop", "regulator_droop"),
    separated_by="fill both muscles in quick succession, then hold",
)  # fmt: skip


# The first-order response also avoids an algebraic loop.
regulator_droop = Law(
    "regulator_droop",
    "p = p0 - R q, dq/dt = (flow_drawn - q) / tau",
    _where,
    lambda at: (
        size("resistance", "Pa s/kg", 1e7, 1e8, "droop over flow",
             source="0.1 to 0.4 bar at full flow in the literature"),
        shape("time_constant", "s", 0.05, "response of the regulator", between=(0.005, 5.0)),
    ),
    lambda at: at.value - at.p.resistance * at.x.drawn,
    states=lambda at: (State("drawn", "kg/s", 1e-3, "flow that the regulator answers"),),
    rates=lambda e: {"drawn": (_drawn(e) - e.x.drawn) / e.p.time_constant},
    shapes=lambda at: ({"time_constant": 0.05}, {"time_constant": 0.5}),
    source="flow characteristic of a pressure regulator, linearised",
    look_alikes=("supply_droop",),
    separated_by="one long fill: a reservoir runs down, a regulator settles",
)  # fmt: skip

supply_jump = replace(
    offset_jump,
    name="supply_jump",
    where=each("supply_pressure"),
    source="a regulator that sticks, another consumer that is switched on",
    look_alikes=("supply_droop", "reservoir_droop", "regulator_droop"),
    separated_by="the event again at rest: a droop needs flow",
)

supply_drift = replace(
    sensor_drift,
    name="supply_drift",
    where=each("supply_pressure"),
    parameters=lambda at: warming(at, 0.3),
    group="process",
    source="a bottle that runs empty, a regulator that creeps",
    look_alikes=("supply_jump", "reservoir_droop", "supply_droop"),
    separated_by="the same motion at the start and at the end of a recording",
)
