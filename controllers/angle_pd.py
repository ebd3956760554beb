"""Plain PD on the angle: the textbook beginner's law, kept for comparison.

    D[k] = f D[k-1] - (1 - f) Kd (y[k] - y[k-1]) / h           f = Tf / (Tf + h)
    o[k] = Kp (r[k] - y[k]) + D[k]                             valve opening, then the inverse curve

The valve integrates flow into pressure, so the loop holds an integrator and the joint's lightly
damped swing. A derivative of the angle adds stiffness to it, not damping, which would take the
acceleration: the arm ends in a limit cycle of 2 to 3 degrees rms, with or without hysteresis in
the muscles. `controllers.pid` closes a loop on the pressure difference inside.

Source: Åström and Hägglund, Advanced PID Control, 2006, sections 3.3 and 13.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from controllers.arithmetic import FLOATS
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.valve_inverse import ThroughValve, ValveInverse
from workbench.errors import check_range


class AnglePDState(NamedTuple):
    """What an `AnglePD` remembers.

    Args:
        derivative: Filtered derivative part, as an opening fraction.
        angle: Angle of the sample before, in rad.
    """

    derivative: float
    angle: float


@dataclass(frozen=True)
class AnglePD(ThroughValve):
    """PD law on the angle without an inner loop.

    Args:
        proportional: Kp, opening fraction per rad.
        derivative: Kd, opening fraction per rad/s.
        derivative_filter: Time constant Tf of the derivative's filter, in s.
        sample_time: Time between steps, in s.
        valve: Valve curve that is inverted.
        name: Name under which results are reported.
        sensors: Name of the angle.
        follows: Name of the followed output.
        actuators: Name of the command.
        preview: No future references are used.

    Raises:
        WorkbenchError: If a gain or time constant is outside its range.

    Example:
        >>> pd = AnglePD(0.4, 0.02)
        >>> pd.step(pd.initial_state((0.5,)), (0.5,), (0.5,))[0]
        (5.0,)
    """

    proportional: float
    derivative: float
    derivative_filter: float = 0.01
    sample_time: float = 0.002
    valve: ValveInverse = ValveInverse()
    name: str = "PD on the angle"
    sensors: tuple[str, ...] = ("angle",)
    follows: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    def __post_init__(self) -> None:
        """Check the gains."""
        check_range(f"proportional gain of {self.name}", self.proportional, 0.0, 1e6, "per rad")
        check_range(f"derivative gain of {self.name}", self.derivative, 0.0, 1e6, "s/rad")
        check_range(f"derivative filter of {self.name}", self.derivative_filter, 0.0, 10.0, "s")
        check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")

    def initial_state(self, measurement: Measurement) -> AnglePDState:
        """Return the state of an arm at rest.

        Args:
            measurement: Angle, in rad.
        """
        return AnglePDState(0.0, measurement[0])

    def step(
        self, state: AnglePDState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, AnglePDState, Info]:
        """Compute the valve voltage of one sample.

        Args:
            state: State of the step before.
            measurement: Angle, in rad.
            reference: Wanted angle, in rad.

        Returns:
            Voltage in V, next state, and the opening (fraction).
        """
        (angle,), h = measurement, self.sample_time
        fade = self.derivative_filter / (self.derivative_filter + h)
        slope = (angle - state.angle) / h
        derivative = fade * state.derivative - (1.0 - fade) * self.derivative * slope
        opening = FLOATS.clip(self.proportional * (reference[0] - angle) + derivative, -1.0, 1.0)
        return (self.valve.command(opening),), AnglePDState(derivative, angle), {"opening": opening}
