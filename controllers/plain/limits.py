"""Of many laws between measurements and commands, the best within limits.

A law is within them if its sampled loop, with every delay up to that which it must tolerate, and
with the lag and without, has

    Ms = max |1 / (1 + L)|, Mt = max |L / (1 + L)| within their limits,   |T| w <= trusted frequency

and the noise of the measurements moves no command by more than a share of half its range. Of
several outputs, |S| is the largest singular value of the sensitivity, opened at all outputs or at
all commands, each in the unit that makes it least: what the loop bears of changes of all channels
at once, whatever their units; where more is measured than followed, it is opened at the commands,
and with five times the limits at each measurement. Where no law holds all limits, as no loop of a
plant that is unstable and late does, those are taken that exceed them least. Of what is left, the
best has the least error after a step of each reference and of each load: the sum of the integrals
of time by absolute error, what other outputs do counted in their scales, each over the least that
any has; a step that overshoots by a percent more than it may counts as a tenth of it more, one that
moves another output by as much as its own as four times.

Source: Panagopoulos, Åström and Hägglund, Design of PID controllers based on constrained
optimisation, IEE Proc. Control Theory Appl. 149, 2002 (limits); Safonov, Stability margins of
diagonally perturbed multivariable feedback systems, IEE Proc. D 129, 1982 (units); Graham and
Lathrop, The synthesis of optimum transient response, AIEE Trans. 72, 1953 (time by absolute error).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import casadi as ca
import numpy as np
import numpy.typing as npt

from controllers.arithmetic import SYMBOLS
from controllers.linear_law import LinearLaw, reached
from controllers.named_state import flat, restored
from controllers.plain.loop import (
    Loop,
    LoopSpecification,
    PlainLaw,
    loop_of,
    paced,
    spare_outputs,
)
from controllers.plain.pairing import zeros
from controllers.plain.trial import borne
from controllers.sensitivity import (
    frequencies,
    least_gain,
    loop_matrices,
    peaks_of,
    sampled_at,
)
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.linearisation.pace import reach_of
from workbench.linearisation.transfer import transfer_function
from workbench.model.units import in_time
from workbench.work import in_one_thread
from workbench.work.buffered import Buffered


class AroundRest(Protocol):
    """A law that tells its linear form."""

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the outputs that it reads, those that follow references first."""
        ...

    @property
    def controlled(self) -> tuple[str, ...]:
        """Names of those that follow references."""
        ...

    def around_rest(self) -> LinearLaw:
        """Return the law between its ends, from measurements and references as deviations."""
        ...


C = TypeVar("C", bound=AroundRest)
D = TypeVar("D")
P = TypeVar("P", bound=AroundRest)

ANGLE = np.geomspace(1e-6, 0.98 * np.pi, 300)
"""Frequencies at which a loop is judged, in rad per sample."""


NEARLY = 1.05
"""Largest ratio to a limit, or to the least that is to be had, of what is as good."""

AT_A_TIME = 64
"""Loops whose responses are computed together."""

USUAL_SENSITIVITY = 1.8
"""Limit on Ms, a ratio, where none is given."""

USUAL_QUIET, HOLDING_QUIET = 0.02, 0.06
"""What noise may move a command by, rms, as a fraction of half its range, where nobody says; also
that of a plant that is unstable."""

USUAL_COMPLEMENTARY = 2.8
"""Limit on Mt, a ratio, where none is given."""


FEEDBACK = "a state feedback"
"""What a state feedback is called."""


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


@dataclass(frozen=True)
class ReadingSpecification(LoopSpecification):
    """What every law is told that may read more outputs than it follows.

    Args:
        also_measured: Name of an output that is read and that nobody follows, or several with
            commas between or as a list; by default none, or all that show the same states where
            no loop of the followed outputs alone is within its limits, or a much better one is
            with them.
    """

    also_measured: str | tuple[str, ...] = ""

    def loop(self, linear: Any) -> Loop:
        also = self.also_measured
        return loop_of(linear, self.measured, self.actuator, also, self.sample_time)

    @in_one_thread()
    def designed(
        self,
        linear: Any,
        design: Callable[[LoopLimits], C],
        helps: Callable[[LoopLimits, LoopLimits], bool],
    ) -> C:
        """Return a design of the followed outputs, or of others too where that is what it takes.

        It is one whose steps the equations of the plant bear, slower than the linear model lets it
        be if it must.

        Args:
            helps: Tells whether loops of the second limits, which read more, are much better.

        Raises:
            WorkbenchError: If there is no such design.
        """
        from workbench.linearisation.state_space import linear_model

        whole = linear_model(linear)
        best = borne(self.upon(whole, design, helps), whole, self)
        fast = self.trusted_frequency or math.inf
        if best.poor:
            law: Any = best.law
            loop = peaks_of(loop_matrices(law, whole), frequencies())
            fast = min(fast, loop.bandwidth / self.sample_time)
        for share in SLOWER if best.poor and fast < math.inf else ():
            slower = replace(self, trusted_frequency=share * fast)
            # A plant that is unstable needs so much.
            with suppress(WorkbenchError):
                found = borne(slower.upon(whole, design, helps), whole, self)
                best = found if found.cost < MUCH_LESS * best.cost else best
            if not best.poor:
                break
        return best.law

    def upon(
        self,
        linear: LinearModel,
        design: Callable[[LoopLimits], C],
        helps: Callable[[LoopLimits, LoopLimits], bool],
    ) -> C:
        """Return a design upon a linear model alone; see `designed`."""
        try:
            loop = self.loop(linear)
        except WorkbenchError:
            # What grows may show at what nobody follows.
            others = linear.output_names
            if self.also_measured or len(others) < 2:
                raise
            return replace(self, also_measured=others).upon(linear, design, helps)
        more = () if loop.read is not None else spare_outputs(linear, loop)
        if not more:
            return design(LoopLimits(loop, self))
        wider = replace(self, also_measured=more).loop(linear)
        best: tuple[float, C | None] = math.inf, None
        reason: WorkbenchError | None = None
        both = [LoopLimits(tried, self) for tried in (loop, wider)]
        for limits in reversed(both) if helps(*both) else both:
            try:
                law = design(limits)
            except WorkbenchError as error:
                # What reads more says more.
                reason = error if reason is None or limits is both[1] else reason
                continue
            own = limits
            if len(law.sensors) < limits.sensors:
                # An inner loop takes one of what may be read.
                read = tuple(name for name in law.sensors if name not in law.controlled)
                own = LoopLimits(replace(self, also_measured=read).loop(linear), self)
            excess = float(own.judge(stacked([law.around_rest()])).excess[0])
            if best[1] is None or excess < best[0]:
                best = excess, law
            if excess <= 1.0:
                break
        if best[1] is None:
            raise cast(WorkbenchError, reason)
        return best[1]


