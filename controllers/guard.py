"""One guard around every controller: what it may be told and command, and what is done instead.

Each sample, in this order (`guard.c` does the same in C, in the same order of operations):

1. A reference that is not finite is the last one that was; one out of the declared range is its
   end. The law steps on.
2. A measurement that is not finite, out of range or jumps is not shown to the law: its state stays
   as it was and the last command is held, for at most ``hold`` samples; then comes the safe one.
3. A measurement that does not change by a bit, while commands asked for a move long enough that the
   plant as declared would have moved, or for ``hold`` samples right after it had moved fast, is
   stuck: safe command, until it changes.
4. The law steps. If what it commands is not finite, or (with limits) it raises an error of
   arithmetic, that is treated like a measurement that is not shown: its state stays as it was.
5. A command at its end, or an error of the controlled outputs above tolerance that does not get
   smaller, for ``patience`` samples (a plant that cannot follow, a solver that reports success
   without progress): safe command for ``patience`` samples, then again.

After the safe command the law returns when measurements are plausible for ``settle`` samples, from
its start at what is measured then (what its integrals had wound up is gone), and its references
move from there to what is asked along a quintic of ``ramp`` samples: no bump.

On plausible measurements and references the guard changes nothing, not by a bit. Its limits are
what the plant declares (`workbench.verification.guard_limits`); without any it refuses what is not
finite.

Source: signal validation and safe fallback as in Isermann, Fault-Diagnosis Systems, 2006, chapters
7 (limit checking) and 20 (fault tolerance); bumpless transfer: Åström and Hägglund, Advanced PID
Control, 2006, section 3.6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from controllers.c_source import CSource, defined, table
from controllers.named_state import names
from controllers.protocol import Command, Controller, Info, Measurement, Reference
from workbench.errors import WorkbenchError, check_range

_INFINITE = math.inf


class Fault(NamedTuple):
    """What the guard may find in a sample."""

    name: str
    meaning: str


FAULTS = (
    Fault("clear", "nothing; the command is that of the law"),
    Fault("reference", "a reference out of its range or not finite was replaced; the law steps on"),
    Fault("returning", "the law is about to start anew, or its reference moves to what is asked"),
    Fault("not_finite", "a measurement is not finite: command held, then the safe one"),
    Fault("out_of_range", "a measurement is out of its range: command held, then the safe one"),
    Fault("jump", "a measurement changed faster than the plant can: held, then safe"),
    Fault("stuck", "a measurement does not change while the plant must move: safe command"),
    Fault("law", "the law gave no finite command: command held, then the safe one"),
    Fault("saturated", "the command was at its end for too long: safe command for a time"),
    Fault("no_progress", "the error did not get smaller for too long: safe command for a time"),
)
"""Everything the guard may find; the place in this list times 16 is its status in C."""

(
    CLEAR,
    REFERENCE,
    RETURNING,
    NOT_FINITE,
    OUT_OF_RANGE,
    JUMP,
    STUCK,
    LAW,
    SATURATED,
    NO_PROGRESS,
) = range(len(FAULTS))

WEAK = 0.1
"""Share of a command that friction may swallow: up to it a plant that stays is no sign."""

ACTIONS = ("law", "clamp", "ramp", "hold", "safe")
"""What may be done: the law's command, also with a replaced reference or on the way back; the
command before; the safe command."""


class SensorLimits(NamedTuple):
    """What is plausible of a measurement.

    Args:
        lower: Smallest value, in SI.
        upper: Largest value, in SI.
        jump: Largest change from sample to sample, in SI.
        watched: 1 if it never rests to the bit while the plant moves, so that it may be found to be
            stuck: a controlled output, or one that is noisy; else 0 (dimensionless).
        motion: Smallest change from sample to sample after which it does not stop to the bit at
            once, in SI.
    """

    lower: float = -_INFINITE
    upper: float = _INFINITE
    jump: float = _INFINITE
    watched: float = 0.0
    motion: float = _INFINITE


class ReferenceLimits(NamedTuple):
    """What may be asked of a controlled output.

    Args:
        lower: Smallest reference, in SI.
        upper: Largest reference, in SI.
        tolerance: Error that a plant that moves does not keep, in SI.
        sensor: Place of the sensor that reads the output (dimensionless); -1 for none.
    """

    lower: float = -_INFINITE
    upper: float = _INFINITE
    tolerance: float = _INFINITE
    sensor: float = -1.0


class CommandLimits(NamedTuple):
    """What an actuator is given.

    Args:
        safe: Safe command, in SI.
        lower: Its lower end, in SI.
        upper: Its upper end, in SI.
    """

    safe: float
    lower: float = -_INFINITE
    upper: float = _INFINITE


class GuardState(NamedTuple):
    """What a guard remembers.

    Args:
        measurement: Last plausible one, under the safe command the last one, in SI.
        command: Last command, in SI.
        reference: Last references within their ranges, in SI.
        still: Samples of full command for which each sensor has not changed by a bit.
        same: Samples for which it has not.
        pace: Its last change that was one, in SI.
        place: First controlled output when each sensor last changed, in SI.
        origin: Controlled outputs at the last return, in SI.
        target: References from which progress is counted, in SI.
        best: Smallest error since then, in tolerances (a ratio).
        idle: Samples since it got smaller.
        railed: Samples for which the command has been at its end.
        bad: Samples for which the command has been held.
        good: Plausible samples under the safe command.
        wait: Plausible samples after which the law returns; 0 while the law acts.
        ramp: Samples since the last return.
    """

    law: Any
    measurement: tuple[float, ...]
    command: tuple[float, ...]
    reference: tuple[float, ...]
    still: tuple[float, ...]
    same: tuple[float, ...]
    pace: tuple[float, ...]
    place: tuple[float, ...]
    origin: tuple[float, ...]
    target: tuple[float, ...]
    best: float
    idle: float
    railed: float
    bad: float
    good: float
    wait: float
    ramp: float


@dataclass(frozen=True)
class Guard:
    """Limits and times of a guard; times in samples.

    Args:
        sensors: Limits of each measurement; none for those that are only to be finite.
        references: Limits of the reference of each controlled output.
        commands: Limits of each command.
        hold: How long the last command is held, in samples.
        settle: How long measurements must be plausible before the law returns, in samples.
        ramp: How long the reference then moves from what is measured to what is asked, in samples.
        stuck: Samples of full command after which a watched sensor must have changed.
        patience: How long a command may be at its end, or an error may stay, in samples.
    """

    sensors: tuple[SensorLimits, ...]
    references: tuple[ReferenceLimits, ...]
    commands: tuple[CommandLimits, ...]
    hold: float = 5.0
    settle: float = 10.0
    ramp: float = 50.0
    stuck: float = _INFINITE
    patience: float = _INFINITE

    def __post_init__(self) -> None:
        for name, least in (("hold", 0.0), ("settle", 1.0), ("ramp", 0.0)):
            value = check_range(f"{name} of a guard", getattr(self, name), least, 1e6, "samples")
            object.__setattr__(self, name, float(value))
        for name in ("stuck", "patience"):
            value = getattr(self, name)
            if value != _INFINITE:
                value = float(check_range(f"{name} of a guard", value, 1.0, 1e9, "samples"))
            object.__setattr__(self, name, value)


def plain_guard(controller: Controller) -> Guard:
    """Return the guard that knows of no limits: it refuses what is not finite."""
    stated = getattr(controller, "rest_command", (0.0,) * len(controller.actuators))
    return Guard(
        (SensorLimits(),) * len(controller.sensors),
        tuple(ReferenceLimits(sensor=_place(controller, name)) for name in controller.controlled),
        tuple(CommandLimits(float(value)) for value in stated),
    )


def _place(controller: Controller, name: str) -> float:
    return float(controller.sensors.index(name)) if name in controller.sensors else -1.0


class Guarded:
    """A controller inside its guard; itself a controller.

    Args:
        guard: Its limits; by default none, which refuses what is not finite.

    Raises:
        WorkbenchError: If the guard does not fit the controller.

    Example:
        >>> from controllers.angle_pd import AnglePD
        >>> law = Guarded(AnglePD(0.4, 0.02))
        >>> state = law.initial_state((0.5,))
        >>> command, state, info = law.step(state, (float("nan"),), (0.6,))
        >>> command, info["guard"], info["guard_action"]
        ((5.0,), 'not_finite', 'hold')
    """

    def __init__(self, controller: Controller, guard: Guard | None = None) -> None:
        if isinstance(controller, Guarded):
            raise WorkbenchError(
                f"controller {controller.name!r} has a guard already; give the controller inside,"
                " `guarded.controller`"
            )
        self.controller = controller
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
        self._plain = guard == Guard(
            (SensorLimits(),) * len(guard.sensors),
            tuple(ReferenceLimits(sensor=limits.sensor) for limits in guard.references),
            guard.commands,
            hold=guard.hold,
            settle=guard.settle,
            ramp=guard.ramp,
        )
        self.safe = tuple(limits.safe for limits in guard.commands)
        reach = [max(c.upper - c.safe, c.safe - c.lower) for c in guard.commands]
        self._reach = tuple(value if value > 0.0 else 1.0 for value in reach)
        self._tracked = [
            (i, int(limits.sensor), limits.tolerance)
            for i, limits in enumerate(guard.references)
            if limits.sensor >= 0.0
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
        return GuardState(
            law=self.controller.initial_state(seen),
            measurement=seen,
            command=self.safe,
            reference=at,
            still=zeros,
            same=zeros,
            pace=zeros,
            place=tuple(self._followed(seen) for _ in seen),
            origin=at,
            target=at,
            best=0.0,
            idle=0.0,
            railed=0.0,
            bad=0.0,
            good=0.0,
            wait=0.0 if finite else self.guard.settle,
            ramp=self.guard.ramp,
        )

    def _at(self, measurement: Measurement) -> tuple[float, ...]:
        """Return the controlled outputs as they are measured."""
        return tuple(
            measurement[int(limits.sensor)] if limits.sensor >= 0.0 else 0.0
            for limits in self.guard.references
        )

    def _followed(self, measurement: Measurement) -> float:
        return measurement[self._tracked[0][1]] if self._tracked else 0.0

    def step(
        self, state: GuardState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, GuardState, Info]:
        """Compute the command of one sample.

        Unless all is clear, the information has ``guard``, the name of what was found (`FAULTS`),
        and ``guard_action``, one of `ACTIONS`.
        """
        guard = self.guard
        if (
            self._plain
            and not (state.wait or state.bad or state.ramp < guard.ramp)
            and math.isfinite(sum(measurement) + sum(reference))
        ):
            # Nothing can be found: the same as below, without looking.
            command, law, info = self.controller.step(state.law, measurement, reference)
            if not math.isfinite(sum(command)):
                return self._refused(state, measurement, LAW, info)
            now = reference[: len(guard.references)]
            return command, GuardState(law, measurement, command, now, *state[4:]), info
        wanted, found = self._references(state, reference)
        now = wanted[: len(guard.references)]
        error = 0.0
        for i, sensor, tolerance in self._tracked:
            error = max(error, abs(now[i] - measurement[sensor]) / tolerance)
        state, fault = self._sensors(state, measurement, now, error)
        if fault:
            return self._refused(state, measurement, fault, {})
        if state.wait:
            good = state.good + 1.0
            if good <= state.wait:
                state = state._replace(good=good, measurement=measurement)
                return self._told(self.safe, state, {}, RETURNING, "safe")
            state = self._returned(measurement, now)
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
            found = RETURNING
        else:
            shown = wanted
        try:
            command, law, info = self.controller.step(state.law, measurement, shown)
        except (ArithmeticError, ValueError):
            if self._plain:
                # Without limits nothing is known of what it was asked: a bug is to be seen.
                raise
            return self._refused(state, measurement, LAW, {})
        if not all(map(math.isfinite, command)):
            return self._refused(state, measurement, LAW, info)
        railed, target, best, idle = self._progress(state, command, now, error)
        following = GuardState(
            law, measurement, command, now, *state[4:8], state.origin,
            target, best, idle, railed, 0.0, 0.0, 0.0, state.ramp,
        )  # fmt: skip
        if railed >= guard.patience or idle >= guard.patience:
            fault = SATURATED if railed >= guard.patience else NO_PROGRESS
            following = self._safe(following, guard.patience)
            return self._told(self.safe, following, info, fault, "safe")
        if found:
            return self._told(
                command, following, info, found, "ramp" if found == RETURNING else "clamp"
            )
        return command, following, info

    def _references(self, state: GuardState, reference: Reference) -> tuple[Reference, int]:
        """Return the references within their ranges, and whether one was replaced."""
        limits = self.guard.references
        count, wanted, found = len(limits), [], CLEAR
        for i, asked in enumerate(reference):
            own, value = limits[i % count], asked
            if not math.isfinite(value):
                value, found = state.reference[i % count], REFERENCE
            if value < own.lower:
                value, found = own.lower, REFERENCE
            elif value > own.upper:
                value, found = own.upper, REFERENCE
            wanted.append(value)
        return tuple(wanted), found

    def _sensors(
        self, state: GuardState, measurement: Measurement, now: Reference, error: float
    ) -> tuple[GuardState, int]:
        """Return the state with what does not change counted, and what is wrong."""
        guard, far = self.guard, 1.0 + state.bad
        for value, before, limits in zip(
            measurement, state.measurement, guard.sensors, strict=True
        ):
            if not math.isfinite(value):
                return state, NOT_FINITE
            if value < limits.lower or value > limits.upper:
                return state, OUT_OF_RANGE
            if abs(value - before) > limits.jump * far:
                return state, JUMP
        if guard.stuck == _INFINITE:
            return state, CLEAR
        effort = 0.0
        for value, safe, reach in zip(state.command, self.safe, self._reach, strict=True):
            effort = max(effort, min((abs(value - safe) / reach - WEAK) / (1.0 - WEAK), 1.0))
        followed = self._followed(measurement)
        tolerance = self._tracked[0][2] if self._tracked else _INFINITE
        still, place, fault = list(state.still), list(state.place), CLEAR
        same, pace = list(state.same), list(state.pace)
        for i, (value, limits) in enumerate(zip(measurement, guard.sensors, strict=True)):
            moved = abs(followed - place[i]) / tolerance
            change = abs(value - state.measurement[i])
            if change:
                still[i], place[i], same[i], pace[i] = 0.0, followed, 0.0, change
                continue
            inside = limits.lower < value < limits.upper
            same[i] = same[i] + 1.0 if inside else 0.0
            if limits.watched and inside and (error > 1.0 or moved > 1.0):
                still[i] = still[i] + effort
            else:
                still[i] = 0.0
            if still[i] >= guard.stuck or (pace[i] >= limits.motion and same[i] >= guard.hold):
                fault = STUCK
        state = state._replace(
            still=tuple(still), same=tuple(same), pace=tuple(pace), place=tuple(place)
        )
        return state, fault

    def _progress(
        self, state: GuardState, command: Command, now: Reference, error: float
    ) -> tuple[float, tuple[float, ...], float, float]:
        """Return how long the command has been at its end, and the error without progress."""
        guard = self.guard
        if guard.patience == _INFINITE:
            return 0.0, state.target, 0.0, 0.0
        ends = any(
            value <= limits.lower or value >= limits.upper
            for value, limits in zip(command, guard.commands, strict=True)
        )
        railed = state.railed + 1.0 if ends and command == state.command else 0.0
        new = state.ramp < guard.ramp or any(
            abs(now[i] - state.target[i]) > tolerance for i, _, tolerance in self._tracked
        )
        if error <= 1.0 or new:
            return railed, now, 0.0 if error <= 1.0 else error, 0.0
        if state.best == 0.0 or error < state.best - 0.5:
            return railed, state.target, error, 0.0
        return railed, state.target, state.best, state.idle + 1.0

    def _refused(
        self, state: GuardState, measurement: Measurement, fault: int, info: Info
    ) -> tuple[Command, GuardState, Info]:
        """Hold the last command, or give the safe one."""
        bad = state.bad + 1.0
        if not state.wait and fault != STUCK and bad <= self.guard.hold:
            state = state._replace(bad=bad, railed=0.0, idle=0.0)
            return self._told(state.command, state, info, fault, "hold")
        state = self._safe(state, state.wait or self.guard.settle)
        if all(map(math.isfinite, measurement)):
            # From here on a jump is one from sample to sample: another level may be the true one.
            state = state._replace(measurement=measurement)
        return self._told(self.safe, state, info, fault, "safe")

    def _safe(self, state: GuardState, wait: float) -> GuardState:
        return state._replace(
            command=self.safe, bad=0.0, good=0.0, wait=wait, railed=0.0, idle=0.0, best=0.0
        )

    def _returned(self, measurement: Measurement, now: Reference) -> GuardState:
        """Return the state in which the law starts anew at what is measured."""
        state = self.initial_state(measurement)
        return state._replace(reference=now, ramp=0.0)

    def _told(
        self, command: Command, state: GuardState, info: Info, fault: int, action: str
    ) -> tuple[Command, GuardState, Info]:
        return command, state, {**info, "guard": FAULTS[fault].name, "guard_action": action}

    def c_source(self, name: str) -> CSource:
        """Write law and guard as C."""
        inner = f"{name}_law"
        found: CSource = self.controller.c_source(inner)  # type: ignore[attr-defined]
        guard = self.guard
        state = self.initial_state(tuple(0.0 for _ in self.sensors))
        sizes = {
            "SENSORS": len(self.sensors),
            "CONTROLLED": len(self.controlled),
            "REFERENCES": len(self.controlled) * (1 + self.preview),
            "COMMANDS": len(self.actuators),
            "REPORTS": len(found.reports),
            "LAW_STATES": len(found.states),
            "HOLD": guard.hold,
            "SETTLE": guard.settle,
            "RAMP": guard.ramp,
            "STUCK_AFTER": guard.stuck,
            "WEAK": WEAK,
            "PATIENCE": guard.patience,
        }
        tables = {
            **_columns("SENSOR", SensorLimits._fields, guard.sensors),
            **_columns("REFERENCE", ReferenceLimits._fields, guard.references),
            **_columns("COMMAND", CommandLimits._fields, guard.commands),
            "COMMAND_REACH": self._reach,
        }
        report = "report" if found.reports else "0"
        parameter = ", double *report" if found.reports else ""
        text = (
            found.source
            + "".join(
                defined(f"GUARD_{key}", "INFINITY" if value == _INFINITE else value)
                for key, value in sizes.items()
            )
            + "".join(defined(f"GUARD_{fault.name.upper()}", i) for i, fault in enumerate(FAULTS))
            + defined("GUARD_LAW_START(measurement, state)", f"{inner}_start(measurement, state)")
            + defined(
                "GUARD_LAW_STEP(measurement, reference, state, command, report)",
                f"{inner}_step(measurement, reference, state, command"
                + (", report)" if found.reports else ")"),
            )
            + "\n"
            + "".join(table(f"GUARD_{key}", values) for key, values in tables.items())
            + "\n"
            + Path(__file__).with_name("guard.c").read_text(encoding="utf-8")
            + f"""
