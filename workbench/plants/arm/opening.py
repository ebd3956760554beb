"""What general rooms may know of the arm: its mean pressure, limits, and the valve's curve.

The curve of a valve with soft overlap is almost flat at rest, 2 % of the opening per volt against
20 % on average, so a linear model by the voltage is wrong from 0.1 V on. A controller decides the
signed opening instead (positive fills chamber 1 and vents chamber 2) and sends it through the
inverse of the static curve. What it then controls is the plant whose edges open in proportion to
the spool; that plant has one kink left, between filling and venting.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from workbench.model import ActuatorCurve, DriftingSum, Effect, Traits

EDGES = {
    "valve.supply_1": 1.0,
    "valve.exhaust_2": 1.0,
    "valve.supply_2": -1.0,
    "valve.exhaust_1": -1.0,
}
"""Ports of the metering edges of one 5/3 valve, with the sign of the spool that opens them."""

FULL_STROKE = 5.0
"""Spool voltage from the centre at which a proportional edge is fully open, V."""

_WIDTH = 0.04


def proportional_edges(edges: Mapping[str, float] = EDGES, suffix: str = "") -> Effect:
    """Build edges that open in proportion to the spool, in place of the valve's curve.

    ``opening = max(0, +-spool / 5 V)``
    """
    return Effect(
        f"proportional_edges{suffix}",
        tuple(edges),
        lambda at: at.form.ramp(edges[at.port] * at.signals.spool, _WIDTH) / FULL_STROKE,
    )


_ARM = Traits(
    limits=tuple(
        (name, ("ambient_pressure",), ("ambient_pressure", "supply_pressure"))
        for name in ("pressure_1", "pressure_2")
    ),
    stops=(("angle", ("lower_stop",), ("upper_stop",)),),
    choices=("load", "supply_pressure"),
)

ONE_VALVE = replace(
    _ARM,
    sums=(
        DriftingSum(
            "mean_pressure",
            "Pa",
            weights=(("pressure_1", 0.5), ("pressure_2", 0.5)),
            drifting=(("pressure_1", 1.0), ("pressure_2", 1.0)),
            lower=0.0,
            upper=("supply_pressure",),
            display_unit="bar",
            scale=1e5,
        ),
    ),
    curves=(
        ActuatorCurve(
            "opening",
            state="spool",
            full=FULL_STROKE,
            straight=proportional_edges,
            signals=(("valve.supply_1", 1.0), ("valve.supply_2", -1.0)),
        ),
    ),
)
"""Of the arm with one 5/3 valve: the mean pressure drifts to where leakage holds it."""

TWO_VALVES = replace(
    _ARM,
    curves=tuple(
        ActuatorCurve(
            f"opening_{i}",
            state=f"spool_{i}",
            full=FULL_STROKE,
            straight=partial(
                proportional_edges,
                {f"valve.supply_{i}": 1.0, f"valve.exhaust_{i}": -1.0},
                f"_{i}",
            ),
            signals=((f"valve.supply_{i}", 1.0), (f"valve.exhaust_{i}", -1.0)),
            input=f"valve_{i}",
        )
        for i in (1, 2)
    ),
)
"""Of the arm with one valve per muscle."""
