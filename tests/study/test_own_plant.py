"""A study on a plant, a design and a metric that stand beside the study file."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from workbench.errors import WorkbenchError
from workbench.reports.study_page import write_study_files
from workbench.study.read import load_study, read_study
from workbench.study.result import run_study

RIG = """
from controllers.plain.transfer_law import pid_by_hand
from workbench.model import Input, Model, Output, Parameter, State
from workbench.verification import Metric

def tank():
    return Model("tank",
        lambda m: (
            {"level": (m.u.pump - m.x.level) / m.p.time_constant}, {"level": m.x.level}),
        states=(State("level", "m", 1.0),),
        inputs=(Input("pump", "m", 1.0, lower=0.0, upper=2.0),),
        outputs=(Output("level", "m", 1.0, noise_rms=1e-4),),
        parameters=(Parameter("time_constant", "s", value=1.0, lower=0.1, upper=10.0),))

def design(linear, specification):
    ends = {"measured": "level", "actuator": "pump", "sample_time": 0.01, "name": "own"}
    return pid_by_hand(specification["gain"], specification["gain"], **ends)

PUMPED = Metric("pumped", lambda run: float(run["pump"].mean()), "mean command", unit="m")
"""
STUDY = """
name = "tank"
metrics = ["own_tank:PUMPED"]
[plant]
kind = "own_tank:tank"
[variations.slow]
parameters = { time_constant = "2 s" }
[controllers.own]
design = "own_tank:design"
at = { level = 0.5 }
specification = { gain = 10.0 }
[scenarios.up]
duration = "4 s"
sample_time = "10 ms"
[scenarios.up.references.level]
kind = "steps"
unit = "cm"
times = [0.0, 0.5]
values = [50, 60]
[[requirements]]
metric = "steady_error"
limit = 1.0
unit = "cm"
[[requirements]]
metric = "pumped"
limit = 1.0
"""


@pytest.fixture
def study_file(tmp_path: Path) -> Path:
    (tmp_path / "own_tank.py").write_text(RIG, encoding="utf-8")
    path = tmp_path / "tank.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def test_parsing_imports_nothing_and_leaves_the_path_alone(study_file: Path) -> None:
    before = list(sys.path)
    sys.modules.pop("own_tank", None)
    read_study(study_file)
    assert "own_tank" not in sys.modules and sys.path == before


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("jobs", [1, 2])
def test_it_runs_and_reports(study_file: Path, jobs: int) -> None:
    before = list(sys.path)
    study = load_study(study_file)
    result = run_study(study, study_file.parent / "out", jobs=jobs)
    assert [r.reason for r in result.records] == ["", ""]
    assert {j.demand.requirement.metric for j in result.judgements} == {"steady_error", "pumped"}
    assert result.passed, result.headline()
    assert [p for p in sys.path if p not in before] == [str(study_file.parent)]
    page = write_study_files(result, study_file.parent / "out")[-1].read_text(encoding="utf-8")
    assert "pumped" in page


def test_a_mistake_in_ones_own_module_is_a_sentence_with_its_line(study_file: Path) -> None:
    module = study_file.parent / "own_tank.py"
    module.write_text(RIG + "\nimport nowhere_at_all\n", encoding="utf-8")
    sys.modules.pop("own_tank", None)
    with pytest.raises(WorkbenchError, match=r"line \d+: .*nowhere_at_all"):
        load_study(study_file)


def test_specifications_take_units_and_points_take_inputs(study_file: Path) -> None:
    own = 'design = "own_tank:design"\nat = { level = 0.5 }\nspecification = { gain = 10.0 }'
    lqi = 'design = "lqi"\nat = { pump = "50 cm" }\nspecification = { sample_time = "10 ms" }'
    study_file.write_text(STUDY.replace(own, lqi), encoding="utf-8")
    recipe = load_study(study_file).controllers["own"]
    assert dict(recipe.specification) == {"sample_time": 0.01} and dict(recipe.at) == {"pump": 0.5}
    study_file.write_text(STUDY.replace(own, lqi.replace("10 ms", "10 mV")), encoding="utf-8")
    with pytest.raises(WorkbenchError, match="which does not measure it"):
        load_study(study_file)


def test_a_design_for_any_plant_steps_as_often_as_its_scenarios(study_file: Path) -> None:
    other = STUDY.replace("specification = { gain = 10.0 }", "").replace(
        '"own_tank:design"', '"lqi"'
    )
    study_file.write_text(other, encoding="utf-8")
    assert load_study(study_file).controllers["own"].build().sample_time == 0.01
    stated = other.replace(
        'design = "lqi"', 'design = "lqi"\nspecification = { sample_time = 0.02 }'
    )
    study_file.write_text(stated, encoding="utf-8")
    with pytest.raises(WorkbenchError, match="steps every 0.02 s .* every 0.01 s; give both"):
        load_study(study_file)


@pytest.mark.parametrize("key", ["measured", "also_measured", "actuator"])
def test_an_output_or_a_command_that_the_plant_does_not_have_is_told_at_once(
    study_file: Path, key: str
) -> None:
    own = study_file.read_text(encoding="utf-8")
    told = own.replace('"own_tank:design"', '"lqi"').replace("gain = 10.0", f'{key} = "levl"')
    study_file.write_text(told, encoding="utf-8")
    with pytest.raises(
        WorkbenchError, match=r"tank.toml, line 11: .* is 'levl'; it must be one of"
    ):
        load_study(study_file)


@pytest.mark.usefixtures("undrawn")
def test_a_run_that_failed_is_done_again(
    study_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = study_file.with_name("own_tank.py")
    text = rig.read_text(encoding="utf-8")
    rig.write_text(text.replace("    ends", "    import gains_of_mine\n    ends", 1))
    out = study_file.with_name("out")
    first = run_study(load_study(study_file), out, jobs=1)
    assert len(first.failed) == len(first.records) > 0
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "gains_of_mine.py").touch()
    monkeypatch.syspath_prepend(tmp_path / "more")
    assert not run_study(load_study(study_file), out, jobs=1).failed
