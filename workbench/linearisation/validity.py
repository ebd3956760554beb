"""How far a linear model holds: its kinks, its swings, and what simulation says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from workbench.linearisation.kinks import Kink
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.sines import FrequencyValidity, frequency_validity
from workbench.linearisation.steps import AmplitudeValidity, amplitude_validity


@dataclass(frozen=True)
class Swing:
    """A slope that was taken over a swing of a state because it is another at the point.

    Args:
        name: State that swings.
        amplitude: Amplitude of the swing, in SI.
        of: State whose rate has the slope.
        at_rest: Slope at the point, in SI.
        over_swing: Slope over the swing, in SI, which the matrices hold.

    Example:
        >>> print(Swing("speed", 1.0, "speed", -32.8, -1.4))
        slope of d speed/dt by speed: -1.4 over a swing of 1, -32.8 at the point
    """

    name: str
    amplitude: float
    of: str
    at_rest: float
    over_swing: float

    def __str__(self) -> str:
        """Return one line with both slopes."""
        return (
            f"slope of d {self.of}/dt by {self.name}: {self.over_swing:.4g} over a swing of"
            f" {self.amplitude:.4g}, {self.at_rest:.4g} at the point"
        )


@dataclass(frozen=True)
class Validity:
    """How far a linear model may be trusted.

    Args:
        linear: The linear model.
        kinks: Kinks of the plant at or next to the point, with the matrices on both sides.
        swings: Slopes that were taken over a swing.

    Example:
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.servo_axis import servo_axis
        >>> verdict = linearise(operating_point(servo_axis())).verdict
        >>> [swing.name for swing in verdict.swings]
        ['speed']
    """

    linear: LinearModel
    kinks: tuple[Kink, ...]
    swings: tuple[Swing, ...]

    @cached_property
    def amplitude(self) -> AmplitudeValidity:
        """Steps of the input for which the linear response holds within 10 %; simulated once."""
        return amplitude_validity(self.linear)

    @cached_property
    def frequency(self) -> FrequencyValidity:
        """Frequencies up to which a sine on the full plant agrees; simulated once.

        The output swings by 5 % of its scale.
        """
        return frequency_validity(self.linear)

    def summary(self) -> list[str]:
        """Return the lines that need no simulation: kinks and swings."""
        return [str(item) for item in (*self.kinks, *self.swings)] or ["no kink next to the point"]

    def __str__(self) -> str:
        """Return the whole verdict as a short table; simulates if that was not done yet."""
        return "\n".join([*self.summary(), str(self.amplitude), str(self.frequency)])
