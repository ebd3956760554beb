"""Entries for ports of no special kind: drives, flows and levels of any plant."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import Model, Port
from workbench.physics.dead_band import dead_band
from workbench.physics.delay import command_delay
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.offset_gain import gain, offset
from workbench.physics.overflow import overflow
from workbench.physics.saturation import rectification, saturation

_DRIVES = (".command", ".voltage", ".current")
_FLOWS = (".flow", ".inflow", ".outflow")
_HANDLED = ("valve.", "chamber", "supply.", "exhaust_", "line_", "muscle")


def entries(model: Model) -> Iterator[Hypothesis]:
    """Yield what drives and flows of any plant may lack.

    Args:
        model: The model; drives are the ports ``*.command``, ``*.voltage`` and ``*.current``, flows
            ``*.flow``, ``*.inflow`` and ``*.outflow``, those of valves and air apart.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> list(entries(servo_axis()))
        []
    """
    for port in model.ports:
        if port.name.startswith(_HANDLED):
            continue
        if port.name.endswith(_DRIVES):
            yield from _drive(port)
        elif port.name.endswith(_FLOWS):
            yield from _flow(model, port)


def _basic(port: Port) -> Iterator[Hypothesis]:
    where = port.name.replace(".", "_")
    yield Hypothesis(
        offset(
            (port.name,),
            amount=0.0,
            unit=port.unit,
            upper=port.scale,
            typical=0.05 * port.scale,
            look_alikes=("gain",),
            name=f"offset_{where}",
        ),
        "amount",
        0.05 * port.scale,
        0.005 * port.scale,
        law="offset",
    )
    yield Hypothesis(
        gain((port.name,), excess=0.0, look_alikes=("offset",), name=f"gain_{where}"),
        "excess",
        0.05,
        0.01,
        law="gain",
    )
    yield Hypothesis(
        saturation(
            (port.name,),
            share=0.0,
            limit=port.scale,
            unit=port.unit,
            scale=port.scale,
            look_alikes=("gain",),
            name=f"saturation_{where}",
        ),
        "share",
        1.0,
        0.5,
        law="saturation",
        shapes=tuple({"limit": share * port.scale} for share in (1.0, 0.5, 2.0)),
    )
    # An inflow or outflow has its direction in its name: cutting its negative part does nothing.
    if not port.name.endswith((".inflow", ".outflow")):
        yield Hypothesis(
            rectification((port.name,), share=0.0, scale=port.scale, name=f"rectification_{where}"),
            "share",
            1.0,
            0.2,
            law="rectification",
        )


def _drive(port: Port) -> Iterator[Hypothesis]:
    where = port.name.replace(".", "_")
    yield from _basic(port)
    yield Hypothesis(
        dead_band(
            (port.name,),
            half_width=0.0,
            unit=port.unit,
            corner=0.01 * port.scale,
            upper=port.scale,
            typical=0.05 * port.scale,
            name=f"dead_band_{where}",
        ),
        "half_width",
        0.05 * port.scale,
        0.005 * port.scale,
        law="dead_band",
    )
    yield Hypothesis(
        command_delay(
            port.name,
            time=0.0,
            unit=port.unit,
            scale=port.scale,
            look_alikes=("gain",),
            name=f"delay_{where}",
        ),
        "time",
        0.01,
        0.001,
        law="delay",
        far=True,
    )


def _flow(model: Model, port: Port) -> Iterator[Hypothesis]:
    yield from _basic(port)
    levels = [s for s in port.signals if s in ("level", f"{port.group}_level")]
    if not port.name.endswith((".flow", ".inflow")) or not levels:
        return
    state = next((q for q in model.states if q.name == levels[0]), None)
    scale, unit = (state.scale, state.unit) if state is not None else (1.0, "1")
    rate = port.scale / scale
    # What runs over falls, if anywhere, into the next store that the equations fill.
    inflows = [q for q in model.ports if q.name.endswith(".inflow") and q.unit == port.unit]
    below = inflows[inflows.index(port) + 1 :] if port in inflows else []
    yield Hypothesis(
        overflow(
            port.name,
            coefficient=0.0,
            limit=scale,
            into=below[0].name if below else "",
            level_signal=levels[0],
            unit=port.unit,
            level_unit=unit,
            level_scale=scale,
            upper=100 * rate,
            typical=10 * rate,
            name=f"overflow_{port.group}",
        ),
        "coefficient",
        10 * rate,
        0.5 * rate,
        law="overflow",
        shapes=tuple({"limit": k * scale} for k in (1.0, 1.5, 2.0)),
    )
