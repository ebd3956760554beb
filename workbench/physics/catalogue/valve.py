"""Entries for a servovalve: command, spool and metering edges."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import Model
from workbench.physics.dead_band import dead_band
from workbench.physics.delay import command_delay
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.leakage import centre_leakage, edge_leakage
from workbench.physics.offset_gain import asymmetric_gain, gain, offset
from workbench.physics.play import command_play, play, spool_hysteresis
from workbench.physics.slew_limit import slew_limit


def entries(model: Model) -> Iterator[Hypothesis]:
    """Yield what a servovalve may lack.

    Args:
        model: The model; its valve is the ports ``valve.command``, ``valve.spool`` and the edges
            ``valve.supply_*`` and ``valve.exhaust_*``.

    Example:
        >>> from workbench.plants.arm import servovalve
        >>> [entry.name for entry in entries(servovalve())][:3]
        ['valve_offset', 'valve_delay', 'slew_limit']
    """
    ports = {q.name: q for q in model.ports}
    if "valve.command" in ports:
        yield Hypothesis(
            offset(
                amount=0.0,
                look_alikes=("asymmetric_gain", "constant_torque", "edge_gain", "edge_leakage"),
                separated_by="small steps to both sides of the centre against large ones",
                name="valve_offset",
            ),
            "amount",
            0.1,
            0.005,
        )
        yield Hypothesis(
            command_delay(time=0.0, name="valve_delay"),
            "time",
            0.005,
            0.001,
            law="valve_delay",
            far=True,
            # Whatever moves is late by the same time, or is read late by it.
            same_as=("clock_shift",) if len(model.inputs) == 1 else (),
        )
        yield Hypothesis(
            slew_limit(share=0.0),
            "share",
            1.0,
            0.5,
            shapes=tuple({"largest_rate": r} for r in (1000.0, 300.0, 100.0)),
        )
        yield Hypothesis(command_play(half_width=0.0), "half_width", 0.03, 0.005, law="play")
    if "valve.spool" in ports:
        yield Hypothesis(dead_band(half_width=0.0), "half_width", 0.1, 0.01)
        yield Hypothesis(asymmetric_gain(difference=0.0), "difference", 0.1, 0.01)
        if "speed" in ports["valve.spool"].signals:
            yield Hypothesis(play(half_width=0.0), "half_width", 0.03, 0.005)
            yield Hypothesis(spool_hysteresis(half_width=0.0), "half_width", 0.02, 0.005)
    edges = [name for name in ports if name.startswith(("valve.supply_", "valve.exhaust_"))]
    if len(edges) > 1:
        yield Hypothesis(centre_leakage(tuple(edges), fraction=0.0), "fraction", 0.004, 0.001)
    for edge in edges:
        where = edge.removeprefix("valve.")
        yield Hypothesis(
            gain(
                (edge,),
                excess=0.0,
                typical=0.1,
                look_alikes=("asymmetric_gain", "valve_offset", "silencer"),
                separated_by="fill and vent each chamber alone over the same pressures",
                name=f"edge_gain_{where}",
            ),
            "excess",
            0.1,
            0.02,
            law="edge_gain",
        )
        yield Hypothesis(
            edge_leakage(edge, fraction=0.0, name=f"edge_leakage_{where}"),
            "fraction",
            0.004,
            0.0005,
            law="edge_leakage",
        )
