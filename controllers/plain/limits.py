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
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from controllers.linear_law import LinearLaw
from controllers.named_state import flat, restored
from controllers.plain.single_loop import ARRAYS, ENDLESS, LoopSpecification, PlainLaw
from controllers.sensitivity import sampled_at
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import WorkbenchError
from workbench.linearisation.transfer import transfer_function

if TYPE_CHECKING:
    from controllers.plain.single_loop import SingleLoop
    from workbench.linearisation import LinearModel


class AroundRest(Protocol):
    """A law that tells its linear form."""

    def around_rest(self) -> LinearLaw:
        """Return the law between its ends, from measurement and reference as deviations."""
        ...


C = TypeVar("C", bound=AroundRest)
P = TypeVar("P", bound=PlainLaw)

ANGLE = np.geomspace(1e-6, 0.98 * np.pi, 300)
"""Frequencies at which a loop is judged, in rad per sample."""


USUAL_SENSITIVITY = 1.8
"""Limit on Ms, a ratio, where none is given."""

USUAL_COMPLEMENTARY = 2.8
"""Limit on Mt, a ratio, where none is given."""


class Judged(NamedTuple):
    """What loops reach.

    Args:
        sensitivity: Largest Ms of each over the corners, shape (n,), ratios.
        complementary: Largest Mt of each over the corners, shape (n,), ratios.
        excess: Largest ratio of each to a limit, shape (n,); at most 1 if all are held, infinite if
            it is not stable.
    """

    sensitivity: Vector
    complementary: Vector
    excess: Vector


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

    def judge(self, laws: LinearLaw) -> Judged:
        """Tell the peaks of loops of laws around rest, whose first input is the measurement.

        Where some hold the limits, those that a few frequencies show not to are told as unstable.
        """
        rough = self._ratio(*self._peaks(laws, slice(None, None, 8))[:3])
        near = np.flatnonzero(rough <= 1.05)
        if 0 < len(near) < len(rough):
            found = self._judged(chosen(laws, near))
            if found.excess.min() <= 1.0:
                told = np.full((3, len(rough)), math.inf)
                told[:, near] = found
                return Judged(*told)
        return self._judged(laws)

    def _judged(self, laws: LinearLaw) -> Judged:
        ms, mt, beyond, stirred, stable = self._peaks(laws, slice(None))
        for plant in self.plants:
            stable &= np.abs(np.linalg.eigvals(_closed(plant, laws)[0])).max(axis=1) < 1.0
        excess = np.maximum(self._ratio(ms, mt, beyond), stirred / self.want.quiet)
        return Judged(ms, mt, np.where(stable, excess, math.inf))

    def _ratio(self, ms: Vector, mt: Vector, beyond: Vector) -> Vector:
        """Return the largest ratio of peaks, as of `_peaks`, to their limits."""
        want = self.want
        ms = ms / (want.maximum_sensitivity or USUAL_SENSITIVITY)
        mt = mt / (want.maximum_complementary or USUAL_COMPLEMENTARY)
        return np.maximum(np.maximum(ms, mt), beyond / (want.trusted_frequency or math.inf))

    def _peaks(
        self, laws: LinearLaw, which: slice
    ) -> tuple[Vector, Vector, Vector, Vector, npt.NDArray[np.bool_]]:
        """Return what loops reach at some frequencies if they are stable without a delay.

        A delay turns the loop at each frequency: of all up to the largest, the worst is the one
        that turns it to -1, or is nearest to that.

        Returns:
            Ms, Mt, |T| w in rad/s, noise of the command as a share of half its range, and whether
            no delay turns a crossover to -1.
        """
        h, angle = self.want.sample_time, ANGLE[which]
        K = -response(laws, np.exp(1j * angle))
        late = angle * (self.want.delay / h)
        ms, mt, beyond, stirred = np.zeros((4, len(K)))
        stable = np.ones(len(K), dtype=bool)
        for P in self.responses:
            L = P[which] * K
            gain, margin = np.abs(L), np.mod(np.angle(L) + np.pi, 2.0 * np.pi)
            reached = margin <= late
            stable &= ~np.any(np.diff(gain < 1.0, append=True) & reached, axis=1)
            turned = np.where(reached, 0.0, np.minimum(margin - late, 2.0 * np.pi - margin))
            # |1 + L| with -L = gain exp(j turned), without the difference of near numbers.
            near = np.hypot(gain - 1.0, 2.0 * np.sqrt(gain) * np.sin(0.5 * turned))
            s = 1.0 / np.maximum(near, 1e-300)
            ms, mt = np.maximum(ms, s.max(axis=1)), np.maximum(mt, (gain * s).max(axis=1))
            beyond = np.maximum(beyond, (gain * s * angle).max(axis=1) / h)
            noisy = np.trapezoid((np.abs(K) * s) ** 2, angle) / np.pi
            stirred = np.maximum(stirred, self.noise * np.sqrt(noisy))
        return ms, mt, beyond, stirred, stable

    def held(self, judged: Judged, family: str) -> list[int]:
        """Return which loops hold the limits, or else which exceed them least.

        Raises:
            WorkbenchError: If none is stable, or a limit that was given is not held.
        """
        ends = f"{self.loop.measured} by {self.loop.actuator}"
        least = float(np.min(judged.excess, initial=math.inf))
        if not math.isfinite(least):
            raise WorkbenchError(
                f"{family} makes no stable loop of {ends}; take another family, such as lqi"
            )
        want = self.want
        given = (("Ms", want.maximum_sensitivity), ("Mt", want.maximum_complementary))
        asked = [f"{name} <= {limit:g}" for name, limit in given if limit]
        if asked and least > 1.0:
            k = int(np.argmin(judged.excess))
            raise WorkbenchError(
                f"{family} of {ends} that holds {' and '.join(asked)} is not to be had; the nearest"
                f" has Ms {judged.sensitivity[k]:.3g} and Mt {judged.complementary[k]:.3g}: allow"
                " larger peaks, tolerate less, or let noise move the command more (quiet)"
            )
        return np.flatnonzero(judged.excess <= max(1.0, 1.05 * least)).tolist()

    def steps(self, laws: LinearLaw) -> tuple[Vector, Matrix, Matrix]:
        """Return the outputs of linear loops after unit steps.

        Returns:
            Times, shape (n,), in s, eight to an octave; outputs, shape (n_loops, n, n_steps), in
            SI, for each input of the law behind the measurement and for the load of the command;
            and 1 as long as a loop has not settled, shape (n_loops, n).
        """
        closed, entry = _closed(self.plants[0], laws)
        (count, n), k = closed.shape[:2], entry.shape[2]
        slowest = np.abs(np.linalg.eigvals(closed)).max(axis=1)
        over = np.zeros((count, n + k, n + k))
        over[:, :n, :n], over[:, :n, n:], over[:, n:, n:] = closed, entry, np.eye(k)
        x = np.zeros((count, n + k, k))
        x[:, n:] = np.eye(k)
        C = self.plants[0][2][0]
        times, seen, going, t, stride = [0.0], [np.zeros((count, k))], [np.ones(count)], 0, 1
        while np.any(lasts := (t * (1.0 - slowest) < 8.0) & (t < 1e9)):
            for _ in range(8):
                x, t = over @ x, t + stride
                times.append(t)
                seen.append(C @ x[:, : len(C)])
                going.append(lasts.astype(float))
            if t >= 16 * stride:
                over, stride = over @ over, 2 * stride
        time = np.array(times) * self.want.sample_time
        return time, np.stack(seen, axis=1), np.stack(going, axis=1)

    def best(self, designs: Iterable[Callable[[], C]], family: str) -> C:
        """Return the best law of those that can be designed.

        Raises:
            WorkbenchError: If there is none, none is stable, or a limit that was given is not held.
        """
        found = []
        reason: WorkbenchError | None = None
        for design in designs:
            try:
                found.append(design())
            except WorkbenchError as error:
                reason = error
        if reason and not found:
            raise reason
        laws = stacked([law.around_rest() for law in found])
        judged = self.judge(laws)
        held = self.held(judged, family)
        reached = answer(*self.steps(chosen(laws, held)))
        errors = cost(reached, reached.errors.min(axis=0), self.want.overshoot)
        return found[held[int(np.argmin(errors))]]

    def led(self, lagging: Callable[[float], C], speed: float, family: str) -> C:
        """Return the best of a law's lags of the reference, whose speed is about this, in rad/s."""
        top = 0.5 / self.want.sample_time
        return self.best([partial(lagging, min(k * speed, top)) for k in LAGS], family)

    def at_pace(self, law: P) -> P:
        """Return the law at the pace of its reference that suits steps beyond the command's ends.

        The linear plant is run through steps, up and down, of half of what the command is just
        enough for, and of up to ten times that, as far as the command can hold it there. Of paces,
        the best is that whose errors and overshoots are least (as by `cost`); the loop is the same.
        """
        loop, want = self.loop, self.want
        ends = np.array([loop.lower, loop.upper]) - loop.rest_command
        around = replace(law, rest=0.0, rest_output=0.0, lower=ends[0], upper=ends[1])
        once, endless = np.ones(1), np.full(1, math.inf)
        y, asked = (part[:, 0] for part in self._run(around, once, endless, ENDLESS))
        peak, held = asked[np.argmax(np.abs(asked))], asked[-1]
        if not (np.isfinite(ends).any() and math.isfinite(peak) and peak):
            return law
        most = 0.9 * np.sort(ends / held) if held else np.array([-math.inf, math.inf])
        sizes = set()
        for sign, top in zip((-1.0, 1.0), np.abs(most), strict=True):
            enough = float(abs(ends[int(sign * peak > 0.0)] / peak))
            if 0.0 < enough < top:
                sizes |= {sign * min(share * enough, top) for share in LARGE}
        if not sizes:
            return law
        size, smallest = np.array(sorted(sizes)), min(map(abs, sizes))
        arrived = max(int(np.argmax(y > 0.63)), 1)
        paces = np.array([share * smallest / LARGE[0] / arrived for share in PACES])
        step, pace = (part.ravel() for part in np.meshgrid(size, paces))
        with np.errstate(over="ignore", invalid="ignore"):
            away = self._run(around, step, pace, ARRAYS)[0] / step - 1.0
        away = np.nan_to_num(away, nan=1e9, posinf=1e9, neginf=-1e9)
        errors = (np.arange(len(away)) @ np.abs(away)).reshape(len(paces), -1)
        beyond = np.maximum(away.max(axis=0) - want.overshoot, 0.0).reshape(len(paces), -1)
        total = np.sum(errors / errors.min(axis=0) * (1.0 + OVERSHOT * beyond), axis=1)
        best = int(np.argmin(total))
        return replace(law, pace=float(paces[best])) if total[best] < 0.9 * total[0] else law

    def _run(
        self, law: PlainLaw, step: Vector, pace: Vector, arithmetic: Any
    ) -> tuple[Matrix, Matrix]:
        """Return outputs and commands asked for, shape (n_samples, n), after steps from rest.

        Args:
            step: Sizes of the steps, shape (n,), in SI of the output.
            pace: Largest change of the reference, shape (n,), in SI of the output per sample.
        """
        A, B, C = self.plants[0]
        nothing, x = np.zeros_like(step), np.zeros((len(A), len(step)))
        state: Any = law.initial_state((0.0,))
        state = restored(state, [nothing] * len(flat(state)))
        outputs, commands, r = [], [], nothing
        for k in range(MOST_SAMPLES):
            y, r = (C @ x)[0], r + np.clip(step - r, -pace, pace)
            (u,), state, told = law.law(state, (y,), (r,), arithmetic)
            x = A @ x + B * u
            outputs.append(y)
            commands.append(told["asked"])
            if k % 100 == 99 and np.all(np.abs(np.array(outputs[-100:]) / step - 1.0) < 0.01):
                break
        return np.array(outputs), np.array(commands)


