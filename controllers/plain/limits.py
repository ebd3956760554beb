"""Of many laws between one measurement and one command, the best within limits.

A law is within them if its sampled loop, with every delay up to that which it must tolerate, and
with the lag and without, has

    Ms = max |1 / (1 + L)|, Mt = max |L / (1 + L)| within their limits,   |T| w <= trusted frequency

and the noise of the measurement moves its command by no more than a share of half its range. Where
no law holds all of them, as no loop of a plant that is unstable and late does, those are taken that
exceed them least. Of what is left, the best has the least error after steps of reference and load:
the sum of both integrals of time by absolute error, each over the least that any has; a step that
overshoots by a percent more than it may counts as a tenth of it more.

Source: Panagopoulos, Åström and Hägglund, Design of PID controllers based on constrained
optimisation, IEE Proc. Control Theory Appl. 149, 2002 (limits); Graham and Lathrop, The synthesis
of optimum transient response, AIEE Trans. 72, 1953 (time by absolute error).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from controllers.linear_law import LinearLaw, linear_law
from controllers.protocol import Controller
from controllers.sensitivity import sampled_at
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import WorkbenchError
from workbench.linearisation.transfer import transfer_function

if TYPE_CHECKING:
    from controllers.plain.single_loop import LoopSpecification, SingleLoop

C = TypeVar("C", bound=Controller)
T = TypeVar("T")

ANGLE = np.geomspace(1e-6, 0.98 * np.pi, 300)
"""Frequencies at which a loop is judged, in rad per sample."""


USUAL_SENSITIVITY = 1.8
"""Limit on Ms, a ratio, where none is given."""

USUAL_COMPLEMENTARY = 2.8
"""Limit on Mt, a ratio, where none is given."""


class Judged(NamedTuple):
    """What a loop reaches.

    Args:
        sensitivity: Largest Ms over the corners, a ratio.
        complementary: Largest Mt over the corners, a ratio.
        excess: Largest ratio to a limit; at most 1 if all are held, infinite if it is not stable.
    """

    sensitivity: float
    complementary: float
    excess: float


UNSTABLE = 15.0
"""Ms, a ratio, of a loop that is not stable with a delay near to those that are looked at."""

NONE = Judged(math.inf, math.inf, math.inf)
"""What a loop reaches that is not stable."""


class LoopLimits:
    """The limits of a specification on a loop."""

    def __init__(self, loop: SingleLoop, want: LoopSpecification) -> None:
        h, own, size = want.sample_time, loop.linear, loop.linear.state_scales
        A, B, C = own.A * size / size[:, None], own.B / size[:, None], own.C * size
        self.want, self.loop = want, loop
        lags = [(0.0, lag) for lag in sorted({0.0, want.sensor_lag})]
        self.plants = sampled_at(A, B, C, (True,), lags, h)
        z = np.exp(1j * ANGLE)
        self.responses = [
            transfer_function(a, b, c, np.zeros((1, 1)), z)[:, 0, 0] for a, b, c in self.plants
        ]
        half = 0.5 * (loop.upper - loop.lower)
        self.noise = want.loop_noise(loop) / (half if half < math.inf else loop.command_scale)

    def judge(self, law: LinearLaw) -> Judged:
        """Tell the peaks of the loop of a law around rest, whose first input is the measurement."""
        F, G, H, J = law.F, law.G[:, :1], law.H, law.J[:, :1]
        want, z = self.want, np.exp(1j * ANGLE)
        K = -transfer_function(F, G, H, J, z)[:, 0, 0]
        ms = mt = beyond = stirred = 0.0
        for (A, B, C), P in zip(self.plants, self.responses, strict=True):
            closed = np.block([[A + B @ J @ C, B @ H], [G @ C, F]])
            if not np.max(np.abs(np.linalg.eigvals(closed))) < 1.0:
                return NONE
            L = P * K * self._delays(P * K)
            s = 1.0 / (1.0 + L)
            if not (len(L) and np.abs(s).max() <= UNSTABLE):
                return NONE
            t = np.abs(L * s)
            ms, mt = max(ms, float(np.abs(s).max())), max(mt, float(t.max()))
            beyond = max(beyond, float((t * ANGLE).max()) / want.sample_time)
            noisy = np.max(np.abs(K * s), axis=0) ** 2
            stirred = max(stirred, self.noise * math.sqrt(np.trapezoid(noisy, ANGLE) / np.pi))
        excess = max(
            ms / (want.maximum_sensitivity or USUAL_SENSITIVITY),
            mt / (want.maximum_complementary or USUAL_COMPLEMENTARY),
            beyond / (want.trusted_frequency or math.inf),
            stirred / want.quiet,
        )
        return Judged(ms, mt, excess)

    def _delays(self, loop: Complex) -> Complex:
        """Return what delays from none to the largest multiply a loop by, shape (n_delays, n).

        From one to the next the phase at a crossover moves by a tenth, so that none on the way at
        which the loop is not stable is passed over; there are none where that is certain.
        """
        late = self.want.delay / self.want.sample_time
        if not late:
            return np.ones((1, 1), dtype=complex)
        crossover = ANGLE[np.abs(loop) >= 1.0].max(initial=0.0)
        if crossover * late > 2.0 * np.pi:
            return np.ones((0, 1), dtype=complex)
        delays = np.linspace(0.0, late, max(8, math.ceil(10.0 * crossover * late)))
        return np.asarray(np.exp(-1j * delays[:, None] * ANGLE))

    def held(self, tries: Sequence[tuple[T, Judged]], family: str) -> list[tuple[T, Judged]]:
        """Return the tries that hold the limits, or else those that exceed them least.

        Raises:
            WorkbenchError: If none is stable, or a limit that was given is not held.
        """
        ends = f"{self.loop.measured} by {self.loop.actuator}"
        nearest = min((judged for _, judged in tries), key=lambda one: one.excess, default=NONE)
        if not math.isfinite(nearest.excess):
            raise WorkbenchError(
                f"{family} makes no stable loop of {ends}; take another family, such as lqi"
            )
        want = self.want
        given = (("Ms", want.maximum_sensitivity), ("Mt", want.maximum_complementary))
        asked = [f"{name} <= {limit:g}" for name, limit in given if limit]
        if asked and nearest.excess > 1.0:
            raise WorkbenchError(
                f"{family} of {ends} that holds {' and '.join(asked)} is not to be had; the nearest"
                f" has Ms {nearest.sensitivity:.3g} and Mt {nearest.complementary:.3g}: allow"
                " larger peaks, tolerate less, or let noise move the command more (quiet)"
            )
        top = max(1.0, 1.05 * nearest.excess)
        return [(tried, judged) for tried, judged in tries if judged.excess <= top]

    def steps(self, law: LinearLaw) -> tuple[Vector, Matrix]:
        """Return the output of the linear loop after unit steps.

        Returns:
            Times, shape (n,), in s, eight to an octave, and outputs, shape (n, n_steps), in SI: for
            each input of the law behind the measurement, and for the load of the command.
        """
        (A, B, C), (F, G, H, J) = self.plants[0], law
        n, k = len(A) + len(F), G.shape[1]
        closed = np.block([[A + B @ J[:, :1] @ C, B @ H], [G[:, :1] @ C, F]])
        load = np.vstack([B, np.zeros((len(F), 1))])
        entry = np.hstack([np.vstack([B @ J[:, 1:], G[:, 1:]]), load])
        slowest = float(np.max(np.abs(np.linalg.eigvals(closed))))
        over = np.block([[closed, entry], [np.zeros((k, n)), np.eye(k)]])
        x = np.vstack([np.zeros((n, k)), np.eye(k)])
        times, seen, t, stride = [0.0], [np.zeros(k)], 0, 1
        while t * (1.0 - slowest) < 8.0 and t < 1e9:
            for _ in range(8):
                x, t = over @ x, t + stride
                times.append(t)
                seen.append(C[0] @ x[: len(A)])
            if t >= 16 * stride:
                over, stride = over @ over, 2 * stride
        return np.array(times) * self.want.sample_time, np.array(seen)

    def best(self, designs: Iterable[Callable[[], C]], family: str) -> C:
        """Return the best law of those that can be designed.

        Raises:
            WorkbenchError: If there is none, none is stable, or a limit that was given is not held.
        """
        tries = []
        reason: WorkbenchError | None = None
        rest = (self.loop.rest_output,)
        for design in designs:
            try:
                law = design()
            except WorkbenchError as error:
                reason = error
                continue
            around = linear_law(law, rest, rest * (1 + law.preview), referred=True)
            judged = self.judge(around)
            tries.append(((law, around), judged))
        if reason and not tries:
            raise reason
        found = [
            (law, judged, answer(*self.steps(around)))
            for (law, around), judged in self.held(tries, family)
        ]
        among = Among.of([one[1:] for one in found], self.want.overshoot)
        return min(found, key=lambda one: among.cost(*one[1:]))[0]

    def led(self, lagging: Callable[[float], C], speed: float, family: str) -> C:
        """Return the best of a law's lags of the reference, whose speed is about this, in rad/s."""
        top = 0.5 / self.want.sample_time
        return self.best([partial(lagging, min(k * speed, top)) for k in LAGS], family)


