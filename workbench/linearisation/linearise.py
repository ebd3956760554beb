"""From an operating point to a linear model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.linearisation.actuator_inverse import ActuatorInverse, straightened_point
from workbench.linearisation.kinks import find_kinks, slope_read
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.matrices import check_amplitude, describing_function, speeds
from workbench.linearisation.validity import DescribingFunction, Validity
from workbench.model import EXACT, ActuatorCurve, Form
from workbench.model.units import rate_unit
from workbench.operating_point import OperatingPoint, derivatives_of


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