class LoopLimits:
    """The limits of a specification on a loop."""

    def __init__(self, loop: Loop, want: LoopSpecification) -> None:
        h, own, size = want.sample_time, loop.linear, loop.linear.state_scales
        A, B, C = own.A * size / size[:, None], own.B / size[:, None], loop.seen * size
        self.want, self.loop, self.outputs, self.sensors = want, loop, len(own.C), len(C)

        def plants(late: float) -> list[tuple[Matrix, Matrix, Matrix]]:
            corners = [(late, lag) for lag in sorted({0.0, want.sensor_lag})]
            return sampled_at(A, B, C, (True,) * len(C), corners, h)

        self.plants, self._plants_late = plants(0.0), plants
        z = np.exp(1j * ANGLE)
        self.responses = [
            transfer_function(a, b, c, np.zeros((len(c), b.shape[1])), z) for a, b, c in self.plants
        ]
        self.noise = want.loop_noise(loop) / loop.command_scale[:, None]
        # A loop that is too slow for what grows is led astray by noise more.
        self.quiet = want.quiet or (USUAL_QUIET if not self.growing else HOLDING_QUIET)

    def judge(self, laws: LinearLaw, most: float = math.inf) -> Judged:
        """Tell the peaks of loops of laws around rest, whose first inputs are the measurements.

        Those that exceed a limit, and that by more than others or by more than a ratio, are told
        as unstable: a few frequencies show that of many.
        """
        rough = self._ratio(*self._peaks(laws, slice(None, None, 8))[:3])
        order, told, least = (
            np.argsort(rough, kind="stable"),
            np.full((3, len(rough)), math.inf),
            most,
        )
        for first in range(0, len(order), AT_A_TIME):
            part = order[first : first + AT_A_TIME]
            part = part[rough[part] <= NEARLY * max(1.0, least)]
            *peaks, stirred, stable = self._peaks(chosen(laws, part), slice(None))
            excess = np.maximum(self._ratio(*peaks), stirred / self.quiet)
            near = np.flatnonzero(stable & (excess <= NEARLY * max(1.0, least)))
            near = near[self.stable(chosen(laws, part[near]))]
            told[:, part[near]] = peaks[0][near], peaks[1][near], excess[near]
            least = min(least, excess[near].min(initial=math.inf))
            if len(part) < AT_A_TIME:
                break
        return Judged(*told)

    def stable(self, laws: LinearLaw) -> npt.NDArray[np.bool_]:
        """Tell which loops are stable without a delay, with the lag and without."""
        closed = [_closed(plant, laws)[0] for plant in self.plants]
        largest = [np.abs(np.linalg.eigvals(own)).max(axis=1) for own in closed]
        return np.asarray(np.max(largest, axis=0) < 1.0)

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
            Ms, Mt, |T| w in rad/s, noise of the commands as a share of half their range, and
            whether no delay turns a crossover to -1.
        """
        h, angle = self.want.sample_time, ANGLE[which]
        z, late = np.exp(1j * angle), angle * (self.want.delay / h)
        count, more = len(laws.F), self.sensors > self.outputs
        single = self.responses[0].shape[2] == 1 and (more or self.sensors == 1)
        ms, mt, beyond, stirred = np.zeros((4, count))
        stable = np.ones(count, dtype=bool)
        turned = _turned if single else partial(_turned_together, at_outputs=not more)
        # Noise may neither take much of the commands' range nor of how fast they are.
        fast = np.abs(z - 1.0)[:, None] * self.loop.command_scale / (STIRRED * h * self.loop.slew)
        both = 1.0 + (self.quiet * fast) ** 2
        # As many at a time as stay in the processor's cache.
        for first in range(0, count, AT_A_TIME):
            part = slice(first, first + AT_A_TIME)
            K = -response(chosen(laws, part), z, self.sensors)
            for P in self.responses:
                s, t, moved, crossed = turned(P[which], K, late, self.noise)
                stable[part] &= ~crossed
                noisy = np.trapezoid(moved * both, angle, axis=1) / np.pi
                for most, own in (
                    (ms, s.max(axis=1)),
                    (mt, t.max(axis=1)),
                    (beyond, (t * angle).max(axis=1) / h),
                    (stirred, np.sqrt(noisy.max(axis=1))),
                ):
                    np.maximum(most[part], own, out=most[part])
        return ms, mt, beyond, stirred, stable

    def held(self, judged: Judged, family: str) -> list[int]:
        """Return which loops hold the limits, or else which exceed them least.

        Raises:
            WorkbenchError: If none is stable, or a limit that was given is not held.
        """
        ends = self.loop.words
        least = float(np.min(judged.excess, initial=math.inf))
        if not math.isfinite(least):
            beside = self._beside_a_zero()
            more = family == FEEDBACK or beside
            fix = "measure more" if more else "take another family, such as lqi"
            why = self._too_late() or beside
            raise WorkbenchError(f"{family} makes no stable loop of {ends}{why}; {fix}")
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
        return np.flatnonzero(judged.excess <= max(1.0, NEARLY * least)).tolist()

    def _too_late(self) -> str:
        """Say how late commands may be of a plant that grows at p: every |T| peaks by e^(p T).

        Source: Åström and Murray, Feedback Systems, 2008, section 11.5, with p T < 1/3 for margins.
        """
        late = self.want.delay + 0.5 * self.want.sample_time
        turned = float(self.loop.linear.poles.real.max(initial=0.0)) * late
        if turned < 1.0 / 3.0:
            return ""
        return (
            f", which grows in {in_time(late / turned)} and is {in_time(late)} late: no loop has an"
            f" Mt below {math.exp(min(turned, 99.0)):.3g}, and good ones are late by less than"
            f" {in_time(late / turned / 3.0)}"
        )

    def _beside_a_zero(self) -> str:
        """Say how near to a zero z an output grows at p: Ms >= product |z + p| / |z - p|.

        Source: Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 5.3.
        """
        poles = self.loop.linear.poles
        growing = poles[poles.real > 0.0]
        late = [z for z in zeros(self.loop) if z.real > 1e-6 * abs(z)] if self.sensors == 1 else []
        each = [float(np.prod(np.abs((z + growing.conj()) / (z - growing)))) for z in late]
        if max(each, default=0.0) <= USUAL_SENSITIVITY:
            return ""
        worst = max(each)
        z = late[each.index(worst)]
        return (
            f", which grows at {growing.real.max():.3g} rad/s beside a zero at {abs(z):.3g} rad/s:"
            f" no loop of it has an Ms below {worst:.3g}"
        )

    def steps(self, laws: LinearLaw) -> tuple[Vector, Matrix, Matrix]:
        """Return the outputs of linear loops after unit steps.

        Returns:
            Times, shape (n,), in s, eight to an octave; outputs, shape (n_loops, n, n_outputs,
            n_steps), in SI, for each input of the law behind the measurements and for the load of
            each command; and 1 as long as a loop has not settled, shape (n_loops, n).
        """
        over, entry = _closed(self.plants[0], laws)
        slowest = np.abs(np.linalg.eigvals(over)).max(axis=1)
        C = self.plants[0][2][: self.outputs]
        left, x, stride = np.arange(len(over)), np.zeros_like(entry), 1
        shape, times, on = (len(C), x.shape[2]), [0], np.ones(len(over), dtype=bool)
        parts, going = [np.zeros((len(x), 1, *shape))], [on[:, None]]
        while np.any(on := on & (times[-1] * (1.0 - slowest) < 8.0) & (times[-1] < 1e9)):
            # Those that have settled are left as they are.
            left, staying = np.flatnonzero(on), on[left]
            x, over, entry = x[staying], over[staying], entry[staying]
            states = []
            for _ in range(8):
                x = over @ x + entry
                states.append(x[:, : C.shape[1]])
                times.append(times[-1] + stride)
            part = np.tile(parts[-1][:, -1:], (1, 8, 1, 1))
            part[left] = C @ np.stack(states, axis=1)
            parts.append(part)
            going.append(np.tile(on[:, None], 8))
            if times[-1] >= 16 * stride:
                entry, over, stride = over @ entry + entry, over @ over, 2 * stride
        time = np.array(times) * self.want.sample_time
        return time, np.concatenate(parts, axis=1), np.concatenate(going, axis=1).astype(float)

    def answered(self, laws: LinearLaw) -> Answer:
        """Return what loops answer to steps of references and loads."""
        return answer(*self.steps(laws), self.loop.output_scale)

    def best(self, designs: Iterable[Callable[[], C]], family: str) -> C:
        """Return the best law of those that can be designed.

        Raises:
            WorkbenchError: If there is none, none is stable, or a limit that was given is not held.
        """
        places = [((), design) for design in designs]
        return self.best_of(lambda _, design: design(), places, family, 0)[0]

    def best_of(
        self,
        designed: Callable[[tuple[int, ...], D], C],
        places: Sequence[tuple[tuple[int, ...], D]],
        family: str,
        count: int,
        apart: Sequence[int] = (),
    ) -> tuple[C, tuple[tuple[int, ...], D]]:
        """Return the best law of a grid, and its place.

        A law is designed for a step of the grid for each output, ``count`` being the number of
        steps, and something else. Those of several outputs that are alike are then tried with one
        of them some steps apart, and the step of each output is changed by itself as long as that
        makes the law better, but not of a single one of a plant that is unstable.

        Raises:
            WorkbenchError: As of `best`.
        """

        def made(place: tuple[tuple[int, ...], D]) -> tuple[C, tuple[tuple[int, ...], D]]:
            return designed(*place), place

        def answers(
            places: Iterable[tuple[tuple[int, ...], D]],
        ) -> tuple[list[tuple[C, tuple[tuple[int, ...], D]]], Judged, LinearLaw]:
            found = _designed([partial(made, place) for place in places])
            laws = stacked([law.around_rest() for law, _ in found])
            return found, self.judge(laws), laws

        def best_among(
            places: Iterable[tuple[tuple[int, ...], D]],
        ) -> tuple[tuple[C, tuple[tuple[int, ...], D]], float, Vector, float]:
            found, judged, laws = answers(places)
            held = self.held(judged, family)
            reached = self.answered(chosen(laws, held))
            least = reached.errors.min(axis=0)
            errors = cost(reached, least, self.want.overshoot)
            k = int(np.argmin(errors))
            top = max(1.0, float(judged.excess[held].max()))
            return found[held[k]], float(errors[k]), least, top

        def beside(steps: tuple[int, ...], *far: int) -> list[tuple[int, ...]]:
            """Return the places in the grid with one output some steps away."""
            moved = [
                tuple(s + by * (i == j) for j, s in enumerate(steps))
                for i in range(self.outputs)
                for most in far
                for by in (-most, most)
            ]
            return [one for one in moved if all(0 <= s < count for s in one)]

        best, error, least, top = best_among(places)
        if apart and self.outputs > 1:
            alike = sorted({steps for steps, _ in places})[:: apart[0]]
            moved = [one for steps in alike for one in beside(steps, *apart)]
            best, error, least, top = best_among([best[1], *((one, best[1][1]) for one in moved)])
        # A loop of one output that holds what grows keeps the margins that it has.
        changed = count and (self.outputs > 1 or not self.growing)
        for stride in STRIDES if changed else ():
            while True:
                steps, other = best[1]
                try:
                    found, judged, laws = answers([(one, other) for one in beside(steps, stride)])
                except WorkbenchError:
                    break
                held = np.flatnonzero(judged.excess <= top).tolist()
                if not held:
                    break
                errors = cost(self.answered(chosen(laws, held)), least, self.want.overshoot)
                k = int(np.argmin(errors))
                if errors[k] > 0.98 * error:
                    break
                best, error = found[held[k]], errors[k]
        return best

    def led(self, entered: Callable[[tuple[D, ...]], C], tried: Sequence[tuple[D, ...]]) -> C:
        """Return the best of a law's ways in which references enter, one for each output.

        They change what a loop does after steps of the references, each of its own.
        """
        p = self.outputs
        reached = self.answered(stacked([entered(each).around_rest() for each in tried]))
        best = []
        for i in range(p):
            own = [i, *range(p, reached.errors.shape[1])]
            alone = (reached.overshoot[:, [i]], reached.interaction[:, [i]])
            part = Answer(*alone, reached.errors[:, own])
            errors = cost(part, part.errors.min(axis=0), self.want.overshoot)
            best.append(tried[int(np.argmin(errors))][i])
        return entered(tuple(best))

    def lags(self, speeds: Sequence[float]) -> list[tuple[float, ...]]:
        """Return speeds of lags of references that are tried, of about these, in rad/s."""
        top = 0.5 / self.want.sample_time
        return [tuple(min(k * w, top) for w in speeds) for k in LAGS]

    def better(self, laws: Sequence[C]) -> C:
        """Return the law whose steps of the references are the best, the loops being the same."""
        found = self.answered(stacked([law.around_rest() for law in laws]))
        errors = cost(found, found.errors.min(axis=0), self.want.overshoot)
        return laws[int(np.argmin(errors))]

    @property
    def late(self) -> LoopLimits:
        """The same, whose steps are those of commands that are late by the delay."""
        count = round(self.want.delay / self.want.sample_time)
        if not 0 < count <= MOST_LATE:
            return self
        found = copy(self)
        found.plants = self._plants_late(count * self.want.sample_time)
        return found

    @property
    def growing(self) -> bool:
        """Whether the plant is unstable."""
        return bool(np.any(self.loop.linear.poles.real > 0.0))

    def swing(self, law: AroundRest) -> float:
        """Return the largest swing of a command after a step of an output, over scales, a ratio."""
        m = len(self.loop.actuators)
        swings = [np.abs(self._freely(law.around_rest(), i)[1][:, :m]) for i in range(self.outputs)]
        each = [own.max(axis=0) / self.loop.command_scale for own in swings]
        return float(np.max(np.array(each) * self.loop.output_scale[:, None]))

    def unexcited(self, own: LinearLaw) -> list[tuple[Matrix, Matrix]]:
        """Return ways by which references leave as many modes alone as the law has states.

        With references entering by E = [B Dr; Br], a mode of left eigenvector w stays at rest if
        w E = 0; what is left free makes the outputs arrive at the references. Those that stay are
        the slowest few and else the fastest: a step shows no tail of what else the loop is for, and
        no swing of an observer.

        Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, section 5.2 (observer
        polynomial).

        Returns:
            Br, shape (n, p), and Dr, shape (m, p), of each, in SI.
        """
        (A, B, C), p = self.plants[0], self.outputs
        one = LinearLaw(*(part[None] for part in own))
        closed, n, k, m = _closed(self.plants[0], one)[0][0], len(A), len(own.F), B.shape[1]
        if m > 1 or not k or self.growing:
            # Of several outputs, what is fast for one reference is not for another.
            return []
        poles, left = np.linalg.eig(closed.T)
        order = np.argsort(-np.abs(poles), kind="stable")
        # What the references' gains (Dr, then Br) do to states, and to outputs at rest.
        enter = np.block([[B, np.zeros((n, k))], [np.zeros((k, m)), np.eye(k)]])
        seen = np.hstack([C[:p], np.zeros((p, k))])
        at_rest = seen @ np.linalg.solve(np.eye(n + k) - closed, enter)
        found = []
        for slow in range(min(k, MOST_SLOW) + 1):
            still = np.concatenate([order[:slow], order[len(order) - k + slow :]])
            rates = np.log(poles[order[:slow]].astype(complex))
            swings = np.any(np.abs(rates.imag) > SWINGS * np.abs(rates.real))
            # Half of a pair is no mode, and what swings is not left to swing by itself.
            if abs(np.sum(poles[still].imag)) > 1e-9 or swings:
                continue
            modes = left[:, still].T @ enter
            table = np.vstack([modes.real, modes.imag, at_rest])
            size = np.maximum(np.linalg.norm(table, axis=1, keepdims=True), 1e-300)
            aim = np.vstack([np.zeros((2 * k, p)), np.eye(p)]) / size
            gains, _, rank, _ = np.linalg.lstsq(table / size, aim, rcond=1e-12)
            if rank == k + m and np.linalg.cond(gains[:m]) < 1e9:
                found.append((gains[m:], gains[:m]))
        return found

    def entering(self, own: LinearLaw) -> Callable[[Sequence[float], float], tuple[Matrix, Matrix]]:
        """Return what tells how references enter a law so that outputs answer them as lags do.

        After a unit step of a reference, its output is as near as can be to that of two lags of a
        speed, in rad/s, and the others stay, in the mean square of time by error; all arrive. The
        answer to what enters at each state and each command adds up to it, so that no mode of the
        loop is in the way; its poles, and what it does about loads, stay. What it costs to enter
        otherwise than by the error of the output is a ratio.

        Args:
            own: Law around rest.

        Returns:
            A function of a speed for each output, in rad/s, and that ratio, which returns Br, shape
            (n, p), and Dr, shape (m, p), in SI.

        Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, section 5.3 (model
        following).
        """
        F, G, H, J = own
        (k, m), p, y = (len(F), len(H)), self.outputs, self.sensors
        each = np.vstack([np.eye(m, m + k), np.eye(k, m + k, m)])
        law = LinearLaw(F, np.hstack([G[:, :y], each[m:]]), H, np.hstack([J[:, :y], each[:m]]))
        time, seen, _ = self.steps(stacked([law]))
        size, weight = self.loop.output_scale, np.sqrt(np.gradient(time) * time)
        seen = seen[0, :, :, : m + k] / size[:, None]
        by_error = np.vstack([J[:, y : y + p], G[:, y : y + p]])
        weighed = weight[:, None, None] * seen
        column = np.maximum(np.linalg.norm(weighed, axis=(0, 1)), 1e-300)
        table, last = weighed.reshape(-1, m + k) / column, seen[-1] / column
        arriving, free = np.linalg.pinv(last), np.linalg.svd(last)[2][p:].T

        def entered(speeds: Sequence[float], reluctance: float) -> tuple[Matrix, Matrix]:
            entry = by_error.copy()
            for i, speed in enumerate(speeds):
                asked = np.zeros((len(time), p))
                asked[:, i] = (1.0 - (1.0 + speed * time) * np.exp(-speed * time)) / size[i]
                missing = asked - seen @ by_error[:, i]
                begun = arriving @ (np.eye(p)[i] / size[i] - seen[-1] @ by_error[:, i])
                left = (weight[:, None] * missing).ravel() - table @ begun
                within = np.vstack([table @ free, reluctance * free])
                more = np.linalg.lstsq(within, np.append(left, -reluctance * begun), rcond=None)[0]
                entry[:, i] += (begun + free @ more) / column
            return entry[m:], entry[:m]

        return entered

    def best_at_pace(self, laws: Sequence[P]) -> P:
        """Return the law, at its pace, whose steps are the best, the loops being the same.

        Small steps and those as far as an output goes count alike; overshoots of these by their
        third power: what is no faster for them is no better.
        """
        reached = self.answered(stacked([law.around_rest() for law in laws]))
        small = cost(reached, reached.errors.min(axis=0), self.want.overshoot)
        tried: list[Any] = [self.at_pace(law) for law in laws]
        large = np.zeros(len(laws))
        for i, name in enumerate(self.loop.measured):
            room = next((found for law in laws if len(found := self._large(law, i)[0])), None)
            if room is None:
                continue
            far = reach_of(self.loop.linear, name) * np.array([-1.0, -0.25, 0.25, 1.0])
            size = np.clip(far, room.min(), room.max())
            each = [
                self._paced(self._run, law, i, size, np.array([limits[i]]))
                for law, limits in zip(tried, map(self._limits, tried), strict=True)
            ]
            errors, penalty = (np.vstack(part) for part in zip(*each, strict=True))
            large += _over(errors, penalty)
        return cast(P, tried[int(np.argmin(small * large if large.any() else small))])

    def at_pace(self, law: P) -> P:
        """Return the law at the pace of its references that suits steps beyond the commands' ends.

        The linear plant is run through steps of each output, up and down, of half of what the
        commands are just enough for, and of up to ten times that, as far as they can hold it there;
        commands that change slowly do so.
        Of paces and brakes, the best is that whose errors and overshoots are least (as by `cost`);
        the loop is the same.
        """
        found = np.array([self._pace(law, i) for i in range(self.outputs)])
        if np.isinf(found).all():
            return law
        pace, brake = (tuple(part.tolist()) for part in found.T)
        more = {"brake": brake} if isinstance(law, PlainLaw) else {}
        return cast(P, replace(cast(Any, law), pace=pace, **more))

    def _limits(self, law: Any) -> list[tuple[float, float]]:
        """Return the pace of each reference of a law, and the brake."""
        none = (math.inf,) * self.outputs
        return list(zip(law.pace or none, law.brake or none, strict=True))

    def _large(self, law: Any, i: int) -> tuple[Vector, Vector]:
        """Return steps beyond the commands' ends, in SI of an output, paces and brakes.

        There are none where nothing ends, or only small steps can be held.
        """
        loop, solved = self.loop, not isinstance(law, PlainLaw)
        (low, _), (high, _) = self._moving
        none = np.full(len(low), math.inf)
        fixed = np.array([loop.lower, loop.upper]) - loop.rest_command
        ends = np.hstack([fixed, [low, none], [-none, high]]) * (1.0 if solved else LEFT)
        y, asked = self._freely(law.around_rest(), i)
        peak, held = asked[np.argmax(np.abs(asked), axis=0), np.arange(asked.shape[1])], asked[-1]
        if not (np.isfinite(ends).any() and np.all(np.isfinite(peak)) and np.any(peak)):
            return np.zeros(0), np.zeros((0, 2))
        sizes, enough, reach = set(), set(), reach_of(loop.linear, loop.measured[i])
        goes = () if solved else (0.25 * reach, reach)
        with np.errstate(divide="ignore", invalid="ignore"):
            for sign in (-1.0, 1.0):
                least, most = (
                    float(np.nanmin(np.abs(np.where(sign * u > 0.0, *ends[::-1]) / u)))
                    for u in (peak, held)
                )
                if 0.0 < least < 0.9 * most:
                    large = [share * least for share in LARGE]
                    large += [far for far in goes if far > large[-1]]
                    sizes |= {sign * min(far, 0.9 * most) for far in large}
                    enough.add(least)
        # A ramp moves the commands as fast as a step of its pace moves them far.
        far = np.maximum(np.abs(peak[: len(low)]), 1e-300)
        slow = self.want.sample_time * float(np.min(loop.slew / far))
        if slow < math.inf:
            sizes |= set() if sizes else {-loop.output_scale[i], loop.output_scale[i]}
        if not sizes:
            return np.zeros(0), np.zeros((0, 2))
        size, arrived = np.array(sorted(sizes)), max(int(np.argmax(y > 0.63)), 1)
        tried = {share * least / arrived for least in enough for share in PACES}
        tried |= {share * slow for share in SLOW if slow < math.inf}
        paces = [(pace, math.inf) for pace in (math.inf, *sorted(tried, reverse=True))]
        if not solved:
            brakes = [least / arrived**2 for least in enough]
            brakes += [slow / arrived] if slow < math.inf else []
            paces += [(math.inf, share * brake) for brake in brakes for share in BRAKES]
        return size, np.array(paces)

    def _pace(self, law: Any, i: int) -> tuple[float, float]:
        size, paces = self._large(law, i)
        if not len(size):
            return math.inf, math.inf
        if isinstance(law, PlainLaw):
            errors, penalty = self._paced(self._run, law, i, size, paces)
            braked = np.flatnonzero(np.isfinite(paces[:, 1]))
            if len(braked):
                # Under a brake the farthest step is fast: the plant may be slower.
                brake = paces[braked[np.argmin(_over(errors, penalty)[braked])], 1]
                fast = math.sqrt(brake * np.abs(size).max())
                both = [(part * fast, k * brake) for part in PARTS for k in (1.0, 2.0)]
                paces = np.vstack([paces, both])
                more, worse = self._paced(self._run, law, i, size, np.array(both))
                errors, penalty = np.vstack([errors, more]), np.vstack([penalty, worse])
        else:
            # Of those that solve something, most need no pace.
            errors, penalty = self._paced(self._solved, law, i, size, paces[:1])
            if np.all(penalty < 1.1):
                return math.inf, math.inf
            more, worse = self._paced(self._solved, law, i, size, paces[1:])
            errors, penalty = np.vstack([errors, more]), np.vstack([penalty, worse])
        total = _over(errors, penalty)
        best = int(np.argmin(total))
        pace, brake = paces[best if total[best] < 0.9 * total[0] else 0].tolist()
        return pace, brake

    def _paced(
        self, run: Callable[..., Matrix], law: Any, i: int, size: Vector, paces: Matrix
    ) -> tuple[Matrix, Matrix]:
        """Return errors of steps in s2 and penalties for what is too much, by pace and size."""
        step, pace = np.tile(size, len(paces)), np.repeat(paces.T, len(size), axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            seen = run(law, i, step, pace) / step
        own, scale = np.arange(self.outputs) == i, self.loop.output_scale
        # What runs away is too much, whatever it comes to.
        away = np.clip(np.nan_to_num(seen - own[:, None], nan=1e9), -1e9, 1e9)
        counted = np.abs(away) * (scale[i] / scale)[:, None]
        errors = np.tensordot(np.arange(len(away)), counted.sum(axis=1), 1)
        over = np.maximum(away[:, i].max(axis=0) - self.want.overshoot, 0.0)
        moved = np.where(own[:, None], 0.0, counted).max(axis=(0, 1))
        penalty = (1.0 + OVERSHOT * over) * (1.0 + moved)
        return errors.reshape(len(paces), -1), penalty.reshape(len(paces), -1)

    def _freely(self, law: LinearLaw, i: int) -> tuple[Vector, Matrix]:
        """Return an output, shape (n,), after its unit step, and what is held against ends, in SI.

        That is, shape (n, 3 m), the commands, and the same over what their lower ends and their
        upper ends move by.
        """
        (A, B, C), (F, G, H, J) = self.plants[0], law
        p, entry = self.sensors, [self.sensors + i]
        # The reference, which stays, is the last state.
        command = np.hstack([J[:, :p] @ C, H, J[:, entry]])
        over = np.vstack([B @ command, np.hstack([G[:, :p] @ C, F, G[:, entry]])])
        over[: len(A), : len(A)] += A
        over = np.vstack([over, np.eye(1, over.shape[1], len(over))])
        states = np.eye(len(over))[:, -1:]
        while states.shape[1] < MOST_SAMPLES:
            states, over = np.hstack([states, over @ states]), over @ over
        x = states[: len(A), :MOST_SAMPLES]
        u, y = command @ states[:, :MOST_SAMPLES], C[i] @ x
        asked = np.vstack([u, *(u - slopes @ x for _, slopes in self._moving)])
        near = np.all(np.abs(y.reshape(-1, LOOKED_AT) - 1.0) < SETTLED, axis=1)
        end = LOOKED_AT * (int(np.argmax(near)) + 1) if near.any() else MOST_SAMPLES
        return y[:end], asked[:, :end].T

    @property
    def _moving(self) -> tuple[tuple[Vector, Matrix], tuple[Vector, Matrix]]:
        """Lower and upper ends of commands that move with states: from rest, and their slopes."""
        n, own = len(self.plants[0][0]), self.loop.linear
        ends = own.ends
        if ends is None:
            far = np.full(own.B.shape[1], math.inf)
            still = np.zeros((len(far), n))
            return (-far, still), (far, still)
        # States count in their scales, and commands on their way are states too.
        slopes = ends[..., 1:] * own.state_scales
        slopes = np.pad(slopes, ((0, 0), (0, 0), (0, n - len(own.A))))
        return (ends[0, :, 0], slopes[0]), (ends[1, :, 0], slopes[1])

    def _run(self, law: PlainLaw, i: int, step: Vector, pace: Matrix) -> Matrix:
        """Return outputs, shape (n_samples, n_outputs, n), in SI, after steps from rest.

        Args:
            i: Number of the output that steps.
            step: Sizes of the steps, shape (n,), in SI of the output.
            pace: Largest changes of the reference and of these, shape (2, n), in SI of the output
                per sample.
        """
        loop, (A, B, C), p = self.loop, self.plants[0], self.outputs
        law = replace(
            law,
            rest=(0.0,) * len(law.rest),
            rest_output=(0.0,) * self.sensors,
            lower=tuple((LEFT * (loop.lower - loop.rest_command)).tolist()),
            upper=tuple((LEFT * (loop.upper - loop.rest_command)).tolist()),
            curves=(),
            fading=(),
            pace=(),
            brake=(),
        )
        example = law.initial_state((0.0,) * self.sensors)
        x, z, r, v = (ca.SX.sym("", n) for n in (len(A), len(flat(example)), 1, 1))
        to, most, brake = (ca.SX.sym("", 1) for _ in range(3))
        moved = paced(to - r, v, most, brake, SYMBOLS)
        y, now = ca.mtimes(C, x), r + moved
        asked = tuple(now if j == i else 0.0 for j in range(p))
        seen = tuple(ca.vertsplit(y))
        u, following, _ = law.law(restored(example, ca.vertsplit(z)), seen, asked, SYMBOLS)
        low, high = (LEFT * end + ca.mtimes(slopes, x) for end, slopes in self._moving)
        u = ca.fmin(ca.fmax(ca.vcat(u), low), high)
        after = ca.vertcat(ca.mtimes(A, x) + ca.mtimes(B, u), *flat(following), now, moved)
        entering = [ca.vertcat(x, z, r, v), ca.vertcat(to, most, brake)]
        leaving, count = [ca.densify(after), ca.densify(y[:p])], len(step)
        sample = Buffered(ca.Function("sample", entering, leaving).map(count).expand())
        # What has no end takes long to reach one.
        told = np.array([step, *np.minimum(pace, 1e9 * np.abs(step))])
        state, outputs = np.zeros((after.numel(), count)), np.zeros((MOST_SAMPLES, p, count))
        for k in range(MOST_SAMPLES):
            state, outputs[k] = sample(state, told)
            block = outputs[max(0, k + 1 - LOOKED_AT) : k + 1, i]
            if (k + 1) % LOOKED_AT == 0 and np.all(np.abs(block / step - 1.0) < SETTLED):
                break
        return outputs[: k + 1]

    def _solved(self, law: Any, i: int, step: Vector, pace: Matrix) -> Matrix:
        """Return the same of an MPC, whose programs of all steps are solved sample by sample."""
        loop, (A, B, C), count = self.loop, self.plants[0], len(step)
        rest, own = np.array(loop.ends["rest_output"])[:, None], np.eye(self.outputs)[:, [i]]
        asked, paces = rest[: self.outputs] + own * step, np.where(own > 0.0, pace[0], math.inf)
        paced = replace(law, pace=(math.inf,) * self.outputs)
        start = paced.initial_state(tuple(rest[:, 0].tolist()))
        state = type(start)(*(np.tile(part[:, None], count) for part in start))
        x, left = np.zeros((len(A), count)), np.arange(count)
        full = np.array([[1.0 / curve.gain_at_rest] for curve in law.curves])
        outputs = np.zeros((MOST_SOLVED, self.outputs, count))
        for k in range(MOST_SOLVED):
            y = C @ x
            outputs[k][:, left] = y[: self.outputs]
            paced = replace(law, pace=tuple(paces[:, left]))
            _, state = paced.stepped(state, rest + y, asked[:, left])
            low, high = (end[:, None] + slopes @ x for end, slopes in self._moving)
            x = A @ x + B @ np.clip(full * state.opening, low, high)
            if k % SOLVED_AT == SOLVED_AT - 1:
                late = outputs[k + 1 - SOLVED_AT : k + 1, i] / step
                on = np.any(np.abs(late[:, left] - 1.0) >= SETTLED, axis=0)
                # What has settled stays as it is.
                outputs[k + 1 :, :, left[~on]] = outputs[k][:, left[~on]]
                left, x = left[on], x[:, on]
                state = type(state)(*(part[:, on] for part in state))
                if not len(left):
                    break
        return outputs[: k + 1]


def _over(errors: Matrix, penalty: Matrix) -> Vector:
    """Return what steps come to, as of `LoopLimits._paced`, overshoots by their third power."""
    return np.asarray(np.sum(errors / errors.min(axis=0) * penalty**3, axis=1))


def _designed(designs: Iterable[Callable[[], D]]) -> list[D]:
    """Return the laws that can be designed.

    Raises:
        WorkbenchError: If there is none.
    """
    found: list[D] = []
    reason = WorkbenchError("there is nothing to design")
    for design in designs:
        try:
            found.append(design())
        except WorkbenchError as error:
            reason = error
    if not found:
        raise reason
    return found


SLOWER, MUCH_LESS = (0.5, 0.25, 0.12), 0.7
"""Frequencies up to which a model is trusted that are tried, over what a loop asks of it whose
steps are poor; and what steps must cost at most, over those of the loop before, to be taken."""

MOST_LATE = 40
"""Samples of a delay up to which steps reckon with it."""

MOST_SLOW = 4
"""Slowest modes of a loop that a reference may leave alone."""

SWINGS = 2.0
"""Frequency over rate of decay of a mode that swings on: a twenty-fifth is left after a period."""

STRIDES = (4, 2, 1)
"""Steps of a grid by which the speed of one output is changed."""

LARGE = (0.5, 3.0, 10.0)
"""Steps of which the reference's pace is chosen, over that which the command is just enough for."""

