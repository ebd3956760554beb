"""Stores of matter, charge and heat: what they lose, and capacities that change with their level.

They lose it over a brim, through an orifice, through a leak, to the room. A lag short beside the
store's own time lets both stores see the same spill. What runs over falls, if anywhere, into the
next store that the equations fill. At the port that carries the whole rate, a capacity that falls
to C / r is a signal of r times the size; unlike ``1 / (1 + z)`` the factor is positive for every z.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import casadi as ca

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression, maximum, sqrt
from workbench.model.units import per, same_dimension
from workbench.physics.law import Fit, Law, Own, each, flag, floor, reference, shape, size, size_at
from workbench.physics.place import Local, Place
from workbench.physics.survey import Survey

_FAR = 10.0
"""Distance of what is around from the temperature at the start, over the latter's typical size."""

_ZERO = 273.15
"""Absolute temperature at 0 degC, K."""

_ROOM = _ZERO + 20.0
"""Absolute temperature of a room, K."""

_MAGNUS, _MAGNUS_ZERO = 17.625, _ZERO - 243.04
"""Constants of the vapour pressure over water, ln p = 17.625 t / (t + 243.04), t in degC: a factor
(dimensionless) and an absolute temperature, K; O. A. Alduchov and R. E. Eskridge 1996."""


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


def _heat_stores_and_all(survey: Survey) -> Iterator[Fit]:
    """Yield each heat store, and pieces of one thing at once, such as the sections of a kiln.

    Pieces are three or more that one parameter describes, or two whose capacity is one.
    """
    fits = list(heat_stores(survey))
    yield from fits
    pieces = {place.name: place for _, ((place,),) in fits}
    found: dict[tuple[str, ...], str] = {}
    for q, places in (*survey.spread, *survey.fixed):
        own = tuple(at.name for at in places if at.name in pieces)
        alike = len({(pieces[name].unit, pieces[name].fills) for name in own}) == 1
        least = 2 if any(same_dimension(q.unit, one) for one in _CAPACITIES) else 3
        if alike and len(own) >= least:
            found.setdefault(own, "" if len(own) == len(pieces) else f"_{q.name}")
    for own, suffix in found.items():
        yield suffix, tuple((pieces[name],) for name in own)


_CAPACITIES = ("J/K", "J/(kg K)", "J/(m3 K)", "kg", "kg/m3", "m3")
"""Units of what makes a heat capacity."""


def sense(at: Place) -> Own:
    """State whether what flows at a place fills a store, 1, or empties it, -1; dimensionless."""
    text = "whether the port's flow fills or empties the store"
    return flag("sense", at.fills, text, lower=-1.0)


def _around(at: Place) -> Own:
    start, reach = at.level.start, _FAR * at.level.scale
    each = [shape["ambient"] for shape in _rooms(at)]
    between = min(start - reach, *each), max(start + reach, *each)
    return shape("ambient", at.level.unit, start, "temperature around", between=between,
                 scale=at.level.scale, read=at.level.read)  # fmt: skip


def _rooms(at: Place) -> list[dict[str, float]]:
    """Return what may be around a store: what it is at first, or a room, if it counts from zero."""
    first = at.level.start
    warm = first > 0.5 * _ZERO and abs(first - _ROOM) > 0.5 * at.level.scale
    return [{"ambient": t} for t in (first, *[_ROOM] * warm)]


def _conductance(
    at: Place, text: str, usual: float = 0.1, most: float = 10.0, *, signed: bool = False
) -> Own:
    """State a flow over a level by its usual and largest size over those of the place."""
    one = at.scale / at.level.scale
    return size("conductance", per(at.unit, at.level.unit), usual * one, most * one, text,
                signed=signed)  # fmt: skip


def _typical(level: Local, value: float) -> Own:
    """Return the level at which a law tells its size: of another one it tells another size."""
    return reference("level_scale", level.unit, value, "typical level")


# Signed: less loss than the equations have.
heat_loss = Law(
    "heat_loss",
    "Q = Q - conductance (T - ambient)",
    _heat_stores_and_all,
    lambda at: (_conductance(at, "heat lost over difference", signed=True), _around(at), sense(at)),
    lambda at: at.value - at.p.sense * at.p.conductance * (at.signals.level - at.p.ambient),
    shapes=_rooms,
    usual=True,
    source="I. Newton 1701",
    look_alikes=("radiation", "second_store", "offset"),
    separated_by="let it cool from high: the temperature falls along an exponential",
)


