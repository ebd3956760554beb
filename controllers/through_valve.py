"""What laws that end in the inverse of a valve's curve have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.protocol import Command, Info, Measurement, Reference

if TYPE_CHECKING:
    from controllers.valve_inverse import ValveInverse


class ThroughValve:
    """A controller with one command, bent by the inverse of the valve's curve.

    Example:
        >>> from controllers.angle_pd import AnglePD
        >>> issubclass(AnglePD, ThroughValve)
        True
    """

    if TYPE_CHECKING:

        @property
        def valve(self) -> ValveInverse:
            """Valve curve that is inverted."""

    def linear_command(self, command: Command) -> Command:
        """Return the command that gives a linear model the same opening.

        Args:
            command: Voltage on the plant, V.

        Returns:
            Voltage for a linear model, V.
        """
        return (self.valve.linear_command(command[0]),)


class ScheduledLaw(ThroughValve):
    """A law of numbers, written once for floats and for symbols.

    Example:
        >>> from controllers.scheduled_pid import ScheduledPID
        >>> issubclass(ScheduledPID, ScheduledLaw)
        True
    """

    def step(
        self, state: tuple[float, ...], measurement: Measurement, reference: Reference
    ) -> tuple[Command, tuple[float, ...], Info]:
        """Compute the valve voltage of one sample.

        Args:
            state: State of the step before, a tuple of numbers in SI.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.

        Returns:
            What `law` returns: voltage in V, next state, and information about the step in SI.
        """
        return self.law(state, measurement, reference, FLOATS)

    def law(
        self,
        state: tuple[Number, ...],
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
    ) -> tuple[tuple[Number, ...], tuple[Number, ...], dict[str, Number]]:
        """Compute one sample on floats or on symbols.

        Args:
            state: State of the step before, a tuple of numbers in SI.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.
            arithmetic: Floats or CasADi symbols.

        Returns:
            Voltage in V, next state, and information about the step in SI.
        """
        raise NotImplementedError
