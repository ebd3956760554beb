"""What a current, a flow or a speed warms: a parameter that goes with its heat, a store.

The heat of what passes a resistance goes with its square. What it warms follows late: a winding
within minutes, a magnet or the oil of a gear within an hour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from workbench.model import State
from workbench.physics.law import Fit, Law, Own, reference, shape, size_at, with_subject
from workbench.physics.parameter_arguments import dissipating, gained, heating
from workbench.physics.place import Place
from workbench.physics.stores import heat_stores, sense
from workbench.physics.survey import Survey


def _warmed(survey: Survey) -> Iterator[Fit]:
    for q, places in gained(survey):
        if over := dissipating(survey, q, places):
            at = (replace(p, parameters=(q,)).with_signal("over", over) for p in places)
            yield f"_{q.name}", (tuple(at),)


def _largest(at: Place) -> Own:
    return reference("largest", at.over.unit, at.over.largest, "largest value seen")


own_warming = Law(
    "own_warming",
    "parameter + amount w, dw/dt = ((i / i_largest)^2 - w) / time_constant",
    _warmed,
    lambda at: (
        size_at(at.changed, "amount", 0.3, 10.0,
                "change of the parameter if the largest value lasted", signed=True),
        shape("time_constant", "s", 0.3 * at.lasting, "time in which it warms",
              around=(1e-3, 100.0)),
        _largest(at),
    ),
    lambda at: with_subject(at, at.subject + at.p.amount * at.x.warmth),
    states=lambda at: (
        State("warmth", "1", 1.0, "heat stored, over that of the largest value", start_rms=0.5),
    ),
    rates=lambda e: {
        "warmth": ((e.here.signals.over / e.p.largest) ** 2 - e.x.warmth) / e.p.time_constant
    },
    shapes=lambda at: [{"time_constant": part * at.lasting} for part in (0.3, 0.05, 1.0)],
    of_parameter=True,
    source="J. P. Joule 1841: copper warms with the square of the current, oil with that of the"
    " speed",
    look_alikes=("parameter_fade", "parameter_curve", "gain_fade"),
    separated_by="a long load, then the same motion as before it: it comes back as it cools",
)  # fmt: skip


def _heated(survey: Survey) -> Iterator[Fit]:
    for name, ((place,),) in heat_stores(survey):
        for over in heating(survey):
            at = place.with_signal("over", over)
            yield f"{name}_{over.source}", ((at,),)


resistive_heat = Law(
    "resistive_heat",
    "Q = Q + heat (i / i_largest)^2",
    _heated,
    lambda at: (
        size_at(at, "heat", 0.2, 20.0, "heat of the largest value", signed=True),
        _largest(at),
        sense(at),
    ),
    lambda at: at.value + at.p.sense * at.p.heat * (at.signals.over / at.p.largest) ** 2,
    source="J. P. Joule 1841",
    look_alikes=("bend", "parameter_curve", "heat_loss"),
    separated_by="the same current in both directions: the heat is the same",
)
