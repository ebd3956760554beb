"""The benchmark: cases without answers, baselines, and a table of several methods."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.evaluation.own_cases.made_up import LIMIT, found, verdict
from tests.shell import Refused, Shell
from workbench.diagnosis.diagnose import stages
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated_recording
from workbench.diagnosis.stages import Diagnosis
from workbench.errors import WorkbenchError
from workbench.evaluation.benchmark import cases as module
from workbench.evaluation.benchmark.baselines import BASELINES, answers, case_folders
from workbench.evaluation.benchmark.cases import compared, table, write_cases
from workbench.evaluation.benchmark.neural import Network, trained
from workbench.evaluation.benchmark.random_walk import walk_gains
from workbench.evaluation.own_cases.own_case import made
from workbench.evaluation.own_cases.plan import Planned
from workbench.physics.stiffness import linear_spring
from workbench.plants.servo_axis import servo_axis
from workbench.recordings import read_case


@cache
def refitted(stiffness: float) -> Diagnosis:
    """An axis held by a spring that its model lacks, as far as the refit."""
    axis = servo_axis()
    true = axis.with_effect(linear_spring("axis.force", stiffness=stiffness, upper=1e3))
    push = {f"axis {seed}": pushes(400, largest=200.0, seed=seed) for seed in (1, 2)}
    runs = [simulated_recording(true, u, sample_time=0.01, name=name) for name, u in push.items()]
    reached = stages(axis, runs[:1], runs[1:], jobs=1, advise=False, progress=lambda _: None)
    return next(d for d in reached if d.fitted is not None)


def test_a_case_is_written_without_its_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def short(case: Planned, folder: Path) -> Path:
        return made(replace(case, recorded="narrow"), folder, seconds=0.5)

    monkeypatch.setattr(module, "made", short)
    (line,) = write_cases(tmp_path / "set", 1, 50000)
    (folder,) = case_folders(tmp_path / "set")
    assert line.startswith(folder.name)
    files = ["case.toml", "identify_closed.csv", "validate_closed.csv"]
    assert sorted(p.name for p in folder.iterdir()) == files
    assert len(read_case(folder).fit) == 1
    key = json.loads((tmp_path / "set/key.json").read_text())
    assert list(key) == [folder.name]
    assert key[folder.name]["truth"][0]["effect"] not in ("", "none")
    assert set(key[folder.name]["limit"]) == {"angle", "pressure_1", "pressure_2"}
    with pytest.raises(WorkbenchError, match="holds a benchmark already"):
        list(write_cases(tmp_path / "set", 1, 50000))
    with pytest.raises(WorkbenchError, match="holds no case"):
        case_folders(tmp_path)


def _set(folder: Path) -> Path:
    folder.mkdir()
    key: dict[str, Any] = {
        "one": {"truth": [{"effect": "tilt"}], "limit": LIMIT},
        "two": {"truth": [{"effect": "none"}], "limit": LIMIT},
    }
    (folder / "key.json").write_text(json.dumps(key))
    wrong = found("ripple", "joint.torque"), found("creep", "muscle_1.force")
    said = {
        "good": (verdict(found("tilt_gravity", "joint.torque"), scale=1.2), verdict()),
        "bad": tuple(map(verdict, wrong)),
    }
    for method, both in said.items():
        (folder / method).mkdir()
        for case, data in zip(("one", "two"), both, strict=True):
            (folder / method / f"{case}.json").write_text(json.dumps(data))
    return folder


def test_methods_stand_beside_each_other(tmp_path: Path, shell: Shell, refused: Refused) -> None:
    place = _set(tmp_path / "set")
    good, bad = compared(place, [place / "good", place / "bad"])
    assert (good.score.points, bad.score.points) == (12, -12)
    assert good.score.rates["right name or class"].value == 1.0
    assert bad.score.rates["false alarm"].count == 1 and bad.score.rates["wrong name"].value == 1.0
    # The error is that over the true model's, the median of 1.2 and 1.
    assert good.over_limit == pytest.approx(1.1)
    assert table([good, bad]).splitlines()[1].startswith("good    12 of 12")
    out = tmp_path / "scores.json"
    asked = ("evaluate benchmark", place, place / "good", place / "bad")
    assert "12 of 12" in shell(*asked, "--out", out).out
    assert [m["method"] for m in json.loads(out.read_text())["methods"]] == ["good", "bad"]
    # A name that no law has counts as wrong, and is told; a word that no verdict has is refused.
    answer = verdict(found("seal_friction", "joint.torque"), kind="named")
    (place / "bad/two.json").write_text(json.dumps(answer))
    assert "bad: no law is called seal_friction, which counts as wrong" in shell(*asked).out
    (place / "bad/two.json").write_text(json.dumps(answer | {"verdict": "found it"}))
    told = refused(*asked)
    assert "it must be one of 'data_unfit'" in told and '"verdict": WORD' in told
    (place / "good/two.json").unlink()
    assert "no verdict of case two" in refused(*asked)


def test_a_walk_at_the_force_is_significant_where_a_spring_is_hidden() -> None:
    given = answers(refitted(300.0), ("random walk",))["random walk"]
    assert given["verdict"] == "unexplained"
    (finding,) = given["findings"]
    assert finding["where"] == ["axis.force"] and finding["effect"] is None
    plain = refitted(0.0)
    gains = walk_gains(plain.base, plain.nominal, plain.prepared.fitting)
    assert max(gains.values()) < 0.1 * max(finding["gains"].values())


def test_a_network_in_the_equations_improves_the_runs() -> None:
    given = answers(refitted(300.0), ("refit only", "neural residual"))
    (finding,) = given["neural residual"]["findings"]
    assert finding["where"] == ["axis.force"] and finding["effect"] == "nonparametric"
    errors = {n: a["fit"]["held_out"]["extended"]["position"] for n, a in given.items()}
    assert errors["neural residual"] < 0.5 * errors["refit only"]
    assert given["refit only"]["verdict"] == "nothing_missing"


def test_an_answer_that_fails_is_an_abstention(monkeypatch: pytest.MonkeyPatch) -> None:
    # Sparse regression knows the equations of the arm only.
    given = answers(refitted(300.0), ("sindy",))["sindy"]
    assert given["verdict"] == "failed" and not given["findings"]
    assert "sindy" in BASELINES


def test_a_network_is_the_same_as_numbers_and_as_expression() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, 2)) * [1.0, 50.0]
    y = 3.0 * np.tanh(x[:, 0]) + 0.02 * x[:, 1]
    network = trained(x, y)
    assert np.mean((network(x) - y) ** 2) < 0.05 * np.var(y)
    told = [float(network.expression(ca.DM(row))) for row in x[:5]]
    np.testing.assert_allclose(told, network(x[:5]), rtol=1e-10)
    assert isinstance(network, Network)
