"""No control: a command that is held."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.protocol import Command, Info, Measurement, Reference


@dataclass(frozen=True)
class ConstantCommand:
    """A controller that always gives the same command.

    Args:
        values: The command in SI, one value per actuator.
        sample_time: Time between steps, in s.
        controlled: Names of the outputs that have a reference, which is not followed.
    """

    values: Command
    sample_time: float = 0.002
    name: str = "held command"
    sensors: tuple[str, ...] = ()
    controlled: tuple[str, ...] = ()
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    def initial_state(self, measurement: Measurement) -> None:
        """Return no state."""

    def step(
        self, state: None, measurement: Measurement, reference: Reference
    ) -> tuple[Command, None, Info]:
        """Return the command."""
        return self.values, None, {}

    def linear_command(self, command: Command) -> Command:
        """Return the command unchanged."""
        return command