LARGE = (0.5, 3.0, 10.0)
"""Steps of which the reference's pace is chosen, over that which the command is just enough for."""

PACES = (math.inf, 3.0, 1.5, 0.75, 0.4)
"""Paces that are tried: what the command is just enough for, in the time of a small step's rise."""

MOST_SAMPLES = 2000
"""Samples for which large steps are looked at."""


LAGS = (4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25)
"""Factors by which the speed of lags of the reference is changed."""


def stacked(laws: Sequence[LinearLaw]) -> LinearLaw:
    """Return laws one behind the other, each matrix of shape (n_laws, ...)."""
    n = max(len(law.F) for law in laws)

    def padded(part: Matrix, *shape: int) -> Matrix:
        return np.pad(part, [(0, to - had) for to, had in zip(shape, part.shape, strict=True)])

    k = laws[0].G.shape[1]
    filled = [(padded(F, n, n), padded(G, n, k), padded(H, 1, n), J) for F, G, H, J in laws]
    return LinearLaw(*(np.stack(parts) for parts in zip(*filled, strict=True)))


def chosen(laws: LinearLaw, which: Any) -> LinearLaw:
    """Return some of laws."""
    return LinearLaw(*(part[which] for part in laws))


def response(laws: LinearLaw, z: Complex) -> Complex:
    """Return the transfer functions of laws by their first input, shape (n_laws, n_z), in SI."""
    from scipy.linalg import matrix_balance, schur

    T, b, c = laws.F.astype(complex), laws.G[:, :, 0].astype(complex), laws.H[:, 0].astype(complex)
    n = T.shape[1]
    for k in np.flatnonzero(np.any(np.tril(laws.F, -1), axis=(1, 2))):
        even, (size, _) = matrix_balance(laws.F[k], permute=False, separate=True)
        T[k], Z = schur(even, output="complex")
        b[k], c[k] = Z.conj().T @ (b[k] / size), (c[k] * size) @ Z
    x = np.zeros((len(T), n, len(z)), dtype=complex)
    for i in reversed(range(n)):
        right = (T[:, None, i, i + 1 :] @ x[:, i + 1 :])[:, 0]
        x[:, i] = (b[:, i, None] + right) / (z - T[:, i, i, None])
    return np.asarray((c[:, None] @ x)[:, 0] + laws.J[:, :1, 0])