int {name}_start(const double *measurement, double *state) {{
  return guard_start(measurement, state);
}}

int {name}_step(const double *measurement, const double *reference, double *state,
{" " * (len(name) + 10)}double *command{parameter}) {{
  return guard_step(measurement, reference, state, command, {report});
}}
"""
        )
        safe = ", ".join(f"{value:g}" for value in self.safe)
        never = "never found" if guard.stuck == _INFINITE else f"{guard.stuck:g} samples"
        endless = "any time" if guard.patience == _INFINITE else f"{guard.patience:g} samples"
        notes = (
            *found.notes,
            f"Guard: safe command {safe}; a command is held for at most {guard.hold:g} samples.",
            f"The law returns after {guard.settle:g} plausible samples, its reference along a",
            f"quintic of {guard.ramp:g} more. Stuck at full command: {never}.",
            f"A command at its end, or an error that stays: {endless}.",
        )
        states = names(state)
        operations = found.operations + 40 * (len(self.sensors) + sizes["REFERENCES"])
        return CSource(text, states, notes, found.reports, int(operations))


def _columns(
    prefix: str, fields: tuple[str, ...], rows: tuple[tuple[float, ...], ...]
) -> dict[str, tuple[float, ...]]:
    columns = zip(*rows, strict=True)
    return {f"{prefix}_{f.upper()}": column for f, column in zip(fields, columns, strict=True)}


def unguarded(controller: Any) -> Any:
    """Return the controller inside a guard, or the controller itself."""
    return controller.controller if isinstance(controller, Guarded) else controller
