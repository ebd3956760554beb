"""The proposed experiment, made on the independent rig, separates what it was predicted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from tests.diagnosis.machine_data import recording
from workbench.arrays import Vector
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    extended_start,
    fit_with_process_noise,
)
from workbench.diagnosis.experiment.next_experiment import separate
from workbench.diagnosis.experiment.separation import Explanation, Separation
from workbench.evaluation.rig import plant, simulate
from workbench.evaluation.rig.cases import settled
from workbench.evaluation.rig.parameters import nominal, switch_on
from workbench.model import Model
from workbench.physics.library import library
from workbench.plants.arm import arm
from workbench.recordings.recording import Recording

RATE = 500.0


def rig(effects: list[str], load: float, sizes: Mapping[str, float]) -> dict[str, float]:
    """Parameters of a rig that differs from nominal by the effects alone."""
    return switch_on(nominal({"load": load}), effects, dict(sizes))


def recorded(
    p: dict[str, float], name: str, seed: int, *, reference: Vector | None = None,
    command: Vector | None = None,
) -> Recording:  # fmt: skip
    """A recording of the rig in SI."""
    start = settled(p, seconds=2.0)
    if reference is not None:
        bars = [float(b) / 1e5 for b in plant.gauge(start, p)]
        start = plant.initial(30.0, (float(np.mean(bars)),) * 2, p)
    r = simulate.run(p, start, command=command, reference=reference, seed=seed)
    read = {
        "angle [rad]": np.radians(r.angle),
        "pressure_1 [Pa]": 1e5 * r.pressure_1,
        "pressure_2 [Pa]": 1e5 * r.pressure_2,
    }
    return recording(name, 1.0 / RATE, {"valve [V]": r.valve}, read)


@dataclass(frozen=True)
class Rival:
    """One of two effects that explain a recording about equally well."""

    name: str
    model: Model
    priors: tuple[Prior, ...]
    start: dict[str, float]

    @classmethod
    def of(cls, nominal_model: Model, name: str, size: float) -> Rival:
        entry = next(e for e in library(nominal_model) if e.name == name)
        model = nominal_model.with_effect(entry.effect)
        own = f"{name}.{entry.size_parameter}"
        q = model.parameter(own)
        prior = Prior(own, 0.0, entry.largest_size, q.lower, q.upper)
        return cls(name, model, (*default_priors(nominal_model), prior), {own: size})

    def fitted(
        self, nominal_model: Model, seen: list[Observed], scale: float = 1.0
    ) -> ProcessNoiseFit:
        started = [extended_start(r, nominal_model, self.model) for r in seen]
        return fit_with_process_noise(
            self.model,
            started,
            self.priors,
            start=self.start,
            noise_scale=scale,
            follow=scale >= 1.0,
        )


def proved(
    p: dict[str, float], load: float, rivals: list[tuple[str, float]], narrow: Recording
) -> tuple[float, float, Separation]:
    """Fit both rivals, make the proposed experiment, and refit both with it.

    Returns the difference of log likelihood before and after, and what was predicted.
    """
    model = arm(load_kg=load)
    seen = [observe(model, narrow)]
    both = [Rival.of(model, *rival) for rival in rivals]
    fits = [rival.fitted(model, seen) for rival in both]
    before = fits[1].cost - fits[0].cost
    explanations = [Explanation(r.name, f) for r, f in zip(both, fits, strict=True)]
    ranked = separate(explanations, seen, model)
    # Played as it is, so that the rig's own controller does not matter.
    best = next(s for s in ranked if not s.experiment.settings)
    made = recorded(p, "proposed", 7, command=best.experiment.inputs[:, 0])
    seen.append(observe(model, made))
    assert fits[0].noise_scale == fits[1].noise_scale
    after = [rival.fitted(model, seen, fits[0].noise_scale) for rival in both]
    return before, after[1].cost - after[0].cost - before, best


def slow_sine(seconds: float, amplitude: float) -> Vector:
    t = np.arange(round(seconds * RATE)) / RATE
    return np.asarray(30.0 + amplitude * np.sin(2 * np.pi * 0.25 * t))


@pytest.mark.long
def test_tilt_is_told_from_a_constant_torque() -> None:
    p = rig(["tilt"], 3.0, {"tilt": 0.06})
    narrow = recorded(p, "narrow", 1, reference=slow_sine(6.0, 3.0))
    rivals = [("tilt_gravity", 0.05), ("constant_torque", -0.5)]
    before, gain, predicted = proved(p, 3.0, rivals, narrow)
    # Look-alikes: this recording may just tell them apart, one like it would not be trusted to.
    assert before < 40.0
    assert predicted.sigma > 3.0
    assert gain > 4.5
    assert 0.3 * predicted.gain < gain < 3.0 * predicted.gain
