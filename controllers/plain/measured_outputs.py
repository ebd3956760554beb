"""Which outputs a law reads, and how fast it may be for the equations of its plant.

A law reads the outputs that it follows, and others where no loop is within its limits without them,
or a much better one is with them. Where its steps are poor on the equations, it is slower than the
linear model lets it be (`controllers.plain.steps_on_equations`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from controllers.plain.limits import LoopLimits, LoopSpecification
from controllers.plain.loop import spare_outputs
from controllers.plain.selection import Answer
from controllers.plain.steps_on_equations import borne
from controllers.sensitivity import peaks
from workbench.computing import in_one_thread
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel

C = TypeVar("C")
Makes = Callable[[LoopLimits], C]
Helps = Callable[[LoopLimits, LoopLimits], bool]
"""Tells whether loops of the second limits, which read more, are much better."""

SLOWER, MUCH_LESS = (0.5, 0.25, 0.12), 0.7
"""Frequencies up to which a model is trusted that are tried, over what a loop asks of it whose
steps are poor; and what steps must cost at most, over those of the loop before, to be taken."""


@in_one_thread()
def designed_for(want: LoopSpecification, linear: Any, design: Makes[C], helps: Helps) -> C:
    """Return a design of the followed outputs, or of others too where that is what it takes.

    It is one whose steps the equations of the plant bear, slower than the linear model lets it be
    if it must.
    """
    from workbench.linearisation.state_space import linear_model

    whole = linear_model(linear)
    best = borne(_upon(want, whole, design, helps), whole, want)
    fast = want.trusted_frequency or math.inf
    if best.poor:
        law: Any = best.law
        fast = min(fast, peaks(law, whole).bandwidth / want.sample_time)
    for share in SLOWER if best.poor and fast < math.inf else ():
        slower = replace(want, trusted_frequency=share * fast)
        # A plant that is unstable needs so much.
        with suppress(WorkbenchError):
            most = MUCH_LESS * best.cost
            found = borne(_upon(slower, whole, design, helps), whole, want, most)
            best = found if found.cost < most else best
        if not best.poor:
            break
    return best.law


def _upon(want: LoopSpecification, linear: LinearModel, design: Makes[C], helps: Helps) -> C:
    """Return a design upon a linear model alone; see `designed_for`."""
    try:
        loop = want.loop(linear)
    except WorkbenchError:
        # What grows may show at what nobody follows.
        others = linear.output_names
        if want.also_measured or len(others) < 2:
            raise
        return _upon(replace(want, also_measured=others), linear, design, helps)
    more = () if loop.read is not None else spare_outputs(linear, loop)
    if not more:
        return design(LoopLimits(loop, want))
    wider = replace(want, also_measured=more).loop(linear)
    found: list[tuple[float, C]] = []
    both = [LoopLimits(tried, want) for tried in (loop, wider)]
    refused: dict[LoopLimits, WorkbenchError] = {}
    for limits in reversed(both) if helps(*both) else both:
        try:
            law: Any = design(limits)
        except WorkbenchError as error:
            refused[limits] = error
            continue
        own = limits
        if len(law.sensors) < limits.sensors:
            # An inner loop takes one of what may be read.
            read = tuple(name for name in law.sensors if name not in law.controlled)
            own = LoopLimits(replace(want, also_measured=read).loop(linear), want)
        found.append((own.excess(law), law))
        if found[-1][0] <= 1.0:
            break
    if not found:
        # What reads more says more.
        raise refused[both[1]]
    return min(found, key=lambda one: one[0])[1]


MUCH = 0.05
"""Largest share of the errors of a loop of the followed outputs alone for which others are read:
they go with the square of time, so that it is some five times as fast."""


def much_better(
    limits: LoopLimits, wider: LoopLimits, answered: Callable[[LoopLimits], tuple[float, Answer]]
) -> bool:
    """Tell whether a loop makes so much less of an error that what it reads more is worth it.

    Of loops within limits and wider ones, the excess, a ratio, and the answer are told.
    """
    found = []
    with suppress(WorkbenchError):
        for tried in (limits, wider):
            excess, own = answered(tried)
            if excess > 1.0:
                break
            found.append(own)
    if len(found) < 2:
        return False
    least = np.min([one.least for one in found], axis=0)
    without, with_it = (float(one.cost(limits.want.overshoot, least=least)[0]) for one in found)
    return with_it < MUCH * without
