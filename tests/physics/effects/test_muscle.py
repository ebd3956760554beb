"""Effects of the muscle: creep, tendons, other shapes of the force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.physics.effects.bench import bench, offered, run
from workbench.physics.braided_muscle import series_elasticity
from workbench.physics.creep import creep
from workbench.physics.force_laws import PaperLaw
from workbench.physics.muscle_volume import BraidedCylinder
from workbench.physics.offset_gain import gain
from workbench.plants.arm import arm, pneumatic_muscle
from workbench.plants.arm.laws import (
    phi_term,
)
from workbench.simulation import simulate

TENSION = ("muscle.tension",)
SERIES = [("muscle.length", "chamber.volume_rate", "muscle.force")]


def test_creep_starts_short_and_reaches_the_whole() -> None:
    effect = creep(
        ("muscle.force",), share=0.1, slow_part=0.4, time_constant=0.5, slow_time_constant=5.0
    )
    model = bench(effect, "N")
    times = np.linspace(0.0, 30.0, 1501)
    step = run(model, lambda t: {"value": 100.0 if t > 0 else 0.0}, times)
    exact = 100.0 * (1 - 0.1 * (0.6 * np.exp(-times / 0.5) + 0.4 * np.exp(-times / 5.0)))
    # The step is taken within the first sample of 20 ms.
    np.testing.assert_allclose(step[1:], exact[1:], atol=0.5)
    assert step[1] == pytest.approx(90.0, abs=0.5)
    assert step[-1] == pytest.approx(100.0, abs=0.02)


def test_creep_starts_settled() -> None:
    model = arm(3.0).with_effect(creep(share=0.1))
    x = model.initial_state({"pressure_1": 5e5})
    base = arm(3.0).rates(arm(3.0).initial_state({"pressure_1": 5e5}), [5.0])
    np.testing.assert_allclose(model.rates(x, [5.0])[: len(base)], base, rtol=1e-9)


def test_a_tendon_stretches_until_its_force_is_that_of_the_shorter_muscle() -> None:
    """Its gas gives way too: locked at both ends and shut, the muscle keeps its mass of gas."""
    law, braid, length, compliance = PaperLaw(), BraidedCylinder(), 0.188, 7e-6
    ambient, dead = 101325.0, 15e-6
    model = pneumatic_muscle().with_effect(series_elasticity(SERIES, compliance=compliance))
    shut = np.tile([length, 0.0, 0.0], (3001, 1))
    begin = {"pressure": 4e5 + ambient, "series_elasticity.pull": 0.0}
    run = simulate(model, shut, sample_time=1e-3, start=begin)
    # It began at full length, and as warm as its wall, to which it returns.
    amount = (4e5 + ambient) * (float(braid.volume(length)) + dead)

    def excess(force: float) -> float:
        shorter = length - compliance * force
        pressure = amount / (float(braid.volume(shorter)) + dead) - ambient
        return float(law.tension(0.2 - shorter, pressure)) - force

    settled = brentq(excess, 0.0, 2000.0)
    assert run["force"][-1] == pytest.approx(settled, rel=1e-3)
    assert settled < 0.9 * float(law.tension(0.2 - length, 4e5))
    assert offered(pneumatic_muscle(), "series_elasticity").ports == SERIES[0]


def test_a_damped_muscle_in_series_with_its_tendon_yields_as_a_book_says() -> None:
    """Shut, and pulled to and fro: a series element behind a spring beside a damper (Hill 1938)."""
    law, compliance, viscosity = PaperLaw(), 7e-6, 900.0
    model = pneumatic_muscle().with_effect(
        series_elasticity(SERIES, compliance=compliance, viscosity=viscosity)
    )
    times = np.arange(0.0, 0.6, 1e-4)

    def moved(t: Any) -> tuple[Any, Any]:
        return 0.188 + 0.002 * np.sin(25.0 * t), 0.05 * np.cos(25.0 * t)

    inputs = np.column_stack([*moved(times), np.zeros_like(times)])
    begin = {"pressure": 5e5, "series_elasticity.pull": 0.0}
    run = simulate(model, inputs, sample_time=1e-4, start=begin)

    def yields(t: float, s: Any) -> Any:
        pressure = float(np.interp(t, run.time, run["pressure"]))
        stretched = (moved(t)[0] - s[0]) / compliance
        return [(stretched - float(law.tension(0.2 - s[0], pressure))) / viscosity]

    book = solve_ivp(yields, (0.0, times[-1]), [0.188], t_eval=times, rtol=1e-8, atol=1e-10)
    force = (moved(times)[0] - book.y[0]) / compliance
    late = times > 0.1
    error = run["force"][: len(times)][late] - force[late]
    assert np.ptp(force[late]) > 100.0 and np.abs(error).max() < 0.01 * np.ptp(force[late])


def test_phi_completes_petrovic_to_the_papers_law() -> None:
    incomplete = arm(3.0, force_law="petrovic").with_effect(phi_term())
    complete = arm(3.0)
    x = complete.initial_state({"angle": 0.8})
    np.testing.assert_allclose(incomplete.rates(x, [5.0]), complete.rates(x, [5.0]), rtol=1e-9)


def test_a_gain_of_both_muscles_is_the_plants_own() -> None:
    both = arm(3.0).with_effect(gain(("muscle_1.force", "muscle_2.force"), excess=0.1))
    own = arm(3.0).with_parameters({"force_gain": 1.1})
    x = own.initial_state({"pressure_1": 5e5})
    np.testing.assert_allclose(both.rates(x, [5.0]), own.rates(x, [5.0]), rtol=1e-9)