PACES = (3.0, 1.5, 0.75, 0.4)
"""Paces that are tried: what the command is just enough for, up or down, in the time of a small
step's rise."""

BRAKES = (8.0, 4.0, 2.0, 1.0, 0.5)
"""Brakes that are tried, over that which takes what the command is just enough for in the time of a
small step's rise."""

PARTS = (0.7, 0.5, 0.35, 0.25, 0.18, 0.12)
"""Paces that are tried beside a brake, over the fastest that it lets a reference move."""

STIRRED = 0.3
"""Largest change of a command in a sample that noise makes, rms, over that which its slew lets it
make: beyond, it lets little else through."""

SLOW = (4.0, 2.0, 1.0)
"""Paces that are tried over that which the commands' slews let them follow."""

LEFT = 0.8
"""Part of the commands' room that large steps are tried with: far from rest a plant takes more."""

MOST_SAMPLES, MOST_SOLVED = 2000, 400
"""Samples for which large steps are looked at, also of a law that solves something."""

LOOKED_AT, SOLVED_AT, SETTLED = 100, 50, 0.01
"""Samples after which a step, also of a law that solves something, has settled if it is as near as
this to where it goes in all of them, as a fraction of it."""


LAGS = (4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25)
"""Factors by which the speed of lags of the reference is changed."""


