"""From an operating point to a linear model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.linearisation.actuator_inverse import ActuatorInverse, straightened_point
from workbench.linearisation.command_ends import with_command_ends
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.validity import DescribingFunction, Validity, find_kinks, slope_read
from workbench.model import EXACT, ActuatorCurve, Form, Model, Quantity
from workbench.model.sizes import response
from workbench.model.units import per
from workbench.operating_point import Derivatives, OperatingPoint, derivatives_of, operating_point

_POINTS = 32

Flags = npt.NDArray[np.bool_]


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
        q = names[check_choice("swinging state", name, names)]
        ends = 1e-9 * q.scale, 1e6 * q.scale
        result[name] = check_range(f"amplitude of {name}", value, *ends, q.unit)
    return result


def describing_function(
    at: Derivatives, x: Vector, u: Vector, p: Vector, along: Vector, amplitude: float, point: Vector
) -> Vector:
    """Compute the describing function of rates and measurements for an oscillation of x and u.

    Args:
        x: States, shape (n_x,), in SI.
        u: Inputs, shape (n_u,), in SI.
        p: Parameters, shape (n_p,), in SI.
        along: What states and inputs move by, shape (n_x + n_u,), in SI, over the amplitude.
        amplitude: Amplitude of the oscillation, in SI.
        point: Derivatives along it at the point, shape (n_x + n_y,), in SI.

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
        >>> slope = describing_function(at, *rest, np.eye(3)[1], 0.1, at(*rest)[1][:, 1])
        >>> coulomb = 4 * 20.0 / (np.pi * 0.1)
        >>> abs(95.0 * slope[1] / -(200.0 + coulomb) - 1) < 1e-3
        np.True_
    """
    displaced = _displaced(at, x, u, p, along)
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


def _displaced(
    at: Derivatives, x: Vector, u: Vector, p: Vector, along: Vector
) -> Callable[[float], Vector]:
    """Return what computes rates and measurements, in SI, with x and u moved along a direction."""

    def displaced(by: float) -> Vector:
        moved = np.concatenate([x, u]) + by * along
        return at.values(moved[: len(x)], moved[len(x) :], p)

    return displaced


def _dead_zones(
    model: Model, at: Derivatives, point: OperatingPoint, jacobian: Vector
) -> dict[str, float]:
    """Find states and inputs within dead zones that keep an input from an output, with amplitudes.

    Play in a gear, or a valve that overlaps: they have no slope at the point, and all of it does
    something to both sides.

    Args:
        jacobian: Derivatives of rates and measurements, shape (n_x + n_y, n_x + n_u), in SI.
    """
    traced, n = model.form(EXACT), len(model.states)
    moved = _moved(jacobian != 0.0, n)
    if moved[n:].all():
        return {}
    values, by = ca.vertcat(traced.rates, traced.outputs), ca.vertcat(traced.x, traced.u)
    written = np.asarray(ca.DM(ca.jacobian_sparsity(values, by), 1.0).full() != 0.0)
    if np.all(_moved(written, n)[n:] <= moved[n:]):
        return {}
    # A contact that is only read leaves the others as they are at the point.
    apart = ~moved
    apart[n:] &= not moved[n:].any()
    found: list[Quantity] = []
    one = np.eye(written.shape[1])
    for i, quantity in enumerate((*model.states, *model.inputs)):
        displaced = _displaced(at, point.x, point.u, model.values, one[i])
        up, down = (displaced(by) - displaced(0.0) for by in (quantity.scale, -quantity.scale))
        if np.any((up * down < 0.0) & written[:, i] & (jacobian[:, i] == 0.0) & apart):
            found.append(quantity)
    # Bodies on both sides of a play swing alike, lest turning them together stretches it.
    widest = {q.unit: max(other.scale for other in found if other.unit == q.unit) for q in found}
    return {q.name: widest[q.unit] for q in found}


_STUCK = 10.0
"""Slope of its own rate by a state, over that between its scale to both sides, from which on it
sticks where it is, a ratio."""


def _sticking(
    model: Model, at: Derivatives, point: OperatingPoint, jacobian: Vector
) -> dict[str, float]:
    """Find states that stick where they are, as a shaft in a dry bearing, with their scales, in SI.

    Friction that is nearly dry creeps at rest, and what it does to a motion is alike to both sides.
    """
    found = {}
    one = np.eye(jacobian.shape[1])
    for i, q in enumerate(model.states):
        displaced = _displaced(at, point.x, point.u, model.values, one[i])
        up, down = (displaced(by)[i] - displaced(0.0)[i] for by in (q.scale, -q.scale))
        alike = abs(up + down) < 0.1 * abs(up - down)
        if alike and jacobian[i, i] < 0.5 * _STUCK * (up - down) / q.scale < 0.0:
            found[q.name] = q.scale
    return found


_ROUNDS = 8
"""Times that the amplitude of what sticks is followed to where the commands swing it."""


def _moved_by(model: Model, matrix: Vector) -> Vector:
    """Return how far inputs within their range swing each state, shape (n_x,), in SI."""
    n = len(model.states)
    of_x, of_u = (np.array([q.scale for q in own]) for own in (model.states, model.inputs))
    return response(matrix[:n, :n], matrix[:n, n:], of_u, of_x)


def _moved(slopes: Flags, n: int) -> Flags:
    """Tell which states and outputs any input moves, shape (n_x + n_y,), by which slopes are there.

    Args:
        slopes: Whether rates and measurements, by states and inputs, have one.
    """
    moved = np.any(slopes[:, n:], axis=1)
    for _ in range(n):
        moved = np.any(np.column_stack([moved, slopes[:, :n] & moved[:n]]), axis=1)
    return np.asarray(moved)


def _with_ends(ends: Vector | None, i: int, n: int, count: int) -> Vector:
    """Return what an oscillation of one of x, u moves, shape (n_x + n_u,), over it.

    With a state, inputs go whose ends do: the loop within that is clipped does not let go of it.

    Args:
        ends: As of `LinearModel.ends`.
    """
    along: Vector = np.eye(count)[i]
    if ends is not None and i < n:
        finite = np.isfinite(ends[..., 0])
        sides = np.maximum(finite.sum(axis=0), 1)
        along[n:] = np.where(finite, ends[..., 1 + i], 0.0).sum(axis=0) / sides
    return along


def _room(model: Model, u: Vector, by: Vector) -> float:
    """Return how far a state may swing until an input that goes with it ends, in SI."""
    rooms = [min(q.upper - now, now - q.lower) for q, now in zip(model.inputs, u, strict=True)]
    ends = [room / abs(one) for room, one in zip(rooms, by, strict=True) if one and room > 0.0]
    return min(ends, default=math.inf)


def linearise(
    op: OperatingPoint | Any,
    *,
    input: str = "plant",  # noqa: A002 -- The word of the field.
    amplitude: Mapping[str, float] | None = None,
    form: Form | str = EXACT,
    verdict: bool = True,
) -> LinearModel:
    """Linearise a model at an operating point.

    The matrices are exact, automatic derivatives. Where the plant has a kink that is a maximum or
    minimum they are the mean of both sides; the verdict holds both. Slopes by a *speed* are taken
    over an oscillation (``amplitude``), because dry friction has no slope at rest; so are those by
    what is within a dead zone there, where no input would move an output otherwise.

    Args:
        op: The operating point, or a plant, which is linearised where it rests.
        input: ``"plant"`` for the plant's own inputs, or the name of an actuator's curve that the
            plant declares and a controller inverts, such as ``"opening"`` of the arm's valve,
            -1..1: the model's ``inverse``. The state behind the curve is then straight in it.
        amplitude: Amplitudes of states by name over which slopes are taken, in SI; by
            default every state that is the rate of another oscillates over its scale, or as far
            as the inputs swing it where it sticks at the point and nobody declares a scale. ``{}``
            for the slopes at the point.
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
    op = op if isinstance(op, OperatingPoint) else operating_point(op)
    curve = None if input == "plant" else op.model.traits.curve(input)
    if curve is not None and len(op.model.inputs) != 1:
        raise WorkbenchError(
            f"{op.model.name!r} has {len(op.model.inputs)} inputs; the {curve.name} stands for one"
        )
    point = op if curve is None else straightened_point(op, (curve,))
    model = point.model
    at = derivatives_of(model, form)
    p = model.values
    ends = None
    if curve is None:
        model, ends = with_command_ends(op, at)
        op = point = replace(op, model=model)
    jacobian = at(point.x, point.u, p)[1]
    if not np.isfinite(jacobian).all():
        raise WorkbenchError(
            f"the derivatives of {model.name!r} are not finite at this operating point; move it a"
            " little, or linearise the regularised form"
        )
    names = [q.name for q in model.states]
    if amplitude is None:
        wanted = speeds(model, jacobian) | _sticking(model, at, point, jacobian)
        wanted |= _dead_zones(model, at, point, jacobian)
    else:
        wanted = check_amplitude(model, amplitude)
    both = [*model.states, *model.inputs]
    places = {q.name: i for i, q in reversed(list(enumerate(both)))}
    swings = {name: _with_ends(ends, places[name], len(names), len(both)) for name in wanted}
    if amplitude is None:
        rooms = {name: _room(model, point.u, swings[name][len(names) :]) for name in wanted}
        wanted = {name: min(size, rooms[name]) for name, size in wanted.items()}

    def slopes() -> Vector:
        """Return the derivatives, those by what swings over its amplitude."""
        matrix = jacobian.copy()
        for name, size in wanted.items():
            along = swings[name]
            bent = describing_function(at, point.x, point.u, p, along, size, jacobian @ along)
            matrix[:, places[name]] += bent - jacobian @ along
        return matrix

    matrix = slopes()
    for _ in range(_ROUNDS if amplitude is None else 0):
        # What nobody declares was sized as it sticks at the point, and swings further.
        moved = _moved_by(model, matrix)
        farther = {
            name: min(moved[i], rooms[name])
            for name, size in wanted.items()
            if (i := places[name]) < len(names)
            and not both[i].sized
            and abs(jacobian[i, i]) > _STUCK * abs(matrix[i, i])
            and min(moved[i], rooms[name]) > 1.1 * size
        }
        if not farther:
            break
        wanted |= farther
        matrix = slopes()
    described = []
    for name, size in wanted.items():
        i = places[name]
        if not np.array_equal(matrix[:, i], jacobian[:, i]):
            row = int(np.argmax(np.abs(matrix[: len(names), i] - jacobian[: len(names), i])))
            of, unit = names[row], per(model.states[row].unit, "s")
            described.append(
                DescribingFunction(
                    name,
                    size,
                    of,
                    float(jacobian[row, i]),
                    float(matrix[row, i]),
                    model.reading(both[i].unit, name, size=size),
                    slope_read(model, f"rate of {of}", unit, both[i], float(matrix[row, i])),
                )
            )
    linear = replace(_model(op, point, matrix, curve), ends=ends)
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