def _zero(level: Local) -> Own:
    """State the absolute temperature at zero of the scale: one in degC begins near zero."""
    return shape("zero", level.unit, _ZERO if abs(level.start) < 0.5 * _ZERO else 0.0,
                 "absolute temperature at zero of the scale", around=None, scale=_ZERO,
                 fitted=False)  # fmt: skip


def _radiated(at: PortView) -> Expression:
    around = at.p.ambient + at.p.zero
    warm, cool = (at.signals.level + at.p.zero) / around, 1.0
    return at.value - at.p.sense * at.p.conductance * around * (warm**4 - cool) / 4.0


# The conductance is that of small differences, 4 emissivity area sigma ambient^3.
radiation = Law(
    "radiation",
    "Q = Q - conductance T_a / 4 [(T / T_a)^4 - 1]",
    _heat_stores_and_all,
    lambda at: (
        _conductance(at, "heat radiated over a small difference"),
        _around(at),
        _zero(at.level),
        sense(at),
    ),
    _radiated,
    shapes=_rooms,
    source="J. Stefan 1879, L. Boltzmann 1884",
    look_alikes=("heat_loss", "second_store"),
    separated_by="hold two temperatures far apart: the loss grows faster than the difference",
)


def _usually(*levels: Local) -> Own:
    """State the absolute temperature between those that exchange heat."""
    middles = [0.5 * sum(q.seen) if q.seen else q.start for q in levels]
    usual = sum(middles) / len(middles) + _zero(levels[0]).value
    return reference("usual", "K", usual or _ZERO, "usual absolute temperature")


def _wet(survey: Survey) -> Iterator[Fit]:
    """Yield the stores of heat whose temperature is one of liquid water."""
    for end, sites in heat_stores(survey):
        level = sites[0][0].level
        zero = _zero(level).value
        low, high = (t + zero for t in level.seen or (level.start, level.start))
        if low >= _ZERO and high <= _ZERO + 100.0:
            yield end, sites


def _vapour(at: PortView, absolute: Expression) -> Expression:
    """Return the pressure of saturated vapour over its slope at the usual temperature, in K."""
    usual = at.p.usual - _MAGNUS_ZERO
    steepness = _MAGNUS * (_ZERO - _MAGNUS_ZERO) / (usual * usual)
    above = (absolute - _ZERO) / (absolute - _MAGNUS_ZERO) - (at.p.usual - _ZERO) / usual
    return ca.exp(_MAGNUS * above) / steepness


def _evaporated(at: PortView) -> Expression:
    warm, around = (_vapour(at, t + at.p.zero) for t in (at.signals.level, at.p.ambient))
    return at.value - at.p.sense * at.p.conductance * (warm - around)


evaporation = replace(
    radiation,
    name="evaporation",
    equation="Q = Q - conductance [p_s(T) - p_s(T_d)] / (dp_s/dT at T_u)",
    where=_wet,
    parameters=lambda at: (
        _conductance(at, "heat lost to vapour over a small difference at the usual temperature"),
        replace(_around(at), text="dew point around"),
        _usually(at.level),
        _zero(at.level),
        sense(at),
    ),
    transform=_evaporated,
    source="J. Dalton 1802, with the vapour pressure of G. Magnus 1844: open water, moist goods",
    look_alikes=("heat_loss", "radiation", "overflow"),
)


def _head(at: Place) -> Local:
    """Return the temperature that a flow of heat lowers."""
    return at.signals.get("head", Local("head", "K"))


def _shone(at: PortView) -> Expression:
    warm, cool = ((t + at.p.zero) / at.p.usual for t in (at.signals.head, at.signals.back))
    return at.value + at.p.conductance * at.p.usual * (warm**4 - cool**4) / 4.0


