"""Through which ports the parameters of a model enter its equations."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import casadi as ca
import numpy as np

from workbench.model import Parameter
from workbench.physics.ports import Ports, same

_VISIBLE = 0.02
"""Part of a port's scale that a parameter must bring in to be offered a change with time."""


def through_one(ports: Ports, known: Collection[str]) -> tuple[tuple[Parameter, ...], ...]:
    """Return the refitted parameters that each port alone brings into the equations.

    Args:
        known: Names of effects whose parameters are left out.
    """
    t, found = ports.trace, [list[Parameter]() for _ in ports.trace.ports]
    for k, q in enumerate(ports.model.parameters):
        if not q.fitted or q.name.partition(".")[0] in known:
            continue
        whole = ports.whole_slope(k)
        for i in range(len(t.ports)):
            slope = ca.jacobian(ports.value(i), t.p[k])
            if slope.is_zero() or not same(ports.sampled(ports.by_port[:, i] * slope), whole):
                continue
            part = ports.sampled(slope * t.p[k])
            if np.nanmax(np.abs(part)) >= _VISIBLE * t.ports[i].scale:
                found[i].append(q)
            break
    return tuple(tuple(each) for each in found)


def is_gain(ports: Ports, q: Parameter, index: int) -> bool:
    """Tell whether a parameter is a mere gain of what is driven, which has laws of its own."""
    value, own = ports.value(index), ports.symbol_of(q)
    part = ports.sampled(ca.jacobian(value, own) * own)
    return any(ports.entered[index]) and same(part, ports.sampled(value))


def through_several(
    ports: Ports, apart: Sequence[Sequence[Parameter]]
) -> list[tuple[Parameter, list[str]]]:
    """Return the refitted parameters of the plant that several ports bring in, with their names.

    Args:
        apart: What each port alone brings in, as of `through_one`.
    """
    t, found = ports.trace, []
    taken = {q.name for of_port in apart for q in of_port}
    for k, q in enumerate(ports.model.parameters):
        if not q.fitted or q.name in taken or "." in q.name:
            continue
        slopes = [ca.jacobian(ports.value(i), t.p[k]) for i in range(len(t.ports))]
        at = [i for i, slope in enumerate(slopes) if not slope.is_zero()]
        through = sum(ports.by_port[:, i] * slopes[i] for i in at)
        if len(at) > 1 and same(ports.sampled(through), ports.whole_slope(k)):
            found.append((q, [t.ports[i].name for i in at]))
    return found
