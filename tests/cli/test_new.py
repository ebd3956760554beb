"""What ``new-study``, ``new-controller`` and ``new-plant`` write runs, and the page of fields."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.shell import Refused, Shell
from workbench.data_folder import shipped_folder
from workbench.study.fields import TABLES, Field
from workbench.study.fields_page import study_fields, tables
from workbench.study.step_trial import StepTrial

NEW = {"new-study": "mine.toml", "new-controller": "mine.py", "new-plant": "mine.py"}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.system
@pytest.mark.parametrize("verb", NEW)
def test_what_is_written_runs_as_it_says(
    verb: str, here: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    monkeypatch.syspath_prepend(here)
    name = f"{verb.replace('-', '_')}_{NEW[verb]}"
    said = shell(verb, name).out.strip()
    command = shlex.split(re.sub(f"^written to {name}; run it: ", "", said))
    assert command[0] == "workbench" and Path(name).stem in said.partition("run it")[2]
    # Processes of their own take longer to start than these few runs.
    alone = ["--jobs", "1"] if verb == "new-study" else []
    said = shell(*command[1:], *alone).out
    if verb == "new-study":
        results = json.loads(Path("comparison/results.json").read_text())
        assert results["passed"] and results["robustness"]
    elif verb == "new-controller":
        assert f"{Path(name).stem}:design on servo axis" in said and "settling_time" in said
    else:
        assert Path("run.csv").read_text().count("\n") > 300


OVEN = """
from workbench.model import Input, Model, Output, Parameter, State


def oven():
    return Model(
        "oven",
        lambda m: ({"T": (0.5 * m.u.power - m.x.T) / m.p.lag}, {"T": m.x.T}),
        states=(State("T", "K", 50.0),),
        inputs=(Input("power", "W", 100.0, lower=0.0, upper=400.0),),
        outputs=(Output("T", "K", 50.0, noise_rms=0.05),),
        parameters=(Parameter("lag", "s", value=60.0),),
    )