radiant_exchange = Law(
    "radiant_exchange",
    "Q = Q + conductance T_u / 4 [(T_1 / T_u)^4 - (T_2 / T_u)^4]",
    each(
        "heat", "flow", needs=("head", "back"), label=lambda at: at.port.group,
        only=lambda at: same_dimension(_head(at).unit, "K"),
    ),
    lambda at: (
        size("conductance", per(at.unit, "K"), 0.1 * at.scale / _head(at).scale,
             100.0 * at.scale / _head(at).scale,
             "heat radiated over a small difference at the usual temperature"),
        _usually(_head(at), at.signals.get("back", _head(at))),
        _zero(_head(at)),
    ),
    _shone,
    source="J. Stefan 1879, L. Boltzmann 1884; a heater and what it heats, a wall and a load",
    look_alikes=("radiation", "outflow_exponent", "parameter_curve"),
    separated_by="the same difference of temperatures at two levels far apart",
)  # fmt: skip


def _stores(survey: Survey) -> list[Place]:
    """Return one flow of each store whose level is a state.

    What is lost leaves as the store has it: a flow is preferred that changes the level and nothing
    else, such as the heat of what flows in.
    """
    flows = survey.fitting("flow", "current")
    found: dict[str, Place] = {}
    for place in flows:
        if place.store:
            found.setdefault(place.store, survey.with_level(place))
    for place in flows:
        if "level" in place.signals and place.fills > 0.0:
            found.setdefault(place.level.source, place)
    return list(found.values())


def _over_brims(survey: Survey) -> Iterator[Fit]:
    stores = [q for q in _stores(survey) if q.role == "flow"]
    for i, place in enumerate(stores):
        below = [q for q in stores[i + 1 :] if q.unit == place.unit]
        yield f"_{place.port.group}", ((place, *below[:1]),)


def _spilled(at: PortView) -> Expression:
    spill = at.p.coefficient * at.x.excess
    if at.index == 0:
        return at.value - at.p.sense * spill
    return at.value + at.p.sense_below * at.p.caught * spill


def _excess(e: EffectView) -> Expression:
    at = e.here
    return at.form.ramp(at.signals.level - e.p.limit, 0.005 * e.p.level_scale)


def _brims(at: Place) -> list[float]:
    """Levels worth trying: without the spill the level seems to rise beyond the brim."""
    level = at.level
    if level.seen is None:
        return [k * level.scale for k in (1.0, 1.5, 2.0)]
    low, high = level.seen
    return [low + k * (high - low) for k in (0.7, 0.85, 0.95)]


def _brim(at: Place) -> tuple[Own, ...]:
    level, rate = at.level, at.scale / at.level.scale
    caught = shape("caught", "1", 0.0, "part of the spill that is caught", between=(0.0, 1.0),
                   scale=0.5, source="")  # fmt: skip
    return (
        size("coefficient", per(at.unit, level.unit), 10 * rate, 100 * rate,
             "spill over excess level"),
        shape("limit", level.unit, _brims(at)[0], "level of the brim", around=(0.1, 10.0),
              read=level.read),
        _typical(level, level.scale),
        sense(at),
        floor(at, 0.5),
        *((caught, replace(sense(at.others[0]), name="sense_below")) if at.others else ()),
    )  # fmt: skip


overflow = Law(
    "overflow",
    "flow = flow - coefficient max(0, level - limit)",
    _over_brims,
    _brim,
    _spilled,
    states=lambda at: (State("excess", at.level.unit, at.level.scale, "level beyond the brim"),),
    rates=lambda e: {"excess": (_excess(e) - e.x.excess) / e.p.floor},
    start=lambda e: {"excess": _excess(e)},
    # Where there is a store below, all of the spill may fall into it, or nothing.
    shapes=lambda at: [
        {"limit": limit, **({"caught": caught} if at.others else {})}
        for limit in _brims(at)
        for caught in (0.0, 1.0)[: 1 + bool(at.others)]
    ],
    downhill=True,
    source="broad-crested brim, linearised",
    look_alikes=("saturation",),
    separated_by="fill slowly beyond the brim: the level stops rising",
)


def _each_store(survey: Survey) -> Iterator[Fit]:
    """Yield the stores that may run empty, as one of heat does not."""
    for place in _stores(survey):
        if not same_dimension(place.level.unit, "K"):
            yield f"_{place.port.group}", ((place,),)


