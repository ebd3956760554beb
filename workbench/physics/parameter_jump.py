"""A parameter of the plant that changes during a recording: at a time, or little by little.

Offered for every refitted parameter, of the plant or of an effect of it, that enters the equations
through one port alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.drift import gain_fade, offset_jump, passed, when
from workbench.physics.law import Fit, Own, shape, size
from workbench.physics.place import Place, Survey


def _each_parameter(survey: Survey) -> Iterator[Fit]:
    for place in survey.places:
        for q in place.parameters:
            yield f"_{q.name.replace('.', '_')}", ((replace(place, parameters=(q,)),),)


def _amount(at: Place) -> Own:
    if not at.parameters:
        return size("amount", "1", 1.0, 10.0, "change of the parameter", signed=True)
    q = at.parameters[0]
    return size("amount", q.unit, 0.3 * q.scale, 10.0 * q.scale,
                f"change of {q.name}", signed=True)  # fmt: skip


def _changed(at: PortView, part: Expression) -> Expression:
    own = ca.SX(at.subject)
    return ca.substitute(ca.SX(at.value), own, own + at.p.amount * part)


parameter_jump = replace(
    offset_jump,
    name="parameter_jump",
    equation="parameter + amount step(t - time)",
    where=_each_parameter,
    parameters=lambda at: (_amount(at), *when(at)),
    transform=lambda at: _changed(at, passed(at)),
    source="an event: a part that slipped, seized, or was switched",
    look_alikes=("parameter_fade", "gain_jump", "offset_jump"),
)

parameter_fade = replace(
    gain_fade,
    name="parameter_fade",
    equation="parameter + amount w, dw/dt = (1 - w) / tau",
    where=_each_parameter,
    parameters=lambda at: (
        _amount(at),
        shape("time_constant", "s", at.duration or 60.0, "time constant", around=(0.05, 100.0)),
    ),
    transform=lambda at: _changed(at, at.x.warm),
    source="warming, wear, ageing",
    look_alikes=("parameter_jump", "gain_fade"),
)
