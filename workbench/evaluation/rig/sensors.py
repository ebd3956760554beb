"""What the sensors make of angle and pressures: offset, gain, noise, quantisation.

Units: as in the names; parameters in SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

SAMPLE = 2e-3


def quantise(value: float, step: float) -> float:
    """Round to the nearest multiple of step; step 0 leaves the value alone."""
    return round(value / step) * step if step > 0.0 else value


@dataclass
class Sensors:
    """Sensors with memory: coloured noise and the delay of the angle (linear interpolation)."""

    parameters: dict[str, float]
    rng: np.random.Generator
    _noise: list[float] = field(default_factory=lambda: [0.0, 0.0], init=False)
    _angles: list[float] = field(default_factory=list, init=False)
    _lagged: list[float | None] = field(default_factory=lambda: [None, None], init=False)

    def angle(self, true_deg: float) -> float:
        """Return the angle read in degrees."""
        p = self.parameters
        self._angles.append(true_deg)
        lag = p["angle_delay"] / SAMPLE
        whole = math.floor(lag)
        back = [self._angles[max(0, len(self._angles) - 1 - whole - k)] for k in (0, 1)]
        value = back[0] + (lag - whole) * (back[1] - back[0]) + p["angle_offset"]
        return quantise(value, p["angle_step"])

    def pressure(self, k: int, true_pa: float) -> float:
        """Return the gauge pressure of muscle k (0, 1) read in Pa.

        The lag is the sampled filter y += (1 - exp(-h/T)) (p - y), settled at the first sample.
        """
        p = self.parameters
        if p["pressure_lag"] > 0.0:
            last = self._lagged[k]
            share = 1.0 - math.exp(-SAMPLE / p["pressure_lag"])
            true_pa = true_pa if last is None else last + share * (true_pa - last)
            self._lagged[k] = true_pa
        tau = p["pressure_noise_time"]
        keep = math.exp(-SAMPLE / tau) if tau > 0.0 else 0.0
        fresh = math.sqrt(1.0 - keep * keep) * p["pressure_noise"]
        self._noise[k] = keep * self._noise[k] + fresh * self.rng.standard_normal()
        value = p[f"pressure_gain_{k + 1}"] * true_pa + p[f"pressure_offset_{k + 1}"]
        return quantise(value + self._noise[k], p["pressure_step"])