def _each_effort(survey: Survey) -> Iterator[Fit]:
    """Yield the stores whose level times what flows is a power."""
    return (fit for fit in _each_store(survey) if fit[1][0][0].level.unit in ("V", "Pa"))


def _above(at: PortView) -> Expression:
    return at.form.ramp(at.signals.level - at.p.outlet, 0.01 * at.p.level_scale)


def _rooted(at: PortView) -> Expression:
    """Return the root of the level over the typical one, in proportion to it where next to none."""
    level = _above(at) / at.p.level_scale
    return level / sqrt(level + 1e-4)


def _outlet(at: Place) -> tuple[Own, ...]:
    level = at.level
    return (
        shape("outlet", level.unit, 0.0, "level of the outlet", around=None, scale=level.scale,
              fitted=False),
        sense(at),
        _typical(level, level.scale),
    )  # fmt: skip


# The root is rounded at an empty store, where its slope would be infinite.
orifice_outflow = Law(
    "orifice_outflow",
    "flow = flow - coefficient sqrt(level / level_scale)",
    _each_store,
    lambda at: (
        size_at(at, "coefficient", 0.1, 1.0, "outflow at the typical level", signed=True),
        *_outlet(at),
    ),
    lambda at: at.value - at.p.sense * at.p.coefficient * _rooted(at),
    source="E. Torricelli 1643",
    tells="level_scale",
    look_alikes=("linear_outflow", "saturating_outflow", "overflow", "offset"),
    separated_by="let the store run empty: the level falls along a parabola, not an exponential",
)

linear_outflow = Law(
    "linear_outflow",
    "flow = flow - conductance (level - outlet)",
    _each_store,
    lambda at: (
        _conductance(at, "outflow over level", most=2.0, signed=True),
        *_outlet(at)[:2],
    ),
    lambda at: at.value - at.p.sense * at.p.conductance * (at.signals.level - at.p.outlet),
    source="laminar leak, G. Hagen 1839; leak resistance",
    look_alikes=("orifice_outflow", "saturating_outflow", "overflow", "offset"),
    separated_by="let the store run empty: the level falls along an exponential",
)

# Of a voltage or a pressure: what a converter or a pump takes at a constant power.
constant_power_outflow = Law(
    "constant_power_outflow",
    "flow = flow - coefficient level_scale / level",
    _each_effort,
    lambda at: (
        size_at(at, "coefficient", 0.1, 1.0, "outflow at the typical level", signed=True),
        sense(at),
        _typical(at.level, at.level.largest),
    ),
    # An empty store gives none.
    lambda at: at.value
    - at.p.sense * at.p.coefficient * at.p.level_scale * at.signals.level
    / (at.signals.level**2 + (0.03 * at.p.level_scale) ** 2),
    source="A. Emadi et al., IEEE Trans. Vehicular Technology 55 (2006) 1112: constant power loads",
    tells="level_scale",
    look_alikes=("linear_outflow", "saturating_outflow", "offset"),
    separated_by="two levels of the store: what flows out grows where it falls",
)  # fmt: skip

quadratic_outflow = replace(
    linear_outflow,
    name="quadratic_outflow",
    equation="flow = flow - coefficient (level - outlet)^2",
    parameters=lambda at: (
        size_at(at, "coefficient", 0.1, 2.0, "outflow over squared level", over=at.level, power=2,
                signed=True),
        *_outlet(at),
    ),
    transform=lambda at: at.value - at.p.sense * at.p.coefficient * _above(at) ** 2,
    source="P.-F. Verhulst 1845: what crowds; reactions of second order, recombination",
    look_alikes=("linear_outflow", "saturating_outflow", "overflow"),
    separated_by="two levels far apart: what is lost grows faster than the level",
)  # fmt: skip