def _turned(
    P: Complex, K: Complex, late: Vector, noise: Matrix
) -> tuple[Vector, Vector, Vector, npt.NDArray[np.bool_]]:
    """Return what single loops reach at each frequency, turned by the worst angle up to `late`.

    Of several measurements, the loop is opened at the command, and at each of them with all others
    closed, there turned by nothing and by `late`.

    Args:
        P: Plant, shape (n_z, p, m), in SI.
        K: Laws, shape (n_laws, n_z, m, p), in SI.
        late: Angles, shape (n_z,), in rad.
        noise: Noise of the measurements over half of the commands' range, shape (m, p).

    Returns:
        |S| and |T|, shape (n_laws, n_z); squares of what noise moves the commands by, over half of
        their range, shape (n_laws, n_z, m); and whether a crossover is turned to -1, (n_laws,).
    """
    each = P[:, :, 0] * K[:, :, 0]
    L = each[..., 0] if each.shape[2] == 1 else each.sum(axis=2)
    gain, near, crossed = np.abs(L), np.abs(1.0 + L), np.zeros(len(L), dtype=bool)
    if late.any():
        margin = np.mod(np.angle(L) + np.pi, 2.0 * np.pi)
        reached = margin <= late
        crossed = np.any(np.diff(gain < 1.0, append=True) & reached, axis=1)
        turned = np.where(reached, 0.0, np.minimum(margin - late, 2.0 * np.pi - margin))
        # |1 + L| with -L = gain exp(j turned), without the difference of near numbers.
        near = np.hypot(gain - 1.0, 2.0 * np.sqrt(gain) * np.sin(0.5 * turned))
    s = 1.0 / np.maximum(near, 1e-300)
    t, stirred = gain * s, np.sum((np.abs(K) * s[..., None, None] * noise) ** 2, axis=3)
    for turn in (1.0, np.exp(-1j * late)) if each.shape[2] > 1 else ():
        share = each * (turn / (1.0 + L * turn))[..., None]
        s = np.maximum(s, np.abs(1.0 - share).max(axis=2) / AT_A_SENSOR)
        t = np.maximum(t, np.abs(share).max(axis=2) / AT_A_SENSOR)
    # One that is crossed between two frequencies comes near to it at both.
    return s, t, stirred, crossed | (s.max(axis=1) > NEAR)


