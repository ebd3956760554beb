"""References that the equations bear which a linear model is one of.

A law is designed on the linear model alone. Before it is handed out, it is run on the model's own
equations through a step of each output and back, as far as a first trial steps it
(`workbench.linearisation.first_step`). Where that overshoots by much more than is allowed, or is
lost, as where a plant answers more the farther it goes, references are led there in several times
the rise of the step.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np

from controllers.plain.loop import LoopSpecification, PlainLaw
from workbench.linearisation.first_step import command_of_loop, step_of
from workbench.linearisation.from_rest import FromRest, bends

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

P = TypeVar("P")


class Stepped(NamedTuple):
    """What a step of an output and back comes to.

    Args:
        overshoot: The larger, as a fraction of the step; infinite where the plant is lost.
        error: Integral of time by absolute error, in samples squared, of unit steps.
        rise: Samples after which 63 % of the step is reached.
    """

    overshoot: float
    error: float
    rise: int


def borne(law: P, linear: LinearModel, want: LoopSpecification) -> P:
    """Return the law with references that the equations of its plant bear, each of its own."""
    found: Any = law
    if not bends(linear):
        return law
    run = _Run(found, linear, want)
    for i in range(len(found.controlled)):
        found = run.led(found, i)
    return cast(P, found)


class _Run:
    """Steps of a law on the equations at whose operating point it was designed."""

    def __init__(self, law: Any, linear: LinearModel, want: LoopSpecification) -> None:
        self.linear, self.want = linear, want
        self.plant = FromRest(linear, want.sample_time, law.actuators, law.sensors)

    def led(self, law: Any, i: int) -> Any:
        """Return the law with the best references of an output."""
        names, model = law.controlled, self.linear.operating_point.model
        command = command_of_loop(self.linear, names[i]) if len(names) == 1 else ""
        size = step_of(model, self.linear, names[i], names, command)
        first = self.stepped(law, i, size)
        if first.overshoot < self.want.overshoot + MORE:
            return law
        laws = [law, *(slower(law, i, abs(size), by * first.rise) for by in SLOWER)]
        found = [first, *(self.stepped(one, i, size) for one in laws[1:])]
        over = [max(each.overshoot - self.want.overshoot, 0.0) for each in found]
        cost = [one.error * (1.0 + OVERSHOT * x) ** 3 for one, x in zip(found, over, strict=True)]
        return laws[int(np.argmin(cost))]

    def stepped(self, law: Any, i: int, size: float) -> Stepped:
        """Return what a step of one output, in SI, and back comes to."""
        plant, lost = self.plant, Stepped(math.inf, math.inf, 1)
        plant.start()
        state = law.initial_state(tuple(plant.rest))
        coming = [plant.command] * round(self.want.delay / self.want.sample_time)
        at, asked = law.sensors.index(law.controlled[i]), plant.rest[: len(law.controlled)]
        overshoot, error, rise = 0.0, 0.0, 0
        for sign in (1.0, -1.0):
            asked[i] += sign * size
            away = np.zeros(SAMPLES)
            for k in range(SAMPLES):
                y = plant.read()
                away[k] = sign * (y[at] - asked[i]) / size
                if not abs(away[k]) < LOST:
                    return lost
                if k % BLOCK == BLOCK - 1 and np.all(np.abs(away[k + 1 - BLOCK : k + 1]) < SETTLED):
                    break
                reference = tuple(asked) * (1 + law.preview)
                command, state, _ = law.step(state, tuple(y.tolist()), reference)
                coming.append(command)
                if not plant.hold(coming.pop(0)):
                    return lost
            away = away[: k + 1]
            overshoot = max(overshoot, float(away.max()))
            error += float(np.arange(len(away)) @ np.abs(away))
            rise = rise or max(int(np.argmax(away > -0.37)), 1)
        return Stepped(overshoot, error, rise)


def slower(law: P, i: int, size: float, samples: float) -> P:
    """Return the law whose reference of an output takes so many samples for a step, in SI."""
    own: Any = law
    none = (math.inf,) * len(own.controlled)
    # Half of the time it gets faster, and half of it slower, if it can brake.
    name, most = "brake", 4.0 * size / samples**2
    if not isinstance(law, PlainLaw):
        name, most = "pace", size / samples
    limits = list(getattr(own, name) or none)
    limits[i] = min(limits[i], most)
    return cast(P, replace(own, **{"pace": own.pace or none, name: tuple(limits)}))


SLOWER = (0.75, 1.1, 1.6, 2.5, 4.0, 8.0)
"""Times of a reference that are tried, over the rise of a step."""

MORE = 0.03
"""Overshoot beyond what is allowed from which on slower references are tried, as a fraction."""

OVERSHOT = 10.0
"""What an overshoot beyond that, as a fraction of the step, adds to errors, a ratio."""

SAMPLES, BLOCK, SETTLED = 2000, 100, 0.01
"""Samples of a step; and those in which it has settled if it stays as near as this to where it
goes, as a fraction of the step."""

LOST = 1e3
"""How far a plant is away, over the step, that is lost."""
