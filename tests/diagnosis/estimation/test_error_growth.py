"""Growth of small errors along recordings, beside eigenvalues in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.arrays import Vector
from workbench.diagnosis.estimation.error_growth import growth_along
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.model import Model
from workbench.model.trace import Expression, Names
from workbench.recordings.recording import Recording

STEP, SAMPLES, DAMPING = 0.05, 600, 0.4


def _strut(stiffness: float, hardening: float) -> Model:
    """Return a strut of unit mass; it has buckled where its stiffness is negative."""

    def rates(m: Names) -> tuple[dict[str, Expression], dict[str, Expression]]:
        bend, speed = m.x.bend, m.x.speed
        force = -m.p.stiffness * bend - hardening * bend**3 - DAMPING * speed + m.u.push
        return {"bend": speed, "speed": force}, {"bend": bend}

    return machine(
        rates,
        "bend m 1 scale=1, speed m/s scale=1",
        "push N scale=1",
        "bend m 1e-3 scale=1",
        f"stiffness N/m {stiffness} -3 3",
    )


def _held(stiffness: float, hardening: float, places: Vector) -> Recording:
    """Return what another integrator says, with a controller that leads the strut to places."""
    rng = np.random.default_rng(1)
    x, rows = np.array([1.0, 0.0]), []
    for place in places:
        push = 4.0 * (place - x[0]) - 3.0 * x[1]
        rows.append((push, x[0] + 1e-3 * rng.normal()))

        def rate(t: float, x: Vector, push: float = push) -> tuple[float, float]:
            del t
            return x[1], -stiffness * x[0] - hardening * x[0] ** 3 - DAMPING * x[1] + push

        x = solve_ivp(rate, (0.0, STEP), x, rtol=1e-8, atol=1e-10).y[:, -1]
    push, bend = np.array(rows).T
    return recording("held", STEP, {"push [N]": push}, {"bend [m]": bend})


@pytest.mark.parametrize(
    ("stiffness", "hardening", "wanted"),
    # Beside its well for a while, then on top of the hill between the two.
    [(2.0, 0.0, -DAMPING / 2), (-1.0, 1.0, -DAMPING / 2 + math.hypot(DAMPING / 2, 1.0))],
)
def test_growth_is_that_of_the_worst_place(
    stiffness: float, hardening: float, wanted: float
) -> None:
    places = np.where(np.arange(SAMPLES) < SAMPLES // 2, 1.0, 0.0)
    model = _strut(stiffness, hardening)
    seen = observe(model, _held(stiffness, hardening, places))
    fit = fit_with_process_noise(model, [seen], default_priors(model))
    found = growth_along(fit, seen)
    assert seen.growth == pytest.approx(-DAMPING / 2, rel=1e-6)
    assert found.growth == pytest.approx(wanted, rel=0.02)
    assert found.drifts == found.diverges == (wanted > 0.0)
