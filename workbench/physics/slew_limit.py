"""Slew limit: a lag for small differences that follows large ones at its largest rate."""

from __future__ import annotations

import casadi as ca

from workbench.model import EffectView, State
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, by_port, each, first_of, shape, share
from workbench.physics.place import per


def _follow(e: EffectView) -> dict[str, Expression]:
    r, tau = e.p.largest_rate, e.p.time_constant
    return {"follower": r * ca.tanh((e.here.value - e.x.follower) / (r * tau))}


slew_limit = Law(
    "slew_limit",
    "dy/dt = r tanh((u - y) / (r tau))",
    first_of(each("valve_command"), each("command", "voltage", "circuit", label=by_port)),
    lambda at: (
        share("share of the limited signal"),
        shape("largest_rate", per(at.unit, "s"), 1000.0 * at.scale, "largest speed",
              around=(0.01, 10.0)),
        shape("time_constant", "s", 0.001, "time constant of small motions",
              around=(0.1, 100.0), source="", fitted=False),
    ),
    lambda at: at.value + at.p.share * (at.x.follower - at.value),
    states=lambda at: (
        State("follower", at.unit, at.scale, "signal with limited speed",
              start_rms=0.05 * at.scale),
    ),
    rates=_follow,
    start=lambda e: {"follower": e.here.value},
    shapes=lambda at: [{"largest_rate": k * at.scale} for k in (1000.0, 300.0, 100.0)],
    source="saturated first-order follower; manufacturer: 4 to 5 ms for the full stroke",
    look_alikes=("valve_delay", "spool_bandwidth"),
    separated_by="steps of the command of several sizes: only large ones are slowed",
)  # fmt: skip
