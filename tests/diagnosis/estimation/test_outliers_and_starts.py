"""Refits that begin where their errors tell little: among outliers, from a start that creeps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.arrays import Vector
from workbench.diagnosis.estimation import refit as refitting
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.refit import refit
from workbench.model import Scope
from workbench.model.trace import Equations


def _held(
    rates: Callable[[Vector, float], list[float]], start: list[float], inputs: Vector, step: float
) -> Vector:
    """Integrate a machine whose inputs are held, by another code than the workbench's."""
    states = [np.array(start)]
    for u in inputs[:-1]:
        run = solve_ivp(lambda _, x, u=u: rates(x, u), (0.0, step), states[-1], rtol=1e-8)
        states.append(run.y[:, -1])
    return np.array(states)


def _iron(m: Scope) -> Equations:
    passed = m.p.contact * (m.x.heater - m.x.tip)
    return (
        {
            "heater": (48.0 * m.u.duty - passed - m.p.handle * m.x.heater) / m.p.heater_heat,
            "tip": (passed - m.p.loss * m.x.tip) / m.p.tip_heat,
        },
        {"tip": m.x.tip},
    )


IRON = machine(
    _iron,
    "heater K scale=300, tip K scale=300",
    "duty 1 scale=1",
    "tip K 0.02 scale=300",
    "contact W/K 1.2 0.1 10, handle W/K 0.02 0 0.2, loss W/K 0.05 0 0.5, heater_heat J/K 6 1 30,"
    " tip_heat J/K 9 1 40",
)
"""A soldering iron above the room; of heater and tip only the tip is read."""


def _heated(*, start: float = 0.0, noise: float = 0.02) -> Observed:
    rng = np.random.default_rng(1)
    duty = np.repeat(rng.uniform(0.0, 1.0, 12), 50)

    def rates(x: Vector, duty: float) -> list[float]:
        passed = 1.3 * (x[0] - x[1])
        return [(48.0 * duty - passed - 0.025 * x[0]) / 5.5, (passed - 0.03 * x[1]) / 8.0]

    tip = _held(rates, [start, start], duty, 0.5)[:, 1] + noise * rng.normal(size=600)
    return observe(IRON, recording("iron", 0.5, {"duty [1]": duty}, {"tip [K]": tip}))


def test_where_all_is_an_outlier_a_step_weighs_errors_as_they_cost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By least squares a step goes 25 times too far: none is taken."""
    seen, far = [_heated()], {"contact": 0.3}
    found = refit(IRON, seen, stages=(0.03,), start=far)
    assert found.whiteness["tip"] == pytest.approx(1.0, abs=0.2)
    monkeypatch.setattr(refitting, "_AS_OUTLIERS", 0)
    stuck = refit(IRON, seen, stages=(0.03,), start=far)
    assert stuck.values["contact"] == 0.3 and stuck.cost > found.cost + 1000.0


@pytest.mark.parametrize("slope", [0.06, 0.04, 0.0])
def test_what_creeps_from_the_first_sample_on_begins_where_a_line_through_it_does(
    slope: float,
) -> None:
    """The mean of three samples is a later value: 3.5 and more of its deviations away."""
    rng, off = np.random.default_rng(3), []
    for _ in range(200):
        tip = slope * np.arange(20) + 0.02 * rng.normal(size=20)
        seen = observe(IRON, recording("r", 0.5, {"duty [1]": np.zeros(20)}, {"tip [K]": tip}))
        off.append(seen.start[1] / seen.start_rms[1])
    assert abs(np.mean(off)) < 1.0
    assert 0.8 < np.std(off) < 2.0
