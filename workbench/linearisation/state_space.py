"""python-control's systems as linear models, and models as its systems."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from workbench.arrays import Vector
from workbench.linearisation.linear_model import LinearModel
from workbench.model import EXACT, Model
from workbench.model.linear_system import Limits, LinearEquations, model_of_system
from workbench.model.transfer_text import system_of_text
from workbench.operating_point import Derivatives, OperatingPoint
from workbench.plants.registry import model_of


def linear_model(
    system: Any,
    *,
    limits: Limits = None,
    delay: float = 0.0,
) -> LinearModel:
    """Take a system of python-control, or one written as text, as a linear model.

    The names are those of its signals; ``u[0]`` becomes ``u_0``, or ``u`` if it is the only one.
    Its units are SI. Where no limits are given, the scale of an input is 1, and that of an output
    what the inputs make of it, at most 1 if it integrates. It is a plant too:
    ``linear_model(system).operating_point.model``. The ``system`` of a `LinearModel` has its
    operating point still.

    Args:
        system: A ``control.StateSpace`` or ``control.TransferFunction``, or one of
            ``scipy.signal``, proper, in continuous time or with a sample time over which its inputs
            are held; a text such as ``"2 exp(-0.1 s) / (s + 1)"``; or a `LinearModel`, which is
            returned.
        limits: Lower and upper end of inputs and outputs by name, in SI, or the largest magnitude,
            which alone is that of every input; infinite if not given.
        delay: Time by which every input acts late, in s, by a Pade function of second over third
            order. Whole samples by which a sampled system is late (poles at z = 0) count too.

    Example:
        >>> import control
        >>> linear_model(control.tf([1.0], [0.1, 1.0, 0.0])).output_names
        ('y',)
        >>> linear_model("1 / (s (0.1 s + 1))", limits=1.0).output_names
        ('y',)
    """
    if isinstance(system, str):
        system = system_of_text(system)
    if isinstance(system, LinearModel):
        return system
    known = getattr(system, "linear_model", None)
    if (
        isinstance(known, LinearModel)
        and not (limits or delay)
        and np.array_equal(known.A, system.A)
    ):
        return known
    return of_equations(model_of_system(system, limits=limits, delay=delay))


def of_equations(model: Model) -> LinearModel:
    """Return a model whose equations are `LinearEquations` as a linear model about zero."""
    equations = cast(LinearEquations, model.equations)
    x0, u0, y0 = (np.zeros(len(every)) for every in equations.names)
    point = OperatingPoint(model, x0, u0, y0, 0.0 * x0, {}, {}, 0.0, 1.0)
    return LinearModel(*equations.matrices, point, *equations.names, x0, u0, y0, 0.0 * x0)


def to_iosystem(model: Model | Any) -> Any:
    """Return a model as a ``control.NonlinearIOSystem`` with its names.

    python-control interpolates inputs linearly between samples, while a controller holds them: a
    sampled command arrives half a sample early there. `workbench.simulation.simulate` holds.

    Returns:
        System in SI with the model's inputs, outputs and states; `control.linearize` and
        `control.input_output_response` take it.
    """
    import control as ct

    model = model_of(model)
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
