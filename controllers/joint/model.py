"""The joint as a position controller sees it: a third-order model read off a linear model.

    d2theta/dt2 = b dp - a1 dtheta/dt - a0 theta          joint driven by the pressure difference
    d(dp)/dt    = g o - e dtheta/dt - d dp                pressure difference driven by the opening

with the pressure difference dp = pressure_1 - pressure_2 and the signed valve opening o, all as
deviations from rest, where a valve that leaks needs an opening too. The six numbers are fitted to
frequency responses between the linear model's command and its measurements, so that nothing of the
plant's inside is needed. What is faster (the spool) is left to the margin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers.arithmetic import Number
from controllers.valve_inverse import ValveInverse
from workbench.arrays import Complex
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import LinearModel
from workbench.linearisation.transfer import transfer_function

OPENING = "opening"
"""Name of the input of a linear model that was made with the valve's curve inverted."""

BAND_HZ = (0.5, 10.0)
"""Band in which the third-order model is fitted, in Hz."""


class JointModel(NamedTuple):
    """Third-order model of the joint between valve opening and angle, about one angle.

    Args:
        b: Angular acceleration per pressure difference, in rad/(s2 Pa).
        a1: Damping over inertia, in 1/s.
        a0: Stiffness over inertia, in rad/s2 per rad.
        g: Rate of the pressure difference per opening, in Pa/s.
        e: Rate of the pressure difference per angular speed, in Pa/rad.
        d: Decay of the pressure difference, in 1/s.
        opening: Opening that holds the pressures there, a fraction.
        difference: Pressure difference that holds the joint there, in Pa.
        angle: The angle, in rad.
        misfit: Largest relative distance to the linear model's responses on the fitted grid.
    """

    b: Number
    a1: Number
    a0: Number
    g: Number
    e: Number
    d: Number
    opening: Number = 0.0
    difference: Number = 0.0
    angle: Number = 0.0
    misfit: float = 0.0

    @property
    def opening_to_jerk(self) -> float:
        """Angular jerk per unit opening b g, in rad/s3."""
        return float(self.b * self.g)

    def difference_rate(self, opening: Number, speed: Number, difference: Number) -> Number:
        """Return the rate of the pressure difference, in Pa/s.

        It follows from the opening (a fraction), the speed (rad/s) and the difference (Pa).
        """
        driven = self.g * (opening - self.opening) - self.e * speed
        return driven - self.d * (difference - self.difference)


class OpeningInput(NamedTuple):
    """How the opening enters a linear model.

    Args:
        per_opening: Change of that input per full opening, in the input's SI unit.
        at_rest: Opening at the operating point, a fraction.
    """

    name: str
    per_opening: float
    at_rest: float


def opening_input(
    linear: LinearModel, valve: ValveInverse, actuator: str = "valve"
) -> OpeningInput:
    """Tell how the valve's opening enters a linear model, whichever input it was made with."""
    # A plant of one's own may well have a command of that name.
    name = actuator if actuator in linear.input_names else OPENING
    if name not in linear.input_names:
        raise WorkbenchError(
            f"actuator of the linear model is {', '.join(linear.input_names)}, and this design is"
            f" for a joint with {actuator!r}; for any linear model take a plain design, such as"
            " plain-pid or lqi (controllers.plain)"
        )
    at_point = float(linear.u0[linear.input_names.index(name)])
    if name != actuator:
        return OpeningInput(name, 1.0, at_point)
    return OpeningInput(name, 1.0 / valve.gain_at_rest, valve.opening(at_point))


def joint_model(
    linear: LinearModel,
    sensors: tuple[str, str, str] = ("angle", "pressure_1", "pressure_2"),
    *,
    valve: ValveInverse | None = None,
) -> JointModel:
    """Fit the third-order model to a linear model.

    Raises:
        WorkbenchError: If the linear model lacks one of the signals, or is no such joint: the
            fitted gains b and g must be positive.

    Source:
        Least squares on frequency responses (Levy's method); Ljung, System Identification, 1999,
        section 10.

    Example:
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.arm import arm
        >>> point = operating_point(arm(3), {"angle": 0.5236})
        >>> joint = joint_model(linearise(point, verdict=False))
        >>> 1e-4 < joint.b < 3e-4, joint.misfit < 0.2
        (True, True)
    """
    entry = opening_input(linear, valve or ValveInverse())
    for name in sensors:
        check_choice("sensor of the linear model", name, linear.output_names)
    w = 2 * np.pi * np.geomspace(*BAND_HZ, 60)
    found = transfer_function(linear.A, linear.B, linear.C, linear.D, 1j * w)
    rows = [linear.output_names.index(name) for name in sensors]
    response = found[:, rows, linear.input_names.index(entry.name)].T * entry.per_opening
    theta = response[0]
    dp = response[1] - response[2]
    s = 1j * w
    # s^2 theta = b dp - a1 s theta - a0 theta, every row scaled by the size of its left side
    b, a1, a0 = _real_least_squares(s**2 * theta, dp, -s * theta, -theta)
    g, e, d = _real_least_squares(s * dp, np.ones_like(s), -s * theta, -dp)
    if not (b > 0 and g > 0):
        raise WorkbenchError(
            f"the linear model gives an acceleration of {b:.3g} rad/s2 per Pa and a pressure rate"
            f" of {g:.3g} Pa/s per opening; a joint has both positive: check the order of the two"
            " pressures and the sign of the command"
        )
    fitted_dp = g / (s + d + e * s * b / (s**2 + a1 * s + a0))
    fitted = fitted_dp * b / (s**2 + a1 * s + a0)
    misfit = float(np.max(np.abs(fitted - theta) / np.abs(theta)))
    measurements = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    return JointModel(
        b=b,
        a1=a1,
        a0=a0,
        g=g,
        e=e,
        d=d,
        opening=entry.at_rest,
        angle=measurements[sensors[0]],
        difference=measurements[sensors[1]] - measurements[sensors[2]],
        misfit=misfit,
    )


def _real_least_squares(left: Complex, *columns: Complex) -> list[float]:
    """Solve left = sum of real coefficients times columns, each row relative to its left side."""
    matrix = np.column_stack(columns) / left[:, None]
    stacked = np.vstack([matrix.real, matrix.imag])
    target = np.concatenate([np.ones(len(left)), np.zeros(len(left))])
    size = np.linalg.norm(stacked, axis=0)
    solution = np.linalg.lstsq(stacked / size, target, rcond=None)[0] / size
    return [float(value) for value in solution]


def lag_beside(linear: LinearModel) -> float:
    """Return the lag of a linear model beside the third-order model of its joint, in s.

    ``T = -arg(G(j w) / G_3(j w)) / w`` at w = 2 pi 15 Hz, with G from opening to angle and G_3 its
    third-order model: what spool and lines are slower by.
    """
    joint, entry = joint_model(linear), opening_input(linear, ValveInverse())
    s = 2j * np.pi * 15.0
    whole = transfer_function(linear.A, linear.B, linear.C, linear.D, np.array([s]))
    angle = linear.output_names.index("angle")
    of = whole[0, angle, linear.input_names.index(entry.name)] * entry.per_opening
    third = joint.b / (s**2 + joint.a1 * s + joint.a0)
    third = third * joint.g / (s + joint.d + joint.e * s * third)
    return float(-np.angle(of / third) / s.imag)
