"""The improved model of a diagnosis is a plant of every verb and study."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.machines import machine
from tests.shell import Shell
from workbench.cli.main import run
from workbench.errors import WorkbenchError
from workbench.linearisation import linearise
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.physics.library import every_name, library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.plant import adopt
from workbench.plants.registry import PLANTS, saved_plant
from workbench.simulation import simulate
from workbench.study.plants import PlantRecipe


@pytest.fixture
def verdict(tmp_path: Path) -> Path:
    plant = PLANTS.get("pendulum")
    nominal = plant.model()
    better = plant.model(effects=["quadratic_drag"], without=[])
    better = better.with_parameters(
        {q.name: 1.1 * q.value for q in nominal.parameters if q.fitted and q.value}
    )
    path = tmp_path / "verdict.json"
    path.write_text(json.dumps({"plant": saved_plant("pendulum", {}, nominal, better)}))
    return path


def test_a_saved_model_has_the_same_equations(verdict: Path) -> None:
    kept = json.loads(verdict.read_text())["plant"]
    assert kept["effects"] == ["quadratic_drag"] and kept["parameters"]
    model = PLANTS.get(str(verdict)).model()
    assert {q.name: q.value for q in model.parameters}.items() >= kept["parameters"].items()
    again = PlantRecipe(str(verdict)).build()
    x = model.initial_state({"speed": 0.5})
    u = model.nominal_input
    np.testing.assert_array_equal(again.rates(x, u), model.rates(x, u))
    assert not np.array_equal(model.rates(x, u), PLANTS.get("pendulum").model().rates(x, u))


def test_verbs_take_it(verdict: Path, shell: Shell) -> None:
    assert "quadratic_drag" in shell("plants", verdict).out
    shell("linearise --plant", verdict)


def test_a_size_that_followed_from_the_recordings_is_taken_as_it_stands(tmp_path: Path) -> None:
    plant = PLANTS.get("pendulum")
    nominal = plant.model()
    (slow,) = (
        entry.effect
        for entry in library(nominal, RecordedFacts(sample_time=1.0))
        if entry.name == "sensor_delay_angle"
    )
    late = nominal.with_effect(slow).with_parameters({"sensor_delay_angle.time": 5.0})
    with pytest.raises(WorkbenchError, match="valid range"):
        plant.model(effects=["sensor_delay_angle"]).with_parameters(
            {"sensor_delay_angle.time": 5.0}
        )
    path = tmp_path / "verdict.json"
    path.write_text(json.dumps({"plant": saved_plant("pendulum", {}, nominal, late)}))
    model = PLANTS.get(str(path)).model()
    np.testing.assert_array_equal(model.values, late.values)


def test_a_file_without_a_plant_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "verdict.json"
    for text, message in (("{}", "has no 'plant'"), ("[", "no JSON"), (None, "cannot be read")):
        path.unlink(missing_ok=True)
        if text is not None:
            path.write_text(text)
        with pytest.raises(WorkbenchError, match=message):
            PLANTS.get(str(path))


@pytest.fixture
def axis(here: Path) -> Path:
    """An axis that is heavier than its plant says and has drag that the plant leaves out."""
    plant = PLANTS.get("servo-axis")
    better = plant.model(effects=["quadratic_drag"]).with_parameters(
        {"mass": 120.0, "quadratic_drag.coefficient": 300.0}
    )
    Path("verdict.json").write_text(
        json.dumps({"plant": saved_plant("servo-axis", {}, plant.model(), better)})
    )
    return Path("verdict.json")


def _number(said: str, name: str) -> float:
    return float(re.findall(rf"^ *{name} +(\S+)", said, re.MULTILINE)[0])


def test_simulate_and_linearise_use_the_improved_model(axis: Path, shell: Shell) -> None:
    ends = []
    for name in ("servo-axis", str(axis)):
        shell("simulate --plant", name, "--force 0:200 --duration 1s --out run.csv")
        ends.append(float(Path("run.csv").read_text().splitlines()[-1].split(",")[2]))
    # Heavier, with drag: it comes less far.
    assert ends[1] < 0.95 * ends[0]
    dry = "--without coulomb_friction --without quadratic_drag"
    said = shell("linearise --plant", axis, dry).out
    model = PLANTS.get(str(axis)).model()
    damping = model.parameter("viscous_friction.coefficient").value
    # The axis slows down with the time constant m / d of the heavier mass.
    assert f"{1e3 * 120.0 / damping:.4g} ms" in said


@pytest.mark.usefixtures("undrawn")
@pytest.mark.system
def test_verify_and_compare_run_controllers_on_it(axis: Path, shell: Shell) -> None:
    found = []
    for name in ("servo-axis", str(axis)):
        words = ["--plant", name, "-c", "lqi", "--from", "0mm", "--to", "20mm", "--json"]
        (record,) = shell("verify", *words).result["runs"]
        found.append(record["metrics"]["iae"]["value"])
    assert found[0] != found[1]
    shell("new-study on_it.toml")
    text = Path("on_it.toml").read_text().replace('kind = "servo-axis"', 'kind = "verdict.json"')
    text = text.partition("[robustness]")[0].replace('mass = "110 kg"', 'mass = "130 kg"')
    Path("on_it.toml").write_text(text)
    assert run(["compare", "on_it.toml", "--out", "out", "--jobs", "1"]) in (0, 1)
    results = json.loads(Path("out/results.json").read_text())
    assert {r["status"] for r in results["runs"]} == {"done"}


WRONG = {
    "a value out of its range": ("parameters", {"mass": 1e9}, ("mass", "50 to 150 kg")),
    "an unknown parameter": ("parameters", {"mas": 100.0}, ("'mas'", "did you mean 'mass'")),
    "an unknown effect": ("effects", ["quadratic_drga"], ("quadratic_drga", "did you mean")),
    "another plant": ("name", "servo-axes", ("servo-axes", "did you mean 'servo-axis'")),
    "a loop of files": ("name", "verdict.json", ("names another file",)),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("verb", ["simulate", "linearise", "verify", "compare", "refit"])
def test_what_is_wrong_in_it_is_a_sentence(name: str, verb: str, axis: Path, shell: Shell) -> None:
    key, value, words = WRONG[name]
    table = json.loads(axis.read_text())
    table["plant"][key] = value
    axis.write_text(json.dumps(table))
    given = {"simulate": ["--force", "0:1"], "refit": ["--fit", "a.csv", "--hold-out", "b.csv"]}
    arguments = [verb, "--plant", str(axis), *given.get(verb, [])]
    if verb == "compare":
        shell("new-study on_it.toml")
        text = Path("on_it.toml").read_text().replace('"servo-axis"', '"verdict.json"')
        Path("on_it.toml").write_text(text)
        arguments = ["compare", "on_it.toml", "--out", "out"]
    said = shell(*arguments, status=2).err
    assert all(word in said for word in words) and said.count("\n") == 1, said
    assert not Path("out").exists()


def test_a_value_out_of_range_from_the_command_line_is_a_sentence(axis: Path, shell: Shell) -> None:
    for verb in (["linearise"], ["verify"], ["simulate", "--force", "0:1"]):
        assert (
            "mass is 1000 kg; the valid range is 50 to 150 kg"
            in shell(*verb, "--plant", axis, "-p mass=1000", status=2).err
        )


def _rolling() -> Model:
    """A carriage whose damping is zero until it is refitted."""

    def equations(m: Any) -> dict[str, Any]:
        force = m.port("carriage.force", m.u.drive - m.p.damping * m.x.speed, unit="N", scale=10.0)
        return {"position": m.x.speed, "speed": force / 2.0}

    return machine(
        equations,
        "position m scale=0.2, speed m/s scale=0.5",
        "drive N scale=10",
        "position m 1e-4 scale=0.2",
        "damping N s/m lower=0 upper=40",
    )


def test_a_name_that_follows_from_a_refit_is_known_and_rests_after_its_time() -> None:
    plant = adopt(_rolling, "carriage")
    name = "parameter_jump_damping"
    assert name not in {h.name for h in library(plant.model())}
    model = plant.model(effects=[name], parameters=[f"{name}.amount=8", f"{name}.time=4s"])
    point = operating_point(model)
    assert point.undetermined == ("position",) and point[f"{name}.clock"] > 4.0
    slow = -linearise(point, verdict=False).system.A[1, 1]
    assert slow == pytest.approx(8.0 / 2.0)


def test_a_place_of_a_shared_law_and_what_changes_of_another_effect_are_named() -> None:
    names = ["muscle_hysteresis_muscle_1"]
    assert [e.name for e in PLANTS.get("arm").model(effects=names).effects][-1:] == names
    names = ["coulomb_friction", "parameter_jump_coulomb_friction_level"]
    model = adopt(_rolling, "carriage").model(effects=names)
    assert [e.name for e in model.effects] == names


def test_a_refit_knows_how_long_its_recordings_are(here: Path, shell: Shell) -> None:
    machine = _rolling().with_parameters({"damping": 2.0})
    machine = machine.with_effect(every_name(machine)["parameter_jump_damping"].effect)
    later = {"parameter_jump_damping.amount": 6.0, "parameter_jump_damping.time": 4.0}
    rng = np.random.default_rng(1)
    for name in ("fit", "hold"):
        drive = np.repeat(rng.uniform(-8.0, 8.0, 40), 25)
        made = simulate(machine.with_parameters(later), drive[:, None], sample_time=0.01)
        read = made["position"] + 1e-4 * rng.standard_normal(len(drive))
        rows = zip(0.01 * np.arange(len(drive)), drive, read, strict=True)
        lines = ["time_s,drive_N,position_m", *(",".join(map(str, row)) for row in rows)]
        (here / f"{name}.csv").write_text("\n".join(lines))
    (here / "own_carriage.py").write_text("from tests.plants.test_saved import _rolling\n")
    asked = "--plant own_carriage:_rolling --fit fit.csv --hold-out hold.csv"
    found = shell("refit", asked, "--effect parameter_jump_damping --json").result
    assert found["unidentifiable"] == []
    values = {name: row["value"] for name, row in found["parameters"].items()}
    begun = found["parameters"]["parameter_jump_damping.time"]["before"]
    assert begun == pytest.approx(0.5 * 9.99)
    assert abs(values["parameter_jump_damping.time"] - 4.0) < 0.5 * abs(begun - 4.0)
    after = values["damping"] + values["parameter_jump_damping.amount"]
    assert after == pytest.approx(2.0 + 6.0, rel=0.1)
