"""A machine to be recorded: its truth, what it may conceal, and how a newcomer would excite it.

The integrator is the classical Runge-Kutta method at a fixed step; actuators and sensors are
stepped beside it, with delays as queues, lags as sampled filters, and converters that round. Dry
friction sticks (Karnopp) where the workbench rounds the sign of the speed; backlash is a dead zone
of the twist.

``machines.toml`` describes the machines, and what a newcomer drives them with: random pulses,
random steps, sines or a chirp, in the units of the commands or references; times are in s.

Units: SI.
"""

from __future__ import annotations

import math
import tomllib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt


def dry_friction(
    speed: float,
    applied: float,
    level: float,
    *,
    inertia: float,
    break_away: float = 0.0,
    fade: float = 1.0,
    stuck: float,
) -> float:
    """Return the friction against the motion, after Karnopp (1985).

    Below the speed `stuck` the friction balances what is applied, up to ``level + break_away``, and
    takes the rest of the speed away within 5 ms; above it the break-away fades as
    ``1/(1 + (speed/fade)^2)``.
    """
    top = level + break_away
    if top <= 0.0:
        return 0.0
    if abs(speed) < stuck:
        return min(top, max(-top, applied + inertia * speed / 5e-3))
    return math.copysign(level + break_away / (1.0 + (speed / fade) ** 2), speed)


def dead_zone(value: float, half_width: float) -> float:
    """Return what is left of a value beyond a gap of two half widths."""
    return math.copysign(max(0.0, abs(value) - half_width), value)


def limited(value: float, limit: float) -> float:
    """Return a value cut at plus and minus a limit; no limit at 0."""
    return min(limit, max(-limit, value)) if limit > 0.0 else value


Array = npt.NDArray[np.float64]
Parameters = dict[str, float]
State = list[float]


@dataclass(frozen=True)
class Concealed:
    """One effect that a machine may conceal.

    Args:
        ports: Ports of the newcomer's model that it may rightly be found at.
        size: Smallest and largest value of the parameter that switches it on.
        others: Values of further parameters that it sets.
    """

    name: str
    physics: str
    ports: Sequence[str]
    size: Sequence[float]
    others: Mapping[str, float] = field(default_factory=dict)
    signed: bool = False

    def draw(self, rng: np.random.Generator) -> Parameters:
        """Return parameters that switch it on, the size drawn evenly in its logarithm."""
        low, high = np.log(self.size)
        value = float(np.exp(rng.uniform(low, high)))
        sign = -1.0 if self.signed and rng.random() < 0.5 else 1.0
        return {self.name: sign * value, **self.others}


@dataclass(frozen=True)
class Channel:
    """One sensor: name and unit in the file, the state that it reads, noise and step.

    Its faults are parameters that begin with its name: ``_offset``, ``_gain`` (excess), ``_lag``,
    ``_delay``, ``_top`` (clipping).
    """

    name: str
    unit: str
    state: int
    noise: float
    step: float = 0.0


Rates = Callable[[float, State, Sequence[float], Parameters], State]
"""Rates of the states at a time, from states, commands and parameters."""

Start = Callable[[Parameters], State]
"""States at which a recording begins."""

Loop = Callable[[Array, Array, Array], Array]
"""Commands from the references, the measurements and the last measurements."""

Excitation = Callable[[np.random.Generator, int, float], Array]
"""Commands or references, shape (n, inputs), of n samples at a sample time."""


