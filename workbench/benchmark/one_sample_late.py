"""A controller whose command arrives one sample later: what its computing time may cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from controllers.protocol import Command, Controller, Info, Measurement, Reference

AT_REST = 5.0
"""Command before the first one arrives, V."""


@dataclass(frozen=True)
class OneSampleLate:
    """Hand on the command of the sample before.

    Args:
        controller: The controller.

    Example:
        >>> from controllers.open_loop import HeldCommand
        >>> late = OneSampleLate(HeldCommand((6.0,)))
        >>> late.step(late.initial_state(()), (), ())[0]
        (5.0,)
    """

    controller: Controller

    @property
    def name(self) -> str:
        """Name of the controller."""
        return self.controller.name

    @property
    def sample_time(self) -> float:
        """Time between samples, in s."""
        return self.controller.sample_time

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the readings."""
        return self.controller.sensors

    @property
    def follows(self) -> tuple[str, ...]:
        """Names of the followed outputs."""
        return self.controller.follows

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the commands."""
        return self.controller.actuators

    @property
    def preview(self) -> int:
        """Number of future references."""
        return self.controller.preview

    def initial_state(self, measurement: Measurement) -> Any:
        """Return the controller's state and the command at rest.

        Args:
            measurement: Readings of the sensors at the start, in SI.
        """
        return self.controller.initial_state(measurement), tuple(AT_REST for _ in self.actuators)

    def step(
        self, state: Any, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any, Info]:
        """Step the controller and return its command of the sample before.

        Args:
            state: State of the step before.
            measurement: Readings of the sensors, in SI.
            reference: Wanted values, in SI.

        Returns:
            The command of the sample before in SI, the next state and the step's information.
        """
        command, following, info = self.controller.step(state[0], measurement, reference)
        return state[1], (following, command), info

    def linear_command(self, command: Command) -> Command:
        """Return the controller's command for a linear model.

        Args:
            command: Command for the plant, in SI.

        Returns:
            Command for a linear model, in SI.
        """
        return self.controller.linear_command(command)