def _turned_together(
    P: Complex, K: Complex, late: Vector, noise: Matrix, *, at_outputs: bool
) -> tuple[Vector, Vector, Vector, npt.NDArray[np.bool_]]:
    """Return the same of loops of several outputs or commands, all turned together.

    Args:
        at_outputs: Whether they are opened at all outputs too, or at each of them by itself.
    """
    one, two = (np.eye(k) for k in P.shape[1:])
    late = np.minimum(late, 2.0 * np.pi)
    shares = np.linspace(0.0, 1.0, 1 + math.ceil(float(late.max()) / TURN))
    # Between the ends of what is turned, only where that is something.
    tried = (late[:, None] > HARDLY) | (shares == 0.0) | (shares == 1.0)
    z, own = np.nonzero(tried)
    if len(shares) > 1:
        P, K = np.exp(-1j * late[z] * shares[own])[:, None, None] * P[z], K[:, z]
    S = _inverse(one + P @ K)
    KS = K @ S
    T = KS @ P
    s, t = least_gain(two - T), least_gain(T)
    if at_outputs:
        s, t = np.maximum(least_gain(S), s), np.maximum(least_gain(one - S), t)
    else:
        alone = np.diagonal(S, axis1=-2, axis2=-1)
        s = np.maximum(s, np.abs(alone).max(axis=-1) / AT_A_SENSOR)
        t = np.maximum(t, np.abs(1.0 - alone).max(axis=-1) / AT_A_SENSOR)
    moved = np.sum((np.abs(KS) * noise) ** 2, axis=3)
    if len(shares) > 1:
        first = np.searchsorted(z, np.arange(len(late)))
        s, t, moved = (np.maximum.reduceat(part, first, axis=1) for part in (s, t, moved))
    # A loop that some angle makes unstable comes near to it on the way.
    return s, t, moved, s.max(axis=1, initial=0.0) > NEAR


