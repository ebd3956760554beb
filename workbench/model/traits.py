"""What a plant declares about itself beside its equations: general rooms need not know it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from workbench.errors import check_choice
from workbench.model.effect import Effect

Weights = tuple[tuple[str, float], ...]
"""Names with their weights."""

Bound = float | tuple[str, ...]
"""A number, in SI, or the sum of the parameters of these names."""


@dataclass(frozen=True)
class DriftingSum:
    """A sum of outputs that no input holds, but that an operating point may prescribe.

    The mean of two stores that one valve fills and empties is one: it drifts to where leakage holds
    it, and any other mean can be passed through.

    Args:
        drifting: States whose rates may then differ from zero, in this proportion.
        scale: Typical size, in SI.
    """

    name: str
    unit: str
    weights: Weights
    drifting: Weights
    lower: Bound
    upper: Bound
    display_unit: str
    scale: float


@dataclass(frozen=True)
class ActuatorCurve:
    """A static curve of an actuator that a controller may invert.

    Args:
        name: Name of the input that a controller then has, a fraction from -1 to 1.
        state: State that follows the command, and to which the curve applies.
        full: Value of the state at which a straight curve reaches 1, in SI.
        straight: Builds the effect that puts a straight line in the curve's place.
        signals: Signals of the model whose weighted sum is the curve's value.
        input: Input that the state follows; by default the only one of the plant.
    """

    name: str
    state: str
    full: float
    straight: Callable[[], Effect]
    signals: Weights
    input: str = ""

    def value(self, signals: Mapping[str, float]) -> float:
        """Return the value of the curve, a fraction.

        Args:
            signals: Signals of the model by name, in SI.
        """
        return float(sum(weight * signals[name] for name, weight in self.signals))


LEFT_OUT = 0.05
"""Disturbance at a port that declares none, as a fraction of the signal there."""


@dataclass(frozen=True)
class Traits:
    """What a plant declares about itself.

    Args:
        sums: Sums that an operating point may prescribe beside one value per input.
        limits: States with their smallest and largest value at an operating point.
        stops: States with the mechanical stops at their smallest and largest value.
        choices: Parameters that a user chooses; messages say which values would be possible.
        sizes: Root mean square of the signals at ports along recordings, in SI: of a plant that
            declares no disturbance anywhere, `LEFT_OUT` of it may be left out there.
        scales: Typical sizes of ports that declare none (`workbench.model.sizes`), in SI by name.
        opened: Whether inputs and rates have ports beside those that its author opened.
        straight: Inputs that go straight from sample to sample of a recording; others are held.
        misread: Inputs that were read by a meter, with its noise, root mean square in SI: it moves
            the model and not the machine.
        passing: States that stand for a delay: nothing acts on what only comes later.
        pace: Time in which the response shows of what has no time of its own, in s.
        held: Parameters that are refitted although the author holds them, with his values in SI.
    """

    sums: tuple[DriftingSum, ...] = ()
    limits: tuple[tuple[str, Bound, Bound], ...] = ()
    stops: tuple[tuple[str, Bound, Bound], ...] = ()
    choices: tuple[str, ...] = ()
    curves: tuple[ActuatorCurve, ...] = ()
    sizes: tuple[tuple[str, float], ...] = ()
    scales: tuple[tuple[str, float], ...] = ()
    opened: bool = False
    straight: tuple[str, ...] = ()
    misread: tuple[tuple[str, float], ...] = ()
    passing: tuple[str, ...] = ()
    pace: float = 1.0
    held: tuple[tuple[str, float], ...] = ()

    def curve(self, name: str) -> ActuatorCurve:
        """Return a curve by the name of its input."""
        check_choice("input", name, ["plant", *(c.name for c in self.curves)])
        return next(c for c in self.curves if c.name == name)
