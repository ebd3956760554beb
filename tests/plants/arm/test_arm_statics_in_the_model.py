"""Static figures read off the whole model, not off its laws one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from workbench.errors import WorkbenchError
from workbench.evaluation.rig import parameters
from workbench.evaluation.rig import plant as rig_plant
from workbench.evaluation.rig.plant import namespace
from workbench.plants.arm import arm
from workbench.simulation import simulate

ATMOSPHERE = 101_325.0


def acceleration(load: float, angle_deg: float, p1: float, p2: float, plane: str) -> float:
    model = arm(load, plane=plane)  # type: ignore[arg-type]
    state = model.initial_state(
        {
            "angle": np.radians(angle_deg),
            "pressure_1": p1 + ATMOSPHERE,
            "pressure_2": p2 + ATMOSPHERE,
        }
    )
    return float(model.rates(state, [5.0])[7])


@pytest.mark.parametrize(
    ("angle_deg", "p1_bar"),
    [(0.001, 1.42), (10, 2.00), (20, 2.54), (30, 3.00), (40, 3.46), (50, 4.00), (59.999, 4.58)],
)
def test_equilibria_with_six_bar_in_both_muscles(angle_deg: float, p1_bar: float) -> None:
    p1 = brentq(
        lambda p: acceleration(3.0, angle_deg, p, 6e5 - p, "horizontal"), 0.5e5, 5.5e5, xtol=10.0
    )
    assert p1 / 1e5 == pytest.approx(p1_bar, abs=0.006)  # printed to 0.01 bar


def test_eight_plates_rise_with_six_bar_and_rest_on_the_stop_with_three() -> None:
    assert acceleration(8.0, 0.01, 6e5, 0.0, "vertical") > 0.0
    assert acceleration(8.0, 0.01, 3e5, 0.0, "vertical") < 0.0


@pytest.mark.parametrize(("load", "plane"), [(8.0, "vertical"), (3.0, "horizontal")])
def test_load_cell_reads_what_the_torques_leave(load: float, plane: str) -> None:
    # Sealed muscles, arm pressed on the lower stop until it rests there.
    model = arm(load, plane=plane).without("centre_leakage")  # type: ignore[arg-type]
    start = {"angle": 0.0, "pressure_1": 1e5 + ATMOSPHERE, "pressure_2": 4e5 + ATMOSPHERE}
    run = simulate(model, np.full(1500, 5.0), sample_time=0.002, start=start)
    angle, measurement = float(run["angle"][-1]), float(run["load_cell"][-1])
    assert abs(run["speed"][-1]) < 1e-5
    space = namespace(parameters.nominal({"load": load, "vertical": float(plane == "vertical")}))
    expected = -rig_plant.gravity(angle, load, space)
    for k, (own, sign) in enumerate(((angle, 1.0), (rig_plant.SPAN - angle, -1.0))):
        fibre = rig_plant.distance(own) - rig_plant.FITTINGS
        force = rig_plant.force(fibre, float(run[f"pressure_{k + 1}"][-1]), 1.0, space)
        expected += sign * force * rig_plant.distance_slope(own)
    assert measurement * 0.367 == pytest.approx(expected, rel=1e-4)
    # The stop is a spring: it is compressed by just that torque.
    assert -2e4 * angle == pytest.approx(expected, rel=1e-3)


def test_an_unpressurised_arm_is_slack_and_says_so_with_small_forces() -> None:
    start = {"pressure_1": ATMOSPHERE, "pressure_2": ATMOSPHERE, "speed": 1.0}
    model = arm(3.0).without("centre_leakage")
    run = simulate(model, np.full(500, 5.0), sample_time=0.002, start=start)
    forces = np.array([run["muscle_1.force"], run["muscle_2.force"]])
    assert forces.min() >= 0.0
    assert forces.max() < 60.0  # the sealed gas is compressed a little as the arm moves
    assert run.error < 1e-4


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"load_kg": 12.0}, "load is 12 kg; the valid range is 0 to 8 kg"),
        ({"load_kg": float("nan")}, "load is nan"),
        ({"load_kg": "three"}, "not a number"),
        ({"plane": "vertcal"}, "did you mean 'vertical'?"),
        ({"supply_bar": 60.0}, "2 to 10 bar"),
        ({"variant": "printed"}, "did you mean 'as_printed'?"),
        ({"force_law": "tondu"}, "must be one of"),
        ({"valve_curve": "liner"}, "did you mean 'linear'?"),
    ],
)
def test_mistakes_are_one_clear_sentence(arguments: dict[str, object], text: str) -> None:
    with pytest.raises(WorkbenchError) as caught:
        arm(**arguments)  # type: ignore[arg-type]
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