@dataclass(frozen=True)
class Machine:
    """A machine with its truth.

    Args:
        background: True value and relative half range of each parameter that is never nominal.
        excitations: What drives the recordings ``fit_1``, ``fit_2``, ``hold_1``, ``hold_2``.
    """

    name: str
    inputs: tuple[tuple[str, str], ...]
    channels: tuple[Channel, ...]
    background: Mapping[str, Sequence[float]]
    concealed: tuple[Concealed, ...]
    rates: Rates
    initial: Start
    excitations: Mapping[str, Excitation]
    sample_time: float
    steps: int
    samples: int
    loop: Loop | None = None

    def parameters(self, rng: np.random.Generator, hidden: Sequence[Concealed]) -> Parameters:
        """Return parameters off their nominal values, with what is hidden switched on."""
        p = {n: v * (1 + r * rng.uniform(-1, 1)) for n, (v, r) in self.background.items()}
        p |= {effect.name: 0.0 for effect in self.concealed}
        for effect in hidden:
            p |= effect.draw(rng)
        return p

    def record(
        self,
        excitation: Array,
        p: Parameters,
        rng: np.random.Generator | None,
        *,
        replayed: bool = False,
        start: State | None = None,
    ) -> tuple[Array, Array]:
        """Run the machine along an excitation: commands (n, inputs), measurements (n, channels).

        Args:
            excitation: Commands, or references if there is a loop, shape (n, inputs).
            rng: Source of the sensors' noise; without it they are exact.
            replayed: Whether the excitation holds commands although there is a loop.
        """
        x = list(start if start is not None else self.initial(p))
        h = self.sample_time / self.steps
        actuators = [Actuator(name, p, h) for name, _ in self.inputs]
        sensors = [Sensor(c, p, self.sample_time, rng) for c in self.channels]
        commands = np.empty(excitation.shape)
        measurements = np.empty((len(excitation), len(sensors)))
        for k in range(len(excitation)):
            t = k * self.sample_time
            measurements[k] = [s.read(x[s.channel.state]) for s in sensors]
            u = excitation[k]
            if self.loop is not None and not replayed:
                u = self.loop(u, measurements[k], measurements[max(k - 1, 0)])
            commands[k] = u
            for j in range(self.steps):
                w = [a.step(float(v)) for a, v in zip(actuators, u, strict=True)]
                x = self._step(t + j * h, x, w, p, h)
        return commands, measurements

    def _step(self, t: float, x: State, u: Sequence[float], p: Parameters, h: float) -> State:
        def moved(slope: State, by: float) -> State:
            return [a + by * b for a, b in zip(x, slope, strict=True)]

        k1 = self.rates(t, x, u, p)
        k2 = self.rates(t + 0.5 * h, moved(k1, 0.5 * h), u, p)
        k3 = self.rates(t + 0.5 * h, moved(k2, 0.5 * h), u, p)
        k4 = self.rates(t + h, moved(k3, h), u, p)
        return [
            a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e)
            for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
        ]


class Actuator:
    """The way of a command: ``_delay``, ``_dead_zone``, ``_limit`` and ``_lag`` of its name."""

    def __init__(self, name: str, p: Parameters, step: float) -> None:
        self._queue: deque[float] = deque()
        self._late = round(p.get(f"{name}_delay", 0.0) / step)
        self._dead, self._limit = p.get(f"{name}_dead_zone", 0.0), p.get(f"{name}_limit", 0.0)
        lag = p.get(f"{name}_lag", 0.0)
        self._share = 1.0 - math.exp(-step / lag) if lag > 0.0 else 1.0
        self._value: float | None = None

    def step(self, value: float) -> float:
        """Return what reaches the machine during one step."""
        if self._late:
            if not self._queue:
                self._queue.extend([value] * self._late)
            self._queue.append(value)
            value = self._queue.popleft()
        value = limited(dead_zone(value, self._dead), self._limit)
        self._value = value if self._value is None else self._value
        self._value += self._share * (value - self._value)
        return self._value


