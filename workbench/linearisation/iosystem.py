"""A model as a system of python-control, for its tools and as a cross-check."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.model import EXACT, Model
from workbench.operating_point import Derivatives


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