def _closed(plant: tuple[Matrix, Matrix, Matrix], laws: LinearLaw) -> tuple[Matrix, Matrix]:
    """Return loops, shape (n_loops, n, n), and what references and load enter them by."""
    (A, B, C), (F, G, H, J) = plant, laws
    n, count = len(A), len(F)
    closed = np.zeros((count, n + F.shape[1], n + F.shape[1]))
    closed[:, :n, :n], closed[:, :n, n:] = A + B @ J[:, :, :1] @ C, B @ H
    closed[:, n:, :n], closed[:, n:, n:] = G[:, :, :1] @ C, F
    entry = np.zeros((count, n + F.shape[1], G.shape[2]))
    entry[:, :n, :-1], entry[:, n:, :-1], entry[:, :n, -1] = B @ J[:, :, 1:], G[:, :, 1:], B[:, 0]
    return closed, entry


def settled_after(law: Any, linear: LinearModel, step: float) -> float:
    """Return the time, in s, after which a step, in SI of the output, has settled within 2 %.

    The law, of one measurement and one command, is within its ends on the linear model.
    """
    want = LoopSpecification(law.sensors[0], law.actuators[0], sample_time=law.sample_time)
    limits = LoopLimits(want.loop(linear), want)
    time, seen, _ = limits.steps(stacked([law.around_rest()]))
    away = np.flatnonzero(np.abs(seen[0, :, 0] - 1.0) > 0.02)
    paced: float = abs(step) / getattr(law, "pace", math.inf) * law.sample_time
    return float(time[min(away[-1] + 1, len(time) - 1)]) + paced if len(away) else paced


