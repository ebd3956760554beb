"""Modes of a state matrix: frequency, damping and the states that take part."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.arrays import Vector
from workbench.model.sizes import poles_of
from workbench.model.units import in_time


@dataclass(frozen=True)
class Mode:
    """One real pole or one pair of complex poles.

    Args:
        pole: The pole with positive imaginary part, or the real pole, in rad/s.
        participation: Share of each state in the mode, dimensionless, by name.

    Example:
        >>> mode = Mode(-1 + 2j * math.pi, {"angle": 1.0})
        >>> round(mode.frequency_hz, 2), round(mode.damping, 2)
        (1.01, 0.16)
    """

    pole: complex
    participation: dict[str, float]

    @property
    def frequency_hz(self) -> float:
        """Natural frequency |pole| / 2 pi, in Hz."""
        return abs(self.pole) / (2 * math.pi)

    @property
    def damping(self) -> float:
        """Damping ratio -Re(pole) / |pole|, dimensionless; 1 for a stable real pole."""
        size = abs(self.pole)
        return -self.pole.real / size if size else 1.0

    def share(self, state: str) -> float:
        """Return the share of a state in the mode, dimensionless."""
        return self.participation.get(state, 0.0)

    @property
    def figures(self) -> tuple[float, float, float]:
        """Frequency in Hz and damping ratio of an oscillation, time constant in s; NaN if none."""
        if self.pole.imag:
            return self.frequency_hz, self.damping, math.nan
        time = -1.0 / self.pole.real if abs(self.pole.real) >= 1e-9 else math.inf
        return math.nan, math.nan, time

    @property
    def main_states(self) -> tuple[str, ...]:
        """Names of the states that take more than a fifth, the largest part first."""
        names = sorted(self.participation, key=lambda n: -self.participation[n])
        return tuple(n for n in names if self.participation[n] > 0.2)

    def __str__(self) -> str:
        frequency, damping, time = self.figures
        if math.isnan(time):
            told = f"{damping:.3f}" if abs(damping) > 0.01 else f"{damping:.2g}"
            what = f"{frequency:9.4g} Hz  damping {told:>7}"
        else:
            decays = f"time constant {in_time(time, 4):>11}"
            grows = f"unstable pole {self.pole.real:9.4g} rad/s"
            what = "integrator" if math.isinf(time) else grows if time < 0.0 else decays
        return f"mode {what:<29}  {', '.join(self.main_states)}"


def find_modes(A: Vector, names: tuple[str, ...]) -> tuple[Mode, ...]:
    """Find the modes of a state matrix, from slow to fast; a complex pair is one mode.

    The participation of state k in mode i is ``|v_ki w_ik|`` with right and left eigenvectors,
    normalised to a sum of 1; it does not depend on the units of the states.

    Args:
        A: State matrix, shape (n, n), in SI.

    Source:
        I. J. Perez-Arriaga, G. C. Verghese, F. C. Schweppe 1982.
    """
    if not len(A):
        return ()
    poles, right = np.linalg.eig(A)
    still = int(np.sum(poles_of(A) == 0.0))
    poles[np.argsort(np.abs(poles))[:still]] = 0.0
    left = np.linalg.pinv(right)
    parts = np.abs(right * left.T)
    parts = parts / parts.sum(axis=0)
    found = [
        Mode(complex(pole), dict(zip(names, parts[:, i].tolist(), strict=True)))
        for i, pole in enumerate(poles)
        if pole.imag >= 0.0
    ]
    return tuple(sorted(found, key=lambda mode: abs(mode.pole)))