saturating_outflow = Law(
    "saturating_outflow",
    "flow = flow - largest level / (half_level + level)",
    _each_store,
    lambda at: (
        size_at(at, "largest", 0.1, 1.0, "outflow that it saturates at", signed=True),
        shape("half_level", at.level.unit, at.level.scale, "level with half of that outflow",
              around=(1e-3, 50.0)),
        *_outlet(at),
    ),
    lambda at: at.value
    - at.p.sense * at.p.largest * _above(at) / (at.p.half_level + _above(at)),
    shapes=lambda at: [{"half_level": part * at.level.scale} for part in (0.01, 0.1, 1.0)],
    source="L. Michaelis and M. L. Menten 1913: uptake by enzymes, growth, evaporation",
    look_alikes=("linear_outflow", "orifice_outflow", "offset"),
    separated_by="low levels against high ones: it is linear in the first, constant in the second",
)  # fmt: skip


def _pairs(survey: Survey) -> Iterator[Fit]:
    joined = {q.name for q in survey.places if q.name.endswith(".exchange")}
    filled = [q for q in _stores(survey) if q.fills > 0.0]
    for a, b in combinations(filled, 2):
        names = a.level.source, b.level.source
        alike = a.level.unit == b.level.unit and a.unit == b.unit
        if alike and f"{'_'.join(names)}.exchange" not in joined:
            site = tuple(q.with_signal("beyond", r.level) for q, r in ((a, b), (b, a)))
            yield f"_{'_'.join(names)}", (site,)


def _crossing(at: PortView) -> Expression:
    down = at.p.conductance * (at.signals.level - at.signals.beyond)
    return at.value - (down if at.index == 0 else at.p.ratio * down)


# Of two chambers or tanks the model knows no way between: a worn seal, a crack in a wall.
cross_flow = Law(
    "cross_flow",
    "flow_1 = flow_1 - conductance (level_1 - level_2),"
    " flow_2 = flow_2 + ratio conductance (level_1 - level_2)",
    _pairs,
    lambda at: (
        _conductance(at, "flow from one store to the other over the difference", 0.05, 1.0),
        shape("ratio", "1", 1.0, "capacity of the first store over that of the second",
              around=(1e-2, 1e2)),
    ),
    _crossing,
    source="laminar leak, G. Hagen 1839",
    look_alikes=("linear_outflow", "viscous_friction", "creep"),
    separated_by="shut what drives them with unequal levels: their sum stays",
)  # fmt: skip


def _also_of_heat(survey: Survey) -> Iterator[Fit]:
    stores = dict(heat_stores(survey))
    yield from (stores | {n: f for n, f in _each_store(survey) if n not in stores}).items()


# A second store that the model lumps with the first: a wall beside the water that it holds, tissue
# beside blood, ground beside soil. Its capacity is conductance times time constant.
second_store = Law(
    "second_store",
    "flow = flow - conductance (level - z), dz/dt = (level - z) / time_constant",
    _also_of_heat,
    lambda at: (
        _conductance(at, "flow to the other store over the difference"),
        shape("time_constant", "s", 0.03 * at.lasting, "time in which the other store follows",
              around=(0.01, 100.0)),
        sense(at),
    ),
    lambda at: at.value - at.p.sense * at.p.conductance * (at.signals.level - at.x.beside),
    states=lambda at: (
        State("beside", at.level.unit, at.level.scale, f"level of the store beside {at.name}",
              at.level.start, start_rms=0.1 * at.level.scale),
    ),
    rates=lambda e: {"beside": (e.here.signals.level - e.x.beside) / e.p.time_constant},
    start=lambda e: {"beside": e.here.signals.level},
    shapes=lambda at: [{"time_constant": part * at.lasting} for part in (0.03, 0.1, 0.01)],
    source="two compartments, T. Teorell 1937; two lumped heat capacities",
    look_alikes=("linear_outflow", "heat_loss", "radiation", "cross_flow", "creep"),
    separated_by="a step of what flows in, then rest: the level goes with two time constants",
)  # fmt: skip


def _beside_inputs(survey: Survey) -> Iterator[Fit]:
    for name, ((place,),) in _also_of_heat(survey):
        for beyond in survey.inputs_alike(place.level):
            site = place.with_signal("beyond", beyond)
            yield f"{name}_{beyond.source}", ((site,),)


