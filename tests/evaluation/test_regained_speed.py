"""Speed lost to what was not known of a machine, and regained from what was found."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from workbench.cli.redesign import _beside_tolerant
from workbench.errors import WorkbenchError
from workbench.evaluation import regained_speed
from workbench.evaluation.regained_speed import (
    WHICH,
    Redesigned,
    flow_share,
    nominal_recipe,
    redesigned_recipe,
    study_of_redesign,
)
from workbench.evaluation.tolerance import tolerant_study
from workbench.plants.arm.arm import ARM
from workbench.reports.figures.study_traces import shades_of
from workbench.study.designs import ControllerRecipe
from workbench.study.plants import PlantRecipe
from workbench.study.result import run_study

LINES = (("lines.share", 1.0), ("lines.conductance", 1e-8), ("lines.volume", 15e-6))


def late() -> PlantRecipe:
    """Return a machine that is 8 ms late, with lines of a third of the valve."""
    found = ("valve_delay.time", 0.008)
    plant = tolerant_study().plant
    return plant.varied(effects=["valve_delay", "lines"], parameters=[found, *LINES])


def test_a_line_of_a_third_of_the_valve_leaves_a_third_of_the_flow() -> None:
    nominal = tolerant_study().plant.build()
    assert flow_share(late().build(), nominal, ARM) == pytest.approx(1.0 / 3.0, abs=0.08)
    assert flow_share(nominal, nominal, ARM) == pytest.approx(1.0)


@pytest.mark.long
def test_the_rules_of_a_redesign_are_those_of_the_nominal_designs() -> None:
    recipe = nominal_recipe("cascade PID", late())
    assert recipe.fastest is not None and recipe.fastest.maximum_sensitivity == 2.0
    assert not recipe.plant.build().dry_effects
    with pytest.raises(WorkbenchError, match="controller"):
        nominal_recipe("fuzzy", late())


def test_what_one_family_cannot_do_costs_no_other_its_result(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missed(_: object) -> None:
        raise WorkbenchError("no speed meets the limits")

    monkeypatch.setattr(Redesigned, "designed", missed)
    found = SimpleNamespace(speed=9.0, limit="")
    monkeypatch.setattr(ControllerRecipe, "designed", lambda _: found)
    study = _beside_tolerant(cast(Any, SimpleNamespace(recipe=late())), ["cascade PID"])
    assert list(study.controllers) == ["cascade PID, nominal", "cascade PID, tolerant"]
    assert "redesigned: no speed meets the limits." in capsys.readouterr().out


def test_a_redesign_may_be_as_slow_as_what_tolerates_more() -> None:
    own = redesigned_recipe("cascade PID", late()).fastest
    tolerant = tolerant_study().controllers["cascade PID"].fastest
    assert own is not None and tolerant is not None
    assert own.speeds[1] == tolerant.speeds[1] < 10.0 and own.speeds[2] > 25


def test_a_wrong_family_is_told_before_any_design(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regained_speed, "nominal_recipe", lambda *_: pytest.fail("designed"))
    with pytest.raises(WorkbenchError, match="family of controllers is 'fuzzy'"):
        study_of_redesign(late(), ["state feedback", "fuzzy"])


def test_the_study_sets_the_three_designs_of_a_family_side_by_side() -> None:
    study = study_of_redesign(late(), ["state feedback"])
    nominal, tolerant, own = (f"state feedback, {which}" for which in WHICH)
    assert [list(case.controllers) for case in study.cases.values()] == [[nominal], [tolerant, own]]
    plants = [case.plant for case in study.cases.values()]
    assert plants[1] == late() and "lines" not in plants[0].effects
    # One family has one colour, and the same steps on both plants.
    assert len(set(shades_of(study).values())) == 1
    (scenario,) = study.scenarios.values()
    assert scenario == next(iter(tolerant_study().scenarios.values()))
    assert [(v.name, c) for v, c, _, _ in study.runs()] == [
        ("nominal plant", nominal),
        ("machine that was found", tolerant),
        ("machine that was found", own),
    ]
    made = study.controllers[own]
    assert isinstance(made, Redesigned) and made.fastest is not None
    # It predicts over the latency, and half a millisecond of it is not known.
    assert made.fastest.uncertainty.delay == pytest.approx((0.0075, 0.0085))


def test_what_arrives_late_bounds_the_inner_loop_and_the_horizon() -> None:
    inner = dict(redesigned_recipe("H-infinity", late()).specification)["inner_bandwidth"]
    horizon = dict(redesigned_recipe("linear MPC", late()).specification)["prediction_time"]
    # Dead time of 8 ms, and lines, spool and sample of some 4 ms.
    assert 1.0 / 0.013 < inner < 1.0 / 0.011
    assert horizon == pytest.approx(0.012)
    known = dict(redesigned_recipe("H-infinity", tolerant_study().plant).specification)
    assert known["inner_bandwidth"] == 120.0


@pytest.mark.long
@pytest.mark.parametrize("family", tolerant_study().controllers)
def test_what_was_found_gives_the_speed_back(family: str, tmp_path: Path) -> None:
    study = study_of_redesign(late(), [family])
    result = run_study(study, tmp_path, progress=lambda *_: None)
    nominal, tolerant, own = (
        max(v.value for v in record.values_of_steps("settling_time", math.radians(15.0)))
        for record in result.records
    )
    # A third of the flow costs a factor 3^(1/3), the latency 8 ms.
    assert own <= nominal * 3.0 ** (1.0 / 3.0) + 0.008
    assert own <= 0.5 * tolerant