def _inverse(M: Complex) -> Complex:
    """Return the inverses of matrices, shape (..., k, k); of those of two rows by Cramer's rule."""
    if M.shape[-1] != 2:
        return np.asarray(np.linalg.inv(M))
    (a, b), (c, d) = np.moveaxis(M, (-2, -1), (0, 1))
    found = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return np.moveaxis(found, (0, 1), (-2, -1))


AT_A_SENSOR = 5.0
"""What a loop opened at one of more measurements than are followed may peak to, over its limits:
what one sensor tells wrongly, alone, is its gain, and by less than a tenth of it."""

TURN, HARDLY = 0.4, 0.02
"""Largest step between angles by which a loop of several outputs is turned, and largest angle that
is none, in rad."""

NEAR = 20.0
"""Sensitivity of a loop, a ratio, that a delay or a frequency between two may make unstable."""


def stacked(laws: Sequence[LinearLaw]) -> LinearLaw:
    """Return laws one behind the other, each matrix of shape (n_laws, ...)."""
    n, (m, k), count = max(len(law.F) for law in laws), laws[0].J.shape, len(laws)
    shapes = (count, n, n), (count, n, k), (count, m, n), (count, m, k)
    whole = LinearLaw(*(np.zeros(shape) for shape in shapes))
    for i, law in enumerate(laws):
        for part, own in zip(whole, law, strict=True):
            part[i, : own.shape[0], : own.shape[1]] = own
    return whole


