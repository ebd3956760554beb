"""python-control's systems as linear models, and models as its systems."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.zero_order_hold import before_hold
from workbench.model import EXACT, Input, Model, Output, Scope, State
from workbench.model.trace import Equations
from workbench.operating_point import Derivatives, OperatingPoint

Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class LinearEquations:
    """Equations of a linear model in the language of plants; numbers only, so they pickle.

    Args:
        A: State matrix, in SI.
        B: Input matrix, in SI.
        C: Output matrix, in SI.
        D: Feedthrough, in SI.
    """

    A: Rows
    B: Rows
    C: Rows
    D: Rows
    names: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]

    def __call__(self, m: Scope) -> Equations:
        """Write down ``dx/dt = A x + B u``, ``y = C x + D u``."""
        states, inputs, outputs = self.names
        x = [getattr(m.x, name) for name in states]
        u = [getattr(m.u, name) for name in inputs]

        def row(by_state: tuple[float, ...], by_input: tuple[float, ...]) -> Any:
            terms = [a * v for a, v in zip((*by_state, *by_input), (*x, *u), strict=True) if a]
            return sum(terms[1:], start=terms[0]) if terms else 0.0 * u[0]

        rates = [row(a, b) for a, b in zip(self.A, self.B, strict=True)]
        read = [row(c, d) for c, d in zip(self.C, self.D, strict=True)]
        return dict(zip(states, rates, strict=True)), dict(zip(outputs, read, strict=True))


def linear_model(
    system: Any, *, limits: Mapping[str, tuple[float, float]] | None = None
) -> LinearModel:
    """Take a python-control system as a linear model; a `LinearModel` is one already.

    The names are those of its signals; ``u[0]`` becomes ``u_0``. Its units are SI. Where no limits
    are given, the scale of an input is 1, and that of an output what the inputs make of it, or 1 if
    that is more. It is a plant too: ``linear_model(system).operating_point.model``. The ``system``
    of a `LinearModel` has its operating point still.

    Args:
        system: A ``control.StateSpace`` or ``control.TransferFunction``, or one of
            ``scipy.signal``, proper, in continuous time or with a sample time over which its inputs
            are held; or a `LinearModel`, which is returned.
        limits: Lower and upper end of inputs and outputs by name, in SI; infinite if not given.

    Raises:
        WorkbenchError: If it is no such system, or a name is unknown.

    Example:
        >>> import control
        >>> linear_model(control.tf([1.0], [0.1, 1.0, 0.0])).output_names
        ('y_0',)
    """
    if isinstance(system, LinearModel) or hasattr(system, "output_names"):
        # What has the names of a linear model is one to a design.
        return cast(LinearModel, system)
    known = getattr(system, "linear_model", None)
    if isinstance(known, LinearModel) and not limits and np.array_equal(known.A, system.A):
        return known
    state_space = proper_system(system, "the plant of a design")
    title = str(getattr(system, "name", "system"))
    system = state_space
    if system.dt is True:
        raise WorkbenchError(
            f"system {title!r} is sampled and does not say how often; give its sample time"
            " (dt), in s, or the continuous plant"
        )
    names = (
        _labels(state_space.state_labels),
        _labels(system.input_labels),
        _labels(system.output_labels),
    )
    ends = dict(limits or {})
    for name in ends:
        check_choice("name of a limited signal", name, (*names[1], *names[2]))
        if not ends[name][0] < ends[name][1]:
            raise WorkbenchError(
                f"limits of {name} are {ends[name][0]:g} and {ends[name][1]:g}; give the lower end"
                " and then the upper one"
            )
    A, B, C, D = (
        np.asarray(matrix, dtype=float)
        for matrix in (state_space.A, state_space.B, state_space.C, state_space.D)
    )
    if not system.isctime():
        try:
            A, B = before_hold(A, B, float(system.dt))
        except WorkbenchError as error:
            raise WorkbenchError(
                f"system {title!r}, sampled every {system.dt:g} s: {error}"
            ) from None
    states, inputs, outputs = names
    infinite = (-np.inf, np.inf)
    model = Model(
        _plain(title),
        LinearEquations(_rows(A), _rows(B), _rows(C), _rows(D), names),
        states=tuple(State(name, "1") for name in states),
        inputs=tuple(
            Input(n, "1", _scale(n, ends) or 1.0, lower=low, upper=high)
            for n in inputs
            for low, high in (ends.get(n, infinite),)
        ),
        outputs=tuple(
            Output(n, "1", _scale(n, ends), lower=low, upper=high)
            for n in outputs
            for low, high in (ends.get(n, infinite),)
        ),
        description="linear system",
    )
    read = tuple(q if q.sized else replace(q, scale=min(q.scale, 1.0)) for q in model.outputs)
    model = replace(model, outputs=read)
    x0, u0, y0 = (np.zeros(len(every)) for every in names)
    point = OperatingPoint(model, x0, u0, y0, np.zeros(len(x0)), {}, {}, 0.0, 1.0)
    return LinearModel(A, B, C, D, point, states, inputs, outputs, x0, u0, y0, np.zeros(len(x0)))


def proper_system(system: Any, what: str) -> Any:
    """Return a system of python-control or ``scipy.signal`` as a ``control.StateSpace``.

    Args:
        what: What it is, as the user knows it.

    Raises:
        WorkbenchError: If it is none, or has no state space since it differentiates.

    Example:
        >>> import scipy.signal
        >>> proper_system(scipy.signal.lti([2.0], [1.0, 3.0]), "the plant").A.tolist()
        [[-3.0]]
    """
    import control as ct

    scipys = type(system).__module__.startswith("scipy.signal")
    if not scipys and not isinstance(system, (ct.StateSpace, ct.TransferFunction)):
        raise WorkbenchError(
            f"{what} is a {type(system).__name__}; give a LinearModel, or a python-control"
            " StateSpace or TransferFunction"
        )
    try:
        if not scipys:
            return ct.ss(system)
        own = system.to_ss()
    except ValueError as error:
        raise WorkbenchError(
            f"{what} has no state space ({error}); if it differentiates, add the lag of its filter"
        ) from None
    return ct.ss(own.A, own.B, own.C, own.D, own.dt or 0)


def _rows(matrix: Vector) -> Rows:
    return tuple(tuple(row) for row in matrix.tolist())


def _labels(labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(_plain(label) for label in labels)


def _plain(label: str) -> str:
    return re.sub(r"\W+", "_", label).strip("_") or "system"


def _scale(name: str, limits: Mapping[str, Sequence[float]]) -> float:
    """Return half of the range of a signal; 0, which leaves it to the equations, without one."""
    low, high = limits.get(name, (0.0, 0.0))
    return (high - low) / 2.0 if math.isfinite(high - low) else 0.0


def to_iosystem(model: Model) -> Any:
    """Return a model as a ``control.NonlinearIOSystem`` with its names.

    python-control interpolates inputs linearly between samples, while a controller holds them: a
    sampled command arrives half a sample early there. `workbench.simulation.simulate` holds.

    Returns:
        System in SI with the model's inputs, outputs and states; `control.linearize` and
        `control.input_output_response` take it.
    """
    import control as ct

    at = Derivatives(model, EXACT)
    p, n = model.values, len(model.states)

    def update(_t: float, x: Vector, u: Vector, _params: object) -> Vector:
        return at.values(x, np.atleast_1d(u), p)[:n]

    def output(_t: float, x: Vector, u: Vector, _params: object) -> Vector:
        return at.values(x, np.atleast_1d(u), p)[n:]

    return ct.NonlinearIOSystem(
        update,
        output,
        inputs=[q.name for q in model.inputs],
        outputs=[q.name for q in model.outputs],
        states=[q.name for q in model.states],
        name=model.name.replace(" ", "_"),
    )