class Sensor:
    """What a sensor makes of the truth; see `Channel`."""

    def __init__(
        self, channel: Channel, p: Parameters, sample: float, rng: np.random.Generator | None
    ) -> None:
        self.channel, self._rng = channel, rng

        def fault(name: str) -> float:
            return p.get(f"{channel.name}_{name}", 0.0)

        self._offset, self._gain, self._top = fault("offset"), 1.0 + fault("gain"), fault("top")
        lag = fault("lag")
        self._share = 1.0 - math.exp(-sample / lag) if lag > 0.0 else 1.0
        self._late = fault("delay") / sample
        self._past: list[float] = []
        self._slow: float | None = None

    def read(self, true: float) -> float:
        """Return the measurement at a sample."""
        self._slow = true if self._slow is None else self._slow
        self._slow += self._share * (true - self._slow)
        self._past.append(self._slow)
        whole = math.floor(self._late)
        one, two = (self._past[max(0, len(self._past) - 1 - whole - k)] for k in (0, 1))
        value = self._gain * (one + (self._late - whole) * (two - one)) + self._offset
        if self._rng is not None:
            value += self.channel.noise * self._rng.standard_normal()
        value = min(value, self._top) if self._top > 0.0 else value
        step = self.channel.step if self._rng is not None else 0.0
        return round(value / step) * step if step else value


def _pulses(
    rng: np.random.Generator, n: int, dt: float, *, largest: float, hold: tuple[float, float]
) -> Array:
    """Return random pulses about zero, each held for a time; a quarter returns to it."""
    u, i = np.zeros(n), round(0.5 * hold[1] / dt)
    while i < n:
        length = max(1, round(rng.uniform(*hold) / dt))
        if rng.random() >= 0.25:
            u[i : i + length] += rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.0) * largest
        i += length
    return u


def _steps(
    rng: np.random.Generator,
    n: int,
    dt: float,
    *,
    low: float,
    high: float,
    hold: tuple[float, float],
    first: float,
) -> Array:
    """Return random levels between two ends, after a first one."""
    u, i = np.full(n, first), round(0.5 * hold[1] / dt)
    while i < n:
        length = max(1, round(rng.uniform(*hold) / dt))
        u[i : i + length] = rng.uniform(low, high)
        i += length
    return u


def _sines(
    rng: np.random.Generator, n: int, dt: float, *, largest: float, periods: Sequence[float]
) -> Array:
    """Return a sum of sines of about the given periods, growing from rest in one period."""
    t, u = np.arange(n) * dt, np.zeros(n)
    for period in periods:
        f = rng.uniform(0.85, 1.15) / period
        size = rng.uniform(0.7, 1.0) * largest / len(periods)
        u += size * np.sin(2 * np.pi * (f * t + rng.random()))
    return np.asarray(u * np.minimum(1.0, t / max(periods)))


def _chirp(
    rng: np.random.Generator, n: int, dt: float, *, largest: float, longest: float, shortest: float
) -> Array:
    """Return a sine whose period falls from the longest to the shortest."""
    t = np.arange(n) * dt
    rate = np.log(longest / shortest) / t[-1]
    turns = (np.exp(rate * t) - 1.0) / (longest * rate)
    return np.asarray(rng.uniform(0.8, 1.0) * largest * np.sin(2 * np.pi * turns))


_KINDS: Mapping[str, Callable[..., Array]] = {
    "pulses": _pulses,
    "steps": _steps,
    "sines": _sines,
    "chirp": _chirp,
}


def _driven(
    commands: Sequence[Mapping[str, Any]], rng: np.random.Generator, n: int, dt: float
) -> Array:
    made = []
    for command in commands:
        own = dict(command)
        made.append(_KINDS[own.pop("kind")](rng, n, dt, **own))
    return np.column_stack(made)


@cache
def _table() -> dict[str, dict[str, Any]]:
    return tomllib.loads(Path(__file__).with_name("machines.toml").read_text(encoding="utf-8"))


def machine(name: str, rates: Rates, initial: Start, loop: Loop | None = None) -> Machine:
    """Return a machine of the table with its equations."""
    entry = dict(_table()[name])
    excitations = {key: partial(_driven, own) for key, own in entry.pop("excitations").items()}
    return Machine(
        name,
        tuple(map(tuple, entry.pop("inputs"))),
        tuple(Channel(*channel) for channel in entry.pop("channels")),
        entry.pop("background"),
        tuple(Concealed(key, **own) for key, own in entry.pop("concealed").items()),
        rates,
        initial,
        excitations,
        loop=loop,
        **entry,
    )
