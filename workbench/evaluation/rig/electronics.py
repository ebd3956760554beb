"""What stands between a controller and the rig: sensors, the way of the command, a position loop.

Units: as in the names; parameters in SI; the command in volt.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

SAMPLE = 2e-3


def quantise(value: float, step: float) -> float:
    """Round to the nearest multiple of step; step 0 leaves the value alone."""
    return round(value / step) * step if step > 0.0 else value


@dataclass
class Sensors:
    """Sensors with memory: coloured noise, bursts, lags, play, and the delay of the angle.

    The delay is interpolated linearly; a lag is the sampled filter y += (1 - exp(-h/T)) (u - y),
    settled at the first sample.
    """

    parameters: dict[str, float]
    rng: np.random.Generator
    _noise: list[float] = field(default_factory=lambda: [0.0, 0.0], init=False)
    _angles: list[float] = field(default_factory=list, init=False)
    _lagged: dict[str, float] = field(default_factory=dict, init=False)
    _burst: int = field(default=0, init=False)
    _coupled: float | None = field(default=None, init=False)
    _read: float | None = field(default=None, init=False)
    _counted: tuple[float, float] | None = field(default=None, init=False)

    def angle(self, true_deg: float) -> float:
        """Return the angle read in degrees."""
        p = self.parameters
        dropout = p["angle_dropout"]
        if dropout > 0.0 and self._read is not None and self.rng.random() < dropout:
            return self._read
        self._angles.append(self._count(self._behind(true_deg)))
        lag = p["angle_delay"] / SAMPLE
        whole = math.floor(lag)
        back = [self._angles[max(0, len(self._angles) - 1 - whole - k)] for k in (0, 1)]
        value = self._lag("angle", back[0] + (lag - whole) * (back[1] - back[0]))
        value += p["angle_eccentricity"] * math.sin(2.0 * math.pi * value / 24.0)
        value = p["angle_gain"] * value + p["angle_offset"]
        if p["angle_limit"] > 0.0:
            value = min(value, p["angle_limit"])
        self._read = quantise(value, p["angle_step"])
        return self._read

    def _behind(self, true_deg: float) -> float:
        """Return the angle behind a coupling with play."""
        half = self.parameters["angle_play"]
        last = true_deg if self._coupled is None else self._coupled
        self._coupled = min(true_deg + half, max(true_deg - half, last))
        return self._coupled

    def _count(self, deg: float) -> float:
        """Return the angle of a counter that misses a share of what passes too fast."""
        p, (last, counted) = self.parameters, self._counted or (deg, deg)
        step, slow = deg - last, p["angle_lost_speed"] * SAMPLE
        missed = p["angle_lost"] * max(0.0, abs(step) - slow)
        counted += step - math.copysign(missed, step)
        self._counted = deg, counted
        return counted

    def _lag(self, name: str, value: float) -> float:
        time = self.parameters[f"{name.rstrip('12_')}_lag"]
        if time > 0.0:
            last = self._lagged.get(name, value)
            value = last + (1.0 - math.exp(-SAMPLE / time)) * (value - last)
            self._lagged[name] = value
        return value

    def pressure(self, k: int, true_pa: tuple[float, float]) -> float:
        """Return the gauge pressure of muscle k (0, 1) read in Pa; `true_pa` are both."""
        p = self.parameters
        own = self._lag(f"pressure_{k + 1}", true_pa[k] + p["pressure_cross"] * true_pa[1 - k])
        tau = p["pressure_noise_time"]
        keep = math.exp(-SAMPLE / tau) if tau > 0.0 else 0.0
        fresh = math.sqrt(1.0 - keep * keep) * p["pressure_noise"]
        self._noise[k] = keep * self._noise[k] + fresh * self.rng.standard_normal()
        value = p[f"pressure_gain_{k + 1}"] * own + p[f"pressure_offset_{k + 1}"]
        value += self._noise[k] + self._burst_noise()
        if k == 0 and p["pressure_limit"] > 0.0:
            value = min(value, p["pressure_limit"])
        return quantise(value, p["pressure_step"])

    def _burst_noise(self) -> float:
        size = self.parameters["pressure_burst"]
        if size == 0.0:
            return 0.0
        if self._burst == 0 and self.rng.random() < 0.001:
            self._burst = 6  # both sensors in turn, three samples each
        if self._burst == 0:
            return 0.0
        self._burst -= 1
        return size * self.rng.standard_normal()


@dataclass
class CommandPath:
    """Turns one command per sample into one spool command per integration step."""

    parameters: dict[str, float]
    steps: int
    step: float
    _queue: deque[float] = field(init=False)
    _play: float = field(init=False)
    _stuck: float = field(init=False)
    _held: float = field(init=False)
    _samples: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._queue = deque([5.0] * round(self.parameters["valve_delay"] / self.step))
        self._play = self._stuck = self._held = 5.0

    def quantised(self, volt: float) -> float:
        """Return the command on the grid of the output card, counted from 5 V."""
        return 5.0 + quantise(volt - 5.0, self.parameters["command_step"])

    def __call__(self, volt: float) -> NDArray[np.float64]:
        """Return what the spool is told during the next sample, one value per step."""
        p = self.parameters
        half, every = p["valve_play"], max(1, round(p["command_hold"] / SAMPLE))
        if self._samples % every == 0:
            self._held = volt
        self._samples += 1
        if abs(self._held - self._stuck) >= p["valve_stiction"]:
            self._stuck = self._held
        volt = self._stuck
        self._play = min(volt + half, max(volt - half, self._play))
        self._queue.extend([self._play] * self.steps)
        return np.array([self._queue.popleft() for _ in range(self.steps)])


@dataclass
class PositionLoop:
    """PD on the angle commands a pressure difference; P on that commands the valve.

    Gains: `stiffness` bar/deg, `damping` bar s/deg, `inner` V/bar.  No integral action: the
    valve itself integrates, and the recordings keep a visible steady error.
    """

    stiffness: float = 0.06
    damping: float = 0.012
    inner: float = 0.35
    limit: float = 1.3
    time_constant: float = 0.01
    _last: float | None = field(default=None, init=False)
    _rate: float = field(default=0.0, init=False)

    def __call__(self, reference: float, angle: float, pressures: tuple[float, float]) -> float:
        """Return the command in volt for angles in degrees and gauge pressures in bar."""
        if self._last is None:
            self._last = angle
        share = SAMPLE / (SAMPLE + self.time_constant)
        self._rate += share * ((angle - self._last) / SAMPLE - self._rate)
        self._last = angle
        # equilibrium of the unloaded arm: about 0.11 bar of difference per degree from 30 deg
        wanted = 0.106 * (reference - 30.0) + self.stiffness * (reference - angle)
        wanted -= self.damping * self._rate
        volt = self.inner * (wanted - (pressures[0] - pressures[1]))
        return 5.0 + min(self.limit, max(-self.limit, volt))