# What a store exchanges with something that is recorded: the weather, a jacket, a reservoir.
exchange_with_input = Law(
    "exchange_with_input",
    "flow = flow - conductance (level - u)",
    _beside_inputs,
    lambda at: (_conductance(at, "flow to it over the difference", signed=True), sense(at)),
    lambda at: at.value - at.p.sense * at.p.conductance * (at.signals.level - at.signals.beyond),
    source="I. Newton 1701, A. Fick 1855",
    look_alikes=("heat_loss", "linear_outflow", "second_store"),
    separated_by="what it exchanges with changes, and nothing else",
)


def _of_head(at: Place) -> Own:
    head = at.other("head")
    return _typical(head, head.largest)


def _of_drop(at: Place) -> Own:
    """Return the typical level that drives a flow, or difference of two levels."""
    own = _of_head(at)
    return replace(own, value=0.1 * own.value) if "back" in at.signals else own


def _steeper(at: PortView) -> Expression:
    width = 1e-3 * at.p.level_scale
    if "back" in at.signals:
        level = at.form.absolute(at.signals.head - at.signals.back, width)
    else:
        level = at.form.ramp(at.signals.head, width)
    return at.value * ca.exp(at.p.exponent * ca.log(level / at.p.level_scale + 1e-3))


outflow_exponent = Law(
    "outflow_exponent",
    "flow = flow (level / level_scale)^exponent; between two stores the difference of levels",
    each("flow", needs=("head",)),
    lambda at: (
        size("exponent", "1", 0.1, 2.0, "exponent beyond that of the model", signed=True),
        _of_drop(at),
    ),
    _steeper,
    source="discharge of pipes, between H. Darcy 1857 (1/2) and G. Hagen 1839 (1); heat carried by"
    " free convection (5/4)",
    look_alikes=("outlet_head", "linear_outflow", "orifice_outflow"),
    separated_by="let the store run empty from the top and note the level over time",
)


outlet_head = Law(
    "outlet_head",
    "flow = flow(level + height)",
    # What flows by a difference of temperatures has no pipe that may end below zero.
    each("flow", needs=("head",), only=lambda at: not same_dimension(_head(at).unit, "K")),
    lambda at: (
        size("height", at.other("head").unit, 0.05 * _of_head(at).value, 2.0 * _of_head(at).value,
             "head of the outlet below the zero of the level", signed=True),
        _of_head(at),
    ),
    lambda at: ca.substitute(
        ca.SX(at.value), ca.SX(at.signals.head), ca.SX(at.signals.head) + at.p.height
    ),
    source="E. Torricelli 1643: what counts is the height above the end of the pipe",
    look_alikes=("outflow_exponent", "linear_outflow", "orifice_outflow", "offset"),
    separated_by="let the store run empty: with a pipe below it still flows at level zero",
)  # fmt: skip


def _falling(z: Expression) -> Expression:
    """Return 1 / (1 + z) for positive z and 1 - z for negative: one line through z = 0."""
    return 1.0 / (1.0 + maximum(z, 0.0)) + maximum(-z, 0.0)


def _growth(of: Local, *, signed: bool) -> tuple[Own, ...]:
    usual = 0.2 / of.scale**2
    return (
        size("growth", per("1", of.unit, 2), usual, 50.0 * usual,
             "relative change over the square", signed=signed),
    )  # fmt: skip


saturating_inductance = Law(
    "saturating_inductance",
    "L = L_0 / (1 + growth i^2)",
    each("circuit", needs=("speed",), only=lambda at: at.whole),
    lambda at: _growth(at.speed, signed=False),
    lambda at: at.value * (1.0 + at.p.growth * at.signals.speed**2),
    usual=True,
    source="O. Froelich 1881, magnetisation of iron",
    look_alikes=("viscous_friction", "cubic_drag", "varying_capacitance"),
    separated_by="steps of the voltage at a small and at a large current: the rise is steeper",
)


varying_capacitance = replace(
    saturating_inductance,
    name="varying_capacitance",
    equation="C = C_0 (1 + growth u^2)",
    where=each("current", needs=("level",), only=lambda at: at.whole),
    parameters=lambda at: _growth(at.level, signed=True),
    transform=lambda at: at.value * _falling(at.p.growth * at.signals.level**2),
    source="ceramic of high permittivity, junction of a diode",
    look_alikes=("saturating_inductance", "linear_outflow"),
    separated_by="the same current into the capacitor at a small and at a large voltage",
)