def chosen(laws: LinearLaw, which: Any) -> LinearLaw:
    """Return some of laws."""
    return LinearLaw(*(part[which] for part in laws))


def response(laws: LinearLaw, z: Complex, inputs: int = 1) -> Complex:
    """Return the transfer functions of laws by their first inputs, in SI.

    Returns:
        Shape (n_laws, n_z, n_commands, n_inputs).
    """
    from scipy.linalg.lapack import dgebal, zgees

    entry = laws.G[:, :, :inputs]
    live = reached(np.any(entry != 0.0, axis=(0, 2)), np.any(laws.F != 0.0, axis=0))
    F = laws.F[:, live][:, :, live]
    T, b, c = (part.astype(complex) for part in (F, entry[:, live], laws.H[:, :, live]))
    n = len(live)
    for k in np.flatnonzero(np.any(np.tril(F, -1), axis=(1, 2))):
        even, _, _, size, _ = dgebal(F[k], scale=1, permute=0)
        T[k], _, _, Z, *_ = zgees(lambda _: True, even, lwork=8 * n)
        b[k], c[k] = Z.conj().T @ (b[k] / size[:, None]), (c[k] * size) @ Z
    x = np.zeros((len(T), n, len(z), inputs), dtype=complex)
    for i in reversed(range(n)):
        right = np.einsum("lj,ljzk->lzk", T[:, i, i + 1 :], x[:, i + 1 :])
        x[:, i] = (b[:, i, None] + right) / (z - T[:, i, i, None])[..., None]
    return np.asarray(np.einsum("lmn,lnzk->lzmk", c, x) + laws.J[:, None, :, :inputs])


