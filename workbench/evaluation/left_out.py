"""The paper's own physics left out of the plant, one piece after the other, on the rig's data."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.stages import Diagnosis
from workbench.evaluation.kept_answers import diagnosed, version
from workbench.evaluation.rig import plant
from workbench.evaluation.rig.cases import make_case
from workbench.evaluation.rig.parameters import nominal
from workbench.evaluation.rig.plant import namespace
from workbench.model import Effect, Model
from workbench.physics.gas import isothermal_gas
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.arm import arm, pneumatic_muscle
from workbench.plants.arm.laws import constant_volume
from workbench.recordings import Recording, Signal, read_case

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
    stands = [plant.NOMINAL_LENGTH - 1e-3 * q for q in contractions_mm]
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
        work = (p.gamma - 1.0) * at_energy / _volume(s, p) * plant.volume_slope(s) * speed
        wall = p.heat_transfer * p.heat_area * (temperature - p.ambient_temperature)
        return float(p.gamma * p.cv * inward * carried - work - wall)

    for k, inward in enumerate(flow.tolist()):
        pressure = (p.gamma - 1.0) * energy / _volume(length[k], p) - p.ambient_pressure
        rows[k] = plant.force(length[k], pressure, 1.0, p), pressure
        speed = (length[k + 1] - length[k]) / SAMPLE_TIME
        for j in range(SUBSTEPS):
            s = length[k] + j * h * speed
            middle = energy + 0.5 * h * rate(mass, energy, s, speed, inward)
            half = s + 0.5 * h * speed
            energy += h * rate(mass + 0.5 * h * inward, middle, half, speed, inward)
            mass += h * inward
    return rows


def _volume(s: float, p: SimpleNamespace) -> float:
    return float(p.volume_gain * plant.volume(s) + p.dead_volume)


def _sensed(rows: Vector, p: SimpleNamespace, rng: np.random.Generator) -> tuple[Vector, Vector]:
    sizes = ((FORCE_NOISE_N, FORCE_STEP_N), (p.pressure_noise, p.pressure_step))
    force, pressure = (
        step * np.round((true + noise * rng.standard_normal(len(true))) / step)
        for true, (noise, step) in zip(rows.T, sizes, strict=True)
    )
    return force, pressure


LOAD_KG = 3.0
SEED = 11

Experiment = Literal["isometric", "motion"]


@dataclass(frozen=True)
class LeftOut:
    """A piece of the paper's physics that a nominal plant lacks.

    Args:
        effects: Effects of the plant that are left out; none for a control.
        answers: Names in the library that are right; none where nothing is left out.
        instead: What stands in their place; None for nothing.
        collinear: Whether parameters reproduce most of it, so that silence is right as well.
        seconds: Length of a recording of the arm, in s.
        tried: Names of the effects that compete; the whole library if none.
    """

    physics: str
    experiment: Experiment
    effects: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    instead: Effect | None = None
    collinear: bool = False
    seconds: float = 10.0
    tried: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the case, such as ``phi-isometric``."""
        return f"{self.physics.replace(' ', '-')}-{self.experiment}"

    def nominal(self) -> Model:
        """Return the plant without the piece."""
        whole = pneumatic_muscle() if self.experiment == "isometric" else arm(LOAD_KG)
        beside = () if self.instead is None else (self.instead,)
        return whole.without(*self.effects).with_effect(*beside)


_GAS = isothermal_gas(("chamber_1.heat", "chamber_2.heat"))
PLAN = (
    LeftOut("nothing", "motion"),
    LeftOut("phi", "isometric", ("force_correction",), ("phi_term",)),
    LeftOut("phi", "motion", ("force_correction",), ("phi_term",)),
    LeftOut("changing volume", "motion", ("end_flattening",), ("braid_volume",), constant_volume()),
    LeftOut("flattened ends", "motion", ("end_flattening",), ("flattened_ends",), collinear=True),
    LeftOut("energy of the gas", "motion", ("heat_exchange",), ("gas_energy_balance",), _GAS),
    LeftOut("Coulomb friction", "motion", ("bearing_friction",), ("coulomb_friction",)),
)
"""Every piece, after a control in which nothing is left out."""