LAGS = (4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25)
"""Factors by which the speed of lags of the reference is changed."""


class Answer(NamedTuple):
    """What a loop answers to steps of reference and load.

    Args:
        overshoot: Of a step of the reference, as a fraction of it.
        errors: Integrals of time by absolute error after a unit step of the reference, in s2, and
            of the load, in SI of the output per SI of the command, times s2.
    """

    overshoot: float
    errors: Vector


def answer(time: Vector, seen: Matrix) -> Answer:
    """Measure the output after a unit step of the reference and of the load; see `LoopLimits`."""
    away = np.abs(seen - np.array([1.0, 0.0]))
    errors = np.trapezoid(time[:, None] * away, time, axis=0)
    return Answer(float(seen[:, 0].max()) - 1.0, errors)


class Among(NamedTuple):
    """What loops are compared with.

    Args:
        excess: Ratio to a limit that is allowed.
        overshoot: Of a step of the reference that is allowed, as a fraction of it.
        errors: The least of `Answer.errors`, in their units.
    """

    excess: float
    overshoot: float
    errors: Vector

    @classmethod
    def of(cls, found: Sequence[tuple[Judged, Answer]], overshoot: float) -> Among:
        """Return what loops are compared with that may overshoot a step by a fraction of it."""
        excess = max(1.0, *(judged.excess for judged, _ in found))
        return cls(excess, overshoot, np.min([one.errors for _, one in found], axis=0))

    def cost(self, judged: Judged, found: Answer) -> tuple[float, float]:
        """Return the ratio to a limit and the error, dimensionless: both small, the first first."""
        beyond = max(found.overshoot - self.overshoot, 0.0)
        error = float(np.sum(found.errors / self.errors)) * (1.0 + OVERSHOT * beyond)
        return max(judged.excess, self.excess), error


OVERSHOT = 10.0
"""What an overshoot beyond what is allowed, as a fraction of the step, adds to errors, a ratio."""
