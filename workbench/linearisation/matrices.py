"""Derivatives at a point, with the slope over an oscillation where a point has none to speak of.

Dry friction has no slope at rest: a regularised one has whatever slope the regularisation gives, 15
N m s/rad for the bearing of the arm, and a linear model with it is overdamped at any speed beyond 1
deg/s. What a linear model needs is the part of the torque in phase with an oscillation of the
speed, the describing function

    N(a) = 2 / (pi a) integral_0^pi f(x + a cos(phi) e) cos(phi) dphi,

which is the derivative wherever f is linear and ``4 level / (pi a)`` for Coulomb friction.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.arrays import Vector
from workbench.errors import check_choice, check_range
from workbench.model import Model
from workbench.operating_point import Derivatives

_POINTS = 32


def speeds(model: Model, jacobian: Vector) -> dict[str, float]:
    """Find the states that are the rate of another state, with their scales as amplitudes, in SI.

    Args:
        jacobian: Derivatives of rates and measurements, shape (n_x + n_y, n_x + n_u), in SI.
    """
    n = len(model.states)
    found = {}
    for row in jacobian[:n]:
        (at,) = np.nonzero(row)
        if len(at) == 1 and at[0] < n and row[at[0]] == 1.0:
            quantity = model.states[at[0]]
            found[quantity.name] = quantity.scale
    return found


def check_amplitude(model: Model, amplitude: Mapping[str, float]) -> dict[str, float]:
    """Return amplitudes by name of state as floats, in SI."""
    names = {q.name: q for q in model.states}
    result = {}
    for name, value in amplitude.items():
        check_choice("swinging state", name, names)
        quantity = names[name]
        result[name] = check_range(
            f"amplitude of {name}",
            value,
            1e-9 * quantity.scale,
            1e6 * quantity.scale,
            quantity.unit,
        )
    return result


def describing_function(
    at: Derivatives, x: Vector, u: Vector, p: Vector, index: int, amplitude: float, point: Vector
) -> Vector:
    """Compute the describing function of rates and measurements for an oscillation of one state.

    Args:
        x: States, shape (n_x,), in SI.
        u: Inputs, shape (n_u,), in SI.
        p: Parameters, shape (n_p,), in SI.
        amplitude: Amplitude of the oscillation, in SI.
        point: Derivatives by that state at the point, shape (n_x + n_y,), in SI.

    Returns:
        Rates and measurements in phase with the oscillation, per amplitude, shape (n_x + n_y,), in
        SI; ``point`` where they are linear.

    Source:
        A. Gelb, W. E. Vander Velde 1968, sinusoidal-input describing function.

    Example:
        >>> from workbench.model import EXACT
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> at = Derivatives(axis, EXACT)
        >>> rest = (np.zeros(2), np.zeros(1), axis.values)
        >>> slope = describing_function(at, *rest, 1, 0.1, at(*rest)[1][:, 1])
        >>> coulomb = 4 * 20.0 / (np.pi * 0.1)
        >>> abs(95.0 * slope[1] / -(200.0 + coulomb) - 1) < 1e-3
        np.True_
    """

    def displaced(by: float) -> Vector:
        moved = x.copy()
        moved[index] += by
        return at.values(moved, u, p)

    secant = (displaced(amplitude) - displaced(-amplitude)) / (2 * amplitude)
    near = (displaced(0.3 * amplitude) - displaced(-0.3 * amplitude)) / (0.6 * amplitude)
    size = np.abs(secant) + np.abs(point)
    bent = (np.abs(secant - point) > 1e-6 * size) | (np.abs(near - point) > 1e-6 * size)
    if not bent.any():
        return point
    phases = (np.arange(_POINTS) + 0.5) * np.pi / _POINTS
    total = np.zeros(len(point))
    for cosine in np.cos(phases):
        total += cosine * displaced(amplitude * float(cosine))
    return np.where(bent, 2.0 * total / (_POINTS * amplitude), point)