def recordings(case: LeftOut, folder: Path) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Record on the independent rig, whose parameters are some per cent off.

    Returns:
        Recordings to fit on and others to judge on: isometric ramps of a muscle, or the arm in
        motion, open and closed loop.
    """
    if case.experiment == "isometric":
        return (_ramps("fitted", (0, 5, 11, 18, 26), 1),), (_ramps("held out", (2, 8, 22), 2),)
    made = read_case(make_case(SEED, [], LOAD_KG, folder, seconds=case.seconds))
    return tuple(made.fit.values()), tuple(made.hold_out.values())


def _ramps(name: str, contractions_mm: Sequence[float], seed: int) -> Recording:
    return isometric_recording(
        contractions_mm, seed=seed, name=name, parameters={"force_gain": 1.03, "dead_volume": 18e-6}
    )


SHOWN = {"rad": ("deg", 180.0 / math.pi), "N": ("N", 1.0)}
"""Unit and factor in which the held-out error of the first output is shown."""


def answer(case: LeftOut, jobs: int) -> dict[str, Any]:
    """Diagnose one reduced plant; returns its verdict with what is asked of it.

    ``right`` tells whether everything found is a right answer, and something was found if it had
    to; ``collinearity`` is the share of the right effect's signature that parameters reproduce;
    ``moved`` holds the relative changes of the parameters that left their priors farthest.
    """
    model = case.nominal()
    row = {"schema": "left_out/1", "case": case.name, "physics": case.physics, "version": version()}

    def more(found: Diagnosis) -> dict[str, Any]:
        names = {str(f.effect) for f in found.verdict.findings}
        scores = found.rounds[0][0].scores if found.rounds else ()
        own = next((s for s in scores if s.entry.name in case.answers), None)
        first = next(iter(found.verdict.units))
        unit, factor = SHOWN[found.verdict.units[first]]
        estimates = {e.name: e.value / e.prior.mean - 1.0 for e in found.base.refit.estimates}
        return {
            "right": names <= set(case.answers)
            and (bool(names) or case.collinear or not case.answers),
            "collinearity": own.collinearity if own else None,
            "expected_gain": own.gain if own else None,
            "unit": unit,
            "held_out": {k: factor * v[first] for k, v in found.verdict.fit.items() if v},
            "moved": dict(sorted(estimates.items(), key=lambda e: -abs(e[1]))[:2]),
        }

    with tempfile.TemporaryDirectory() as folder:
        fit, hold_out = recordings(case, Path(folder))
        tried = None
        if case.tried:
            read = tuple(q.name for q in model.outputs if q.name in fit[0])
            tried = [e for e in library(model, RecordedFacts(read)) if e.name in case.tried]
        return diagnosed(row, model, fit, hold_out, jobs=jobs, entries=tried, more=more)


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a reduced plant."""
    verdict = row["verdict"]
    found = ", ".join(
        f"{f['effect']} ("
        + ", ".join(f"{n} {v['value']:.3g} {v['unit']}" for n, v in f["parameters"].items())
        + ")"
        for f in verdict["findings"]
    )
    if "right" not in row:
        return f"{row['case']:<30} {verdict['verdict']}: {verdict.get('failure', '')}"
    errors, reproduced = row["held_out"], row["collinearity"]
    return (
        f"{row['case']:<30} {verdict['verdict']:<16} {found or '-':<40}"
        f" {'right' if row['right'] else 'WRONG'}, held out"
        f" {errors['refitted']:.4g} -> {errors['extended']:.4g} {row['unit']}"
        + (f", parameters reproduce {100 * reproduced:.1f} %" if reproduced is not None else "")
        + f"; {', '.join(f'{n} {100 * v:+.0f} %' for n, v in row['moved'].items())}"
        f" ({row['seconds']:.0f} s)"
    )