"""


@pytest.mark.long
def test_a_delay_that_was_found_is_one_of_commands(here: Path, shell: Shell) -> None:
    (here / "ovens.py").write_text(OVEN)
    found: dict[str, object] = {"name": "ovens:oven", "effects": ["sensor_delay_T"]}
    found["parameters"] = {"sensor_delay_T.time": 20.0}
    (here / "verdict.json").write_text(json.dumps({"plant": found}))
    shell("new-study late.toml --plant verdict.json")
    study = tomllib.loads((here / "late.toml").read_text())
    assert study["plant"]["without"] == ["sensor_delay_T"]
    (step,) = study["scenarios"].values()
    assert step["late_samples"] * step["sample_time"] == pytest.approx(20.0)
    (design,) = study["controllers"].values()
    assert design["specification"]["delay"] == pytest.approx(20.0)


@pytest.mark.parametrize("verb", NEW)
def test_nothing_is_overwritten(verb: str, tmp_path: Path, refused: Refused) -> None:
    path = tmp_path / NEW[verb]
    path.write_text("precious")
    assert "exists; give another name" in refused(verb, path)
    assert path.read_text() == "precious"
    assert "does not end in" in refused(verb, tmp_path / "mine.txt")
    if path.suffix == ".py":
        assert "no name of a Python module" in refused(verb, tmp_path / "my-own.py")
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_the_page_of_fields_is_current(shell: Shell) -> None:
    page = shipped_folder() / "docs" / "study-fields.md"
    # Otherwise: workbench study-fields > data/docs/study-fields.md
    assert shell("study-fields").out == page.read_text(encoding="utf-8") == study_fields()


EVERY = [(title, key, field) for title, _, table in tables() for key, field in table.fields.items()]


def test_every_field_has_a_meaning_and_an_example_that_it_accepts() -> None:
    import tomllib

    assert len(EVERY) > 100
    for heading, key, field in EVERY:
        assert isinstance(field, Field) and field.text, (heading, key)
        if field.example and "..." not in field.example:
            field(tomllib.loads(f"x = {field.example}")["x"], (key,))
        # Words for a unit are for people; what is checked has one that is known.
        assert field.range is None or " " not in field.unit, (heading, key)


@pytest.mark.parametrize(("heading", "key", "field"), [e for e in EVERY if e[2].range is not None])  # type: ignore[union-attr]
def test_a_value_out_of_the_range_of_the_page_is_refused(
    heading: str, key: str, field: Field
) -> None:
    from workbench.checked_json import ShapeError

    assert field.range is not None
    below = field.range[0] - 1
    value = [below] if "[" in field.example else below
    whole = value if not isinstance(below, float) or not below.is_integer() else int(below)
    given = value if isinstance(value, list) else whole
    with pytest.raises(ShapeError, match="the valid range is"):
        field(given, (key,))


def test_each_table_of_a_shipped_study_is_on_the_page() -> None:
    import tomllib

    for path in (shipped_folder() / "studies").glob("*.toml"):
        assert set(tomllib.loads(path.read_text())) <= set(TABLES["study"].fields)


@pytest.mark.long
def test_a_study_asks_a_noisy_sensor_for_no_more_than_it_shows(here: Path, shell: Shell) -> None:
    plant = (
        "from workbench.model import Input, Model, Output, State\n"
        "def oven():\n"
        "    return Model('oven', lambda m: ({'T': (m.u.P - 2.0 * m.x.T) / 50.0}, {'T': m.x.T}),\n"
        "        states=(State('T', 'K'),),\n"
        "        inputs=(Input('P', 'W', nominal=20.0, lower=0.0, upper=100.0),),\n"
        "        outputs=(Output('T', 'K', 5.0, noise_rms=NOISE),))\n"
    )
    for module, noise, asked in (("calm", "0.01", "settling_time"), ("noisy", "0.2", "rise_time")):
        Path(f"{module}_oven.py").write_text(plant.replace("NOISE", noise))
        shell("new-study", f"{module}.toml", "--plant", f"{module}_oven:oven")
        # A step that noise leaves nowhere within 2 % of its end had failed the study as written.
        assert f'metric = "{asked}"' in Path(f"{module}.toml").read_text()


@pytest.mark.long
def test_a_study_takes_a_design_that_meets_it(
    here: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared = StepTrial.prepared

    def slow_first(trial: StepTrial) -> Any:
        recipes, scenarios = prepared(trial)
        slow = (("trusted_frequency", 0.1 / scenarios[0].duration),)
        each = [replace(one, specification=(*one.specification, *slow)) for one in recipes]
        return (each[:1] if alone else [each[0], *recipes[1:]]), scenarios

    monkeypatch.setattr(StepTrial, "prepared", slow_first)
    alone = False
    shell("new-study", "mine.toml", "--plant", "servo-axis")
    assert 'design = "lqi"' not in Path("mine.toml").read_text()
    alone = True
    said = shell("new-study", "other.toml", "--plant", "servo-axis").err
    assert "no design of the workbench brings position there" in said


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
@pytest.mark.system
def test_a_study_steps_every_output_that_is_controlled(here: Path, shell: Shell) -> None:
    Path("dosing.py").write_text(
        "from workbench.model import Input, Model, Output, State\n"
        "def mixer():\n"
        "    return Model('mixer', lambda m: ({'level': m.u.hot + m.u.cold - 0.5 * m.x.level,\n"
        "        'heat': m.u.hot - 0.5 * m.x.heat}, {'level': m.x.level, 'heat': m.x.heat}),\n"
        "        states=(State('level'), State('heat')),\n"
        "        inputs=(Input('hot', nominal=1.0, lower=0.0, upper=5.0),\n"
        "            Input('cold', nominal=1.0, lower=0.0, upper=5.0)),\n"
        "        outputs=(Output('level'), Output('heat')))\n"
    )
    shell("new-study", "mine.toml", "--plant", "dosing:mixer")
    shell("compare", "mine.toml", "--out", "found", "--jobs", "1")
    results = json.loads(Path("found/results.json").read_text())
    judged = {(one["scenario"], one["metric"]) for one in results["requirements"] if one["met"]}
    assert {(name, f"{name}.settling_time") for name in ("level", "heat")} <= judged


def test_a_name_with_blanks_stands_in_quotes(tmp_path: Path, shell: Shell) -> None:
    file = tmp_path / "first try.toml"
    said = shell("new-study", file).out.strip().partition("; run it: ")[2]
    assert shlex.split(said)[4:6] == ["compare", file.name]
    assert f"workbench bless comparison --baseline '{file.stem}.baseline.json'" in file.read_text()