def _closed(plant: tuple[Matrix, Matrix, Matrix], laws: LinearLaw) -> tuple[Matrix, Matrix]:
    """Return loops, shape (n_loops, n, n), and what references and loads enter them by."""
    (A, B, C), (F, G, H, J) = plant, laws
    n, count, p = len(A), len(F), len(C)
    closed = np.zeros((count, n + F.shape[1], n + F.shape[1]))
    closed[:, :n, :n], closed[:, :n, n:] = A + B @ J[:, :, :p] @ C, B @ H
    closed[:, n:, :n], closed[:, n:, n:] = G[:, :, :p] @ C, F
    asked = G.shape[2] - p
    entry = np.zeros((count, n + F.shape[1], asked + B.shape[1]))
    entry[:, :n, :asked], entry[:, n:, :asked], entry[:, :n, asked:] = (
        B @ J[:, :, p:],
        G[:, :, p:],
        B,
    )
    return closed, entry


def settled_after(law: Any, linear: LinearModel, steps: Mapping[str, float]) -> float:
    """Return the time, in s, after which steps, in SI of the outputs, have settled within 2 %.

    The law is within its ends on the linear model, and each output steps alone.
    """
    want = LoopSpecification(law.controlled, law.actuators, sample_time=law.sample_time)
    loop = loop_of(linear, law.controlled, law.actuators, law.sensors, law.sample_time)
    time, seen, _ = LoopLimits(loop, want).steps(stacked([law.around_rest()]))
    long, none = 0.0, (math.inf,) * len(law.controlled)
    paces, brakes = (getattr(law, name, ()) or none for name in ("pace", "brake"))
    for i, (name, pace, brake) in enumerate(zip(law.controlled, paces, brakes, strict=True)):
        away = np.flatnonzero(np.abs(seen[0, :, i, i] - 1.0) > 0.02)
        own = float(time[min(away[-1] + 1, len(time) - 1)]) if len(away) else 0.0
        if steps.get(name):
            far = abs(steps[name])
            moved = far / pace + 2.0 * math.sqrt(far / brake)
            long = max(long, own + moved * law.sample_time)
    return long


class Answer(NamedTuple):
    """What loops answer to steps of references and loads.

    Args:
        overshoot: Of a step of each reference, shape (n, n_outputs), as fractions of it.
        interaction: Most that such a step moves another output, shape (n, n_outputs), in their
            scales as a fraction of it.
        errors: Integrals of time by absolute error, shape (n, n_steps): after a unit step of each
            reference, in s2, then of each load, per SI of the command, times s2.
    """

    overshoot: Vector
    interaction: Vector
    errors: Matrix


def answer(time: Vector, seen: Matrix, going: Matrix, scale: Vector) -> Answer:
    """Measure outputs, of scales in SI, after unit steps; see `LoopLimits.steps`."""
    p, k = seen.shape[2:]
    target = np.eye(p, k)
    # What a step of one output does to another counts in their scales.
    weight = np.append(scale, np.ones(k - p)) / scale[:, None]
    counted = np.abs(seen - target) * weight
    others = np.where(target > 0.0, 0.0, counted)[:, :, :, :p].max(axis=2)
    away = time[:, None] * np.sum(counted, axis=2)
    each = 0.5 * (away[:, 1:] + away[:, :-1]) * np.diff(time)[:, None] * going[:, 1:, None]
    own = seen[:, :, np.arange(p), np.arange(p)]
    over, moved = ((part * going[:, :, None]).max(axis=1) for part in (own, others))
    return Answer(over - 1.0, moved, each.sum(axis=1))


def cost(found: Answer, least: Vector, overshoot: float) -> Vector:
    """Return the errors of loops, shape (n,), dimensionless.

    Args:
        least: Errors that they count over, shape (n_steps,), in the units of `Answer.errors`.
        overshoot: Of a step of a reference that is allowed, as a fraction of it.
    """
    beyond = np.maximum(found.overshoot.max(axis=1) - overshoot, 0.0)
    penalty = (1.0 + OVERSHOT * beyond) * (1.0 + found.interaction.max(axis=1)) ** 2
    return np.asarray(np.sum(found.errors / least, axis=1) * penalty)


def much_better(
    limits: LoopLimits, wider: LoopLimits, answered: Callable[[LoopLimits], tuple[float, Answer]]
) -> bool:
    """Tell whether a loop makes so much less of an error that what it reads more is worth it.

    Args:
        limits: Those of the loop without.
        wider: Those of the loop that reads more.
        answered: Returns the excess, a ratio, and the answer of a loop within limits.
    """
    found = []
    for tried in (limits, wider):
        try:
            excess, own = answered(tried)
        except WorkbenchError:
            return False
        if excess > 1.0:
            return False
        found.append(own)
    least = np.min([one.errors.min(axis=0) for one in found], axis=0)
    without, with_it = (float(cost(one, least, limits.want.overshoot)[0]) for one in found)
    return with_it < MUCH * without


MUCH = 0.05
"""Largest share of the errors of a loop of the followed outputs alone for which others are read:
they go with the square of time, so that it is some five times as fast."""

OVERSHOT = 10.0
"""What an overshoot beyond what is allowed, as a fraction of the step, adds to errors, a ratio."""
