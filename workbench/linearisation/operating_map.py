"""Linear models on a grid of operating points and parameters, in one call."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError, check_finite
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.linearise import linearise
from workbench.model import Model
from workbench.operating_point import OperatingPoint, operating_point

Index = tuple[int, ...]


@dataclass(frozen=True)
class OperatingMap:
    """Linear models on a grid.

    Args:
        axes: Values of each axis by name, in SI.
        state: State whose oscillation `frequency_hz` and `damping` describe.
    """

    axes: Mapping[str, Vector]
    state: str
    models: Mapping[Index, LinearModel]
    reasons: Mapping[Index, str]

    def table(self, of: Callable[[LinearModel], npt.ArrayLike]) -> Vector:
        """Return something of every linear model, NaN where there is no operating point.

        Returns:
            Array of the lengths of the axes, followed by the shape of what is asked for.
        """
        first = np.shape(of(next(iter(self.models.values()))))
        result = np.full((*(len(v) for v in self.axes.values()), *first), np.nan)
        for index, linear in self.models.items():
            result[index] = of(linear)
        return result

    @property
    def frequency_hz(self) -> Vector:
        """Natural frequency of the oscillation, in Hz, over the axes."""
        return self.table(lambda linear: linear.mode_of(self.state).frequency_hz)

    @property
    def damping(self) -> Vector:
        """Damping ratio of the oscillation, dimensionless, over the axes."""
        return self.table(lambda linear: linear.mode_of(self.state).damping)

    def __str__(self) -> str:
        (first, along), *rest = self.axes.items()
        frequency, damping = self.frequency_hz, self.damping
        head = "".join(f"{name:>16}" for name, _ in rest)
        lines = [
            f"map over {first}, {along.min():.3g} to {along.max():.3g}",
            f"{head}  frequency Hz     damping        points",
        ]
        for index in itertools.product(*(range(len(v)) for _, v in rest)):
            f, z = (np.moveaxis(table, 0, -1)[index] for table in (frequency, damping))
            count = int(np.isfinite(f).sum())
            at = "".join(f"{v[i]:>16.6g}" for i, (_, v) in zip(index, rest, strict=True))
            if not count:
                lines.append(f"{at}  no operating point")
                continue
            lines.append(
                f"{at}  {np.nanmin(f):5.2f} to {np.nanmax(f):5.2f}"
                f"  {np.nanmin(z):5.3f} to {np.nanmax(z):5.3f}  {count} of {len(f)}"
            )
        return "\n".join(lines)


def default_input(model: Model) -> str:
    """Return the input of the one curve that a controller inverts, or the plant's own."""
    return (
        model.traits.curves[0].name
        if len(model.inputs) == len(model.traits.curves) == 1
        else "plant"
    )


def operating_map(
    model: Model,
    axes: Mapping[str, npt.ArrayLike],
    *,
    input: str = "",  # noqa: A002 -- The word of the field.
) -> OperatingMap:
    """Linearise a model at every point of a grid.

    Each point starts from its neighbour on the first axis.

    Args:
        axes: Values in SI, by the name of a parameter, or of what `operating_point` takes: an
            output, a state, an input, or a sum that the plant declares.
        input: Name of the input, as for `linearise`; by default that of a curve that a controller
            inverts, where the plant declares one.

    Raises:
        WorkbenchError: If a value is not finite, a name unknown, or there is no operating point.
    """
    grid = {name: np.atleast_1d(check_finite(name, values)) for name, values in axes.items()}
    if not grid or any(values.ndim != 1 for values in grid.values()):
        raise WorkbenchError("a map needs one or more axes, each a list of numbers")
    input = input or default_input(model)  # noqa: A001
    # The oscillation of the first axis that is a state is what the map describes.
    states = [q.name for q in model.states]
    state = next((name for name in grid if name in states), states[0])
    parameters = {q.name for q in model.parameters}
    first, *rest = grid
    models: dict[Index, LinearModel] = {}
    reasons: dict[Index, str] = {}
    for index in itertools.product(*(range(len(grid[name])) for name in rest)):
        near: OperatingPoint | None = None
        fixed = {name: float(grid[name][i]) for name, i in zip(rest, index, strict=True)}
        for i, value in enumerate(grid[first].tolist()):
            given = {first: value, **fixed}
            own = {name: v for name, v in given.items() if name in parameters}
            given = {name: v for name, v in given.items() if name not in parameters}
            changed = model.with_parameters(own) if own else model
            try:
                near = operating_point(changed, given, near=near)
                models[i, *index] = linearise(near, input=input, verdict=False)
            except WorkbenchError as error:
                reasons[i, *index] = str(error)
    if not models:
        raise WorkbenchError(
            "there is no operating point anywhere on the map; the first:"
            f" {next(iter(reasons.values()))}"
        )
    return OperatingMap(grid, state, models, reasons)
