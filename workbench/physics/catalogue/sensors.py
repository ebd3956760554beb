"""Entries for sensors: offset, gain, lag, delay, clipping, drift, one by one and together."""

from __future__ import annotations

import math
from collections.abc import Iterator

from workbench.model import Model, Output, Port
from workbench.physics.delay import delay
from workbench.physics.drift import drift
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.lag import lag
from workbench.physics.offset_gain import gain, offset
from workbench.physics.saturation import saturation

_OFFSETS = {"Pa": (1e4, 1e3), "rad": (0.01, 0.001)}
"""Usual and least offset of sensors whose scale says little about their errors."""

_CLIPS = {"Pa": (4e5, 3e5, 5e5)}


def entries(model: Model, outputs: tuple[str, ...] | None = None) -> Iterator[Hypothesis]:
    """Yield what sensors may do: errors of one sensor, of all of a kind, of the common clock.

    Args:
        model: The model; its sensors are the ports ``NAME.reading`` of its outputs.
        outputs: Names of the outputs that are recorded; all by default.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> [entry.law for entry in entries(servo_axis())][:3]
        ['sensor_offset', 'sensor_gain', 'sensor_lag']
    """
    ports = {q.name: q for q in model.ports}
    wanted = [q for q in model.outputs if outputs is None or q.name in outputs]
    sensors = [(q, ports[f"{q.name}.reading"]) for q in wanted if f"{q.name}.reading" in ports]
    for output, port in sensors:
        yield from _single(model, output, port)
    kinds: dict[str, list[Port]] = {}
    for output, port in sensors:
        stem, _, number = output.name.rpartition("_")
        if number.isdigit():
            kinds.setdefault(stem, []).append(port)
    for stem, same in kinds.items():
        if len(same) > 1:
            yield from _together(stem, same)
    if len(sensors) > 1:
        readings = [port for _, port in sensors]
        yield Hypothesis(
            delay(
                tuple(q.name for q in readings),
                time=0.0,
                units=tuple(q.unit for q in readings),
                scales=tuple(q.scale for q in readings),
                look_alikes=("valve_delay", "spool_bandwidth", "sensor_delay"),
                separated_by="a common event seen by command and readings, such as a click",
                name="clock_shift",
            ),
            "time",
            0.01,
            0.002,
            "sensor",
            far=True,
            same_as=(
                ("valve_delay",) if len(model.inputs) == 1 and "valve.command" in ports else ()
            ),
        )


def _offset_sizes(unit: str, scale: float) -> tuple[float, float]:
    return _OFFSETS.get(unit, (0.02 * scale, 0.002 * scale))


def _single(model: Model, output: Output, port: Port) -> Iterator[Hypothesis]:
    size, least = _offset_sizes(port.unit, output.scale)
    where, ports, unit = output.name, (port.name,), port.unit
    yield Hypothesis(
        offset(
            ports,
            amount=0.0,
            unit=unit,
            upper=5 * size,
            typical=size,
            look_alikes=("sensor_gain", "sensor_drift", "constant_torque", "force_gain"),
            separated_by="compare with a reference at rest, at two levels",
            name=f"sensor_offset_{where}",
        ),
        "amount",
        size,
        least,
        "sensor",
        law="sensor_offset",
    )
    yield Hypothesis(
        gain(
            ports,
            excess=0.0,
            look_alikes=("sensor_offset", "force_gain"),
            name=f"sensor_gain_{where}",
        ),
        "excess",
        0.02,
        0.003,
        "sensor",
        law="sensor_gain",
    )
    yield Hypothesis(
        lag(ports, time=0.0, unit=unit, scale=output.scale, name=f"sensor_lag_{where}"),
        "time",
        0.02,
        0.002,
        "sensor",
        law="sensor_lag",
        far=True,
    )
    yield Hypothesis(
        delay(ports, time=0.0, unit=unit, scales=(output.scale,), name=f"sensor_delay_{where}"),
        "time",
        0.01,
        0.002,
        "sensor",
        law="sensor_delay",
        far=True,
    )
    yield Hypothesis(
        drift(
            ports,
            amount=0.0,
            unit=unit,
            upper=5 * size,
            typical=size,
            name=f"sensor_drift_{where}",
        ),
        "amount",
        size,
        2 * least,
        "sensor",
        law="sensor_drift",
    )
    limits = _clip_limits(model, output, port)
    yield Hypothesis(
        saturation(
            ports,
            share=0.0,
            limit=limits[0],
            unit=unit,
            scale=output.scale,
            name=f"sensor_clipping_{where}",
        ),
        "share",
        1.0,
        0.5,
        "sensor",
        law="sensor_clipping",
        shapes=tuple({"limit": limit} for limit in limits),
    )


def _clip_limits(model: Model, output: Output, port: Port) -> tuple[float, ...]:
    if port.unit in _CLIPS:
        return _CLIPS[port.unit]
    state = next((q for q in model.states if q.name == output.name), None)
    top = state.upper if state is not None and math.isfinite(state.upper) else 2.0 * output.scale
    if math.isfinite(output.upper):
        top = min(top, output.upper)
    return tuple(share * top for share in (0.75, 0.5, 0.9))


def _together(stem: str, ports: list[Port]) -> Iterator[Hypothesis]:
    names, unit = tuple(q.name for q in ports), ports[0].unit
    scale = ports[0].scale
    size, least = _offset_sizes(unit, scale)
    yield Hypothesis(
        lag(
            names,
            time=0.0,
            unit=unit,
            scale=scale,
            look_alikes=("sensor_lag", "sensor_delay", "clock_shift", "line"),
            name=f"sensor_lag_{stem}s",
        ),
        "time",
        0.02,
        0.002,
        "sensor",
        law="sensor_lag",
        far=True,
    )
    yield Hypothesis(
        delay(
            names,
            time=0.0,
            units=(unit,) * len(ports),
            scales=(scale,) * len(ports),
            name=f"sensor_delay_{stem}s",
        ),
        "time",
        0.01,
        0.002,
        "sensor",
        law="sensor_delay",
        far=True,
    )
    yield Hypothesis(
        offset(
            names,
            amount=0.0,
            unit=unit,
            upper=5 * size,
            typical=size,
            look_alikes=("sensor_gain", "sensor_offset", "force_gain"),
            separated_by="compare with a reference at rest, at two levels",
            name=f"sensor_offset_{stem}s",
        ),
        "amount",
        size,
        least,
        "sensor",
        law="sensor_offset",
    )
    yield Hypothesis(
        gain(
            names,
            excess=0.0,
            look_alikes=("sensor_offset", "sensor_gain", "force_gain"),
            name=f"sensor_gain_{stem}s",
        ),
        "excess",
        0.02,
        0.003,
        "sensor",
        law="sensor_gain",
    )
