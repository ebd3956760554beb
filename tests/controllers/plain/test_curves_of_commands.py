"""Plain laws that send their commands through the inverses of curves."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.design import DESIGNS
from controllers.plain.mpc import design_plain_mpc
from controllers.plain.state_feedback import design_plain_sliding_mode
from controllers.sensitivity import peak_sensitivities
from tests.controllers.in_c import InC
from workbench.linearisation import LinearModel, linearise
from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.verification import metrics, step_scenario, verify


def filled_tank(lag: float = 3.0) -> Model:
    """A tank that is filled through an equal-percentage valve behind a positioner."""

    def equations(m: Scope) -> Equations:
        p, x = m.p, m.x
        flow = 5e-3 * 50.0 ** (x.position - 1.0) - 4e-4 * np.sqrt(2.0 * 9.81 * x.level)
        return {
            "position": (m.u.valve - x.position) / p.lag,
            "level": flow / 0.2,
        }, {"level": x.level}

    return Model(
        "filled tank",
        equations,
        states=(State("position", "1", 1.0, initial=0.7), State("level", "m", 0.5, initial=0.5)),
        inputs=(Input("valve", "1", 1.0, lower=0.0, upper=1.0),),
        outputs=(Output("level", "m", 0.5, noise_rms=1e-3, display_unit="m"),),
        parameters=(Parameter("lag", "s", value=lag),),
    )


def at_rest(model: Model, **at: float) -> LinearModel:
    return linearise(operating_point(model, at), verdict=False)


def designed(name: str, linear: LinearModel) -> Any:
    design = DESIGNS.get(name)
    return design.function(linear, design.specification(sample_time=1.0))  # type: ignore[misc]


@pytest.mark.parametrize("lag", [0.2, 3.0])
def test_a_valve_is_used_for_what_all_of_it_does(lag: float) -> None:
    # By the slope of the valve at rest, 32 and 41 s.
    model = filled_tank(lag)
    law = designed("plain-pid", at_rest(model, level=0.5))
    step = step_scenario("level", 0.5, 0.75, hold=200.0, sample_time=1.0)
    found = metrics(verify(law, model, step))
    assert found["settling_time"].value < 28.0
    assert found["overshoot"].value < 0.02


def test_margins_elsewhere_are_those_of_the_curve_and_its_inverse() -> None:
    model = filled_tank()
    law = designed("plain-pid", at_rest(model, level=0.5))
    here, there = (peak_sensitivities(law, at_rest(model, level=level))[0] for level in (0.5, 0.8))
    assert there == pytest.approx(here, rel=0.03)


@pytest.mark.parametrize(("name", "lag"), [("plain-pid", 3.0), ("lqi", 0.2), ("plain-mpc", 0.2)])
def test_in_c_a_curve_is_inverted_alike(name: str, lag: float, tmp_path: Path) -> None:
    law = designed(name, at_rest(filled_tank(lag), level=0.5))
    exported, state = InC(law, tmp_path), law.initial_state((0.5,))
    exported.start((0.5,))
    for k in range(60):
        seen, asked = (0.5 + 0.1 * math.sin(0.2 * k),), (0.5 + 0.3 * (k > 5) - 0.4 * (k > 30),)
        command, state, _ = law.step(state, seen, asked)
        exported.step(seen, asked)
        assert exported.command[0] == pytest.approx(command[0], abs=1e-12)


def test_the_arm_is_led_through_the_curve_of_its_valve() -> None:
    # By the slope at rest, a tenth of that of all of the valve, neither settled.
    model = arm(3)
    linear = at_rest(model.without("bearing_friction"), angle=math.radians(15))
    for design in (design_plain_mpc, design_plain_sliding_mode):
        found = metrics(verify(design(linear), model, step_scenario("angle", 15, 45, unit="deg")))
        assert found["settling_time"].value < 0.6
        assert found["overshoot"].value < 0.08
