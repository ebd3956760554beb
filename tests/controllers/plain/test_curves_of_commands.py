"""Plain laws that send their commands through the inverses of curves."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from controllers.sensitivity import peak_sensitivities
from tests.controllers import families
from tests.controllers.in_c import agrees
from tests.machines import at_rest, machine, stepped
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.plants.arm import arm


def filled_tank(lag: float = 3.0) -> Model:
    """A tank that is filled through an equal-percentage valve behind a positioner."""

    def equations(m: Scope) -> Equations:
        p, x = m.p, m.x
        flow = 5e-3 * 50.0 ** (x.position - 1.0) - 4e-4 * np.sqrt(2.0 * 9.81 * x.level)
        rates = {"position": (m.u.valve - x.position) / p.lag, "level": flow / 0.2}
        return rates, {"level": x.level}

    return machine(
        equations,
        "position 1 0.7 scale=1, level m 0.5 scale=0.5",
        "valve 1 0 1 scale=1",
        "level m 1e-3 scale=0.5 display_unit=m",
        f"lag s {lag}",
    )


designed = partial(families.designed, sample_time=1.0)


@pytest.mark.parametrize("lag", [0.2, 3.0])
def test_a_valve_is_used_for_what_all_of_it_does(lag: float) -> None:
    # By the slope of the valve at rest, 32 and 41 s.
    model = filled_tank(lag)
    law = designed("plain-pid", at_rest(model, level=0.5))
    found = stepped(law, model, "level", 0.5, 0.75, hold=200.0)
    assert found["settling_time"] < 28.0 and found["overshoot"] < 0.02


def test_margins_elsewhere_are_those_of_the_curve_and_its_inverse() -> None:
    model = filled_tank()
    law = designed("plain-pid", at_rest(model, level=0.5))
    here, there = (peak_sensitivities(law, at_rest(model, level=level))[0] for level in (0.5, 0.8))
    assert there == pytest.approx(here, rel=0.03)


@pytest.mark.parametrize(("name", "lag"), [("plain-pid", 3.0), ("lqi", 0.2), ("plain-mpc", 0.2)])
def test_in_c_a_curve_is_inverted_alike(name: str, lag: float, tmp_path: Path) -> None:
    law = designed(name, at_rest(filled_tank(lag), level=0.5))
    k = np.arange(60)
    measured, asked = 0.5 + 0.1 * np.sin(0.2 * k), 0.5 + 0.3 * (k > 5) - 0.4 * (k > 30)
    agrees(law, tmp_path, measured[:, None].tolist(), asked[:, None].tolist(), 1e-12)


@pytest.mark.long
def test_the_arm_is_led_through_the_curve_of_its_valve() -> None:
    # By the slope at rest, a tenth of that of all of the valve, neither settled.
    model = arm(3)
    linear = at_rest(model.without("bearing_friction"), angle=math.radians(15))
    for name in ("plain-mpc", "plain-sliding-mode"):
        law = families.designed(name, linear)
        found = stepped(law, model, "angle", 15, 45, unit="deg")
        assert found["settling_time"] < 0.6 and found["overshoot"] < 0.08
