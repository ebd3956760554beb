"""Linear models over angles, loads and mean pressures, in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError, check_finite
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.linearise import linearise
from workbench.model import Model
from workbench.operating_point import OperatingPoint, operating_point

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class AngleMap:
    """Linear models on a grid of angles, loads and mean pressures.

    Arrays have the shape (n_angles, n_loads, n_mean_pressures), followed by the shape of the
    matrix; they are NaN where there is no operating point.

    Args:
        angles: Angles, shape (n_angles,), in rad.
        loads: Loads, shape (n_loads,), in kg; NaN for the model's own.
        mean_pressures: Mean gauge pressures, shape (n_mean_pressures,), in Pa; NaN for the one that
            leakage holds.
        A: State matrices, in SI.
        B: Input matrices, in SI.
        C: Output matrices, in SI.
        D: Feedthroughs, in SI.
        x: States, in SI.
        u: Inputs of the linear models, in SI.
        y: Readings, in SI.
        frequency_hz: Natural frequency of the arm's oscillation, in Hz.
        damping: Damping ratio of the arm's oscillation, dimensionless.
        static_gain: Readings per input at rest, ``D - C A^-1 B``, in SI.
        models: Linear models by indices of angle, load and mean pressure.
        reasons: Why there is no operating point, by the same indices.

    Example:
        >>> from workbench.plants.arm import arm
        >>> found = angle_map(arm(), [0.3, 0.5], loads=[0.0, 3.0], mean_pressures=[3e5])
        >>> found.A.shape, found.frequency_hz[:, 1, 0].round(1).tolist()
        ((2, 2, 1, 8, 8), [2.1, 2.1])
    """

    angles: Vector
    loads: Vector
    mean_pressures: Vector
    A: Vector
    B: Vector
    C: Vector
    D: Vector
    x: Vector
    u: Vector
    y: Vector
    frequency_hz: Vector
    damping: Vector
    static_gain: Vector
    models: Mapping[tuple[int, int, int], LinearModel]
    reasons: Mapping[tuple[int, int, int], str]

    def __str__(self) -> str:
        """Return a short aligned table: range of frequency and damping per load and pressure."""
        lines = [
            f"angle map, {np.degrees(self.angles.min()):.3g} to"
            f" {np.degrees(self.angles.max()):.3g} deg",
            "    load kg  mean bar  frequency Hz     damping        points",
        ]
        for j, load in enumerate(self.loads):
            for k, mean in enumerate(self.mean_pressures):
                f, z = self.frequency_hz[:, j, k], self.damping[:, j, k]
                count = int(np.isfinite(f).sum())
                first = f"  {_word(load):>9} {_word(mean / 1e5):>9}"
                if not count:
                    lines.append(f"{first}  no operating point")
                    continue
                lines.append(
                    f"{first}  {np.nanmin(f):5.2f} to {np.nanmax(f):5.2f}"
                    f"  {np.nanmin(z):5.3f} to {np.nanmax(z):5.3f}  {count} of {len(f)}"
                )
        return "\n".join(lines)


def angle_map(
    plant: Model | Callable[[float], Model],
    angles: npt.ArrayLike,
    *,
    loads: npt.ArrayLike | None = None,
    mean_pressures: npt.ArrayLike | None = None,
    input: str = "opening",  # noqa: A002 -- The word of the field.
    amplitude: Mapping[str, float] | None = None,
) -> AngleMap:
    """Linearise an arm at every angle, load and mean pressure of a grid.

    Args:
        plant: A model with the reading ``angle``, whose parameter ``load`` is changed, or a
            function that builds the model for a load in kg, such as ``arm``.
        angles: Angles, shape (n,), in rad.
        loads: Loads, shape (n,), in kg; by default the model's own.
        mean_pressures: Means of the two gauge pressures, shape (n,), in Pa; by default the one
            that leakage holds, a true equilibrium.
        input: ``"opening"`` or ``"plant"``, as for `linearise`.
        amplitude: Swings of states by name, in SI, as for `linearise`.

    Returns:
        Matrices, modes and gains; NaN and a reason where there is no operating point.

    Raises:
        WorkbenchError: If a value is not finite, or loads are given for a model without load.

    Example:
        >>> from workbench.plants.arm import arm
        >>> print(angle_map(arm(8), [0.5236], mean_pressures=[3e5]))
        angle map, 30 to 30 deg
            load kg  mean bar  frequency Hz     damping        points
                own         3   1.29 to  1.29  0.077 to 0.077  1 of 1
    """
    angle = np.atleast_1d(check_finite("angles", angles))
    load = np.array([np.nan]) if loads is None else np.atleast_1d(check_finite("loads", loads))
    mean = (
        np.array([np.nan])
        if mean_pressures is None
        else np.atleast_1d(check_finite("mean pressures", mean_pressures))
    )
    if angle.ndim != 1 or load.ndim != 1 or mean.ndim != 1:
        raise WorkbenchError("angles, loads and mean pressures must each be a list of numbers")
    models: dict[tuple[int, int, int], LinearModel] = {}
    reasons: dict[tuple[int, int, int], str] = {}
    for j, kg in enumerate(load):
        model = _loaded(plant, float(kg))
        for k, pressure in enumerate(mean):
            near: OperatingPoint | None = None
            for i, theta in enumerate(angle):
                try:
                    held = {} if np.isnan(pressure) else {"mean_pressure": float(pressure)}
                    near = operating_point(model, {"angle": float(theta), **held}, near=near)
                    models[i, j, k] = linearise(
                        near, input=input, amplitude=amplitude, verdict=False
                    )
                except WorkbenchError as error:
                    reasons[i, j, k] = str(error)
    if not models:
        raise WorkbenchError(
            f"there is no operating point anywhere on the map; the first: {reasons[0, 0, 0]}"
        )
    shape = (len(angle), len(load), len(mean))
    modes = {index: linear.mode_of("angle") for index, linear in models.items()}

    def table(of: Callable[[LinearModel], Vector]) -> Vector:
        first = of(next(iter(models.values())))
        result = np.full(shape + np.shape(first), np.nan)
        for index, linear in models.items():
            result[index] = of(linear)
        return result

    frequency, damping = np.full(shape, np.nan), np.full(shape, np.nan)
    for index, mode in modes.items():
        frequency[index], damping[index] = mode.frequency_hz, mode.damping
    return AngleMap(
        angles=angle,
        loads=load,
        mean_pressures=mean,
        A=table(lambda m: m.A),
        B=table(lambda m: m.B),
        C=table(lambda m: m.C),
        D=table(lambda m: m.D),
        x=table(lambda m: m.x0),
        u=table(lambda m: m.u0),
        y=table(lambda m: m.y0),
        frequency_hz=frequency,
        damping=damping,
        static_gain=table(_static_gain),
        models=models,
        reasons=reasons,
    )


def _loaded(plant: Model | Callable[[float], Model], load: float) -> Model:
    if not isinstance(plant, Model):
        return plant(0.0 if np.isnan(load) else load)
    return plant if np.isnan(load) else plant.with_parameters({"load": load})


def _static_gain(linear: LinearModel) -> Vector:
    if np.linalg.matrix_rank(linear.A) < len(linear.A):
        return np.full(linear.D.shape, np.nan)
    return np.asarray(linear.D - linear.C @ np.linalg.solve(linear.A, linear.B))


def _word(value: float) -> str:
    return "own" if np.isnan(value) else f"{value:g}"
