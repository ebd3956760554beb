"""Position loop of the closed-loop recordings: angle in, pressure difference inside, volt out.

Units: degrees, bar, volt and s.
"""

from __future__ import annotations

from dataclasses import dataclass, field


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
    sample: float = 2e-3
    _last: float | None = field(default=None, init=False)
    _rate: float = field(default=0.0, init=False)

    def __call__(self, reference: float, angle: float, pressures: tuple[float, float]) -> float:
        """Return the command in volt for angles in degrees and gauge pressures in bar."""
        if self._last is None:
            self._last = angle
        share = self.sample / (self.sample + self.time_constant)
        self._rate += share * ((angle - self._last) / self.sample - self._rate)
        self._last = angle
        # equilibrium of the unloaded arm: about 0.11 bar of difference per degree from 30 deg
        wanted = 0.106 * (reference - 30.0) + self.stiffness * (reference - angle)
        wanted -= self.damping * self._rate
        volt = self.inner * (wanted - (pressures[0] - pressures[1]))
        return 5.0 + min(self.limit, max(-self.limit, volt))
