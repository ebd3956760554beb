"""Design of PIDs for any linear model: the best to start from, by loop shaping, tuned gain by gain.

Units: SI.

Source: loop shaping with lag and lead: Åström and Murray, Feedback Systems, 2008, section 11.4.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.design import Design
from controllers.linear_law import LinearLaw
from controllers.plain.limits import NEARLY, Judged, LoopLimits, LoopSpecification
from controllers.plain.loop import Loop, loop_of
from controllers.plain.many_loops import chosen
from controllers.plain.measured_outputs import designed_for, much_better
from controllers.plain.pace import best_at_pace
from controllers.plain.pairing import best_pairings, decoupled, paired
from controllers.plain.selection import Answer, answer, steps
from controllers.plain.transfer_law import TransferLaw, pids
from controllers.specification import number
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import WorkbenchError, check_range
from workbench.linearisation import LinearModel


@dataclass(frozen=True)
class PlainPIDSpecification(LoopSpecification):
    """What a PID for any linear model is designed for.

    Args:
        bandwidth: Largest crossover frequency, in rad/s; by default (0) a tenth of the sampling's.
        error_scale: Smallest error for which all of the command may be used, in SI of the output;
            by default (0) noise alone limits the gain.
        decoupled: Whether the commands of several loops are mixed so that at rest, or at the speed
            of the loops, each moves its own output alone; by default where that makes a much
            better loop.
    """

    bandwidth: float = 0.0
    error_scale: float = number(0.0, 0.0, 1e30)
    decoupled: bool | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("bandwidth", self.bandwidth, 0.0, self.turning(1.0), "rad/s")


def design_plain_pid(
    linear: LinearModel, specification: PlainPIDSpecification | None = None
) -> TransferLaw:
    """Design a PID between commands and outputs of any linear model, one for each output.

    At a crossover frequency w, a zero at a share of w integrates, a lead network, no wider than it
    must be or with a filter far beyond w, gives the phase that is missing to a phase margin, and
    the gain is what is left. Of all w, shares and margins it
    is the best within limits (`controllers.plain.limits`), the reference weighted by what lets a
    step overshoot no further than it may; its four gains are then changed one by one as long as
    that helps.

    Several outputs are paired with commands (`controllers.plain.pairing`), or the commands mixed so
    that each PID moves its own output alone; of the best PIDs of each output alone, each at most so
    fast, those at the best share of their speeds are then changed gain by gain, in the loop of all.

    Raises:
        WorkbenchError: If no such loop is stable, no pairing can be, or a limit that was given is
            not held.
    """
    want = (specification or PlainPIDSpecification()).sampled(linear)
    return designed_for(want, linear, partial(_within, linear, want), partial(_cascade_helps, want))


def _cascade_helps(want: PlainPIDSpecification, limits: LoopLimits, wider: LoopLimits) -> bool:
    """Tell whether a cascade within limits is much better than a PID of its output alone."""
    if limits.outputs > 1 or len(limits.loop.actuators) > 1:
        return False

    def answered(tried: LoopLimits) -> tuple[float, Answer]:
        best = _best(tried, want)
        return best.excess, best.answer

    return much_better(limits, wider, answered)


def _within(linear: LinearModel, want: PlainPIDSpecification, limits: LoopLimits) -> TransferLaw:
    loop, h, limits = limits.loop, want.sample_time, limits.late
    best = _best(limits, want)
    gains, mix = best.gains, best.mix
    moved, read = np.any(mix != 0.0, axis=1), np.any(gains[:, :3] != 0.0, axis=1)
    if not (moved.all() and read.all()):
        # What belongs to no output rests, and what nothing depends on is not read.
        taken = tuple(u for u, moves in zip(loop.actuators, moved, strict=True) if moves)
        also = tuple(y for y, used in zip(loop.sensors, read, strict=True) if used)
        loop = loop_of(linear, loop.measured, taken, also, want.sample_time)
        mix, gains = mix[moved][:, read], gains[read]
        limits = LoopLimits(loop, want).late
    cascade = "PID cascade" if len(gains) > limits.outputs else "PID"
    name = "decoupled PID" if best.mixed else cascade
    law = pids(gains, mix, best.weight, loop.ends, sample_time=h, name=name)
    # What a command does slowly is no end: stopped by it, an integral is as slow.
    ended = [law.conditioned()] if np.isinf(loop.slew).all() else []
    return best_at_pace(limits, [law, *ended])


def _best(limits: LoopLimits, want: PlainPIDSpecification) -> _PIDs:
    tuned = []
    for one in _begun(limits, want):
        own = _PIDLimits(limits, want, one.mix)
        tuned.append(_tuned(own, one))
        if np.any(one.answer.undershoot > want.overshoot):
            # The way to better gains may lead by some that go far the wrong way.
            tuned.append(_tuned(own, _tuned(own, one, math.inf)))
    return _best_of(tuned, want.overshoot)


STEPS = (2.0, 1.5, 1.5, 1.5, 1.3, 1.3, 1.3, 1.15, 1.15, 1.15, 1.07, 1.07)
"""Factors by which each gain is changed, as long as that is better."""


def _tuned(own: _PIDLimits, start: _PIDs, backwards: float | None = None) -> _PIDs:
    """Return PIDs whose gains are changed as long as that makes the loop of all better.

    Args:
        backwards: How far a step may go the wrong way, as a fraction of it; as far as it may
            overshoot by default.
    """
    allowed, n = (own.want.overshoot, backwards), len(start.gains)
    gains, weight, best = start.gains, start.weight, start.answer
    error, stuck = best.cost(*allowed, least=start.least)[0], 0.0
    for step in STEPS:
        if step == stuck:
            continue
        stuck = step
        # Each gain, and all of a PID but its filter time together.
        which = np.vstack([np.eye(4 * n), np.kron(np.eye(n), [[1.0, 1.0, 1.0, 0.0]])])
        which = which[which @ np.abs(gains).ravel() > 0.0]
        changes = step ** np.kron(which, [[1.0], [-1.0]]).reshape(-1, n, 4)
        while len(changes):
            may = np.flatnonzero(own.stable(gains * changes))
            tries = (gains * changes)[may]
            weights, found = own.weighed(tries)
            errors = found.cost(*allowed, least=start.least)
            for k in np.flatnonzero(errors < error):
                if own.limits.judge(own.laws(tries[[k]])).excess <= start.excess:
                    gains, weight, error, stuck = tries[k], weights[k], errors[k], 0.0
                    best, changes = chosen(found, [k]), changes[may[k] + 1 :]
                    break
            else:
                break
    return start._replace(gains=gains, weight=weight, answer=best)


class _PIDs(NamedTuple):
    """PIDs, one for each output.

    Args:
        mix: What each adds to the commands, shape (m, p).
        gains: Kp, Ki, Kd and Tf of each, shape (p, 4); of a cascade the outer one's first, with
            what is measured within, whose reference is the outer one's command.
        weight: Weights of the references, shape (p,), dimensionless.
        speed: Mean crossover of the best alone, in rad/s.
        excess: Largest ratio to a limit that a better one may have, 1 or more.
        least: Least errors of all that hold the limits, as of `Answer`.
    """

    mix: Matrix
    gains: Matrix
    weight: Vector
    speed: float
    excess: float
    least: Vector
    answer: Answer

    @property
    def mixed(self) -> bool:
        """Whether one of them acts on several commands."""
        return bool(np.any(np.count_nonzero(self.mix, axis=0) > 1))


MUCH_BETTER = 1.5
"""What errors of PIDs that each act on one command may be over those of mixed ones, a ratio."""


def _badness(found: Sequence[_PIDs], overshoot: float) -> list[float]:
    """Return how bad PIDs are beside each other, ratios; those of several commands are worse."""
    least = np.min([one.answer.least for one in found], axis=0)
    costs = [one.excess**4 * float(one.answer.cost(overshoot, least=least)[0]) for one in found]
    return [
        own * (MUCH_BETTER if one.mixed else 1.0) for own, one in zip(costs, found, strict=True)
    ]


def _best_of(found: Sequence[_PIDs], overshoot: float) -> _PIDs:
    """Return the best of PIDs that an overshoot, as a fraction of a step, is allowed."""
    return found[int(np.argmin(_badness(found, overshoot)))]


WEIGHTS = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)
"""Weights of the reference that are tried, dimensionless."""


@dataclass(frozen=True, eq=False)
class _PIDLimits:
    """Limits on PIDs that add to the commands by a mix, given by gains of shape (n, p, 4)."""

    limits: LoopLimits
    want: PlainPIDSpecification
    mix: Matrix

    def laws(self, gains: Matrix) -> LinearLaw:
        """Return the laws around rest, whose references enter beside their weights, and by them."""
        h, followed = self.want.sample_time, self.limits.outputs
        kp, ki, kd, filter_time = np.moveaxis(gains, 2, 0)
        fade, slope = filter_time / (filter_time + h), kd / (filter_time + h)
        (n, p), at = kp.shape, np.arange(kp.shape[1])
        F, G = np.zeros((n, 2 * p, 2 * p)), np.zeros((n, 2 * p, 3 * p))
        H, J = np.zeros((n, p, 2 * p)), np.zeros((n, p, 3 * p))
        F[:, at, at], F[:, p + at, p + at], H[:, at, at] = at < followed, fade, 1.0
        G[:, at, at], G[:, at, p + at] = -h * ki, h * ki
        G[:, p + at, at], H[:, at, p + at] = fade - 1.0, -slope
        J[:, at, at], J[:, at, 2 * p + at] = -kp - slope, kp
        kept = np.concatenate([at, p + at[:followed], 2 * p + at[:followed]])
        return LinearLaw(F, G[:, :, kept], self.mix @ H, self.mix @ J[:, :, kept])

    def small(self, gains: Matrix) -> Any:
        """Tell which ask for no more than an error of its scale may."""
        scale = np.abs(self.mix / self.limits.loop.command_scale[:, None]).max(axis=0)
        largest = 1.0 / np.maximum(self.want.error_scale * scale, 1e-300)
        strongest = np.abs(gains[..., 0] + gains[..., 2] / (gains[..., 3] + self.want.sample_time))
        return (strongest <= largest).all(axis=-1)

    def stable(self, gains: Matrix) -> Any:
        """Tell which of them make a stable loop."""
        may = self.small(gains)
        may[may] = self.limits.stable(self.laws(gains[may]))
        return may

    def judged(self, gains: Matrix, size: int, enough: Callable[[Vector], bool]) -> Judged:
        """Judge so many at a time until excesses are enough, or all if none is within limits."""
        found = Judged(*np.zeros((3, 0)))
        for k in range(0, len(gains), size):
            part = self.limits.judge(self.laws(gains[k : k + size]), 1.0)
            found = Judged(*map(np.append, found, part))
            if enough(found.excess):
                break
        within = found.excess.min(initial=math.inf) <= 1.0
        return found if within else self.limits.judge(self.laws(gains))

    def weighed(self, gains: Matrix) -> tuple[Matrix, Answer]:
        """Return the largest weights by which steps overshoot no further than allowed, and answers.

        The weight of a reference changes nothing but the steps of its own.
        """
        p, allowed = self.limits.outputs, self.want.overshoot
        time, seen, going = steps(self.limits, self.laws(gains))
        kept, parts = np.full((len(seen), p), WEIGHTS[-1]), []
        for i in range(p):
            beside, by, left = seen[:, :, :, i], seen[:, :, :, p + i], np.arange(len(seen))
            own, more = beside[:, :, i] * going, by[:, :, i] * going
            for weight in WEIGHTS:
                fits = np.max(own + more * weight, axis=1) - 1.0 <= allowed
                kept[left[fits], i] = weight
                left, own, more = left[~fits], own[~fits], more[~fits]
            parts.append(beside + by * kept[:, [i], None])
        whole = np.concatenate([np.stack(parts, axis=3), seen[:, :, :, 2 * p :]], axis=3)
        return kept, answer(time, whole, going, self.limits.loop.output_scale)

    def best(self, gains: Matrix, speed: Vector, judged: Judged, family: str) -> _PIDs:
        """Return the best of those, of crossovers in rad/s, that hold the limits; see `held`."""
        held = self.limits.held(judged, family)
        weights, found = self.weighed(gains[held])
        k = int(np.argmin(found.cost(self.want.overshoot)))
        return _PIDs(
            self.mix,
            gains[held[k]],
            weights[k],
            float(speed[held[k]]),
            max(1.0, float(judged.excess[held].max())),
            found.least,
            chosen(found, [k]),
        )


HOPELESS = 20.0
"""What errors of PIDs may be before their gains are changed, over those of others, a ratio."""


def _begun(limits: LoopLimits, want: PlainPIDSpecification) -> list[_PIDs]:
    """Return PIDs to start from: the best of a command each, and the best of all commands."""
    loop = limits.loop
    if loop.read is not None:
        return [_cascade(limits, want)]
    if loop.linear.D.shape == (1, 1):
        return [_begun_by(limits, want, np.eye(1))]
    ways: list[Callable[[float], Matrix]] = []
    if not want.decoupled:
        ways.append(lambda w: paired(loop, best_pairings(loop, w)[-1]))
    if want.decoupled is not False:
        ways.append(partial(decoupled, loop))
    mixes: list[Matrix] = []
    found: list[_PIDs] = []
    refused: list[WorkbenchError] = []
    # Which pairs are best at rest says nothing of faster loops.
    for share in (0.0, *FASTER):
        speed = share * (found[0].speed if found else 0.01 / want.sample_time)
        for way in ways if share <= 1.0 else ways[: 0 if want.decoupled else 1]:
            try:
                mix = way(speed)
                if any(np.allclose(mix, known, rtol=0.02) for known in mixes):
                    continue
                mixes.append(mix)
                found.append(_begun_by(limits, want, mix))
            except WorkbenchError as error:
                refused.append(error)
    if not found:
        raise refused[0]
    kinds = [[one for one in found if one.mixed == mixed] for mixed in (False, True)]
    best = [_best_of(kind, want.overshoot) for kind in kinds if kind]
    bad = _badness(best, want.overshoot)
    return [one for one, own in zip(best, bad, strict=True) if own < HOPELESS * min(bad)]


FASTER = (1.0, 5.0, 25.0)
"""Speeds at which pairs are told, over that of the best loops of those that are best at rest."""


def _crossovers(want: PlainPIDSpecification) -> tuple[Vector, Complex]:
    """Return crossovers that are tried, from fast to slow, in rad/s, and what turns loops there."""
    top = want.bandwidth or 0.1 * 2.0 * math.pi / want.sample_time
    tried = np.geomspace(top, 1e-5 * top, 70)
    return tried, np.exp(-1j * tried * (0.5 * want.sample_time + want.delay))


INNER_EVERY, OUTER = 4, (2, 6, 10, 15, 20)
"""Of the crossovers that are tried, every how many an inner loop is tried at; and how many places
slower the loop around it."""


def _cascade(limits: LoopLimits, want: PlainPIDSpecification) -> _PIDs:
    """Return the best PID of one output around a PD of another that is measured.

    At each speed w the inner loop has a phase margin, alone; around it the outer loop is tried at
    shares of w. Which of them are stable together, however each is alone, is left to the limits.
    """
    loop = limits.loop
    sensors, m = len(loop.sensors), len(loop.actuators)
    if limits.outputs > 1 or m > 1:
        raise WorkbenchError(
            f"a PID cascade of the workbench follows one output by one command, not {loop.words};"
            " leave also_measured out, or take another family, such as lqi"
        )
    tried, turned = _crossovers(want)
    seen, found, speeds = loop.response(tried, read=True)[:, :, 0] * turned[:, None], [], []
    for k in range(1, sensors):
        within = np.arange(0, len(tried), INNER_EVERY)
        inner, crossed = _at_crossover(tried[within], seen[within, k], ZEROS[-1:])
        inner[:, 1] = 0.0
        for slower in OUTER:
            place = within[crossed] + slower
            kept = place < len(tried)
            place, pd = place[kept], inner[kept]
            kp, _, kd, fade = pd.T
            s = 1j * tried[place]
            through = seen[place, k] * (kp + kd * s / (fade * s + 1.0))
            plant = seen[place, 0] / (1.0 + through)
            outer, which = _at_crossover(tried[place], plant, ZEROS[-3:], PHASE_MARGINS[::2])
            both = np.zeros((len(outer), sensors, 4))
            both[:, 0], both[:, k] = outer, pd[which]
            found.append(both)
            speeds.append(tried[place[which]])
    own_limits = _PIDLimits(limits, want, np.ones((1, sensors)))
    tries, speed = np.concatenate(found), np.concatenate(speeds)
    may = own_limits.stable(tries)
    judged = limits.judge(own_limits.laws(tries[may]))
    return own_limits.best(tries[may], speed[may], judged, "a PID cascade")


SLOWEST = 0.03
"""Slowest crossover of a single loop that is tried, over that of the fastest within the limits."""

AT_ONCE, ALONE_AT_ONCE = 24, 256
"""PIDs of several loops, and of one, that are judged together."""


def _begun_by(limits: LoopLimits, want: PlainPIDSpecification, mix: Matrix) -> _PIDs:
    """Return the best PIDs that add to the commands by a mix."""
    own = _PIDLimits(limits, want, mix)
    tried, turned = _crossovers(want)
    responses = limits.loop.response(tried) @ mix * turned[:, None, None]
    if limits.outputs == 1:
        return own.best(*_alone(own, tried, responses[:, 0, 0], SLOWEST), "a PID")
    tries, speed = _slowed(own, tried, responses)
    may = own.stable(tries)
    # Few of many need to be judged: the best first.
    order = np.argsort(own.weighed(tries[may])[1].cost(want.overshoot))
    tries, speed = tries[may][order], speed[may][order]
    judged = own.judged(tries, AT_ONCE, lambda excess: bool(excess.min() <= 1.0))
    return own.best(tries, speed, judged, "a PID of each output")


def _alone(
    own: _PIDLimits, speeds: Vector, plant: Complex, slowest: float
) -> tuple[Matrix, Vector, Judged]:
    """Return PIDs of one output, shape (n, 1, 4), their crossovers in rad/s and what they reach.

    They are tried from fast to slow, up to a slowest over the fastest within the limits.
    """
    tries, which = _at_crossover(speeds, plant)
    tries, speed = tries[:, None], speeds[which]
    small = own.small(tries)
    tries, speed = tries[small], speed[small]

    def slow(excess: Vector) -> bool:
        fastest = speed[: len(excess)][excess <= 1.0].max(initial=0.0)
        return bool(np.any(speed[len(excess) :][:1] < slowest * fastest))

    judged = own.judged(tries, ALONE_AT_ONCE, slow)
    count = len(judged.excess)
    return tries[:count], speed[:count], judged


SLOWER = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05, 0.03, 0.02, 0.01)
"""Crossovers that are tried of several loops at once, over those of each alone."""

TAKEN = (1.0, 0.75)
"""Shares of the limits that each of several loops alone may take: what others do to it takes the
rest."""

MOST_PIDS = 130
"""Most choices of speeds of several loops that are tried."""


def _slowed(own: _PIDLimits, speeds: Vector, plant: Complex) -> tuple[Matrix, Vector]:
    """Return PIDs of all loops, shape (n, p, 4), of which each is the best alone that is so fast.

    A pair that is late, or answers the wrong way first, is slow by itself; what it is in the loop
    of all is left to the limits. Where a pair alone cannot be stable, such as one of two magnets
    under one beam, all loops cross at one speed, with one phase.

    The mean crossover of the best alone, or of each, shape (n,), is told beside them, in rad/s.
    """
    p = plant.shape[1]
    crossed: list[float] = []
    best: dict[float, list[list[Vector]]] = {share: [] for share in TAKEN}
    for i in range(p):
        pair = LoopLimits(_pair(own.limits.loop, own.mix, i), own.want)
        single = _PIDLimits(pair, own.want, np.eye(1))
        tries, speed, judged = _alone(single, speeds, plant[:, i, i], 0.5 * SLOWER[-1])
        least = float(judged.excess.min(initial=math.inf))
        if not math.isfinite(least):
            each = [_at_crossover(speeds, plant[:, k, k]) for k in range(p)]
            return _together([(gains, speeds[which]) for gains, which in each])
        held = np.flatnonzero(judged.excess <= max(1.0, NEARLY * least))
        tries, speed, excess = tries[held], speed[held], judged.excess[held]
        costs = single.weighed(tries)[1].cost(own.want.overshoot)
        crossed.append(float(speed[int(np.argmin(costs))]))
        for taken, every in best.items():
            quiet = excess <= max(taken, NEARLY * least)
            slower = []
            for share in SLOWER:
                slow = np.flatnonzero(quiet & (speed <= 1.001 * share * crossed[-1]))
                if len(slow):
                    slower.append(tries[slow[int(np.argmin(costs[slow]))], 0])
            every.append(slower)
    found = []
    for every in best.values():
        most = max(map(len, every))
        whole = np.array([some + some[-1:] * (most - len(some)) for some in every])
        few = min(most, int(MOST_PIDS ** (1.0 / p)))
        steps = np.linspace(0.0, most - 1.0, few).round().astype(int).tolist()
        found += [whole[range(p), each] for each in itertools.product(steps, repeat=p)]
    return np.array(found), np.full(len(found), np.exp(np.mean(np.log(crossed))))


def _pair(loop: Loop, mix: Matrix, i: int) -> Loop:
    """Return the loop of one output and what its PID adds to the commands, all others open."""
    own, endless = loop.linear, np.array([math.inf])
    linear = replace(
        own,
        B=own.B @ mix[:, [i]],
        C=own.C[[i]],
        D=np.zeros((1, 1)),
        input_names=(f"PID of {loop.measured[i]}",),
        output_names=loop.measured[i : i + 1],
    )
    # What the PID may add to the commands, each of which it takes part of.
    scale = np.array([1.0 / np.abs(mix[:, i] / loop.command_scale).max()])
    reduced = linear.without_unseen().without_unreached()
    return Loop(reduced, -endless, endless, scale, endless, (None,), (0.0,))


def _together(alone: Sequence[tuple[Matrix, Vector]]) -> tuple[Matrix, Vector]:
    """Return PIDs of all loops, shape (n, p, 4), of one crossover, with every choice of signs."""
    found: list[list[Vector]] = []
    speeds: list[float] = []
    for w in sorted(set.intersection(*(set(speed.tolist()) for _, speed in alone))):
        rows = [tries[speed == w] for tries, speed in alone]
        for signs in itertools.product((1.0, -1.0), repeat=len(rows)):
            own = [row[np.sign(row[:, 0]) == s] for row, s in zip(rows, signs, strict=True)]
            found += [[row[k] for row in own] for k in range(min(map(len, own)))]
            speeds += [w] * (len(found) - len(speeds))
    return np.array(found).reshape(-1, len(alone), 4), np.array(speeds)


ZEROS = (0.03, 0.15, 0.4, 1.0, 2.5, 6.0, 15.0)
"""Times of the integral that are tried, in time constants of the crossover."""

NEARLY_INTEGRALS = (0.03, 0.15)
"""Those among them that leave little but the integral, for a resonance; every third speed is tried
with them."""

PHASE_MARGINS = (1.15, 0.95, 0.75, 0.55)
"""Phase margins that are tried, in rad."""

LIFT = 1.4
"""Largest phase that a lead network gives, in rad."""

FILTER = 0.1
"""Time constant of the derivative's filter that is tried beside that of the least lead, in time
constants of the crossover."""


def _at_crossover(
    speeds: Vector,
    plant: Complex,
    zeros: Sequence[float] = ZEROS,
    margins: Sequence[float] = PHASE_MARGINS,
) -> tuple[Matrix, npt.NDArray[np.int_]]:
    """Return PIDs, of either sign, that give the loop a phase margin at a speed, or more.

    Returns:
        Kp, Ki, Kd and Tf, shape (n, 4), in SI, and the places of their speeds, shape (n,).
    """
    signs, filters = (1.0, -1.0), (0.0, FILTER)
    grid = np.meshgrid(np.arange(len(speeds)), zeros, margins, signs, filters, indexing="ij")
    which, zero, margin, sign, sharp = (part.ravel() for part in grid)
    rare, which = np.isin(zero, NEARLY_INTEGRALS), which.astype(int)
    w, P = speeds[which], plant[which]
    missing = margin - np.pi - np.angle(P) + np.arctan(1.0 / zero) + np.where(sign < 0.0, np.pi, 0)
    lift = missing - 2.0 * np.pi * np.round(missing / (2.0 * np.pi))
    may = (P != 0.0) & (lift <= LIFT) & ~(rare & (which % 3 > 0))
    may &= (sharp == 0.0) | ((lift > 0.0) & (lift + np.arctan(sharp) < LIFT))
    w, P, zero, sign, sharp = w[may], P[may], zero[may], sign[may], sharp[may]
    integrating, lift = zero / w, lift[may]
    lift = np.where(sharp > 0.0, lift, np.maximum(lift, 0.2))
    ratio = np.sqrt((1.0 + np.sin(lift)) / (1.0 - np.sin(lift)))
    ahead = np.where(sharp > 0.0, np.tan(lift + np.arctan(sharp)), ratio)
    behind = np.where(sharp > 0.0, sharp, 1.0 / ratio)
    lead, fast = ahead / w, behind / w
    shape = (1.0 - 1j / zero) * (1.0 + 1j * ahead) / (1.0 + 1j * behind)
    gain = sign / np.abs(P * shape)
    # (1 + 1 / Ti s) (1 + Td s) / (1 + Tf s) as a sum of its three parts.
    kp = gain * (integrating + lead - fast) / integrating
    return np.column_stack([kp, gain / integrating, gain * lead - kp * fast, fast]), which[may]


PLAIN_PID = Design(
    name="plain-pid",
    family="PID",
    summary="PID of each followed output by a command of its own, for any linear model",
    function=design_plain_pid,
    specification=PlainPIDSpecification,
)
