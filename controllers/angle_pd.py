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

from dataclasses import dataclass, field
from typing import NamedTuple

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.valve_inverse import ValveLaw, joint_design
from workbench.errors import check_choice, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.state_space import linear_model


class AnglePDState(NamedTuple):
    """What an `AnglePD` remembers.

    Args:
        derivative: Filtered derivative part, as an opening fraction.
        angle: Angle of the sample before, in rad.
    """

    derivative: Number
    angle: Number


@dataclass(frozen=True, repr=False)
class AnglePD(ValveLaw):
    """PD law on the angle without an inner loop.

    Args:
        proportional: Kp, opening fraction per rad.
        derivative: Kd, opening fraction per rad/s.
        derivative_filter: Time constant Tf of the derivative's filter, in s.
    """

    proportional: float
    derivative: float
    derivative_filter: float = 0.01
    name: str = "PD on the angle"
    sensors: tuple[str, ...] = field(default=("angle",), kw_only=True)

    def __post_init__(self) -> None:
        check_range(f"proportional gain of {self.name}", self.proportional, 0.0, 1e6, "per rad")
        check_range(f"derivative gain of {self.name}", self.derivative, 0.0, 1e6, "s/rad")
        check_range(f"derivative filter of {self.name}", self.derivative_filter, 0.0, 10.0, "s")
        check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")

    def initial_state(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> AnglePDState:
        return AnglePDState(0.0, measurement[0])

    def law(
        self, state: AnglePDState, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, AnglePDState, Told]:
        (angle,), h = measurement, self.sample_time
        fade = self.derivative_filter / (self.derivative_filter + h)
        slope = (angle - state.angle) / h
        derivative = fade * state.derivative - (1.0 - fade) * self.derivative * slope
        asked = self.proportional * (reference[0] - angle) + derivative
        opening = arithmetic.clip(asked, -1.0, 1.0)
        following = AnglePDState(derivative, angle)
        return (self.valve.command(opening, arithmetic),), following, {"opening": opening}


@dataclass(frozen=True)
class AnglePDSpecification:
    """Gains of an `AnglePD`, given by hand.

    Args:
        proportional: Kp, opening fraction per rad.
        derivative: Kd, opening fraction per rad/s.
        derivative_filter: Time constant of the derivative's filter, in s.
    """

    proportional: float = 0.4
    derivative: float = 0.02
    derivative_filter: float = 0.01


def design_angle_pd(
    linear: LinearModel, specification: AnglePDSpecification | None = None
) -> AnglePD:
    """Return a PD law with gains given by hand."""
    want = specification or AnglePDSpecification()
    check_choice("sensor of the linear model", "angle", linear_model(linear).output_names)
    return AnglePD(want.proportional, want.derivative, want.derivative_filter)


ANGLE_PD = joint_design(
    name="angle-pd",
    family="PD on the angle",
    summary="plain PD on the angle, gains by hand: what the cascade is compared with",
    function=design_angle_pd,
    specification=AnglePDSpecification,
    sensors=("angle",),
)
