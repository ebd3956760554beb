"""What an effort moves: its speed and its coordinate, from the structure of the equations."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.model.units import per, same_dimension
from workbench.physics.place import Local, coordinate_unit
from workbench.physics.ports import Ports, same

_STEADY = 0.2
"""Part of its middle by which a push on a body may change with where the plant is, to be one."""


def motion_of(ports: Ports, index: int, own: Mapping[str, Local]) -> dict[str, Local]:
    """Find what an effort moves: by the author's names, by what they are, by structure."""
    port = ports.trace.ports[index]
    unit = coordinate_unit(port.unit)
    origins = dict(zip(port.signals, port.origins, strict=True))
    speeds: list[str] = [s for s in origins if s in ("speed", "velocity")]
    speeds += [s for s, o in origins.items() if o in ports.integral and s not in speeds]
    speeds += [s for s in origins if s.endswith(("_speed", "_velocity")) and s not in speeds]
    moved = [
        q
        for q in ports.moved[index]
        if q.name in ports.integral or same_dimension(q.unit, f"{unit}/s")
    ]
    if unit == "1" and len(ports.moved[index]) == 1:
        # The water in a pipe: what accelerates it acts on a flow in m3/s.
        moved = list(ports.moved[index])
    # A force moves first what has a speed in m/s, a torque what has one in rad/s.
    moved.sort(
        key=lambda q: (
            not same_dimension(q.unit, f"{unit}/s"),
            q.name != ports.collocated.get(index),
        )
    )
    found: dict[str, Local] = {}
    place = ""
    if speeds:
        found["speed"] = ports.local(port, speeds[0], origins[speeds[0]], f"{unit}/s")
        place = ports.integral.get(origins[speeds[0]], "")
    elif own and (pair := _own_motion(ports, index, own)):
        found |= pair
    elif moved:
        found["speed"] = _between(ports, index, [q.name for q in moved])
        place = "" if found["speed"].minus else ports.integral.get(moved[0].name, "")
    named = [s for s in origins if s in ("coordinate", "angle", "position")]
    named += [s for s, o in origins.items() if place and o == place]
    if named:
        found["coordinate"] = ports.local(port, named[0], origins[named[0]], unit)
    elif place:
        found["coordinate"] = ports.of(place)
    elif "speed" in found and (where := _integral_of(ports, index, found["speed"], own)):
        found["coordinate"] = where
    return found


def _own_motion(ports: Ports, index: int, own: Mapping[str, Local]) -> dict[str, Local] | None:
    """Find a coordinate and its rate among a port's signals, or a signal that it drives."""
    for name, local in own.items():
        rate = ports.rate(index, local)
        for other, speed in own.items():
            if other != name and same(rate, ports.values(index, speed)):
                return {"coordinate": local, "speed": speed}
    driven = [q for q in own.values() if np.nanmax(np.abs(ports.push_rate(index, q))) > 0.0]
    ends = [q for q in driven if any(_is_rate(q.unit, u.unit) for u in own.values())]
    ends += [q for q in driven if not ports.trace.ports[index].role and q.unit.endswith("/s")]
    return {"speed": ends[0]} if ends else None


def _is_rate(unit: str, of: str) -> bool:
    return same_dimension(unit, per(of, "s"))


def _between(ports: Ports, index: int, moved: list[str]) -> Local:
    """Return the speed that an effort raises: of one body, or of one over another."""
    first = ports.of(moved[0])
    # What pushes one body off another does so wherever they are, whatever they weigh: a rope
    # that hangs askew passes a pull on to one side or the other.
    anywhere = [(x, u, ports.model.values) for x, u, _ in ports.points]
    raised = ports.sampled(ports.trace.rates_by_port[:, index], anywhere)
    for name in moved[1:]:
        columns = raised[:, [ports.state_index[moved[0]], ports.state_index[name]]]
        pair = np.nanmedian(columns, axis=0)
        steady = np.all(np.nanmax(np.abs(columns - pair), axis=0) < _STEADY * np.abs(pair))
        if not steady or pair[0] * pair[1] >= 0.0:
            continue
        ratio = _geared(ports, index, moved[0], name)
        if ratio < 1.0:
            return ports.over(moved[0], name, ratio)
        if ratio > 1.0:
            return ports.over(name, moved[0], 1.0 / ratio)
        if ports.known[name].unit == first.unit:
            return ports.over(*((name, moved[0]) if pair[0] < 0.0 else (moved[0], name)))
    return first


def _geared(ports: Ports, index: int, one: str, other: str) -> float:
    """Return how far one body moves another through a port, in the unit of that; or 1.

    The signal is a function of ``ratio * one - other``: of their places, or of their speeds.
    """
    value, own = ports.value(index), ports.symbols
    for pair in ([ports.integral.get(one), ports.integral.get(other)], [one, other]):
        slopes = [ca.jacobian(value, own[name]) for name in pair if name]
        if len(slopes) == 2 and not any(slope.is_zero() for slope in slopes):
            ratios = -ports.sampled(slopes[0] / slopes[1], ports.usual)
            if same(ratios, np.full_like(ratios, ratios[0])) and ratios[0] > 0.0:
                return 1.0 if abs(ratios[0, 0] - 1.0) < 1e-9 else float(ratios[0, 0])
    return 1.0


