"""Limits on the loop of a law between measurements and commands.

A law is within them if its sampled loop, with every delay up to that which it must tolerate, and
with the lag and without, has

    Ms = max |1 / (1 + L)|, Mt = max |L / (1 + L)| within their limits,   |T| w <= trusted frequency

(`controllers.plain.many_loops`) and the noise of the measurements moves no command by more than a
share of half its range. Delays of a linear system count as they are, and as the Pade functions that
a law reckons with. Where no law holds all limits, as no loop of a plant that is unstable and late
does, those are taken that exceed them least.

Units: SI.

Source: Panagopoulos, Åström and Hägglund, Design of PID controllers based on constrained
optimisation, IEE Proc. Control Theory Appl. 149, 2002.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from controllers.linear_law import LinearLaw
from controllers.plain.loop import Loop, followed_by, loop_of, outputs_of
from controllers.plain.many_loops import AT_A_TIME, Peaks, chosen, closed, log_radii, peaks, stacked
from controllers.plain.pairing import zeros
from controllers.sensitivity import sampled_at
from controllers.specification import Checked, number
from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.exact_delays import SAME, Channels, channels_of, held
from workbench.linearisation.state_space import linear_model
from workbench.linearisation.time_scales import noise_of, usual_sample_time
from workbench.linearisation.transfer import transfer_function
from workbench.model.linear_system import LinearEquations, pade
from workbench.model.units import in_time

ANGLE = np.geomspace(1e-6, 0.98 * np.pi, 300)
"""Frequencies at which a loop is judged, in rad per sample."""

NEARLY = 1.05
"""Largest ratio to a limit, or to the least that is to be had, of what is as good."""

USUAL_SENSITIVITY, USUAL_COMPLEMENTARY = 1.8, 2.8
"""Limits on Ms and Mt, ratios, where none is given."""

USUAL_QUIET, HOLDING_QUIET = 0.02, 0.06
"""What noise may move a command by, rms, as a fraction of half its range, where nobody says; also
that of a plant that is unstable."""

STIRRED = 0.3
"""Largest change of a command in a sample that noise makes, rms, over that which its slew lets it
make: beyond, it lets little else through."""

ALIASES = 20
"""Frequencies, to either side, that look alike to samples and are reckoned with."""

MOST_LATE, FEWEST = 40, 10
"""Samples of a delay up to which steps reckon with it, and those that are enough of more commands
each of which is on its way for them."""

FINER = 0.25
"""Least sample time over the usual that is taken for a delay to be one of whole samples."""

SURE = 2.0
"""Angle that a delay turns, in rad, up to which a step shows its Pade function as the delay."""

MOST_APART = 8
"""Commands on their way, beyond those of all channels alike, up to which a regulator has them."""

FEEDBACK = "a state feedback"
"""What a state feedback is called."""


class Judged(NamedTuple):
    """What loops reach, each of shape (n,).

    Args:
        sensitivity: Largest Ms over the corners, ratios.
        complementary: Largest Mt over the corners, ratios.
        excess: Largest ratio to a limit; at most 1 if all are held, infinite if it is not stable.
    """

    sensitivity: Vector
    complementary: Vector
    excess: Vector


def of_whole_samples(
    linear: LinearModel, usual: float, commands: int, delay: float | None = None
) -> float:
    """Return a sample time, in s, of which delays are whole samples, as many as steps reckon with.

    Args:
        usual: The sample time without them, in s.
        commands: How many commands are late.
        delay: A delay that somebody states beside those of the plant, in s: a sample time that is
            shorter than usual will do then, too.
    """
    own = channels_of(linear)
    behind = (max(own.delays, default=0.0) if own else 0.0) + (delay or 0.0)
    if not behind:
        return usual
    # More samples of it than steps reckon with make no loop any faster.
    most = max(MOST_LATE // max(commands, 1), FEWEST)
    count = min(max(math.ceil(behind / usual - 1e-9), 1), most)
    # Up to twice as long, each of two delays may be whole samples, and not their sum alone.
    shares = ((n, n * (delay or 0.0) / behind) for n in range(count, count // 2, -1))
    part = behind / next((n for n, own in shares if abs(own - round(own)) < SAME * n), count)
    # A sum of delays ends in what its last digits make of it.
    part = float(f"{part:.12g}")
    return part if part >= FINER * usual and (part > usual or delay is not None) else usual


@dataclass(frozen=True)
class LoopSpecification(Checked):
    """What every design for any linear model is told.

    Args:
        measured: Name of the followed output, or several with commas between or as a list; by
            default those that the commands hold independently.
        actuator: Name of the command, or several; by default the first that moves one output, all
            for several.
        sample_time: Time between steps, in s; by default (0) what shows the plant's response, and
            makes its delays whole samples (`usual_sample_time`).
        maximum_sensitivity: Limit on Ms, the peak of the sensitivity (ratio); by default (0) 1.8,
            or the least that a loop of this plant has.
        maximum_complementary: Limit on Mt, the peak of the complementary sensitivity (ratio); by
            default (0) 2.8, or the least that a loop of this plant has.
        delay: Delay beside that of sampling up to which the limits hold, in s, and by which a law
            with a model predicts.
        sensor_lag: Time constant of the sensor with which the limits hold as well, in s.
        trusted_frequency: Frequency above which nothing of the model is trusted, in rad/s; every
            one is by default (0).
        quiet: What the noise of the measurement may move the command by, rms, as a fraction of half
            its range; by default (0) 0.02, or 0.06 to hold a plant that is unstable.
        overshoot: Overshoot of a step within the command's ends that is allowed, as a fraction of
            the step.
        noise: Noise rms of every measurement, in SI of the output; by default (0) what the sensor
            declares, and 1e-4 of its scale at least where one is declared or no noise is.
        also_measured: Name of an output that is read and that nobody follows, or several with
            commas between or as a list; by default none, or all that show the same states where
            no loop of the followed outputs alone is within its limits, or a much better one is
            with them.
        step: How far references step at once, in SI of the followed output, or of each, 0 for as
            far as the linear model is of use (`workbench.linearisation.first_step`), which is the
            default: so far the plant's equations are asked whether they bear it.
    """

    measured: str | tuple[str, ...] = ""
    actuator: str | tuple[str, ...] = ""
    _: KW_ONLY
    sample_time: float = number(0.0, 0.0, TIMES_S[1], "s")
    maximum_sensitivity: float = 0.0
    maximum_complementary: float = 0.0
    delay: float = number(0.0, 0.0, TIMES_S[1], "s")
    sensor_lag: float = number(0.0, 0.0, TIMES_S[1], "s", "lag of the sensor")
    trusted_frequency: float = number(0.0, 0.0, 1.0 / TIMES_S[0], "rad/s")
    quiet: float = number(0.0, 0.0, 1e9, words="share of the command that noise may take")
    overshoot: float = number(0.02, 0.0, 1.0)
    noise: float = number(0.0, 0.0, 1e30)
    also_measured: str | tuple[str, ...] = ""
    step: float | tuple[float, ...] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for size in np.atleast_1d(self.step).tolist():
            check_range("step", size, -1e30, 1e30)
        if self.sample_time:
            check_range("sample time", self.sample_time, *TIMES_S, "s")
        ms, mt = self.maximum_sensitivity, self.maximum_complementary
        for name, value, least in (("Ms", ms, 1.05), ("Mt", mt, 1.0)):
            if value:
                check_range(f"limit on {name}", value, least, 10.0)

    def turning(self, angle: float) -> float:
        """Return the frequency, in rad/s, that turns an angle, in rad, in a sample.

        It is without end where nobody says how long a sample is.
        """
        return angle / self.sample_time if self.sample_time else math.inf

    def check_names(self, plant: Any) -> None:
        """Refuse names of outputs and commands that a plant does not have.

        Raises:
            WorkbenchError: With the names that it has.
        """
        whole = linear_model(plant)
        for outputs in (self.measured, self.also_measured):
            followed_by(whole, outputs, self.actuator)

    def sampled(self, plant: Any) -> Self:
        """Return the specification with the sample time that a plant asks for, if it has none."""
        if self.sample_time:
            return self
        whole = linear_model(plant)
        followed, acting, commands = followed_by(whole, self.measured, self.actuator)
        usual, late = usual_sample_time(whole, followed), len(acting or commands)
        return replace(self, sample_time=of_whole_samples(whole, usual, late, self.delay or None))

    def loop_noise(self, loop: Loop) -> Vector:
        """Return the noise rms that is reckoned with, shape (n_sensors,), in SI."""
        read = outputs_of(loop.shown)
        own = np.array([noise_of(q) for q in read])
        # What the equations tell of a size is less sure than what a sensor declares.
        sure = np.array([q.sized for q in read]) | (own == 0.0)
        least = np.maximum(own, np.where(sure, 1e-4, 0.0) * [q.scale for q in read])
        return np.full_like(least, self.noise) if self.noise else least

    def loop(self, linear: Any) -> Loop:
        """Return the loop to control."""
        return loop_of(linear, self.measured, self.actuator, self.also_measured, self.sample_time)


@dataclass(frozen=True, eq=False)
class LoopLimits:
    """The limits of a specification on a loop, late in steps and stability by some samples.

    In exact ones the plant's own delays are no Pade functions. In foreseen ones steps that are not
    late are those of the loop that a law with a model reckons with.
    """

    loop: Loop
    want: LoopSpecification
    late_by: int = 0
    exact: bool = False
    foreseen: bool = False

    @property
    def outputs(self) -> int:
        """Number of outputs that are followed."""
        return len(self.loop.measured)

    @property
    def sensors(self) -> int:
        """Number of outputs that are read."""
        return len(self.loop.sensors)

    @cached_property
    def growing(self) -> bool:
        """Whether the plant is unstable."""
        return bool(np.any(self.loop.linear.poles.real > 0.0))

    @property
    def is_late(self) -> bool:
        """Whether commands are late or the plant has delays of its own."""
        return self.want.delay > 0.0 or bool(self._delays.any())

    @property
    def late(self) -> LoopLimits:
        """The same, whose steps are those of commands that are late by all delays."""
        h = self.want.sample_time
        count = round(self.want.delay / h)
        own = max(self._channels.delays, default=0.0) / h if self._channels else 0.0
        # A delay that is no whole samples is rounded up to some.
        if not 0 < count + own < MOST_LATE + 1:
            return self
        return replace(self, late_by=count, exact=own > 0.0)

    @cached_property
    def _channels(self) -> Channels | None:
        return None if self.want.sensor_lag else channels_of(self.loop.shown)

    @property
    def chain(self) -> Channels | None:
        """The plant whose commands are on their way for some samples, of limits that are late.

        None where samples that differ from command to command, or output to output, are many.
        """
        own, shown = self._channels, self.loop.shown
        if not (self.late_by or self.exact) or (own is None and self._delays.any()):
            return None
        if own is None:
            n, m = shown.B.shape
            none = np.zeros_like(shown.D)
            order, now = tuple(range(m)), (0.0,) * m
            own = Channels(shown.A, shown.B, shown.C, none, order, now, tuple(range(n)), ())
        apart = (max(own.delays) - min(own.delays)) / self.want.sample_time
        late = own.later(self.late_by * self.want.sample_time)
        return late if apart * shown.B.shape[1] <= MOST_APART else None

    @property
    def passing(self) -> int:
        """Samples that steps take to pass all delays, of limits that are late."""
        own = self._channels.delays if self.exact and self._channels else ()
        return self.late_by + math.ceil(max(own, default=0.0) / self.want.sample_time)

    @property
    def surest(self) -> float:
        """Speed up to which what stands for delays does as they do, in rad/s."""
        if self.late_by or self.exact:
            return math.inf
        longest = max(self.want.delay, float(self._delays.max(initial=0.0)))
        return SURE / longest if longest else math.inf

    @property
    def whole_samples(self) -> int:
        """Samples by which all commands act late, of limits that are late; 0 if not by as many."""
        if not (chain := self.chain) or chain.D.any():
            return 0
        samples = np.array(chain.delays) / self.want.sample_time
        alike = np.all(np.abs(samples - round(samples[0])) < SAME * MOST_LATE)
        return round(samples[0]) if alike else 0

    @cached_property
    def predicted(self) -> Loop:
        """The loop that a law with a model reckons with: the commands are late by the delay."""
        return self.loop.late(self.want.delay)

    @cached_property
    def plants(self) -> list[tuple[Matrix, Matrix, Matrix]]:
        """The sampled plant without the lag, and with it, states in their scales."""
        own, size, h = self.loop.linear, self.loop.linear.state_scales, self.want.sample_time
        A, B, C = own.A * size / size[:, None], own.B / size[:, None], self.loop.shown.C * size
        if self.exact and self._channels:
            kept = size[list(self._channels.kept)]
            part = self._channels._replace(
                A=self._channels.A * kept / kept[:, None],
                B=self._channels.B / kept[:, None],
                C=self._channels.C * kept,
            )
            return [held(part.later(self.late_by * h), B.shape[1], h)[:3]]
        corners = [(self.late_by * h, lag) for lag in sorted({0.0, self.want.sensor_lag})]
        return sampled_at(A, B, C, (True,) * len(C), corners, h)

    @cached_property
    def stepped(self) -> tuple[Matrix, Matrix, Matrix]:
        """The sampled plant that steps are judged on, states in their scales."""
        foreseen = self.foreseen and self.want.delay and not self.late_by
        return (replace(self, loop=self.predicted) if foreseen else self).plants[0]

    @cached_property
    def _responses(self) -> list[Complex]:
        shown, h = self.loop.shown, self.want.sample_time
        z = np.exp(1j * ANGLE)
        found = [
            transfer_function(a, b, c, np.zeros((len(c), b.shape[1])), z)
            for a, b, c in replace(self, late_by=0, exact=False).plants
        ]
        if not self._delays.any():
            return found
        # A loop is fast enough for a Pade function to be far from its delay, and must bear both.
        # Held commands have all frequencies that look alike to samples.
        held, lags = 1.0 - 1.0 / z, sorted({0.0, self.want.sensor_lag})
        for k in range(-ALIASES, ALIASES + 1):
            s = 1j * (ANGLE + 2.0 * np.pi * k) / h
            turn = s.imag[:, None, None] * self._delays
            apart = transfer_function(shown.A, shown.B, shown.C, shown.D, s)
            apart = apart * (np.exp(-1j * turn) / pade(turn)[0] - 1.0)
            for i, lag in enumerate(lags):
                found[i] += apart * (held / (s * h * (1.0 + s * lag)))[:, None, None]
        return [P * np.exp(1j * self._less) for P in found]

    @cached_property
    def _delays(self) -> Matrix:
        """Times by which the plant is late by Pade functions, shape (p, m), in s.

        What a PID adds to several commands is judged with all of them.
        """
        shown, equations = self.loop.shown, self.loop.linear.operating_point.model.equations
        found = np.zeros(shown.D.shape)
        if isinstance(equations, LinearEquations) and equations.delays:
            _, inputs, outputs = equations.names
            rows = [outputs.index(name) for name in shown.output_names]
            for k, name in enumerate(shown.input_names):
                if name in inputs:
                    found[:, k] = np.array(equations.delays)[rows, inputs.index(name)]
        return found

    @property
    def _less(self) -> Matrix:
        """Angles by which Pade functions turn less than their delays, in rad, shape (n, p, m)."""
        return pade(ANGLE[:, None, None] / self.want.sample_time * self._delays)[1]

    @property
    def _quiet(self) -> float:
        # A loop that is too slow for what grows is led astray by noise more.
        return self.want.quiet or (HOLDING_QUIET if self.growing else USUAL_QUIET)

    def judge(self, laws: LinearLaw, most: float = math.inf) -> Judged:
        """Tell the peaks of loops of laws around rest, whose first inputs are the measurements.

        Those that exceed a limit, and that by more than others or by more than a ratio, are told
        as unstable: a few frequencies show that of many.
        """
        rough = self._ratio(*self._peaks(laws, 8)[:3])
        order, least = np.argsort(rough, kind="stable"), most
        told = Judged(*np.full((3, len(rough)), math.inf))
        for first in range(0, len(order), AT_A_TIME):
            part = order[first : first + AT_A_TIME]
            part = part[rough[part] <= NEARLY * max(1.0, least)]
            ms, mt, beyond, stirred, stable = self._peaks(chosen(laws, part))
            excess = np.maximum(self._ratio(ms, mt, beyond), stirred / self._quiet)
            near = np.flatnonzero(stable & (excess <= NEARLY * max(1.0, least)))
            near = near[self.stable(chosen(laws, part[near]))]
            for every, own in zip(told, (ms, mt, excess), strict=True):
                every[part[near]] = own[near]
            least = min(least, excess[near].min(initial=math.inf))
            if len(part) < AT_A_TIME:
                break
        return told

    def excess(self, law: Any) -> float:
        """Return the largest ratio of a loop to a limit, as of `Judged`."""
        return float(self.judge(stacked([law])).excess[0])

    def stable(self, laws: LinearLaw) -> npt.NDArray[np.bool_]:
        """Tell which loops are stable without a delay, with the lag and without."""
        grown = [log_radii(closed(plant, laws)[0]) for plant in self.plants]
        return np.asarray(np.max(grown, axis=0) < 0.0)

    def _peaks(self, laws: LinearLaw, every: int = 1) -> Peaks:
        """Return what loops reach, as of `peaks`, at some of the frequencies."""
        want, loop, angle = self.want, self.loop, ANGLE[::every]
        # Noise may neither take much of the commands' range nor of how fast they are.
        fast = np.abs(np.exp(1j * angle) - 1.0)[:, None] * loop.command_scale
        fast = fast / (STIRRED * want.sample_time * loop.slew)
        return peaks(
            [P[::every] for P in self._responses],
            laws,
            angle,
            late=(angle * want.delay / want.sample_time)[:, None, None] + self._less[::every],
            noise=want.loop_noise(loop) / loop.command_scale[:, None],
            weight=1.0 + (self._quiet * fast) ** 2,
            followed=self.outputs,
        )

    def _ratio(self, ms: Vector, mt: Vector, beyond: Vector) -> Vector:
        """Return the largest ratio of peaks, as of `peaks`, to their limits."""
        want = self.want
        ms = ms / (want.maximum_sensitivity or USUAL_SENSITIVITY)
        mt = mt / (want.maximum_complementary or USUAL_COMPLEMENTARY)
        beyond = beyond / want.sample_time / (want.trusted_frequency or math.inf)
        return np.maximum(np.maximum(ms, mt), beyond)

    def held(self, judged: Judged, family: str) -> list[int]:
        """Return which loops hold the limits, or else, if none was given, exceed them least."""
        ends = self.loop.words
        least = float(np.min(judged.excess, initial=math.inf))
        if not math.isfinite(least):
            beside = _beside_a_zero(self.loop) if self.sensors == 1 else ""
            more = family == FEEDBACK or beside
            fix = "measure more" if more else "take another family, such as lqi"
            late = self.want.delay + float(self._delays.min(initial=math.inf))
            why = _too_late(self.loop, late + 0.5 * self.want.sample_time) or beside
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


def _too_late(loop: Loop, late: float) -> str:
    """Say how late commands may be of a plant that grows at p: every |T| peaks by e^(p T).

    Source: Åström and Murray, Feedback Systems, 2008, section 11.5, with p T < 1/3 for margins.

    Args:
        late: How late they are, T, in s.
    """
    turned = float(loop.linear.poles.real.max(initial=0.0)) * late
    if turned < 1.0 / 3.0:
        return ""
    return (
        f", which grows in {in_time(late / turned)} and is {in_time(late)} late: no loop has an"
        f" Mt below {math.exp(min(turned, 99.0)):.3g}, and good ones are late by less than"
        f" {in_time(late / turned / 3.0)}"
    )


def _beside_a_zero(loop: Loop) -> str:
    """Say how near to a zero z an output grows at p: Ms >= product |z + p| / |z - p|.

    Source: Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 5.3.
    """
    growing = loop.linear.poles[loop.linear.poles.real > 0.0]
    least = {
        float(np.prod(np.abs((z + growing.conj()) / (z - growing)))): z
        for z in reversed(zeros(loop))
        if z.real > 1e-6 * abs(z)
    }
    worst = max(least, default=0.0)
    if worst <= USUAL_SENSITIVITY:
        return ""
    return (
        f", which grows at {growing.real.max():.3g} rad/s beside a zero at"
        f" {abs(least[worst]):.3g} rad/s: no loop of it has an Ms below {worst:.3g}"
    )
