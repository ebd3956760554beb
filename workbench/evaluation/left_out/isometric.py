"""Isometric recordings of one muscle, filled slowly: the rig's laws, an integrator of its own.

The gas keeps mass and internal energy, as everywhere in the rig; the workbench keeps pressure and
temperature.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt

from workbench.evaluation.rig import muscle
from workbench.evaluation.rig.parameters import nominal
from workbench.evaluation.rig.plant import namespace
from workbench.recordings import Recording, Signal

Vector = npt.NDArray[np.float64]

SAMPLE_TIME = 0.02
SUBSTEPS = 10
RAMP_S, PAUSE_S, MOVE_S = 5.0, 1.0, 1.0
LOW_BAR, HIGH_BAR = 0.2, 6.0
FORCE_NOISE_N, FORCE_STEP_N = 0.5, 0.5


def isometric_recording(
    contractions_mm: Sequence[float], *, seed: int, name: str, parameters: Mapping[str, float]
) -> Recording:
    """Record a muscle that is filled and vented at one length after the other.

    Args:
        parameters: Parameters of the rig that are not nominal, in its units.

    Returns:
        Length, speed and mass flow as commanded, force and gauge pressure as read.
    """
    p = namespace(nominal(parameters))
    length, flow = _trajectories(contractions_mm, p)
    force, pressure = _sensed(_integrated(length, flow, p), p, np.random.default_rng(seed))
    return Recording(
        name,
        SAMPLE_TIME * np.arange(len(flow), dtype=np.float64),
        (
            # What a sample holds is the length in its middle.
            Signal("fibre_length", 0.5 * (length[1:] + length[:-1]), "m", role="command"),
            Signal("fibre_speed", np.diff(length) / SAMPLE_TIME, "m/s", role="command"),
            Signal("flow", flow, "kg/s", role="command"),
            Signal("force", force, "N"),
            Signal("pressure", pressure, "Pa", kind="gauge pressure"),
        ),
    )


def _trajectories(contractions_mm: Sequence[float], p: SimpleNamespace) -> tuple[Vector, Vector]:
    """Return the length at the ends of all samples, in m, and the flow in each, in kg/s."""
    lengths, flows = [], []
    stands = [muscle.NOMINAL_LENGTH - 1e-3 * q for q in contractions_mm]
    per_volume = 1e5 / (p.gas_constant * p.ambient_temperature)
    for i, s in enumerate(stands):
        v = _volume(s, p)
        ramp = (HIGH_BAR - LOW_BAR) * per_volume * v / RAMP_S
        for seconds, flow in ((RAMP_S, ramp), (PAUSE_S, 0.0), (RAMP_S, -ramp), (PAUSE_S, 0.0)):
            count = round(seconds / SAMPLE_TIME)
            lengths.append(np.full(count, s))
            flows.append(np.full(count, flow))
        if i + 1 < len(stands):
            # On the way to the next length the pressure is held low.
            count = round(MOVE_S / SAMPLE_TIME)
            lengths.append(np.linspace(s, stands[i + 1], count, endpoint=False))
            low = LOW_BAR + 1e-5 * p.ambient_pressure
            grown = _volume(stands[i + 1], p) - v
            flows.append(np.full(count, low * per_volume * grown / MOVE_S))
    return np.append(np.concatenate(lengths), stands[-1]), np.concatenate(flows)


def _integrated(length: Vector, flow: Vector, p: SimpleNamespace) -> Vector:
    """Return force in N and gauge pressure in Pa at the samples, by the midpoint rule."""
    at_rest = p.ambient_pressure + LOW_BAR * 1e5
    v = _volume(length[0], p)
    mass = at_rest * v / (p.gas_constant * p.ambient_temperature)
    energy = at_rest * v / (p.gamma - 1.0)
    h = SAMPLE_TIME / SUBSTEPS
    rows = np.empty((len(flow), 2))

    def rate(at_mass: float, at_energy: float, s: float, speed: float, inward: float) -> float:
        temperature = at_energy / (at_mass * p.cv)
        carried = p.ambient_temperature if inward > 0.0 else temperature
        work = (p.gamma - 1.0) * at_energy / _volume(s, p) * muscle.volume_slope(s) * speed
        wall = p.heat_transfer * p.heat_area * (temperature - p.ambient_temperature)
        return float(p.gamma * p.cv * inward * carried - work - wall)

    for k, inward in enumerate(flow.tolist()):
        pressure = (p.gamma - 1.0) * energy / _volume(length[k], p) - p.ambient_pressure
        rows[k] = muscle.force(length[k], pressure, 1.0, p), pressure
        speed = (length[k + 1] - length[k]) / SAMPLE_TIME
        for j in range(SUBSTEPS):
            s = length[k] + j * h * speed
            middle = energy + 0.5 * h * rate(mass, energy, s, speed, inward)
            half = s + 0.5 * h * speed
            energy += h * rate(mass + 0.5 * h * inward, middle, half, speed, inward)
            mass += h * inward
    return rows


def _volume(s: float, p: SimpleNamespace) -> float:
    return float(p.volume_gain * muscle.volume(s) + p.dead_volume)


def _sensed(rows: Vector, p: SimpleNamespace, rng: np.random.Generator) -> tuple[Vector, Vector]:
    sizes = ((FORCE_NOISE_N, FORCE_STEP_N), (p.pressure_noise, p.pressure_step))
    force, pressure = (
        step * np.round((true + noise * rng.standard_normal(len(true))) / step)
        for true, (noise, step) in zip(rows.T, sizes, strict=True)
    )
    return force, pressure
