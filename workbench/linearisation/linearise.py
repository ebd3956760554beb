"""From an operating point to a linear model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.linearisation.actuator_inverse import ActuatorInverse, straightened_point
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.validity import DescribingFunction, Validity, find_kinks, slope_read
from workbench.model import EXACT, ActuatorCurve, Form, Model
from workbench.model.units import rate_unit
from workbench.operating_point import Derivatives, OperatingPoint, derivatives_of

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


def linearise(
    op: OperatingPoint,
    *,
    input: str = "plant",  # noqa: A002 -- The word of the field.
    amplitude: Mapping[str, float] | None = None,
    form: Form | str = EXACT,
    verdict: bool = True,
) -> LinearModel:
    """Linearise a model at an operating point.

    The matrices are exact, automatic derivatives. Where the plant has a kink that is a maximum or
    minimum they are the mean of both sides; the verdict holds both. Slopes by a *speed* are taken
    over an oscillation (``amplitude``), because dry friction has no slope at rest.

    Args:
        input: ``"plant"`` for the plant's own inputs, or the name of an actuator's curve that the
            plant declares and a controller inverts, such as ``"opening"`` of the arm's valve,
            -1..1: the model's ``inverse``. The state behind the curve is then straight in it.
        amplitude: Amplitudes of states by name over which slopes are taken, in SI; by
            default every state that is the rate of another oscillates over its scale. ``{}`` for
            the slopes at the point.
        form: Exact equations, or regularised ones, whose slope at a kink is one from both sides.
        verdict: Whether to look for kinks and prepare the verdict; its simulated part is computed
            when it is first asked for.

    Raises:
        WorkbenchError: If the plant has no such input, an amplitude is not positive, or the
            derivatives are not finite.

    Source:
        Automatic differentiation; sinusoidal-input describing function for the oscillations.

    Example:
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.arm import arm
        >>> import math
        >>> point = operating_point(arm(3), {"angle": math.radians(30), "mean_pressure": 3e5})
        >>> linear = linearise(point, input="opening")
        >>> round(linear.mode_of("angle").frequency_hz, 2)
        2.06
        >>> kink = linear.verdict.kinks[0]
        >>> kink.name, round(kink.factor, 1)  # filling is faster than venting
        ('spool', 1.6)
    """
    curve = None if input == "plant" else op.model.traits.curve(input)
    if curve is not None and len(op.model.inputs) != 1:
        raise WorkbenchError(
            f"{op.model.name!r} has {len(op.model.inputs)} inputs; the {curve.name} stands for one"
        )
    point = op if curve is None else straightened_point(op, (curve,))
    model = point.model
    at = derivatives_of(model, form)
    p = model.values
    jacobian = at(point.x, point.u, p)[1]
    if not np.isfinite(jacobian).all():
        raise WorkbenchError(
            f"the derivatives of {model.name!r} are not finite at this operating point; move it a"
            " little, or linearise the regularised form"
        )
    wanted = speeds(model, jacobian) if amplitude is None else check_amplitude(model, amplitude)
    described = []
    matrix = jacobian.copy()
    names = [q.name for q in model.states]
    for name, size in wanted.items():
        i = names.index(name)
        matrix[:, i] = describing_function(at, point.x, point.u, p, i, size, jacobian[:, i])
        if not np.array_equal(matrix[:, i], jacobian[:, i]):
            row = int(np.argmax(np.abs(matrix[: len(names), i] - jacobian[: len(names), i])))
            described.append(
                DescribingFunction(
                    name,
                    size,
                    names[row],
                    float(jacobian[row, i]),
                    float(matrix[row, i]),
                    model.reading(model.states[i].unit, name),
                    slope_read(
                        model,
                        f"rate of {names[row]}",
                        rate_unit(model.states[row].unit),
                        model.states[i],
                    ),
                )
            )
    linear = _model(op, point, matrix, curve)
    if not verdict:
        return linear
    kinks = find_kinks(at, point, lambda sided: _model(op, point, sided, curve), matrix, jacobian)
    return replace(linear, verdict=Validity(linear, kinks, tuple(described)))


def _model(
    op: OperatingPoint, point: OperatingPoint, matrix: Vector, curve: ActuatorCurve | None
) -> LinearModel:
    model = point.model
    n = len(model.states)
    A, B, C, D = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
    u0 = point.u
    if curve is not None:
        i = [q.name for q in model.states].index(curve.state)
        B, D = curve.full * B, curve.full * D
        u0 = np.array([point.x[i] / curve.full])
    return LinearModel(
        A=A,
        B=B,
        C=C,
        D=D,
        operating_point=op,
        state_names=tuple(q.name for q in model.states),
        input_names=tuple(q.name for q in model.inputs) if curve is None else (curve.name,),
        output_names=tuple(q.name for q in model.outputs),
        x0=point.x,
        u0=u0,
        y0=point.y,
        drift=np.where(np.isin([q.name for q in model.states], list(op.drift)), op.rates, 0.0),
        inverse=None if curve is None else ActuatorInverse(op, curve),
    )
