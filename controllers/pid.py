"""Cascaded PID: the angle outside, the pressure difference inside.

A PD law on the angle alone limit-cycles once the muscles have hysteresis; the inner loop makes the
valve and the gas a fast source of torque, on which the outer PID can be firm.

Outer loop, sample k, sample time h, y the angle, r its reference:

    w[k]  = r filtered twice by w + h omega_r (r - w)                 reference filter
    D[k]  = f D[k-1] + (1 - f) Kd ((c w - y)[k] - (c w - y)[k-1]) / h     f = Tf / (Tf + h)
    v[k]  = Kp (b w[k] - y[k]) + I[k] + D[k]
    u[k]  = v[k] clipped to what the valve can reach: dp[k] +- 1 / Ki_inner, and to +- limit
    I[k+1] = I[k] + h Ki (w[k] - y[k]) + (h / Tt) (u[k] - v[k])        back-calculation

Inner loop, with the filtered pressure difference dp:

    o[k]  = K_inner (u[k] - dp[k])            valve opening, then the inverse valve curve

Source: Åström and Hägglund, Advanced PID Control, 2006, sections 3.3 to 3.5 (two degrees of
freedom, filter, back-calculation), 13.3 (discretisation), 12.3 (cascade).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.design import Design
from controllers.joint.model import JointModel, joint_model
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.sensitivity import peak_sensitivities
from controllers.through_valve import ThroughValve
from controllers.valve_inverse import ValveInverse
from workbench.errors import WorkbenchError, check_range

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


class PIDState(NamedTuple):
    """What a `CascadePID` remembers.

    Args:
        integral: Integral part of the wanted pressure difference, in Pa.
        derivative: Filtered derivative part, in Pa.
        error: Weighted error of the sample before, in rad.
        filtered: Reference after the first filter, in rad.
        target: Reference after the second filter, in rad.
        difference: Filtered pressure difference, in Pa.
    """

    integral: Number
    derivative: Number
    error: Number
    filtered: Number
    target: Number
    difference: Number


@dataclass(frozen=True)
class CascadePID(ThroughValve):
    """Cascaded PID on angle and pressure difference.

    Args:
        proportional: Outer Kp, in Pa/rad.
        integral: Outer Ki, in Pa/(rad s).
        derivative: Outer Kd, in Pa s/rad.
        derivative_filter: Time constant Tf of the derivative's filter, in s.
        setpoint_weight: Weight b of the reference in the proportional part, dimensionless.
        derivative_weight: Weight c of the reference in the derivative part, dimensionless.
        reference_speed: Bandwidth omega_r of the reference filter, in rad/s.
        tracking_time: Time constant Tt of the anti-windup, in s.
        difference_limit: Largest wanted pressure difference, in Pa.
        inner: Inner gain K_inner, opening fraction per Pa.
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
        >>> pid = CascadePID(6e5, 2e6, 1e5, inner=2e-6)
        >>> at_rest = (0.5, 3e5, 3e5)
        >>> command, state, info = pid.step(pid.initial_state(at_rest), at_rest, (0.5,))
        >>> command
        (5.0,)
    """

    proportional: float
    integral: float
    derivative: float
    inner: float
    derivative_filter: float = 0.005
    setpoint_weight: float = 1.0
    derivative_weight: float = 1.0
    reference_speed: float = 25.0
    tracking_time: float = 0.1
    difference_limit: float = 6e5
    pressure_filter: float = 0.002
    sample_time: float = 0.002
    valve: ValveInverse = ValveInverse()
    name: str = "cascade PID"
    sensors: tuple[str, ...] = ("angle", "pressure_1", "pressure_2")
    follows: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    def __post_init__(self) -> None:
        """Check the gains."""
        for name in ("proportional", "integral", "derivative"):
            check_range(f"{name} gain of {self.name}", getattr(self, name), 0.0, 1e12)
        check_range(f"inner gain of {self.name}", self.inner, 1e-12, 1.0, "per Pa")
        for name in ("derivative_filter", "pressure_filter"):
            check_range(f"{name} of {self.name}", getattr(self, name), 0.0, 10.0, "s")
        h = check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")
        check_range(f"tracking time of {self.name}", self.tracking_time, h, 1e3, "s")
        check_range(f"reference speed of {self.name}", self.reference_speed, 0.0, 1.0 / h, "rad/s")

    def initial_state(self, measurement: Measurement) -> PIDState:
        """Return the state that holds the measured pressure difference at the measured angle.

        Args:
            measurement: Angle in rad and the two gauge pressures in Pa.
        """
        angle, p1, p2 = measurement
        held = p1 - p2 + self.proportional * (1.0 - self.setpoint_weight) * angle
        error = (self.derivative_weight - 1.0) * angle
        return PIDState(held, 0.0, error, angle, angle, p1 - p2)

    def step(
        self, state: PIDState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, PIDState, Info]:
        """Compute the valve voltage of one sample.

        Args:
            state: State of the step before.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.

        Returns:
            Voltage in V, next state, and the opening (fraction) and wanted difference (Pa).
        """
        return self.law(state, measurement, reference, FLOATS)

    def law(
        self,
        state: PIDState,
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
    ) -> tuple[tuple[Number, ...], PIDState, dict[str, Number]]:
        """Compute one sample on floats or on symbols.

        Args:
            state: State of the step before.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.
            arithmetic: Floats or CasADi symbols.

        Returns:
            Voltage in V, next state, and the opening (fraction) and wanted difference (Pa).
        """
        integral, derivative, last, filtered, target, difference = state
        angle, p1, p2 = measurement
        h = self.sample_time
        if self.reference_speed > 0.0:
            filtered = filtered + h * self.reference_speed * (reference[0] - filtered)
            target = target + h * self.reference_speed * (filtered - target)
        else:
            filtered = target = reference[0]
        fade = self.derivative_filter / (self.derivative_filter + h)
        weighted = self.derivative_weight * target - angle
        derivative = fade * derivative + (1.0 - fade) * self.derivative * (weighted - last) / h
        fresh = h / (self.pressure_filter + h)
        difference = difference + fresh * (p1 - p2 - difference)

        wanted = self.proportional * (self.setpoint_weight * target - angle) + integral + derivative
        within = arithmetic.clip(wanted, -self.difference_limit, self.difference_limit)
        reach = 1.0 / self.inner
        reached = arithmetic.clip(within, difference - reach, difference + reach)
        integral = integral + h * (
            self.integral * (target - angle) + (reached - wanted) / self.tracking_time
        )
        opening = self.inner * (reached - difference)
        following = PIDState(integral, derivative, weighted, filtered, target, difference)
        command = self.valve.command(opening, arithmetic)
        return (command,), following, {"opening": opening, "wanted_difference": reached}


@dataclass(frozen=True)
class PIDSpecification:
    """What a `CascadePID` is designed for.

    Args:
        inner_bandwidth: Bandwidth of the pressure-difference loop, in rad/s.
        bandwidth: Largest frequency of the outer closed-loop poles, in rad/s; lowered until the
            sensitivity limits hold.
        damping: Damping ratio of the dominant pair.
        real_pole: Real pole (the integral action) as a fraction of the pair's frequency.
        maximum_sensitivity: Limit on Ms, the peak of the sensitivity (ratio).
        maximum_complementary: Limit on Mt, the peak of the complementary sensitivity (ratio).
        reference_speed: Bandwidth of the reference filter, in rad/s.
        sample_time: Time between steps, in s.

    Raises:
        WorkbenchError: If a number is outside its range.

    Example:
        >>> PIDSpecification().maximum_sensitivity
        2.0
    """

    inner_bandwidth: float = 100.0
    bandwidth: float = 30.0
    damping: float = 0.8
    real_pole: float = 0.6
    maximum_sensitivity: float = 2.0
    maximum_complementary: float = 1.6
    reference_speed: float = 40.0
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_range("sample time", self.sample_time, 1e-6, 1.0, "s")
        top = 1.0 / self.sample_time
        check_range("inner bandwidth", self.inner_bandwidth, 1.0, top, "rad/s")
        check_range("bandwidth", self.bandwidth, 0.1, self.inner_bandwidth, "rad/s")
        check_range("damping ratio", self.damping, 0.1, 2.0)
        check_range("real pole", self.real_pole, 0.01, 10.0)
        check_range("limit on Ms", self.maximum_sensitivity, 1.05, 10.0)
        check_range("limit on Mt", self.maximum_complementary, 1.0, 10.0)


def design_pid(
    linear: LinearModel,
    specification: PIDSpecification | None = None,
    *,
    valve: ValveInverse | None = None,
) -> CascadePID:
    """Design a cascaded PID from a linear model.

    The inner gain places the pole of the pressure difference, ``K_inner = omega_inner / g``. The
    outer gains place the poles of the joint under it at a pair of frequency w and damping z and a
    real pole at a w:

        Kd = ((a + 2 z) w - a1) / b, Kp = ((1 + 2 a z) w^2 - a0) / b, Ki = a w^3 / b

    and w is lowered from ``bandwidth`` until Ms and Mt of the sampled outer loop, computed on the
    whole linear model, are within their limits.

    Args:
        linear: Linear model from the valve's voltage or opening to the sensors.
        specification: What to reach.
        valve: Valve curve that is inverted.

    Returns:
        The controller.

    Raises:
        WorkbenchError: If no bandwidth meets the limits.

    Source:
        Pole placement of PID: Åström and Hägglund, Advanced PID Control, 2006, section 6.4;
        limits on Ms and Mt: section 4.6.

    Example:
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.arm import arm
        >>> point = operating_point(arm(3), {"angle": 0.5236})
        >>> pid = design_pid(linearise(point, verdict=False))
        >>> pid.inner > 0
        True
    """
    want = specification or PIDSpecification()
    valve = valve or ValveInverse()
    joint = joint_model(linear, valve=valve)
    lowest = math.sqrt(joint.a0 / (1.0 + 2.0 * want.real_pole * want.damping))
    for w in np.geomspace(want.bandwidth, min(lowest, want.bandwidth / 2), 40):
        pid = _place(joint, want, float(w), valve)
        ms, mt = peak_sensitivities(pid, linear)
        if ms <= want.maximum_sensitivity and mt <= want.maximum_complementary:
            return pid
    raise WorkbenchError(
        f"no bandwidth from {lowest:.3g} to {want.bandwidth:.3g} rad/s meets Ms <="
        f" {want.maximum_sensitivity:g} and Mt <= {want.maximum_complementary:g} (at the lowest, Ms"
        f" is {ms:.3g} and Mt {mt:.3g}); allow larger peaks, or raise the inner bandwidth"
    )


def _place(joint: JointModel, want: PIDSpecification, w: float, valve: ValveInverse) -> CascadePID:
    a, z = want.real_pole, want.damping
    integral = a * w**3 / joint.b
    proportional = max(((1.0 + 2.0 * a * z) * w**2 - joint.a0) / joint.b, 0.0)
    return CascadePID(
        proportional=proportional,
        integral=integral,
        derivative=max(((a + 2.0 * z) * w - joint.a1) / joint.b, 0.0),
        inner=want.inner_bandwidth / joint.g,
        derivative_filter=1.0 / (10.0 * w),
        # The integral follows the clipped command at the speed of the integral action.
        tracking_time=max(1.0 / (a * w), 2.0 * want.sample_time),
        reference_speed=want.reference_speed,
        sample_time=want.sample_time,
        valve=valve,
    )


PID = Design(
    name="pid",
    family="cascade PID",
    summary="cascaded PID: angle outside, pressure difference inside",
    function=design_pid,
    specification=PIDSpecification,
    colour=("#0062a8", "#5db5f5"),
)