class Answer(NamedTuple):
    """What loops answer to steps of reference and load.

    Args:
        overshoot: Of a step of the reference, shape (n,), as fractions of it.
        errors: Integrals of time by absolute error, shape (n, 2), after a unit step of the
            reference, in s2, and of the load, in SI of the output per SI of the command, times s2.
    """

    overshoot: Vector
    errors: Matrix


def answer(time: Vector, seen: Matrix, going: Matrix) -> Answer:
    """Measure outputs after unit steps of reference and load; see `LoopLimits.steps`."""
    away = time[:, None] * np.abs(seen - np.array([1.0, 0.0]))
    each = 0.5 * (away[:, 1:] + away[:, :-1]) * np.diff(time)[:, None] * going[:, 1:, None]
    return Answer((seen[:, :, 0] * going).max(axis=1) - 1.0, each.sum(axis=1))


def cost(found: Answer, least: Vector, overshoot: float) -> Vector:
    """Return the errors of loops, shape (n,), dimensionless.

    Args:
        least: Errors that they count over, shape (2,), in the units of `Answer.errors`.
        overshoot: Of a step of the reference that is allowed, as a fraction of it.
    """
    beyond = np.maximum(found.overshoot - overshoot, 0.0)
    return np.asarray(np.sum(found.errors / least, axis=1) * (1.0 + OVERSHOT * beyond))


OVERSHOT = 10.0
"""What an overshoot beyond what is allowed, as a fraction of the step, adds to errors, a ratio."""
