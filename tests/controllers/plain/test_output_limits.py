"""Outputs that a linear MPC for any plant shall keep between two values."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.plain.mpc import PlainMPCSpecification, design_plain_mpc
from tests.controllers.in_c import agrees
from tests.machines import at_rest, machine
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.verification import metrics, step_scenario, verify


def cart() -> Model:
    return machine(
        lambda m: ({"x": m.x.v, "v": m.u.f - 0.5 * m.x.v}, {"x": m.x.x, "v": m.x.v}),
        "x m scale=0.5, v m/s scale=0.5",
        "f N -2 2",
        "x m 1e-4 scale=0.5, v m/s 1e-3 scale=0.5",
    )


@pytest.fixture(scope="module")
def linear() -> LinearModel:
    return at_rest(cart(), x=0.0)


def limited(linear: LinearModel, *limits: Any) -> Any:
    wanted = PlainMPCSpecification("x", sample_time=0.02, speed=6.0, output_limits=limits)
    return design_plain_mpc(linear, wanted)


def test_another_output_stays_within_its_limits(linear: LinearModel, tmp_path: Path) -> None:
    asked = step_scenario("x", 0.0, 0.5, hold=4.0, sample_time=0.02, back=True)
    free, held = limited(linear), limited(linear, ("v", "-30 cm/s", math.inf))
    assert (free.sensors, held.sensors) == (("x",), ("x", "v"))
    runs = [verify(law, cart(), asked) for law in (free, held)]
    # Noise of the sensor and what is foreseen every other sample are 3 % of it.
    assert runs[0]["v"].min() < -0.6
    assert runs[1]["v"].min() == pytest.approx(-0.3, rel=0.03)
    assert runs[1]["v"].max() > 0.6
    found = metrics(runs[1])
    # 0.5 m at 0.3 m/s take 1.67 s.
    assert 1.6 < found["settling_time"].value < 2.0
    assert found["fallbacks"].value == 0.0
    k = np.arange(60)
    measured = np.column_stack([0.2 * np.sin(0.1 * k), 0.3 * np.cos(0.1 * k)])
    agrees(held, tmp_path, measured.tolist(), (0.4 * (k[:, None] < 30)).tolist(), 1e-9)


@pytest.mark.long
def test_the_followed_output_goes_no_further_than_its_limit(linear: LinearModel) -> None:
    law = limited(linear, ("x", -1.0, 0.4))
    asked = step_scenario("x", 0.0, 0.5, hold=4.0, sample_time=0.02)
    assert verify(law, cart(), asked)["x"].max() == pytest.approx(0.4, abs=0.005)


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        (("w", 0.0, 1.0), "limited output is 'w'"),
        (("v", 0.1, 1.0), "v at rest is 0; the valid range is 0.1 to 1; limits hold what rests"),
        (("v", 1.0, -1.0), r"output_limits holds \('v', 1.0, -1.0\); give each"),
        (("v", 1.0), r"output_limits holds \('v', 1.0\); give each"),
        (("v", "2 cm/s", "-20 mm/s"), r"output_limits holds \('v', 0.02, -0.02\); give each"),
        (("v", "-3 N", "3 N"), "limit of v '-3 N' has the unit 'N', which does not measure it"),
        ("v", "output_limits holds 'v'; give each"),
    ],
)
def test_limits_that_cannot_be_are_a_sentence(limits: Any, told: str, linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match=told):
        limited(linear, limits)
