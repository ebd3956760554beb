"""How far a linear model holds: its kinks, its describing functions, and what simulation says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from workbench.linearisation.kinks import Kink
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.sines import FrequencyValidity, frequency_validity
from workbench.linearisation.steps import AmplitudeValidity, amplitude_validity
from workbench.model.units import with_unit


@dataclass(frozen=True)
class DescribingFunction:
    """A slope that was taken over an oscillation of a state because it is another at the point.

    Args:
        amplitude: Amplitude of the oscillation, in SI.
        of: State whose rate has the slope.
        at_rest: Slope at the point, in SI.
        over_oscillation: Slope over the oscillation, in SI, which the matrices hold.
        read: Unit in which people read the amplitude, and its size from SI.
        slope_read: Unit in which people read the slopes, and its size from SI.
    """

    name: str
    amplitude: float
    of: str
    at_rest: float
    over_oscillation: float
    read: tuple[str, float]
    slope_read: tuple[str, float]

    def __str__(self) -> str:
        """Return one line with both slopes."""
        unit, factor = self.slope_read
        amplitude = with_unit(f"{self.amplitude * self.read[1]:.4g}", self.read[0])
        return (
            f"slope of d {self.of}/dt by {self.name}: {factor * self.over_oscillation:.4g} {unit}"
            f" over an oscillation of {amplitude}, {factor * self.at_rest:.4g} at the point"
        )


@dataclass(frozen=True)
class Validity:
    """How far a linear model may be trusted."""

    linear: LinearModel
    kinks: tuple[Kink, ...]
    describing_functions: tuple[DescribingFunction, ...]

    @cached_property
    def amplitude(self) -> AmplitudeValidity:
        """Steps of the input for which the linear response holds within 10 %; simulated once."""
        return amplitude_validity(self.linear)

    @cached_property
    def frequency(self) -> FrequencyValidity:
        """Frequencies up to which a sine on the full plant agrees; simulated once.

        The output oscillates by 5 % of its scale.
        """
        return frequency_validity(self.linear)

    def summary(self) -> list[str]:
        """Return the lines that need no simulation: kinks and describing functions."""
        told = [str(item) for item in (*self.kinks, *self.describing_functions)]
        return told or ["no kink next to the point"]

    def __str__(self) -> str:
        """Return the whole verdict as a short table; simulates if that was not done yet."""
        return "\n".join([*self.summary(), str(self.amplitude), str(self.frequency)])
