"""The improved model of a diagnosis is a plant of every verb and study."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.cli.main import run
from workbench.errors import WorkbenchError
from workbench.plants.registry import PLANTS
from workbench.plants.saved import saved_plant
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


def test_verbs_take_it(verdict: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plants", str(verdict)]) == 0
    assert "quadratic_drag" in capsys.readouterr().out
    assert run(["linearise", "--plant", str(verdict)]) == 0


def test_a_file_without_a_plant_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "verdict.json"
    for text, message in (("{}", "has no 'plant'"), ("[", "no JSON"), (None, "cannot be read")):
        path.unlink(missing_ok=True)
        if text is not None:
            path.write_text(text)
        with pytest.raises(WorkbenchError, match=message):
            PLANTS.get(str(path))
