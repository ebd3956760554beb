"""From a model and its inputs to a trajectory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import NumericalError, WorkbenchError, check_choice, check_finite
from workbench.model import EXACT, Form, Model
from workbench.model.model import check_vector
from workbench.model.units import in_time
from workbench.plants.registry import model_of
from workbench.simulation.integrators import METHODS, Method
from workbench.simulation.stepper import Stepper
from workbench.simulation.trajectory import Trajectory, read_outputs

TRUSTED = 0.01
"""Difference to a ten times tighter run up to which a run is trusted, in scales of the states."""


def simulate(
    model: Model | Any,
    inputs: npt.ArrayLike,
    *,
    sample_time: float,
    start: npt.ArrayLike | Mapping[str, float] | None = None,
    tolerance: float = 1e-7,
    method: Literal["auto", "erk", "rosenbrock"] = "auto",
    form: Form = EXACT,
    values: npt.ArrayLike | None = None,
    check: bool = True,
) -> Trajectory:
    """Simulate a model with inputs that are held between samples.

    The integrator is restarted at every sample, so that no step crosses a jump of the inputs.

    Args:
        model: The plant, or what stands for it, such as a system of python-control.
        inputs: Inputs, shape (n, n_inputs), or (n,) for a single input, in SI; row k is held from
            sample k to sample k + 1.
        sample_time: Time between samples, in s.
        start: States at the first sample, shape (n_states,), in SI, or some of them by name.
        tolerance: Local error allowed in a step, relative to the scales of the states.
        method: ``"erk"``, ``"rosenbrock"`` for stiff models, or ``"auto"``: the first, and the
            second where the first gives up.
        values: Parameter values, shape (n_parameters,), in SI; the model's own by default.
        check: Also make a ten times tighter run and report the difference.

    Raises:
        NumericalError: If the integrator gives up, or the two runs differ by more than 1 % of the
            scale of a state: then neither is to be trusted.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> run = simulate(servo_axis(), np.full(200, 100.0), sample_time=0.01)
        >>> round(float(run["position"][-1]), 3)
        0.609
    """
    model = model_of(model)
    held = check_inputs(model, inputs)
    check_choice("integration method", method, ("auto", *METHODS))
    if start is None or isinstance(start, Mapping):
        x0 = model.initial_state(start, u=held[0])
    else:
        x0 = check_vector("state", start, model.states)
    p = model.values if values is None else check_vector("parameter", values, model.parameters)

    def run(tolerance: float, method: Method) -> tuple[Vector, Stepper]:
        stepper = Stepper(model, sample_time, tolerance, method, form, p)
        after = stepper.run_as_far(x0, held[:-1])
        if len(after) < len(held) - 1:
            lasted = in_time(len(after) * sample_time, 4)
            raise NumericalError(f"after {lasted}, {stepper.failure()}")
        return np.vstack([x0, after]), stepper

    candidates: tuple[Method, ...] = METHODS if method == "auto" else (method,)
    for attempt in candidates:
        try:
            states, stepper = run(tolerance, attempt)
            error = math.nan
            if check:
                tighter, _ = run(tolerance / 10, attempt)
                error = float(np.max(np.abs(states - tighter) / stepper.scale))
                if not error < TRUSTED:
                    raise NumericalError(
                        f"two runs of {model.name!r} with {attempt} at tolerances {tolerance:g} and"
                        f" {tolerance / 10:g} differ by {error:.2g} of the scale of a state; a run"
                        f" is trusted up to {TRUSTED:g}: tighten the tolerance, or shorten the run"
                        " if the model is chaotic"
                    )
            break
        except NumericalError:
            if attempt == candidates[-1]:
                raise
    time = sample_time * np.arange(len(held), dtype=np.float64)
    return Trajectory(
        model=model,
        time=time,
        states=states,
        inputs=held,
        outputs=read_outputs(model, states, held, form=form, values=p),
        integrator=stepper.integrator,
        tolerance=tolerance,
        error=error,
        form=form,
        values=p,
    )


def check_inputs(model: Model, inputs: npt.ArrayLike) -> Vector:
    """Return inputs, in SI, as a finite table (n, n_inputs) with a column per input of the model.

    Args:
        inputs: Inputs, shape (n, n_inputs), or (n,) for a single input, in SI.
    """
    table = check_finite("inputs", inputs)
    if table.ndim == 1:
        table = table[:, None]
    if table.ndim != 2 or table.shape[1] != len(model.inputs) or len(table) < 2:
        raise WorkbenchError(
            f"inputs have shape {table.shape}; {model.name!r} needs (samples, {len(model.inputs)})"
            f" with two samples or more: {', '.join(q.name for q in model.inputs)}"
        )
    for quantity, column in zip(model.inputs, table.T, strict=True):
        outside = (column < quantity.lower) | (column > quantity.upper)
        if outside.any():
            first = int(np.argmax(outside))
            raise WorkbenchError(
                f"input {quantity.name} is {column[first]:g} {quantity.unit} at sample {first}; the"
                f" valid range is {quantity.lower:g} to {quantity.upper:g} {quantity.unit}; clip it"
            )
    return table
