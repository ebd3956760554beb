"""The paper's identification experiment: slow pressure ramps at constant contraction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import NumericalError, WorkbenchError, check_range
from workbench.model import Model, Output
from workbench.physics.force_laws import ForceLaw
from workbench.physics.gas import GAS_CONSTANT
from workbench.plants.arm.arm import OUTPUTS
from workbench.plants.arm.geometry import TRAVEL, ArmGeometry
from workbench.plants.arm.muscle import pneumatic_muscle
from workbench.simulation import simulate

CONTRACTIONS = (0.0, 1e-3, 2e-3, 4e-3, 7e-3, 10e-3, 14e-3, 18e-3, 22e-3, 26e-3, 30e-3)
"""Contractions of the experiment, m; close to each other where phi bends."""

MAXIMUM_PRESSURE = 6e5
"""Gauge pressure at the end of a ramp of one muscle, in Pa."""

_STEP = 0.2
"""Time between samples, in s."""

STOP_ANGLES = tuple(math.radians(a) for a in (0, 6, 13, 20, 27, 34, 41, 48, 54, 57, 60))
"""Angles at which the lower stop is fastened in turn, rad: muscle 2 at 30 to 0 mm."""

FILLING_V = 4.9
"""Valve voltage that fills muscle 2, a little below the centre, V."""

_LOAD_CELL = OUTPUTS[3]
_PRESSURE = OUTPUTS[1]


@dataclass(frozen=True)
class IsometricRecord:
    """What the sensors read during isometric pressure ramps.

    Args:
        ramp: Number of the ramp of each sample, shape (n,), from 0.
        pressure: Gauge pressures, shape (n,), in Pa.
        contraction: Contractions, shape (n,), in m.
        force: Forces of the muscle, shape (n,), in N.
    """

    ramp: npt.NDArray[np.int_]
    pressure: Vector
    contraction: Vector
    force: Vector
    source: str

    def __str__(self) -> str:
        """Return a short aligned table, one row per ramp."""
        lines = [self.source, "  contraction  pressure        force"]
        for number in np.unique(self.ramp):
            own = self.ramp == number
            p, f = self.pressure[own] / 1e5, self.force[own]
            lines.append(
                f"  {1e3 * np.median(self.contraction[own]):8.2f} mm  {p.min():.2f} to"
                f" {p.max():.2f} bar  {f.min():7.1f} to {f.max():.1f} N"
            )
        return "\n".join(lines)


def isometric_experiment(
    force_law: ForceLaw | None = None,
    *,
    contractions: Sequence[float] = CONTRACTIONS,
    ramp_time: float = 30.0,
    noise: float = 1.0,
    seed: int = 0,
) -> IsometricRecord:
    """Fill a muscle slowly at several constant lengths and record pressure and force.

    A constant mass flow fills the muscle from ambient to the maximum pressure. The gas warms
    while it is compressed, which the force does not feel: it follows the pressure.

    Args:
        contractions: Contractions of the ramps, in m.
        ramp_time: Duration of a ramp, 5 to 600 s.
        noise: Noise and resolution of the sensors, as a ratio to those of the arm; 0 for none.

    Source:
        The paper's identification experiment, Figure 7.
    """
    check_range("ramp time", ramp_time, 5.0, 600.0, "s")
    check_range("sensor noise", noise, 0.0, 1e3)
    if not len(contractions):
        raise WorkbenchError("there is no contraction to measure at; give at least one")
    model = pneumatic_muscle(force_law)
    values = {q.name: q.value for q in model.parameters}
    count = round(ramp_time / _STEP) + 1
    tables = []
    for contraction in contractions:
        check_range("contraction", contraction, -1e-3, 35e-3, "m", fix="1 mm is 0.001 m")
        length = 0.2 - contraction
        x0 = model.initial_state({"pressure": values["ambient_pressure"]})
        volume = model.signals(x0, [length, 0.0, 0.0])["chamber.volume"]
        mass = MAXIMUM_PRESSURE * volume / (GAS_CONSTANT * values["ambient_temperature"])
        inputs = np.tile([length, 0.0, mass / ramp_time], (count, 1))
        run = simulate(model, inputs, sample_time=_STEP, start=x0)
        tables.append((run["pressure"], np.full(count, contraction), run["force"]))
    return _record(tables, seed, noise, "one muscle, filled at constant length")


def isometric_experiment_on_arm(
    model: Model,
    *,
    stop_angles: Sequence[float] = STOP_ANGLES,
    ramp_time: float = 30.0,
    noise: float = 1.0,
    seed: int = 0,
) -> IsometricRecord:
    """Press the arm against its lower stop with muscle 2 and record the load cell, as the rig does.

    The lower stop is fastened at several angles in turn. Muscle 2 is filled slowly while muscle 1
    stays vented; ``F_2 = -load_cell * arm / (dL_2/dtheta)``. The valve's leakage is taken away, if
    the model has any, because it would fill muscle 1: the paper's authors removed the valve.

    Args:
        stop_angles: Angles of the lower stop, in rad.
        ramp_time: Duration of a ramp, in s.
        noise: Noise and resolution of the sensors, as a ratio to those of the arm; 0 for none.

    Returns:
        The record of muscle 2, its contraction computed from the angle that the encoder reads.

    Raises:
        NumericalError: If the arm leaves the stop.

    Source:
        The paper's identification experiment: arm on the lower stop, load cell, geometric ratios.
    """
    check_range("ramp time", ramp_time, 1.0, 600.0, "s")
    check_range("sensor noise", noise, 0.0, 1e3)
    if any(effect.name == "centre_leakage" for effect in model.effects):
        model = model.without("centre_leakage")
    values = {q.name: q.value for q in model.parameters}
    geometry = ArmGeometry()
    ambient = values["ambient_pressure"]
    count = round(ramp_time / _STEP) + 1
    tables = []
    for stop in stop_angles:
        check_range("stop angle", stop, 0.0, TRAVEL, "rad", fix="30 deg is 0.524 rad")
        fastened = model.with_parameters({"lower_stop": stop, "upper_stop": TRAVEL})
        start = {"pressure_1": ambient, "pressure_2": ambient, "angle": stop}
        run = simulate(fastened, np.full(count, FILLING_V), sample_time=_STEP, start=start)
        angle = run["angle"]
        if np.max(angle) > stop + math.radians(0.5):
            raise NumericalError(
                f"the arm leaves the stop at {math.degrees(stop):.1f} deg; it is isometric"
                " only in the horizontal plane with muscle 1 vented"
            )
        lever = np.asarray(geometry.moment_arms(angle)[1], dtype=float)
        contraction = np.asarray(geometry.contractions(angle)[1], dtype=float)
        force = run["load_cell"] * values["load_cell_arm"] / lever
        settled = run.time > 0.1 * ramp_time
        tables.append((run["pressure_2"][settled], contraction[settled], force[settled]))
    return _record(tables, seed, noise, "muscle 2 of the arm on its lower stop")


def _record(
    tables: list[tuple[Vector, Vector, Vector]], seed: int, noise: float, source: str
) -> IsometricRecord:
    rng = np.random.default_rng(seed)
    pressure, contraction, force = (
        np.concatenate(columns) for columns in zip(*tables, strict=True)
    )
    if noise:
        pressure = _sensed(pressure, _PRESSURE, rng, noise)
        force = _sensed(force, _LOAD_CELL, rng, noise)
    ramp = np.repeat(np.arange(len(tables)), [len(table[0]) for table in tables])
    return IsometricRecord(ramp, pressure, contraction, force, source)


def _sensed(values: Vector, sensor: Output, rng: np.random.Generator, noise: float) -> Vector:
    noisy = values + noise * sensor.noise_rms * rng.standard_normal(values.size)
    step = noise * sensor.resolution
    return np.asarray(np.round(noisy / step) * step, dtype=float)
