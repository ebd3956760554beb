"""One guard around every controller: what it may be told and command, and what is done instead.

Each sample, in this order (`guard.c` does the same in C, in the same order of operations):

1. A reference that is not finite is the last one that was; one out of the declared range moves
   towards its end, at a pace of its own. The law steps on.
2. A measurement is refused that is not finite, out of range, a jump away from the one before and
   from what is expected of it, or that does not change by a bit for ``hold`` samples of a strong
   command while what is expected leaves it (stuck; until it changes). What is expected comes from
   an estimator (`controllers.estimator`) that knows the linear model of the plant, all other
   measurements and the commands. The law is shown its estimate in the place of a refused
   measurement, for at most ``bridge`` samples. When the measurement is believed again, the
   difference fades over ``ramp`` samples: no bump.
3. The law steps. If what it commands is not finite, it raises an error of arithmetic (with limits),
   or it took longer than its deadline, its state stays as it was and the last command is held, for
   at most ``hold`` samples.
4. A command at its end, an error of the controlled outputs above tolerance that does not get
   smaller, for ``patience`` samples (a plant that cannot follow, a lost supply, a solver that
   reports success without progress), or one that changes its side ``swings`` times (oscillation)
   while the reference rests, is given up for ``patience`` samples. So is a law under which an
   output runs from its reference so fast into the end of its range that only the fastest braking
   could stop it before: v^2 / 2a + v lag >= distance, by more than its tolerance for braking.
5. What lasts longer than 2 and 3 allow, or 4, falls back to the inner law: a state feedback of the
   estimator that brings the plant to rest where it is, for ``inner`` samples; then comes the safe
   command.

After that the law returns when measurements are plausible for ``settle`` samples, from its start at
what is measured then (what its integrals had wound up is gone), and its references move from there
to what is asked along a quintic of ``ramp`` samples: no bump. Without an estimator the command is
held in 2, a jump is one from the measurement before, nothing is found to be stuck, and the safe
command takes the place of the inner law.

On plausible measurements and references the guard changes nothing, not by a bit. Its limits are
what the plant declares (`workbench.verification.guard_limits`); without any it refuses what is not
finite.

Units: SI; times in samples.

Source: signal validation, analytical redundancy and fault tolerance: Isermann, Fault-Diagnosis
Systems, 2006, chapters 7, 10 and 20; oscillation: Hägglund, A control-loop performance monitor,
Control Eng. Practice 3, 1995; bumpless transfer: Åström and Hägglund, Advanced PID Control, 2006,
section 3.6.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from controllers.estimator import Estimator
from controllers.protocol import Command, Controller, Info, Measurement, Reference
from workbench.errors import WorkbenchError, check_range

TIMES = {"bridge": 0.0, "hold": 0.0, "inner": 0.0, "settle": 1.0, "ramp": 1.0}
"""Times of a `Guard` by name, with the least of each, in samples."""

COUNTS = ("patience", "swings")
"""What a `Guard` counts up to, or never."""


class Fault(IntEnum):
    """What the guard may find in a sample; sixteen times its number is the status in C."""

    meaning: str

    def __new__(cls, meaning: str) -> Fault:
        """Count what may be found, in the order in which it stands here."""
        found = int.__new__(cls, len(cls.__members__))
        found._value_, found.meaning = int(found), meaning
        return found

    CLEAR = "nothing; the command is that of the law"
    REFERENCE = "a reference out of its range or not finite was replaced; the law steps on"
    RETURNING = "measurements are plausible again: the law is about to start, or has begun"
    NOT_FINITE = "a measurement is not finite"
    OUT_OF_RANGE = "a measurement is out of its range"
    JUMP = "a measurement is not what the others and the one before let expect"
    STUCK = "a measurement stays to the bit, which the others say has changed"
    LAW = "the law gave no finite command"
    DEADLINE = "the command was not there in time"
    SATURATED = "the command was at its end for too long"
    NO_PROGRESS = "the error did not get smaller for too long"
    OSCILLATION = "the error changed its side again and again"
    RUNAWAY = "an output runs into the end of its range, away from its reference"

    @property
    def word(self) -> str:
        """Its name as the information of a step has it."""
        return self.name.lower()


WIDER = 0.05
"""Share by which a jump grows with every sample in which it was not believed."""

FADE = 5.0
"""Time constants in which a difference has faded after a ramp."""


class SensorLimits(NamedTuple):
    """What is plausible of a measurement.

    Args:
        jump: Largest distance from what is expected of it, or from the one before, in SI.
        doubt: Distance from what is expected at which a value that stays is stuck, in SI.
        least: Smallest value that is expected of it, in SI.
    """

    lower: float = -math.inf
    upper: float = math.inf
    jump: float = math.inf
    doubt: float = math.inf
    least: float = -math.inf
    most: float = math.inf


class ReferenceLimits(NamedTuple):
    """What may be asked of a controlled output.

    Args:
        tolerance: Error that a plant that moves does not keep, in SI.
        sensor: Place of the sensor that reads the output (dimensionless); -1 for none.
        pace: Change per sample with which a reference out of range goes to its end, in SI.
        brake: Change of the output's pace per sample under the ends of the commands, in SI.
        lag: Samples until reversed commands do so.
    """

    lower: float = -math.inf
    upper: float = math.inf
    tolerance: float = math.inf
    sensor: float = -1.0
    pace: float = math.inf
    brake: float = math.inf
    lag: float = 0.0


class CommandLimits(NamedTuple):
    """What an actuator is given."""

    safe: float
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True)
class Guard:
    """Limits and times of a guard; times in samples.

    Args:
        estimator: What the plant's linear model says of measurements; None for nothing.
        bridge: How long the law acts on estimates, in samples.
        hold: How long the last command is held, in samples; and how long a measurement must stay to
            be stuck.
        inner: How long the inner law then brings the plant to rest, in samples.
        settle: How long measurements must be plausible before the law returns, in samples.
        ramp: How long the reference then moves from what is measured to what is asked, in samples.
        patience: How long a command may be at its end, or an error may stay, in samples.
        swings: How often an error above a quarter of its tolerance may change its side while the
            reference rests (dimensionless).
        deadline: Time that a step of the law may take by what it tells itself, in s.
    """

    sensors: tuple[SensorLimits, ...]
    references: tuple[ReferenceLimits, ...]
    commands: tuple[CommandLimits, ...]
    estimator: Estimator | None = None
    bridge: float = 125.0
    hold: float = 5.0
    inner: float = 250.0
    settle: float = 10.0
    ramp: float = 50.0
    patience: float = math.inf
    swings: float = math.inf
    deadline: float = math.inf

    def __post_init__(self) -> None:
        for name, least in TIMES.items():
            value = check_range(f"{name} of a guard", getattr(self, name), least, 1e6, "samples")
            object.__setattr__(self, name, float(value))
        for name in COUNTS:
            value = getattr(self, name)
            if value != math.inf:
                value = float(check_range(f"{name} of a guard", value, 1.0, 1e9, "samples"))
            object.__setattr__(self, name, value)

    @property
    def plain(self) -> bool:
        """Whether it has no limits, so that nothing but a number that is not finite is found."""
        bounds = [
            *(value for limits in self.sensors for value in limits),
            *(value for own in self.references for value in (*own[:3], own.pace, own.brake)),
            *(value for limits in self.commands for value in limits[1:]),
            self.patience,
            self.swings,
            self.deadline,
        ]
        return self.estimator is None and all(map(math.isinf, bounds))


def plain_guard(controller: Controller) -> Guard:
    """Return the guard that knows of no limits: it refuses what is not finite."""
    stated = getattr(controller, "rest_command", (0.0,) * len(controller.actuators))
    sensors = controller.sensors
    places = [float(sensors.index(n)) if n in sensors else -1.0 for n in controller.controlled]
    return Guard(
        (SensorLimits(),) * len(controller.sensors),
        tuple(ReferenceLimits(sensor=at) for at in places),
        tuple(CommandLimits(float(value)) for value in stated),
    )


class GuardState(NamedTuple):
    """What a guard remembers.

    Args:
        measurement: Last finite one; without an estimator the last plausible one; in SI.
        reference: Last references within their ranges, in SI.
        estimate: Predicted states and offsets of the estimator, in SI.
        doubted: For each sensor 0 if it is believed, 1 if not, 2 if it is stuck; dimensionless.
        same: Samples of a strong command for which each measurement has not changed by a bit.
        mend: What each measurement is shown with, fading since it is believed again, in SI.
        origin: Controlled outputs at the last return or fall, in SI.
        target: References from which progress is counted, in SI.
        best: Smallest error since then, in tolerances (a ratio).
        idle: Samples since it got smaller.
        railed: Samples for which the command has been at its end.
        side: Largest error since it last changed its side, with its sign, in tolerances (a ratio).
        turns: How often it did (dimensionless).
        bad: Samples since the law was last shown what was measured, and stepped in time; after it
            was given up, those in which nothing was looked at.
        away: Samples since the law was given up; 0 while it acts.
        good: Plausible samples since.
        wait: Plausible samples after which the law returns.
        ramp: Samples since the last return.
    """

    law: Any
    measurement: tuple[float, ...]
    command: tuple[float, ...]
    reference: tuple[float, ...]
    estimate: Any
    doubted: tuple[float, ...]
    same: tuple[float, ...]
    mend: tuple[float, ...]
    origin: tuple[float, ...]
    target: tuple[float, ...]
    best: float = 0.0
    idle: float = 0.0
    railed: float = 0.0
    side: float = 0.0
    turns: float = 0.0
    bad: float = 0.0
    away: float = 0.0
    good: float = 0.0
    wait: float = 0.0
    ramp: float = 0.0


class Guarded:
    """A controller inside its guard; itself a controller.

    Args:
        guard: Its limits; by default none, which refuses what is not finite.
        units: Units of sensors, controlled outputs and commands by name, which an export tells.

    Example:
        >>> from controllers.angle_pd import AnglePD
        >>> law = Guarded(AnglePD(0.4, 0.02))
        >>> state = law.initial_state((0.5,))
        >>> command, state, info = law.step(state, (float("nan"),), (0.6,))
        >>> command, info["guard"], info["guard_action"]
        ((5.0,), 'not_finite', 'hold')
    """

    def __init__(
        self,
        controller: Controller,
        guard: Guard | None = None,
        units: Mapping[str, str] | None = None,
    ) -> None:
        if isinstance(controller, Guarded):
            raise WorkbenchError(
                f"controller {controller.name!r} has a guard already; give the controller inside,"
                " `guarded.controller`"
            )
        self.controller, self.units = controller, dict(units or {})
        self.guard = guard = guard or plain_guard(controller)
        for what, limits, own in (
            ("sensors", guard.sensors, controller.sensors),
            ("controlled outputs", guard.references, controller.controlled),
            ("actuators", guard.commands, controller.actuators),
        ):
            if len(limits) != len(own):
                raise WorkbenchError(
                    f"the guard has limits for {len(limits)} {what} and controller"
                    f" {controller.name!r} has {len(own)}; give one each"
                )
        self.name: str = controller.name
        self.sample_time = controller.sample_time
        self.sensors, self.controlled = controller.sensors, controller.controlled
        self.actuators, self.preview = controller.actuators, controller.preview
        self._plain = guard.plain
        self.safe = tuple(limits.safe for limits in guard.commands)
        self._tracked = [
            (i, int(limits.sensor), limits.tolerance)
            for i, limits in enumerate(guard.references)
            if limits.sensor >= 0.0
        ]
        self._braked = [
            (i, sensor, guard.references[i])
            for i, sensor, _ in self._tracked
            if math.isfinite(guard.references[i].brake)
        ]

    def linear_command(self, command: Command) -> Command:
        """Return the command to which a linear model responds as the plant to ``command``."""
        return self.controller.linear_command(command)

    def initial_state(self, measurement: Measurement) -> GuardState:
        """Return the state in which the law starts, if the measurement is finite.

        Otherwise it begins under the safe command.
        """
        finite = all(map(math.isfinite, measurement))
        seen = measurement if finite else tuple(0.0 for _ in measurement)
        at = self._at(seen)
        zeros = tuple(0.0 for _ in seen)
        own = self.guard.estimator
        return GuardState(
            law=self.controller.initial_state(seen),
            measurement=seen,
            command=self.safe,
            reference=at,
            estimate=None if own is None else own.at_rest(seen),
            doubted=zeros,
            same=zeros,
            mend=zeros,
            origin=at,
            target=at,
            away=0.0 if finite else self.guard.inner + 1.0,
            wait=0.0 if finite else self.guard.settle,
            ramp=self.guard.ramp,
        )

    def _at(self, measurement: Measurement) -> tuple[float, ...]:
        """Return the controlled outputs as they are measured."""
        return tuple(
            measurement[int(limits.sensor)] if limits.sensor >= 0.0 else 0.0
            for limits in self.guard.references
        )

    def step(
        self, state: GuardState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, GuardState, Info]:
        """Compute the command of one sample.

        Unless all is clear, the information has ``guard``, the name of what was found (`Fault`),
        and ``guard_action``: the ``"law"``'s command, also with a replaced reference (``"clamp"``),
        on the way back (``"ramp"``) or with an ``"estimate"`` in the place of a measurement, the
        command before (``"hold"``), that of the ``"inner"`` law, or the ``"safe"`` one.
        """
        guard = self.guard
        if (
            self._plain
            and not (state.away or state.bad or state.ramp < guard.ramp)
            and math.isfinite(sum(measurement) + sum(reference))
        ):
            # Nothing can be found: the same as below, without looking.
            command, law, info = self.controller.step(state.law, measurement, reference)
            if not math.isfinite(sum(command)):
                return self._refused(state, Fault.LAW, info)
            now = reference[: len(guard.references)]
            return command, GuardState(law, measurement, command, now, *state[4:]), info
        wanted, found = self._references(state, reference)
        now = wanted[: len(guard.references)]
        state, seen, fault = self._sensors(state, measurement)
        if state.away:
            good = 0.0 if fault else state.good + 1.0
            state = state._replace(good=good, bad=0.0)
            if good <= state.wait:
                return self._apart(state, {}, fault or Fault.RETURNING)
            state = self.initial_state(seen)
            origin = tuple(
                at if limits.sensor >= 0.0 else asked
                for at, asked, limits in zip(state.origin, now, guard.references, strict=True)
            )
            state = state._replace(reference=now, origin=origin, ramp=0.0)
        elif fault and (guard.estimator is None or state.bad >= guard.bridge):
            return self._refused(state, fault, {})
        shown = wanted
        if state.ramp < guard.ramp:
            ramp = state.ramp + 1.0
            state = state._replace(ramp=ramp)
            s, count = ramp / guard.ramp, len(now)
            # A quintic: what feedforward makes of its speed and acceleration has no corner.
            share = s * s * s * (10.0 + s * (6.0 * s - 15.0))
            shown = tuple(
                state.origin[i % count] + share * (value - state.origin[i % count])
                for i, value in enumerate(wanted)
            )
            found = Fault.RETURNING
        try:
            command, law, info = self.controller.step(state.law, seen, shown)
        except (ArithmeticError, ValueError):
            if self._plain:
                # Without limits nothing is known of what it was asked: a bug is to be seen.
                raise
            return self._refused(state, Fault.LAW, {})
        if not all(map(math.isfinite, command)):
            return self._refused(state, Fault.LAW, info)
        if float(info.get("solve_time", 0.0)) > guard.deadline:
            return self._refused(state, Fault.DEADLINE, info)
        state = self._progress(state, command, seen, now)
        state = state._replace(law=law, reference=now, bad=state.bad + 1.0 if fault else 0.0)
        if state.railed >= guard.patience or state.idle >= guard.patience:
            lasting = Fault.SATURATED if state.railed >= guard.patience else Fault.NO_PROGRESS
            return self._apart(self._fallen(state, guard.patience), info, lasting)
        if state.turns >= guard.swings:
            return self._apart(self._fallen(state, guard.patience), info, Fault.OSCILLATION)
        following = self._commanded(state, command)
        if self._runs_away(state.estimate, following.estimate, now):
            return self._apart(self._fallen(state, guard.patience), info, Fault.RUNAWAY)
        state = following
        if fault:
            return self._told(state, info, fault, "estimate")
        if found:
            return self._told(state, info, found, "ramp" if found == Fault.RETURNING else "clamp")
        return command, state, info

    def missed(self, state: GuardState) -> tuple[Command, GuardState, Info]:
        """Return the command of a sample in which the law's was not there in time."""
        if state.away:
            return self._apart(state._replace(good=0.0, bad=state.bad + 1.0), {}, Fault.DEADLINE)
        return self._refused(state, Fault.DEADLINE, {})

    def _references(self, state: GuardState, reference: Reference) -> tuple[Reference, Fault]:
        """Return the references within their ranges, and whether one was replaced."""
        limits = self.guard.references
        count, wanted, found = len(limits), [], Fault.CLEAR
        for i, asked in enumerate(reference):
            own, before, value = limits[i % count], state.reference[i % count], asked
            if not math.isfinite(value):
                value, found = before, Fault.REFERENCE
            if value < own.lower:
                value, found = max(own.lower, before - own.pace), Fault.REFERENCE
            elif value > own.upper:
                value, found = min(own.upper, before + own.pace), Fault.REFERENCE
            wanted.append(value)
        return tuple(wanted), found

    def _sensors(
        self, state: GuardState, measurement: Measurement
    ) -> tuple[GuardState, Measurement, Fault]:
        """Return the state with the estimate corrected, what the law is shown, and what is wrong.

        Each measurement is held against what is expected of it: the estimate, or without one, and
        under the safe command, the measurement before.
        """
        guard, own = self.guard, self.guard.estimator
        believing = own is not None and state.away <= guard.inner
        expected = state.measurement
        if own is not None and believing:
            expected = self._expected(state.estimate)
            wide = 1.0 + WIDER * state.bad
        else:
            wide = 1.0 + state.bad
        if state.away and state.bad:
            # Nothing was looked at meanwhile: there is nothing to hold a measurement against.
            wide = math.inf
        strong = float(own is not None and own.strong(state.command))
        fault, believed = Fault.CLEAR, 0
        doubted, same = [], []
        seen, last, mend = list(measurement), list(state.measurement), list(state.mend)
        for i, (value, limits) in enumerate(zip(measurement, guard.sensors, strict=True)):
            off, before, wrong = abs(value - expected[i]), state.doubted[i], Fault.CLEAR
            stays = value == last[i]
            leap = off if before else min(off, abs(value - last[i]))
            same.append(state.same[i] + strong if stays else 0.0)
            if not math.isfinite(value):
                wrong = Fault.NOT_FINITE
            elif value < limits.lower or value > limits.upper:
                wrong = Fault.OUT_OF_RANGE
            elif leap > limits.jump * wide:
                wrong = Fault.JUMP
            elif (
                own and stays and (before == 2.0 or (same[i] >= guard.hold and off > limits.doubt))
            ):
                wrong = Fault.STUCK
            if own is None:
                fault = fault or wrong
                continue
            if math.isfinite(value):
                last[i] = value
            if wrong:
                fault = fault or wrong
                doubted.append(2.0 if wrong == Fault.STUCK or (stays and before == 2.0) else 1.0)
                mend[i] = 0.0
                continue
            if not same[i]:
                believed += 1 << i
            doubted.append(0.0)
            mend[i] = expected[i] - value if before else mend[i] * math.exp(-FADE / guard.ramp)
            if abs(mend[i]) <= 1e-6 * limits.jump:
                mend[i] = 0.0
            elif believing:
                seen[i] = value + mend[i]
        if own is None:
            if all(map(math.isfinite, measurement)) and (not fault or state.away > guard.inner):
                # Another level may be the true one: it is believed once it stays.
                state = state._replace(measurement=measurement)
            return state, measurement, fault
        z = state.estimate
        if believing:
            read = np.array([v if math.isfinite(v) else 0.0 for v in measurement])
            z = own.corrected(z, read - own.expected(z), believed)
            for i, value in enumerate(self._expected(z)):
                if doubted[i]:
                    seen[i] = min(max(value, guard.sensors[i].lower), guard.sensors[i].upper)
        elif all(map(math.isfinite, measurement)):
            z, mend = own.at_rest(measurement), [0.0] * len(mend)
        state = state._replace(
            measurement=tuple(last),
            estimate=z,
            doubted=tuple(doubted),
            same=tuple(same),
            mend=tuple(mend),
        )
        return state, tuple(seen), fault

    def _progress(
        self, state: GuardState, command: Command, seen: Measurement, now: Reference
    ) -> GuardState:
        """Count how long the command is at its end, the error stays, and how often it turns."""
        guard = self.guard
        if guard.patience == math.inf:
            return state
        ends = any(
            value <= limits.lower or value >= limits.upper
            for value, limits in zip(command, guard.commands, strict=True)
        )
        railed = state.railed + 1.0 if ends and command == state.command else 0.0
        signed, moved = 0.0, state.ramp < guard.ramp
        fresh = moved
        for i, sensor, tolerance in self._tracked:
            off = (now[i] - seen[sensor]) / tolerance
            if abs(off) > abs(signed):
                signed = off
            moved = moved or now[i] != state.reference[i]
            fresh = fresh or abs(now[i] - state.target[i]) > tolerance
        error, target, best, idle = abs(signed), state.target, state.best, state.idle + 1.0
        if error <= 1.0 or fresh:
            target, best, idle = now, 0.0 if error <= 1.0 else error, 0.0
        elif best == 0.0 or error < best - 0.5:
            best, idle = error, 0.0
        side, turns = state.side, state.turns
        if moved:
            side, turns = 0.0, 0.0
        elif signed * side < 0.0:
            turns = turns + 1.0 if abs(side) > 0.25 else 0.0
            side = signed
        elif abs(signed) > abs(side):
            side = signed
        return state._replace(
            target=target, best=best, idle=idle, railed=railed, side=side, turns=turns
        )

    def _runs_away(self, z: Any, following: Any, now: Reference) -> bool:
        """Tell whether an output leaves its reference and can hardly be stopped in its range."""
        own = self.guard.estimator
        if own is None or not self._braked:
            return False
        here, there = self._expected(z), self._expected(following)
        for i, sensor, limits in self._braked:
            pace = there[sensor] - here[sensor]
            end = limits.upper if pace > 0.0 else limits.lower
            braking = 0.5 * pace * pace / limits.brake
            away = (now[i] - here[sensor]) * pace < 0.0
            if (
                away
                and braking > limits.tolerance
                and braking + abs(pace) * limits.lag >= abs(end - here[sensor])
            ):
                return True
        return False

    def _expected(self, z: Any) -> tuple[float, ...]:
        """Return what is expected of every measurement, within what may be, in SI."""
        own = self.guard.estimator
        assert own is not None
        return tuple(
            min(max(value, limits.least), limits.most)
            for value, limits in zip(own.expected(z).tolist(), self.guard.sensors, strict=True)
        )

    def _refused(
        self, state: GuardState, fault: Fault, info: Info
    ) -> tuple[Command, GuardState, Info]:
        """Hold the last command, or give the law up."""
        bad = state.bad + 1.0
        if bad <= self.guard.hold:
            state = state._replace(bad=bad, railed=0.0, idle=0.0)
            return self._told(self._commanded(state, state.command), info, fault, "hold")
        return self._apart(self._fallen(state, self.guard.settle), info, fault)

    def _fallen(self, state: GuardState, wait: float) -> GuardState:
        """Return the state in which the law has just been given up."""
        guard, own, origin = self.guard, self.guard.estimator, list(state.origin)
        if own is not None:
            expected = self._expected(state.estimate)
            origin = list(state.reference)
            for i, sensor, tolerance in self._tracked:
                low, high = guard.references[i].lower, guard.references[i].upper
                origin[i] = max(min(expected[sensor], high - tolerance), low + tolerance)
        inner = own is not None and len(own.K) > 0
        return state._replace(
            origin=tuple(origin), best=0.0, idle=0.0, railed=0.0, side=0.0, turns=0.0, bad=0.0,
            away=0.0 if inner else guard.inner, good=0.0, wait=wait,
        )  # fmt: skip

    def _apart(
        self, state: GuardState, info: Info, fault: Fault
    ) -> tuple[Command, GuardState, Info]:
        """Give the command of the inner law, or the safe one."""
        state, own = state._replace(away=state.away + 1.0), self.guard.estimator
        if own is None or state.away > self.guard.inner:
            return self._told(self._commanded(state, self.safe), info, fault, "safe")
        command = tuple(
            min(max(value, limits.lower), limits.upper)
            for value, limits in zip(
                own.inner(state.estimate, state.origin), self.guard.commands, strict=True
            )
        )
        if not all(map(math.isfinite, command)):
            command = self.safe
        return self._told(self._commanded(state, command), info, fault, "inner")

    def _commanded(self, state: GuardState, command: Command) -> GuardState:
        """Return the state of the next sample, after a command."""
        own = self.guard.estimator
        estimate = None if own is None else own.predicted(state.estimate, command)
        return state._replace(command=command, estimate=estimate)

    def _told(
        self, state: GuardState, info: Info, fault: Fault, action: str
    ) -> tuple[Command, GuardState, Info]:
        told = {**info, "guard": fault.word, "guard_action": action}
        return state.command, state, told


def unguarded(controller: Any) -> Any:
    """Return the controller inside a guard, or the controller itself."""
    return controller.controller if isinstance(controller, Guarded) else controller
