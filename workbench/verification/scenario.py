"""A scenario: what is asked of a closed loop, as data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_finite, check_range
from workbench.model.units import to_si
from workbench.verification.signals import Signal, Steps

EVENTS_S = (0.0, TIMES_S[1])
"""First and last time of a change, a disturbance or a fault, in s."""

RANGES_S = {
    "sample_time": TIMES_S,
    "duration": TIMES_S,
    "settle": EVENTS_S,
    "rest_window": TIMES_S,
    "count_from": EVENTS_S,
}
"""Ranges of the times of a scenario, in s; a duration and a rest window have two samples or more,
and counting begins before the end."""


def _check_end(what: str, begin: float, end: float) -> None:
    if not end > begin:
        raise WorkbenchError(
            f"the {what} ends at {end:g} s, before it begins at {begin:g} s; give a later end"
        )


@dataclass(frozen=True)
class Change:
    """A parameter of the plant takes another value at some time.

    Args:
        time: Time, in s; the sample that begins at or after it has the new value.
        value: New value, in the parameter's SI unit.
    """

    time: float
    parameter: str
    value: float

    def __post_init__(self) -> None:
        check_range(f"time of the change of {self.parameter}", self.time, *EVENTS_S, "s")
        check_finite(f"new value of {self.parameter}", self.value)


@dataclass(frozen=True)
class Disturbance:
    """A constant added to a port of the plant from some time on.

    Args:
        time: Time, in s.
        level: What is added, in the port's SI unit.
        until: Time at which it ends, in s.
    """

    time: float
    port: str
    level: float
    until: float = math.inf

    def __post_init__(self) -> None:
        check_range(f"time of the disturbance on {self.port}", self.time, *EVENTS_S, "s")
        check_finite(f"disturbance on {self.port}", self.level)
        _check_end(f"disturbance on {self.port}", self.time, self.until)


FAULTS = ("missing", "stuck", "offset", "value")
"""What may be wrong with a signal: it is no number, stays at its last value, is too large by a
level, or is a level."""

DEADLINE = "deadline"
"""Signal whose fault is that no step of the law is done in time."""


@dataclass(frozen=True)
class SignalFault:
    """A measurement or a reference that the controller gets wrong for a time.

    Args:
        time: Time, in s.
        signal: Name of a sensor, ``reference.NAME`` of a controlled output, or ``deadline``.
        kind: One of `FAULTS`.
        level: The offset or the value, in the signal's SI unit.
        until: Time at which it ends, in s.
    """

    time: float
    signal: str
    kind: str
    level: float = 0.0
    until: float = math.inf

    def __post_init__(self) -> None:
        check_range(f"time of the fault of {self.signal}", self.time, *EVENTS_S, "s")
        check_choice(f"kind of the fault of {self.signal}", self.kind, FAULTS)
        _check_end(f"fault of {self.signal}", self.time, self.until)

    def of(self, value: float, first: float) -> float:
        """Return what is given for a value; ``first`` was it when the fault began; both in SI."""
        if self.kind == "missing":
            return math.nan
        return {"stuck": first, "offset": value + self.level, "value": self.level}[self.kind]


USUAL_SAMPLES = {"settle": 250, "rest_window": 500}
"""Times of a scenario, in samples, unless they are given."""


@dataclass(frozen=True)
class Scenario:
    """What a closed loop has to do.

    Args:
        references: Reference of each controlled output, by name, in SI.
        duration: Length of the run, in s.
        sample_time: Time between samples, in s.
        start: Given values of the operating point at which the run starts, in SI, by name; the
            references at t = 0 by default.
        settle: Time for which the loop holds the start before t = 0, in s; 250 samples by default.
            It is not recorded.
        late_samples: Samples by which every command is late, as from a slow computer.
        rest_window: Length of the end of a step at which steady error and oscillation are taken,
            in s; 500 samples by default.
        count_from: Time from which tracking errors count, in s: a sine starts at full speed, which
            nothing at rest can follow.
    """

    name: str
    references: Mapping[str, Signal]
    duration: float
    sample_time: float = 0.002
    start: Mapping[str, float] | None = None
    settle: float = math.nan
    changes: tuple[Change, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    faults: tuple[SignalFault, ...] = ()
    noise: bool = True
    quantise: bool = True
    late_samples: int = 0
    rest_window: float = math.nan
    count_from: float = 0.0

    def __post_init__(self) -> None:
        for key, samples in USUAL_SAMPLES.items():
            if math.isnan(getattr(self, key)):
                object.__setattr__(self, key, samples * self.sample_time)
        lower = 2 * self.sample_time
        least = {"duration": lower, "rest_window": lower}
        most = {"count_from": self.duration - lower}
        for key, (low, high) in RANGES_S.items():
            value = getattr(self, key)
            words = f"{key.replace('_', ' ')} of scenario {self.name!r}"
            check_range(words, value, least.get(key, low), most.get(key, high), "s")
        if not self.references:
            raise WorkbenchError(
                f"scenario {self.name!r} has no reference; give one, such as angle = steps"
            )

    @property
    def samples(self) -> int:
        """Number of samples of the run."""
        return round(self.duration / self.sample_time)

    def start_values(self) -> dict[str, float]:
        """Return what is given at rest before the run, in SI: ``start``, or references at t = 0."""
        if self.start is not None:
            return dict(self.start)
        return {name: float(s.sample(0.0)) for name, s in self.references.items()}

    def without_imperfections(self) -> Scenario:
        """Return the scenario with ideal sensors and converters."""
        return replace(self, noise=False, quantise=False)


def step_scenario(
    output: str,
    begin: float,
    end: float,
    *,
    unit: str = "1",
    back: bool = False,
    lead: float | None = None,
    hold: float | None = None,
    sample_time: float = 0.002,
) -> Scenario:
    """Build a step of an output's reference.

    Args:
        begin: Reference before the step, in ``unit``.
        end: Reference after the step, in ``unit``.
        unit: Unit of both, such as ``"deg"``; by default they are in SI.
        back: Whether a step back follows.
        lead: Time for which the reference rests before the first step, in s; 250 samples by
            default.
        hold: Time that each step is held, in s; 1250 samples by default.
        sample_time: Time between samples, in s: that of the controller, as
            ``controller.sample_time``.
    """
    lead = 250.0 * sample_time if lead is None else lead
    hold = 1250.0 * sample_time if hold is None else hold
    levels = check_finite("step", (begin, end, begin) if back else (begin, end))
    values = tuple(float(to_si(level, unit)) for level in levels)
    times = (0.0, *(lead + hold * i for i in range(len(values) - 1)))
    shown = "" if unit == "1" else f" {unit}"
    return Scenario(
        f"step {begin:g} to {end:g}{shown}" + (" and back" if back else ""),
        {output: Steps(times, values)},
        duration=lead + hold * (len(values) - 1),
        sample_time=sample_time,
    )
