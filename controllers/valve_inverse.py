"""The inverse valve curve: controllers decide an opening, the valve is given the voltage for it.

The flow curve of a soft-overlap valve is almost flat at the centre and steep outside: its local
gain spans 15 to 1. Deciding the opening and inverting the curve leaves a plant whose gain is nearly
constant, and the linear model at rest then holds for large commands too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import chain, pairwise

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.design import Design
from controllers.law import ClosedForm, ShownLaw
from controllers.protocol import Command
from workbench.errors import WorkbenchError, check_finite

MPYE_VOLTAGE: tuple[float, ...] = (
    0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0,
    1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0,
)  # fmt: skip
"""Distance of the command from the centre, V."""

MPYE_FRACTION: tuple[float, ...] = (
    0.0, 0.002, 0.005, 0.008, 0.012, 0.017, 0.023, 0.030, 0.041, 0.056, 0.071,
    0.107, 0.17, 0.24, 0.30, 0.36, 0.49, 0.64, 0.75, 0.86, 0.97, 1.0,
)  # fmt: skip
"""Flow as a fraction of the full one, read from the manufacturer's data sheet."""


SENSORS = ("angle", "pressure_1", "pressure_2")
"""Outputs that the controllers of a joint with two muscles read."""

ACTUATORS = ("valve",)
"""Input that those of a joint with one valve command."""


joint_design = partial(Design, sensors=SENSORS, actuators=ACTUATORS)
"""A design for such a joint."""


@dataclass(frozen=True)
class ValveInverse:
    """The controller's knowledge of the valve: its data sheet, not the valve that is mounted.

    Args:
        voltages: Increasing distances from the centre, in V, starting at 0.
        fractions: Increasing openings, as fractions of the full conductance, starting at 0.
        centre: Voltage at which the valve is shut, in V.
        below: The same two tables of distances below the centre, in V; by default alike.

    Source:
        Manufacturer's flow curve of the MPYE-5-1/8-HF.

    Example:
        >>> valve = ValveInverse()
        >>> round(valve.command(0.056), 3), round(valve.command(-2.0), 3)
        (5.9, 0.0)
    """

    voltages: tuple[float, ...] = MPYE_VOLTAGE
    fractions: tuple[float, ...] = MPYE_FRACTION
    centre: float = 5.0
    below: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    def __post_init__(self) -> None:
        check_finite("valve curve", (*chain(*self.sides[0], *self.sides[1]), self.centre))
        same = all(len(voltages) == len(fractions) >= 2 for voltages, fractions in self.sides)
        if not same or not all(
            table[0] == 0.0 and all(a < b for a, b in pairwise(table))
            for table in (*self.sides[0], *self.sides[1])
        ):
            raise WorkbenchError(
                f"a valve curve has {len(self.voltages)} voltages and {len(self.fractions)}"
                " openings; give equally many, two or more, increasing from 0, so that the curve"
                " can be inverted"
            )

    @property
    def sides(self) -> tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]:
        """Tables of voltages and fractions above the centre and below it."""
        above = self.voltages, self.fractions
        return above, self.below or above

    def scaled(self, full: float) -> ValveInverse:
        """Return the curve whose fractions are those of so many."""
        above, below = ((by, tuple(one / full for one in to)) for by, to in self.sides)
        return ValveInverse(*above, self.centre, below)

    @property
    def full_stroke(self) -> float:
        """Distance from the centre at which the valve is fully open, in V."""
        return self.voltages[-1]

    @property
    def gain_at_rest(self) -> float:
        """Slope of the curve at the centre, in fractions of the full opening per V: the mean."""
        return 0.5 * sum(fractions[1] / voltages[1] for voltages, fractions in self.sides)

    def command(self, opening: Number, arithmetic: Arithmetic = FLOATS) -> Number:
        """Return the voltage, in V, that gives a signed opening; beyond -1..1 the full voltage."""
        if self.below is None:
            return self.centre + arithmetic.table(opening, self.fractions, self.voltages)
        up, down = (arithmetic.largest(sign * opening, 0.0) for sign in (1.0, -1.0))
        above = arithmetic.table(up, self.fractions, self.voltages)
        return self.centre + above - arithmetic.table(down, *self.below[::-1])

    def opening(self, command: Number, arithmetic: Arithmetic = FLOATS) -> Number:
        """Return the signed opening, a fraction, that a voltage in V gives."""
        away, (above, below) = command - self.centre, self.sides
        if self.below is None:
            return arithmetic.table(away, *above)
        up, down = (arithmetic.largest(sign * away, 0.0) for sign in (1.0, -1.0))
        return arithmetic.table(up, *above) - arithmetic.table(down, *below)

    def straight(self, command: Number, arithmetic: Arithmetic = FLOATS) -> Number:
        """Return the centre and the opening beyond it, of a curve whose openings are in V."""
        return self.centre + self.opening(command, arithmetic)

    def linear_command(self, command: float) -> float:
        """Return the voltage, in V, at which the tangent at rest gives the opening of a command.

        It may leave the plant's range.
        """
        return float(self.tangent(self.opening(command)))

    def steepness(self, command: float) -> float:
        """Return the slope of the voltage by that of the tangent at rest, at a voltage in V."""
        opening, by = self.opening(command), 1e-6 * min(own[1] for _, own in self.sides)
        ends = [self.command(opening + sign * by) for sign in (1.0, -1.0)]
        return float((ends[0] - ends[1]) * self.gain_at_rest / (2.0 * by))

    def tangent(self, opening: Number) -> Number:
        """Return the voltage, in V, at which the tangent at rest gives an opening."""
        return self.centre + opening / self.gain_at_rest


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ValveController(ShownLaw):
    """A controller of a joint, whose one command is bent by the inverse of the valve's curve.

    Args:
        sample_time: Time between steps, in s.
    """

    sample_time: float = 0.002
    valve: ValveInverse = ValveInverse()
    sensors: tuple[str, ...] = SENSORS
    controlled: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ACTUATORS
    preview: int = 0

    @property
    def rest_command(self) -> Command:
        """Command that shuts the valve, in V."""
        return (self.valve.centre,)

    def linear_command(self, command: Command) -> Command:
        """Return the command that gives a linear model the same opening."""
        return (self.valve.linear_command(command[0]),)


class ValveLaw(ClosedForm, ValveController):
    """A law in closed form for a joint with one valve, which tells its ``opening``."""

    def straight(self, told: Told) -> Numbers:
        """Return the voltage, in V, at which the tangent at rest gives the opening."""
        return (self.valve.tangent(told["opening"]),)