def _integral_of(ports: Ports, index: int, speed: Local, own: Mapping[str, Local]) -> Local | None:
    """Find the signal, state or difference of two states whose rate is a speed.

    Or times a speed: of the depth of a cage the angle of its drum.
    """
    moving = ports.values(index, speed)
    if not np.any(np.nan_to_num(moving)):
        return None
    states = [q for q in ports.model.states if "." not in q.name]
    single = [*own.values(), *(ports.of(q.name) for q in states)]
    pairs = [
        ports.over(a.name, b.name)
        for i, a in enumerate(states)
        for b in states[i + 1 :]
        if a.unit == b.unit
    ]
    ends = [ports.integral.get(name, "") for name in (speed.source, speed.minus)]
    if speed.ratio != 1.0 and all(ends):
        pairs.append(ports.over(ends[0], ends[1], speed.ratio))
    for local in (*single, *pairs):
        rate = ports.rate(index, local)
        for sign in (1.0, -1.0):
            if same(sign * rate, moving):
                return local.turned(sign)
    for state in (ports.of(q.name) for q in states) if speed.unit.endswith("/s") else ():
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = float(np.nanmedian(moving / ports.rate(index, state)))
        if math.isfinite(ratio) and same(ratio * ports.rate(index, state), moving):
            return state.geared(abs(ratio), speed.unit.removesuffix("/s")).turned(ratio)
    followed = [q for q in single if _follows(ports, q, speed)]
    sees = (q for q in followed if ports.slope(index, q).any())
    return next(sees, next(iter(followed), None))


def _follows(ports: Ports, place: Local, speed: Local) -> bool:
    """Tell whether a speed adds to a place, beside what else carries it off.

    So the pitch rate of an aircraft adds to the angle at which the wind meets it, and the rise
    of a boat through the water, beside its pitch, to its depth.
    """
    at, t = ports.state_index, ports.trace
    if place.source not in at or speed.source not in at or place.minus or speed.minus:
        return False
    own, over = at[place.source], t.x[at[speed.source]]
    slope = ports.sampled(ca.jacobian(t.rates[own], over))
    return _is_rate(speed.unit, place.unit) and same(slope, np.ones_like(slope))


def carried_motion(ports: Ports, index: int, motion: Mapping[str, Local]) -> dict[str, Local]:
    """Return place and speed over what carries a body, where an input moves that.

    So the travel of a seat is its height over the floor.
    """
    value, own = ports.value(index), ports.symbols

    def over(local: Local) -> Local:
        if local.minus or local.source not in ports.state_index:
            return local
        slope = ports.sampled(ca.jacobian(value, own[local.source]))
        bases = (q.name for q in ports.model.inputs if q.unit == local.unit)
        based = (q for q in bases if same(-ports.sampled(ca.jacobian(value, own[q])), slope))
        return next((ports.over(local.source, q).turned(local.sign) for q in based), local)

    found = {name: over(local) for name, local in motion.items()}
    carried = {name: q for name, q in found.items() if q is not motion[name]}
    return carried if "coordinate" in carried else _filling(ports, value, motion)


def _filling(ports: Ports, value: ca.SX, motion: Mapping[str, Local]) -> dict[str, Local]:
    """Return speed over an input, where the port sees what the two of them alone fill.

    So the water of a tunnel that no turbine takes rises in a surge shaft, through its throat.
    """
    speed, own, t = motion.get("speed"), ports.symbols, ports.trace
    if speed is None or speed.minus or speed.source not in ports.state_index:
        return {}
    bases = [q.name for q in ports.model.inputs if q.unit == speed.unit]
    for i in ports.state_index.values() if bases else ():
        slope = ports.sampled(ca.jacobian(t.rates[i], own[speed.source]))
        if not ca.depends_on(value, t.x[i]) or not np.any(np.nan_to_num(slope)):
            continue
        for base in bases:
            passed = slope * ports.sampled(own[speed.source] - own[base])
            if same(passed, ports.sampled(t.rates[i])):
                return {"speed": ports.over(speed.source, base).turned(speed.sign)}
    return {}


def directed_motion(
    ports: Ports, index: int, motion: dict[str, Local]
) -> tuple[dict[str, Local], bool]:
    """Turn speed and coordinate so that more of the signal raises them.

    Where the signal drives nothing, as the force that a rig measures, it is taken to resist.
    """
    if not motion:
        return motion, True
    signs: list[float] = []
    if "speed" in motion:
        signs.append(_sign(ports.push_rate(index, motion["speed"])))
    if not any(signs):
        signs += [
            -_sign(ports.slope(index, motion[q])) for q in ("speed", "coordinate") if q in motion
        ]
    sign = next((q for q in signs if q), 0.0)
    return {k: q.turned(sign) for k, q in motion.items()}, bool(sign)


def is_elastic(ports: Ports, index: int, at: Local) -> bool:
    """Tell whether a signal is a straight line over a coordinate, of a fixed slope."""
    place, value = ports.expression(index, at), ports.value(index)
    slopes = [ca.jacobian(value, q) / ca.jacobian(place, q) for q in ca.symvar(place)]
    return (
        bool(slopes)
        and not any(ca.depends_on(q, ports.trace.x) for q in slopes)
        and all(
            same(ports.sampled(q, ports.usual), ports.sampled(slopes[0], ports.usual))
            for q in slopes
        )
    )


def muscle_signals(ports: Ports, index: int, own: Mapping[str, Local]) -> dict[str, Local]:
    """Find pressure and length of a force whose slope over the one depends on the other."""
    known = [(q, e) for q in own.values() if (e := ports.expression(index, q)).is_symbolic()]
    for pressure, p in known:
        slope = ca.jacobian(ports.value(index), p)
        for length, x in known:
            units = same_dimension(pressure.unit, "Pa") and same_dimension(length.unit, "m")
            if units and not ca.jacobian(slope, x).is_zero():
                return {"contraction": length, "gauge_pressure": pressure}
    return {}


def _sign(values: Vector) -> float:
    """Return the sign that all values have, or 0."""
    signs = set(np.sign(values[np.isfinite(values)]).tolist())
    return float(signs.pop()) if len(signs) == 1 else 0.0
