"""Drawn machines: what differs, on both simulators, and what is told of the runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from controllers.uncertainty import Uncertainty
from workbench.errors import WorkbenchError
from workbench.evaluation.rig.plant import derivative
from workbench.evaluation.tolerance import at_rest, measured, on_rig, tolerance, tolerant_study
from workbench.evaluation.variations import KINDS, Draw, Sized, draws
from workbench.reports.figures.drawn_machines import worst_table
from workbench.reports.tolerance_page import tables, tried
from workbench.study.drawn_machines import BLIND_SEED
from workbench.study.plants import tolerated
from workbench.verification import Steps

TUNING_SEED = 11


def test_draws_are_seeded_and_those_for_tuning_are_others() -> None:
    blind = draws(52, BLIND_SEED)
    assert blind == draws(52, BLIND_SEED)
    assert all(a.parts != b.parts for a, b in zip(blind, draws(52, TUNING_SEED), strict=True))
    assert [len(d.kinds) for d in blind[:4]] == [1, 3, 1, 3]
    assert {d.kinds[0] for d in blind[::2]} == set(KINDS)
    assert all(len(set(d.kinds)) == len(d.kinds) for d in blind)
    # What was told of the arm is told of the same machines again.
    assert blind[3].kinds == ("hysteresis", "delay", "pressure lag")
    assert dict(blind[0].rig)["valve_delay"] == pytest.approx(0.002991527354)
    assert dict(blind[3].rig)["hyst_force"] == pytest.approx(17.1029101225)


@pytest.mark.long
def test_every_kind_is_named_as_both_simulators_name_it() -> None:
    recipe = tolerant_study().plant
    for one in draws(2 * len(KINDS), BLIND_SEED)[::2]:
        (part,) = one.parts
        # The rig refuses a name that it does not have; so does the plant.
        assert one.rig != draws(1, BLIND_SEED)[0].rig or one.number == 0
        built = recipe.varied(effects=part.effects).build()
        for name, value in part.own.items():
            assert built.with_parameters({name: value}).parameter(name).value == value


def test_a_rig_at_rest_stays() -> None:
    parameters = draws(8, BLIND_SEED)[6].rig
    x = at_rest(parameters, 20.0)
    rates = derivative(x, parameters["valve_centre"], parameters)
    assert math.degrees(x[0]) == pytest.approx(20.0) and abs(rates[1]) < 1e-3


def test_what_is_told_of_a_run() -> None:
    time = np.arange(0.0, 4.0, 0.002)
    deg = math.radians(1.0)
    signal = Steps((0.0, 0.5, 2.0), (20 * deg, 35 * deg, 30 * deg))
    angle = np.where(time < 0.8, 20.0, np.where(time < 2.0, 35.2, 30.0)) * deg
    angle = angle + 0.3 * deg * np.sin(60.0 * time) * (time > 3.0)
    told = measured(time, angle, 5.0 + 0.0 * time, signal)
    assert told["settling_time"] == [pytest.approx(0.3, abs=3e-3)]
    assert told["oscillation"] == pytest.approx(0.3 * deg, rel=0.05)
    assert told["steady_error"][0] == pytest.approx(0.2 * deg) and not told["stop_impacts"]
    hit = measured(time, angle - 25 * deg, 5.0 + 0.0 * time, signal)
    assert hit["stop_impacts"]


def test_the_table_counts_what_falls_short() -> None:
    def run(size: float, settling: float | None) -> dict[str, object]:
        told = {"settling_time": [0.4, settling], "oscillation": math.radians(size)}
        calm = {"steady_error": [0.0], "stop_impacts": 0.0, "chatter": 3.0, "valve_at_rest": 0.02}
        return {**told, "overshoot": 0.04, **calm}

    rows = [
        {"simulator": "rig", "draw": "a", "kinds": ["delay"], "runs": {"PID": run(0.1, 0.5)}},
        {"simulator": "rig", "draw": "b", "kinds": ["leak"], "runs": {"PID": run(0.7, None)}},
        {"simulator": "rig", "draw": "c", "kinds": ["leak"], "runs": {"PID": {"reason": "left"}}},
    ]
    reached, missed = tables(rows)  # And none of the simulator on which nothing ran.
    told = {row[0]: str(row[1]) for row in reached.rows}
    assert told["oscillation at most 0.2°"] == "1 of 3 ✗" and told["  largest (°)"] == "0.700"
    assert told["stop impacts at most 0"] == "2 of 3 ✗"
    assert told["settling time of steps of 15° at most 0.8 s"] == "1 of 3 ✗"
    assert worst_table(tried(rows)).rows[0][:2] == ("rig, b", "leak")
    # The kind that costs most comes first; what could not be run is missed too.
    assert missed.rows == (("leak", "2", "2"), ("delay", "1", "0"))


@dataclass(frozen=True)
class Refusing:
    """A controller that refuses to begin."""

    words: str

    def initial_state(self, measurement: tuple[float, ...]) -> None:
        raise WorkbenchError(self.words)


def test_runs_are_kept_for_the_designs_that_they_are_of(tmp_path: Path) -> None:
    def told(words: str, speed: float) -> str:
        law = cast(Controller, Refusing(words))
        designs = {"cascade PID": MarginedDesign(law, speed, 2.0, 2.0)}
        (row,) = tolerance({"rig": draws(1, TUNING_SEED)}, designs, tmp_path)
        return str(row["runs"]["cascade PID"]["reason"])

    said = [told("first", 8.0), told("second", 7.0), told("third", 8.0)]
    assert said == ["first", "second", "first"]


def test_the_study_tolerates_what_its_plant_declares() -> None:
    study = tolerant_study()
    loads = [dict(p.parameters).get("load") for p in tolerated(study.plant)]
    assert {1.0, 5.0} <= set(loads)
    for recipe in study.controllers.values():
        unsure = recipe.fastest.uncertainty
        assert unsure.delay == (0.0, 0.008) and unsure.sensor_lag == (0.0, 0.01)
        assert len(recipe.fastest.plants) == 6


@pytest.mark.long
@pytest.mark.parametrize("name", ["state feedback", "cascade PID"])
def test_a_design_for_an_identified_machine_is_as_fast_as_one_without_latency(name: str) -> None:
    # 8 ms late and with lines of a third of the valve: the delay is known to half a millisecond.
    study = tolerant_study()
    recipe = study.controllers[name]
    known = replace(
        recipe.fastest,
        uncertainty=Uncertainty.known(0.008),
        plants=recipe.fastest.plants[:1],
        speeds=(50.0, 10.0, 25),
        maximum_sensitivity=2.2,
        maximum_complementary=2.0,
    )
    given = {"compensation": 0.5, "jerk_limit": 1200.0, "jerk_share": 0.5}
    given |= {"lag": 0.005, "lead": 0.0085}
    recipe = replace(recipe, inertia_margin=(), specification=tuple(given.items()))
    law = replace(recipe, fastest=known).build()
    late = Sized({"valve_delay": 0.008, "line_conductance": 1e-8, "line_volume": 15e-6}, {})
    told = on_rig(law, Draw(0, ("late",), 3.0, (late,)), study.scenarios["steps"])
    assert max(told["settling_time"]) <= 0.27 and told["overshoot"] <= 0.05
    assert told["oscillation"] <= math.radians(0.1)
