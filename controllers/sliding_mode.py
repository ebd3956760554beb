"""Sliding mode of first order with a boundary layer, on the third-order model of the joint.

    d2theta/dt2 = b dp - a1 dtheta/dt - a0 theta + w,    d(dp)/dt = g o - e dtheta/dt - d dp

The reference passes a third-order model r with poles at omega_r, whose derivatives are known. With
the error x = r - theta and its derivatives, speed and w from the observer and dtheta2/dt2 from the
measured pressure difference, the sliding surface and its rate are

    s     = x'' + 2 lambda x' + lambda^2 x
    ds/dt = r''' + 2 lambda x'' + lambda^2 x' - theta'''
    theta''' = b (g o - e theta' - d dp) - a1 theta'' - a0 theta'

so the opening is the equivalent control, which keeps ds/dt = 0 on the model, and the reaching part:

    o = [r''' + 2 lambda x'' + lambda^2 x' + b (e theta' + d dp) + a1 theta'' + a0 theta'] / (b g)
        + rho sat(s / layer)

For |s| > layer the surface is reached if rho b g exceeds the jerk that the model leaves out.
Inside the layer the law is linear, with the pole rho b g / layer instead of chattering.

Source: Slotine and Li, Applied Nonlinear Control, 1991, sections 7.1 and 7.2 (surface of a chain,
boundary layer); Edwards and Spurgeon, Sliding Mode Control, 1998, chapter 3 (equivalent control).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.design import Design
from controllers.joint.model import JointModel, joint_model
from controllers.joint.observer import JointEstimate, JointObserver, design_joint_observer
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.through_valve import ThroughValve
from controllers.valve_inverse import ValveInverse
from workbench.errors import check_range

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


class SlidingModeState(NamedTuple):
    """What a `SlidingMode` remembers.

    Args:
        angle: Predicted angle, in rad.
        speed: Predicted speed, in rad/s.
        unexplained: Predicted acceleration that the model does not explain, in rad/s2.
        difference: Filtered pressure difference, in Pa.
        target: Reference model's angle, in rad.
        target_speed: Reference model's speed, in rad/s.
        target_acceleration: Reference model's acceleration, in rad/s2.
    """

    angle: Number
    speed: Number
    unexplained: Number
    difference: Number
    target: Number
    target_speed: Number
    target_acceleration: Number


@dataclass(frozen=True)
class SlidingMode(ThroughValve):
    """First-order sliding mode with boundary layer, observer and reference model.

    Args:
        joint: Third-order model of the joint.
        observer: Observer of speed and unexplained acceleration.
        slope: Slope lambda of the surface, in rad/s: errors decay like exp(-lambda t) on it.
        reaching: Reaching gain rho, fraction of the full opening.
        layer: Half width of the boundary layer, in rad/s2.
        reference_speed: Poles omega_r of the reference model, in rad/s.
        pressure_filter: Time constant of the pressures' filter, in s.
        sample_time: Time between steps, in s.
        valve: Valve curve that is inverted.
        name: Name under which results are reported.
        sensors: Names of the angle and the two pressures.
        follows: Name of the followed output.
        actuators: Name of the command.
        preview: No future references are used.

    Raises:
        WorkbenchError: If a gain or time constant is outside its range.

    Example:
        >>> joint = JointModel(b=1.6e-4, a1=1.0, a0=100.0, g=3.7e7, e=6.9e5, d=0.3, angle=0.5)
        >>> observer = design_joint_observer(joint, bandwidth=100.0, sample_time=0.002)
        >>> law = SlidingMode(joint, observer, slope=20.0, reaching=0.5, layer=40.0)
        >>> at_rest = (0.5, 3e5, 3e5)
        >>> law.step(law.initial_state(at_rest), at_rest, (0.5,))[0]
        (5.0,)
    """

    joint: JointModel
    observer: JointObserver
    slope: float
    reaching: float
    layer: float
    reference_speed: float = 25.0
    pressure_filter: float = 0.002
    sample_time: float = 0.002
    valve: ValveInverse = ValveInverse()
    name: str = "sliding mode"
    sensors: tuple[str, ...] = ("angle", "pressure_1", "pressure_2")
    follows: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    def __post_init__(self) -> None:
        """Check the gains."""
        h = check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")
        check_range(f"slope of {self.name}", self.slope, 0.01, 1.0 / h, "rad/s")
        check_range(f"reaching gain of {self.name}", self.reaching, 1e-6, 1.0)
        check_range(f"boundary layer of {self.name}", self.layer, 1e-9, 1e9, "rad/s2")
        check_range(f"reference speed of {self.name}", self.reference_speed, 0.1, 0.5 / h, "rad/s")
        check_range(f"pressure filter of {self.name}", self.pressure_filter, 0.0, 10.0, "s")

    @property
    def layer_bandwidth(self) -> float:
        """Pole inside the boundary layer, rho b g / layer, in rad/s."""
        return self.reaching * self.joint.opening_to_jerk / self.layer

    def initial_state(self, measurement: Measurement) -> SlidingModeState:
        """Return the state of a joint at rest.

        Args:
            measurement: Angle in rad and the two gauge pressures in Pa.
        """
        angle, p1, p2 = measurement
        estimate = self.observer.start(self.joint, angle, p1 - p2)
        return SlidingModeState(*estimate, p1 - p2, angle, 0.0, 0.0)

    def step(
        self, state: SlidingModeState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, SlidingModeState, Info]:
        """Compute the valve voltage of one sample.

        Args:
            state: State of the step before.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.

        Returns:
            Voltage in V, next state, and the opening (fraction), the surface s (rad/s2) and the
            estimated speed (rad/s).
        """
        return self.law(state, measurement, reference, FLOATS)

    def law(
        self,
        state: SlidingModeState,
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
    ) -> tuple[tuple[Number, ...], SlidingModeState, dict[str, Number]]:
        """Compute one sample on floats or on symbols.

        Args:
            state: State of the step before.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.
            arithmetic: Floats or CasADi symbols.

        Returns:
            Voltage in V, next state, and the opening (fraction), the surface s (rad/s2) and the
            estimated speed (rad/s).
        """
        joint, lam, h, w = self.joint, self.slope, self.sample_time, self.reference_speed
        angle, p1, p2 = measurement
        predicted = JointEstimate(state.angle, state.speed, state.unexplained)
        now = self.observer.correct(predicted, angle)
        fresh = h / (self.pressure_filter + h)
        difference = state.difference + fresh * (p1 - p2 - state.difference)
        dp = difference - joint.difference
        acceleration = (
            joint.b * dp
            - joint.a1 * now.speed
            - joint.a0 * (now.angle - joint.angle)
            + now.unexplained
        )
        target, speed, curve = state.target, state.target_speed, state.target_acceleration
        jerk = w**3 * (reference[0] - target) - 3.0 * w * w * speed - 3.0 * w * curve

        x, dx, ddx = target - angle, speed - now.speed, curve - acceleration
        surface = ddx + 2.0 * lam * dx + lam * lam * x
        equivalent = (
            jerk
            + 2.0 * lam * ddx
            + lam * lam * dx
            + joint.b * (joint.e * now.speed + joint.d * dp)
            + joint.a1 * acceleration
            + joint.a0 * now.speed
        ) / joint.opening_to_jerk
        reaching = self.reaching * arithmetic.clip(surface / self.layer, -1.0, 1.0)
        opening = arithmetic.clip(equivalent + reaching, -1.0, 1.0)

        following = SlidingModeState(
            *self.observer.predict(now, difference),
            difference,
            target + h * speed,
            speed + h * curve,
            curve + h * jerk,
        )
        command = self.valve.command(opening, arithmetic)
        return (command,), following, {"opening": opening, "surface": surface, "speed": now.speed}


@dataclass(frozen=True)
class SlidingModeSpecification:
    """What a `SlidingMode` is designed for.

    Args:
        slope: Decay of the error on the surface, in rad/s.
        jerk_bound: Bound on the jerk that the model leaves out (gain of the valve, hysteresis,
            load), in rad/s3; the reaching gain exceeds it.
        layer_bandwidth: Pole inside the boundary layer, in rad/s; below the spool's bandwidth.
        observer_bandwidth: Poles of the observer, in rad/s.
        reference_speed: Poles of the reference model, in rad/s.
        sample_time: Time between steps, in s.

    Raises:
        WorkbenchError: If a number is outside its range.

    Example:
        >>> SlidingModeSpecification().slope
        25.0
    """

    slope: float = 25.0
    jerk_bound: float = 2000.0
    layer_bandwidth: float = 80.0
    observer_bandwidth: float = 100.0
    reference_speed: float = 25.0
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_range("slope of the surface", self.slope, 0.01, 1e3, "rad/s")
        check_range("bound on the jerk", self.jerk_bound, 1e-6, 1e9, "rad/s3")
        check_range("bandwidth of the layer", self.layer_bandwidth, 0.1, 1e3, "rad/s")
        check_range("bandwidth of the observer", self.observer_bandwidth, 0.1, 1e3, "rad/s")
        check_range("reference speed", self.reference_speed, 0.1, 1e3, "rad/s")


def design_sliding_mode(
    linear: LinearModel,
    specification: SlidingModeSpecification | None = None,
    *,
    valve: ValveInverse | None = None,
) -> SlidingMode:
    """Design a sliding mode with boundary layer from a linear model.

    ``rho = jerk_bound / (b g)``, at most 1, and ``layer = jerk_bound / layer_bandwidth``.

    Args:
        linear: Linear model from the valve's voltage or opening to the sensors.
        specification: What to reach.
        valve: Valve curve that is inverted.

    Returns:
        The controller.

    Raises:
        WorkbenchError: If the bound on the jerk exceeds what the fully open valve can do.

    Source:
        Slotine and Li, Applied Nonlinear Control, 1991, section 7.2.

    Example:
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.arm import arm
        >>> point = operating_point(arm(3), {"angle": 0.5236})
        >>> law = design_sliding_mode(linearise(point, verdict=False))
        >>> round(law.layer_bandwidth)
        80
    """
    want = specification or SlidingModeSpecification()
    valve = valve or ValveInverse()
    joint = joint_model(linear, valve=valve)
    check_range(
        "bound on the jerk",
        want.jerk_bound,
        1e-6,
        joint.opening_to_jerk,
        "rad/s3",
        fix="the upper limit is what the fully open valve does to this joint",
    )
    observer = design_joint_observer(
        joint, bandwidth=want.observer_bandwidth, sample_time=want.sample_time
    )
    return SlidingMode(
        joint=joint,
        observer=observer,
        slope=want.slope,
        reaching=want.jerk_bound / joint.opening_to_jerk,
        layer=want.jerk_bound / want.layer_bandwidth,
        reference_speed=want.reference_speed,
        sample_time=want.sample_time,
        valve=valve,
    )


SLIDING_MODE = Design(
    name="sliding-mode",
    family="sliding mode",
    summary="sliding mode with boundary layer, observer and reference model",
    function=design_sliding_mode,
    specification=SlidingModeSpecification,
    slides=True,
    colour=("#c24a00", "#ff9152"),
)
