"""References that the equations bear which a linear model is one of.

A law is designed on the linear model alone. Before it is handed out, it is run on the model's own
equations through a step of each output and back, as far as it is asked to, or as a first trial
steps it (`workbench.linearisation.first_step`). Where that overshoots by much more than is allowed,
or is lost, as where a plant answers more the farther it goes, references are led there in several
times the rise of the step. Where that does not mend it, nor where the plant does not arrive, as
where it sticks or swings on, the loop is too fast for what the linear model leaves out. What noise
of the sensors makes of a step by the linear model is no fault of it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Generic, NamedTuple, TypeVar, cast

import numpy as np

from controllers.plain.limits import LoopSpecification
from controllers.plain.plain_law import PlainLaw
from controllers.plain.selection import OVERSHOT
from controllers.sensitivity import stirred
from workbench.arrays import Vector
from workbench.linearisation import LinearModel
from workbench.linearisation.first_step import command_of_loop, step_of
from workbench.linearisation.from_rest import FromRest, bends
from workbench.linearisation.time_scales import noise_of
from workbench.model.quantities import of_names

P = TypeVar("P")


class Stepped(NamedTuple):
    """What a step of an output and back comes to.

    Args:
        overshoot: The larger, beyond what is allowed, as a fraction of the step; infinite where the
            plant is lost.
        error: Integral of time by absolute error, in samples squared, of unit steps, with half the
            square of the time that each takes to settle.
        rise: Samples after which 63 % of the step is reached.
        left: How far away it stays in the end, the larger, as a fraction of the step; all of it
            where a command still swings from end to end.
    """

    overshoot: float
    error: float
    rise: int
    left: float

    def cost(self, power: float = 1.0) -> float:
        """Return what it comes to, in samples squared, overshoots by a power."""
        return self.error * float((1.0 + OVERSHOT * self.overshoot) ** power)

    @property
    def poor(self) -> bool:
        """Whether no reference alone mends it."""
        return self.overshoot > POOR or self.left > SETTLED


class Borne(NamedTuple, Generic[P]):
    """A law whose references suit the equations of its plant.

    Args:
        cost: What its steps come to, in samples squared; 0 of a plant that has no equations.
        poor: Whether one of them is.
    """

    law: P
    cost: float
    poor: bool


def borne(law: P, linear: LinearModel, want: LoopSpecification, most: float = math.inf) -> Borne[P]:
    """Return the law with references that the equations of its plant bear, each of its own.

    Args:
        most: What its steps may come to, in samples squared: those of a law that come to more are
            not run to their end, and cost more than any.
    """
    found, cost, poor = cast(Any, law), 0.0, False
    if not bends(linear):
        return Borne(law, cost, poor)
    run = _Run(found, linear, want)
    for i in range(len(found.controlled)):
        if cost <= most:
            found, stepped = run.led(found, i, most - cost)
            cost, poor = cost + stepped.cost(), poor or stepped.poor
    return Borne(found, cost, poor)


class _Run:
    """Steps of a law on the equations at whose operating point it was designed."""

    def __init__(self, law: Any, linear: LinearModel, want: LoopSpecification) -> None:
        self.linear, self.want = linear, want
        self.plant = FromRest(linear, want.sample_time, law.actuators, law.sensors)
        model = linear.operating_point.model
        self.noise = np.array([noise_of(q) for q in of_names(model.outputs, law.sensors)])
        moved = of_names(model.inputs, law.actuators)
        self.lower = np.array([q.lower + ENDED * q.scale for q in moved])
        self.upper = np.array([q.upper - ENDED * q.scale for q in moved])

    def led(self, law: Any, i: int, most: float) -> tuple[Any, Stepped]:
        """Return the law with the best references of an output, and what its step comes to.

        Args:
            most: What it may come to, in samples squared.
        """
        names, model = law.controlled, self.linear.operating_point.model
        command = command_of_loop(self.linear, names[i]) if len(names) == 1 else ""
        asked = np.broadcast_to(self.want.step, len(names))[i]
        size = float(asked) or step_of(model, self.linear, names[i], names, command)
        noisy = NOISY * stirred(law, self.linear, self.want.delay).get(names[i], 0.0) / abs(size)
        best = law, self.stepped(law, i, size, noisy, most)
        first = best[1]
        if not first.overshoot or (first.overshoot < POOR and first.left > SETTLED):
            return best
        # The slowest first: beside it, what overshoots is soon known to be worse.
        for by in reversed(SLOWER) if first.rise else ():
            tried = slower(law, i, abs(size), by * first.rise)
            found = self.stepped(tried, i, size, noisy, most, best[1].cost(3.0))
            best = (tried, found) if found.cost(3.0) < best[1].cost(3.0) else best
        return best

    def stepped(
        self,
        law: Any,
        i: int,
        size: float,
        noisy: float,
        most: float = math.inf,
        others: float = math.inf,
    ) -> Stepped:
        """Return what a step of one output, in SI, and back comes to.

        Where that is more than it may be, it is not run to its end, and counts as lost.

        Args:
            noisy: What noise may move it by, as a fraction of the step.
            most: What it may come to, in samples squared.
            others: What others come to, with overshoots by their third power.
        """
        plant, lost = self.plant, Stepped(math.inf, math.inf, 1, math.inf)
        plant.start()
        state = law.initial_state(tuple(plant.rest))
        coming = [plant.command] * round(self.want.delay / self.want.sample_time)
        at, asked = law.sensors.index(law.controlled[i]), plant.rest[: len(law.controlled)]
        so_far = Stepped(0.0, 0.0, 0, 0.0)
        settled = SETTLED + noisy
        random = np.random.default_rng(0)
        for sign in (1.0, -1.0):
            asked[i] += sign * size
            away, sent = np.zeros(SAMPLES), np.zeros((SAMPLES, len(law.actuators)))
            for k in range(SAMPLES):
                y = plant.read()
                away[k] = sign * (y[at] - asked[i]) / size
                if not abs(away[k]) < LOST:
                    return lost
                if k % BLOCK == BLOCK - 1:
                    if np.all(np.abs(away[k + 1 - BLOCK : k + 1]) < settled):
                        break
                    found = self._with(so_far, away[: k + 1], noisy)
                    if found.cost() > most or found.cost(3.0) > others:
                        return lost._replace(rise=found.rise)
                reference = tuple(asked) * (1 + law.preview)
                y = y + self.noise * random.standard_normal(len(y))
                command, state, _ = law.step(state, tuple(y.tolist()), reference)
                coming.append(command)
                sent[k] = command
                if not plant.hold(coming.pop(0)):
                    return lost
            away = away[: k + 1]
            so_far, left = self._with(so_far, away, noisy), so_far.left
            last, before = (np.abs(part[:BLOCK]).max() for part in (away[-BLOCK:], away[k // 2 :]))
            end = sent[k + 1 - BLOCK : k + 1]
            low, high = end <= self.lower, end >= self.upper
            waits = np.any(np.all(low, axis=0) | np.all(high, axis=0))
            # A command that goes from end to end and back holds nothing.
            left = 1.0 if np.any(np.any(low, axis=0) & np.any(high, axis=0)) else left
            # What still gets nearer only takes longer, as long as a command at its end lets it.
            left = (
                max(left, float(last) - noisy) if last > (1.0 if waits else 0.5) * before else left
            )
            so_far = so_far._replace(rise=max(so_far.rise, 1), left=left)
        return so_far

    def _with(self, before: Stepped, away: Vector, noisy: float) -> Stepped:
        """Return what steps come to with a further one, by how far it is away, shape (n,)."""
        unsettled = np.flatnonzero(np.abs(away) > WITHIN + noisy).max(initial=0)
        error = float(np.arange(len(away)) @ np.abs(away)) + 0.5 * float(unsettled) ** 2
        return before._replace(
            overshoot=max(before.overshoot, float(away.max()) - noisy - self.want.overshoot),
            error=before.error + error,
            rise=before.rise or int(np.argmax(away > -0.37)),
        )


def slower(law: P, i: int, size: float, samples: float) -> P:
    """Return the law whose reference of an output takes so many samples for a step, in SI."""
    own: Any = law
    none = (math.inf,) * len(own.controlled)
    # Half of the time it gets faster, and half of it slower, if it can brake.
    name, most = "brake", 4.0 * size / samples**2
    if not isinstance(law, PlainLaw):
        name, most = "pace", size / samples
    limits, leap = list(getattr(own, name) or none), list(own.leap or (0.0,) * len(none))
    limits[i], leap[i] = min(limits[i], most), 0.0
    told = {"pace": own.pace or none, name: tuple(limits), "leap": tuple(leap)}
    return cast(P, replace(own, **told))


SLOWER = (0.75, 1.1, 1.6, 2.5, 4.0, 8.0)
"""Times of a reference that are tried, over the rise of a step."""

NOISY = 4.0
"""What noise moves an output by at most, over its rms: more comes once in thousands of samples."""

WITHIN = 0.02
"""How near a step is to where it goes when it has settled, as a fraction of it."""

POOR = 0.06
"""Overshoot beyond what is allowed of a step that asks for another loop, as a fraction of it."""

SAMPLES, BLOCK, SETTLED = 2000, 100, 0.01
"""Samples of a step; and those in which it has settled if it stays as near as this to where it
goes, as a fraction of the step."""

ENDED = 1e-6
"""How near its end a command is that is at it, over its scale: what rounding may leave."""

LOST = 1e3
"""How far a plant is away, over the step, that is lost."""
