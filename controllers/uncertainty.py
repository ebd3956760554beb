"""What a design must tolerate beside its linear models: latency, lags of sensors, fast dynamics.

A loop on a rig is late by what computer, converters and bus need, its analogue sensors are
filtered, and above some frequency no model of it is worth anything. A design that is told so holds
its margins at every corner,

    command:    exp(-delay s),  delay at either end of its range
    sensors:    1 / (1 + lag s),  lag at either end, for every sensor with noise of its own (one
                that counts has no filter)
    elsewhere:  any multiplicative change of the command of size w / trusted_frequency:
                |T(j w)| w <= trusted_frequency                                    (small gain)

The middle of a range is known, and may be compensated; the rest is left to the margin. Loads,
supply and offsets are the plant's own words: a plant declares them (`Plant.tolerated`).

Source: Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, sections 7.4 and 7.5.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

from workbench.errors import WorkbenchError, check_range

_WITHIN = 0.5e-3
"""How far a delay or lag that was identified may be off, in s."""


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """What a design must tolerate.

    Args:
        delay: Least and largest time between measurement and valve beside the sample's, in s.
        sensor_lag: Least and largest time constant of the sensors with noise, in s.
        trusted_frequency: Frequency above which nothing is trusted, in rad/s; infinite if the
            model is.
    """

    delay: tuple[float, float] = (0.0, 0.008)
    sensor_lag: tuple[float, float] = (0.0, 0.010)
    trusted_frequency: float = 2.0 * math.pi * 30.0

    def __post_init__(self) -> None:
        for name, (least, largest) in (("delay", self.delay), ("lag", self.sensor_lag)):
            check_range(f"least {name} that is tolerated", least, 0.0, 1.0, "s")
            check_range(f"largest {name} that is tolerated", largest, least, 1.0, "s")
        if not self.trusted_frequency > 0.0:
            raise WorkbenchError(
                f"the frequency up to which a model is trusted is {self.trusted_frequency!r}; give"
                " a positive one, in rad/s, or infinity"
            )

    @property
    def known_delay(self) -> float:
        """Delay that may be compensated, in s."""
        return 0.5 * sum(self.delay)

    @property
    def known_lag(self) -> float:
        """Lag of the sensors that may be compensated, in s."""
        return 0.5 * sum(self.sensor_lag)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Pairs of delay and lag, in s, at which the margins must hold."""
        return tuple(dict.fromkeys(itertools.product(self.delay, self.sensor_lag)))

    @classmethod
    def known(cls, delay: float, *, sensor_lag: float = 0.0) -> Uncertainty:
        """Return what is left to tolerate of delay and sensor lag, in s, that were identified.

        At every frequency the model is trusted; both may be off by half a millisecond.
        """
        ranges = [(max(v - _WITHIN, 0.0), v + _WITHIN) for v in (delay, sensor_lag)]
        return cls(delay=ranges[0], sensor_lag=ranges[1], trusted_frequency=math.inf)

    def reduced(self, share: float) -> Uncertainty:
        """Return the same with a share, a ratio, of delay and lag."""
        (d0, d1), (l0, l1) = self.delay, self.sensor_lag
        return replace(self, delay=(share * d0, share * d1), sensor_lag=(share * l0, share * l1))


NONE = Uncertainty(delay=(0.0, 0.0), sensor_lag=(0.0, 0.0), trusted_frequency=math.inf)
"""A loop that is just as it is modelled."""
