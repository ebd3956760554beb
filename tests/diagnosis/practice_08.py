"""The rig behind the shipped case practice-08, and a diagnosis of a part of its recordings."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from workbench.data_folder import shipped_data
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.stages import Diagnosis
from workbench.evaluation.rig import plant
from workbench.evaluation.rig.parameters import elements, nominal
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.recordings import read_case

SECONDS = 6.0
TRIED = ("muscle_hysteresis", "maxwell_slip_hysteresis", "stribeck_friction", "tilt_gravity")


def rig() -> tuple[dict[str, float], NDArray[np.float64]]:
    """Return the parameters behind the recordings and the arm at rest at 30 degrees.

    The recordings' loop shape is that of ten equal elements.
    """
    parameters = nominal(
        {
            "arm_inertia": 0.056657,
            "force_gain": 0.973045,
            "conductance": 2.767331e-8,
            "centre_leakage": 0.00245011,
            "volume_gain": 1.027254,
            "dead_volume": 1.365934e-5,
            "viscous": 0.233093,
            "coulomb": 0.346625,
            "heat_transfer": 157.9379,
            "hyst_force": 14.98781,
            "hyst_slope": 9.930904,
            **elements(0.216e-3, 4.108e-3, 10),
        }
    )
    return parameters, plant.initial(30.0, (3.0, 3.0), parameters)


@lru_cache(maxsize=1)
def diagnosed() -> Diagnosis:
    """Diagnose the first seconds of the recordings with a few effects."""
    case = read_case(shipped_data("practice-08"))
    model = case.model()
    fit_on, hold_out = (
        [r.between(0.0, SECONDS) for r in recordings.values()]
        for recordings in (case.fit, case.hold_out)
    )
    outputs = tuple(q.name for q in model.outputs if q.name in fit_on[0])
    entries = [e for e in library(model, RecordedFacts(outputs=outputs)) if e.name in TRIED]
    return diagnose(model, fit_on, hold_out, entries=entries, jobs=1)


def sine(
    frequency_hz: float, *, middle_deg: float = 30.0, amplitude_deg: float = 15.0
) -> Callable[[float], float]:
    """Return a sine in rad over time in s."""

    def reference(t: float) -> float:
        return math.radians(middle_deg + amplitude_deg * math.sin(2 * math.pi * frequency_hz * t))

    return reference
