"""The joint as a position controller sees it: a third-order model read off a linear model.

    d2theta/dt2 = b dp - a1 dtheta/dt - a0 theta          joint driven by the pressure difference
    d(dp)/dt    = g o - e dtheta/dt - d dp                pressure difference driven by the opening

with the pressure difference dp = pressure_1 - pressure_2 and the signed valve opening o. The six
numbers are fitted to frequency responses between the linear model's command and its measurements,
so that nothing of the plant's inside is needed. What is faster (the spool) is left to the margin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from controllers.joint.opening_input import opening_input
from controllers.valve_inverse import ValveInverse
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation.transfer import transfer_function

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class JointModel:
    """Third-order model of the joint between valve opening and angle.

    Args:
        b: Angular acceleration per pressure difference, in rad/(s2 Pa).
        a1: Damping over inertia, in 1/s.
        a0: Stiffness over inertia, in rad/s2 per rad.
        g: Rate of the pressure difference per opening, in Pa/s.
        e: Rate of the pressure difference per angular speed, in Pa/rad.
        d: Decay of the pressure difference, in 1/s.
        angle: Angle of the operating point, in rad.
        difference: Pressure difference of the operating point, in Pa.
        misfit: Largest relative distance to the linear model's responses on the fitted grid.
    """

    b: float
    a1: float
    a0: float
    g: float
    e: float
    d: float
    angle: float = 0.0
    difference: float = 0.0
    misfit: float = 0.0

    @property
    def opening_to_jerk(self) -> float:
        """Angular jerk per unit opening b g, in rad/s3."""
        return self.b * self.g


def joint_model(
    linear: LinearModel,
    *,
    valve: ValveInverse | None = None,
    sensors: tuple[str, str, str] = ("angle", "pressure_1", "pressure_2"),
    actuator: str = "valve",
    band_Hz: tuple[float, float] = (0.5, 10.0),
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
    entry = opening_input(linear, valve or ValveInverse(), actuator)
    response, w = frequency_response(linear, sensors, entry.name, band_Hz)
    response = response * entry.per_opening
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
        angle=measurements[sensors[0]],
        difference=measurements[sensors[1]] - measurements[sensors[2]],
        misfit=misfit,
    )


def frequency_response(
    linear: LinearModel, outputs: tuple[str, ...], actuator: str, band_Hz: tuple[float, float]
) -> tuple[Complex, npt.NDArray[np.float64]]:
    """Compute responses from the command to some outputs on a logarithmic grid.

    Args:
        band_Hz: First and last frequency, in Hz.

    Returns:
        Responses, shape (n_outputs, 60), in SI per SI, and the frequencies, shape (60,), in rad/s.

    Raises:
        WorkbenchError: If the linear model lacks one of the signals.
    """
    for output in outputs:
        check_choice("sensor of the linear model", output, linear.output_names)
    check_choice("actuator of the linear model", actuator, linear.input_names)
    rows = [linear.output_names.index(output) for output in outputs]
    column = linear.input_names.index(actuator)
    w = 2 * np.pi * np.geomspace(*band_Hz, 60)
    found = transfer_function(linear.A, linear.B, linear.C, linear.D, 1j * w)
    return found[:, rows, column].T, w


def _real_least_squares(left: Complex, *columns: Complex) -> list[float]:
    """Solve left = sum of real coefficients times columns, each row relative to its left side."""
    matrix = np.column_stack(columns) / left[:, None]
    stacked = np.vstack([matrix.real, matrix.imag])
    target = np.concatenate([np.ones(len(left)), np.zeros(len(left))])
    size = np.linalg.norm(stacked, axis=0)
    solution = np.linalg.lstsq(stacked / size, target, rcond=None)[0] / size
    return [float(value) for value in solution]
