"""Scoring of a blind round, on fabricated verdicts."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from workbench.data_folder import shipped_folder
from workbench.diagnosis.verdict import SCHEMA
from workbench.errors import WorkbenchError
from workbench.evaluation.answer_key import commitments, read_names
from workbench.evaluation.blind_round import score_verdicts
from workbench.physics.library import library
from workbench.plants.arm import arm

RIGHT: dict[str, tuple[str, list[str]]] = {
    "valve_offset": ("valve_offset", ["valve.command"]),
    "tilt": ("tilt_gravity", ["joint.torque"]),
    "supply_droop": ("supply_droop", ["supply.pressure"]),
    "leak_muscle_2": ("chamber_leakage_2", ["chamber_2.flow"]),
    "stribeck": ("stribeck_friction", ["joint.torque"]),
    "p_lag": ("sensor_lag_pressures", ["pressure_1.reading", "pressure_2.reading"]),
    "muscle_hysteresis": ("maxwell_slip_hysteresis", ["muscle_1.force", "muscle_2.force"]),
}
"""What a right verdict says, by the word of the key."""


def _found(effect: str | None, where: list[str], alike: tuple[str, ...] = ()) -> dict[str, Any]:
    return {"where": where, "effect": effect, "class": [*([effect] if effect else []), *alike]}


Cases = dict[str, tuple[list[str], str, list[dict[str, Any]]]]


def _round(folder: Path, cases: Cases, **fit: float) -> tuple[Path, Path]:
    key = {}
    for case, (hidden, verdict, findings) in cases.items():
        key[case] = {"truth": [{"effect": word} for word in hidden or ["none"]], "salt": case}
        data = {
            "schema": SCHEMA,
            "verdict": verdict,
            "findings": findings,
            "fit": {"held_out": {name: {"angle": value} for name, value in fit.items()}},
        }
        (folder / f"{case}.json").write_text(json.dumps(data))
    path = folder.parent / f"{folder.name}-key.json"
    path.write_text(json.dumps(key))
    return folder, path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder for verdicts."""
    made = tmp_path / "verdicts"
    made.mkdir()
    return made


def test_a_perfect_round_has_all_points_and_beats_chance(folder: Path) -> None:
    cases = {word: ([word], "named", [_found(*says)]) for word, says in RIGHT.items()}
    cases["quiet"] = ([], "nothing_missing", [])
    found = score_verdicts(*_round(folder, cases, refitted=2.0, extended=0.3, noise_floor=0.2))
    assert (found.points, found.most) == (48, 48)
    # One of 8! = 40320 orders is right; two answers per group would make it more.
    assert found.p_value < 1e-3 and found.chance < 0
    data = found.as_data()
    assert data["right_group_rate"] == data["right_name_or_class_rate"] == 1.0
    assert data["confidently_wrong_rate"] == 0.0 and found.false_alarms == (0, 1)
    assert data["cases"][0]["error_over_noise"] == pytest.approx(1.5)
    assert "48 of 48 points" in str(found) and "p = " in str(found)


JOINT = ["joint.torque"]
SENSOR = _found(None, ["angle.reading"])
TILT, LAG = _found(*RIGHT["tilt"]), _found(*RIGHT["p_lag"])
RIPPLE = _found("ripple", JOINT)
ALIKE = ("stribeck_friction", "ripple", "local_friction")
POINTS: list[tuple[list[str], str, list[dict[str, Any]], int]] = [
    (["stribeck"], "named", [_found("stribeck_friction", JOINT)], 6),
    (["stribeck"], "named_class", [_found("stribeck_friction", JOINT, ("lugre_friction",))], 3),
    (["stribeck"], "named_class", [_found("lugre_friction", JOINT, ALIKE[::2])], 3),
    (["stribeck"], "named_class", [_found("lugre_friction", JOINT, ALIKE)], 2),
    (["stribeck"], "located_unnamed", [_found(None, JOINT)], 2),
    # The structure cannot tell the joint from the forces of the muscles.
    (["stribeck"], "located_unnamed", [_found(None, ["muscle_1.force"])], 2),
    (["stribeck"], "located_unnamed", [_found(None, ["chamber_1.flow"])], 1),
    (["stribeck"], "located_unnamed", [SENSOR], 0),
    (["p_lag"], "located_unnamed", [SENSOR], 1),
    (["stribeck"], "unexplained", [], 0),
    (["stribeck"], "nothing_missing", [], 0),
    (["stribeck"], "named", [TILT], -6),
    (["stribeck"], "named", [_found("valve_offset", ["valve.command"])], -6),
    # Nothing is hidden.
    ([], "nothing_missing", [], 6),
    ([], "parameter", [], 6),
    ([], "unexplained", [], 0),
    ([], "data_unfit", [], 0),
    ([], "named", [TILT], -6),
    ([], "located_unnamed", [_found("nonparametric", JOINT)], -6),
    # Two effects, and names too many.
    (["tilt", "p_lag"], "named", [LAG, TILT], 12),
    (["tilt", "p_lag"], "named", [TILT], 6),
    (["tilt", "p_lag"], "named", [TILT, RIPPLE], 0),
    (["tilt"], "named", [TILT, RIPPLE], 0),
    (["tilt"], "named", [RIPPLE, TILT], 0),
    # An effect outside the library.
    (["torque_noise"], "named", [TILT], -6),
]


@pytest.mark.parametrize(("hidden", "verdict", "findings", "points"), POINTS)
def test_points(
    folder: Path, hidden: list[str], verdict: str, findings: list[dict[str, Any]], points: int
) -> None:
    assert score_verdicts(*_round(folder, {"one": (hidden, verdict, findings)})).points == points


@pytest.mark.parametrize(("extended", "points"), [(1.0, 6), (4.0, 2)])
def test_points_of_an_effect_outside_the_library(
    folder: Path, extended: float, points: int
) -> None:
    cases = {"one": (["torque_noise"], "located_unnamed", [_found("nonparametric", JOINT)])}
    told = _round(folder, cases, refitted=2.0, extended=extended)
    assert score_verdicts(*told).points == points


def test_silence_everywhere_is_no_better_than_chance(folder: Path) -> None:
    quiet: Cases = {word: ([word], "nothing_missing", []) for word in RIGHT}
    found = score_verdicts(*_round(folder, quiet | {"quiet": ([], "nothing_missing", [])}))
    assert found.points == 6 and found.p_value == 1.0


def test_commitments_are_checked(folder: Path, tmp_path: Path) -> None:
    verdicts, key = _round(folder, {"one": (["tilt"], "named", [_found(*RIGHT["tilt"])])})
    answer = json.loads(key.read_text())["one"]
    text = '{"salt": "one", "truth": [{"effect": "tilt"}]}'
    digest = hashlib.sha256(text.encode()).hexdigest()
    assert digest in commitments(answer)
    file = tmp_path / "commitments.txt"
    file.write_text(f"one {digest}\n")
    assert score_verdicts(verdicts, key, commitments=file).committed == 1
    file.write_text(f"one {'0' * 64}\n")
    with pytest.raises(WorkbenchError, match="not the one committed beforehand"):
        score_verdicts(verdicts, key, commitments=file)
    file.write_text(f"two {digest}\n")
    with pytest.raises(WorkbenchError, match="committed case is 'one'"):
        score_verdicts(verdicts, key, commitments=file)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[]", "it must be a table"),
        ("{", "is no JSON"),
        ('{"one": {"truth": "tilt"}}', "one.truth is 'tilt'; it must be a list"),
        ('{"one": {"truth": [{"effect": "gremlins"}]}}', "has no meaning in the table"),
        ('{"one": {"truth": []}, "two": {"truth": []}}', "no verdict of case two"),
    ],
)
def test_bad_keys_are_refused_in_one_sentence(folder: Path, content: str, message: str) -> None:
    verdicts, key = _round(folder, {"one": ([], "nothing_missing", [])})
    key.write_text(content)
    with pytest.raises(WorkbenchError, match=message):
        score_verdicts(verdicts, key)


def test_other_files_are_no_verdicts(folder: Path) -> None:
    verdicts, key = _round(folder, {"one": ([], "nothing_missing", [])})
    (verdicts / "one.json").write_text('{"schema": "workbench.refit/1"}')
    both = r"must be 'workbench\.verdict/2' or 'workbench\.verdict/1'"
    with pytest.raises(WorkbenchError, match="has no 'verdict'"):
        score_verdicts(verdicts, key)
    (verdicts / "one.json").write_text('{"schema": "workbench.refit/1", "verdict": "named"}')
    with pytest.raises(WorkbenchError, match=both):
        score_verdicts(verdicts, key)


def test_a_table_of_names_adds_words(folder: Path, tmp_path: Path) -> None:
    names = tmp_path / "names.toml"
    names.write_text('[effects.gremlins]\nlibrary = ["ripple"]\nports = ["joint.torque"]\n')
    case = {"one": (["gremlins"], "named", [_found("ripple", ["joint.torque"])])}
    assert score_verdicts(*_round(folder, case), names=names).points == 6
    names.write_text("[effects.gremlins]\nlibrary = []\n")
    with pytest.raises(WorkbenchError, match="effects.gremlins has no 'ports'"):
        score_verdicts(*_round(folder, case), names=names)


def test_every_name_of_the_table_is_in_the_library_at_the_right_place() -> None:
    table = read_names()
    known = {entry.name: entry for entry in library(arm(3))}
    for word, truth in table.effects.items():
        for name in truth.library:
            assert name in known, f"{word}: {name}"
            assert {table.group(port) for port in known[name].ports} <= set(truth.groups), word
            assert (known[name].group == "sensor") == truth.sensor, word


def test_the_score_that_is_published_is_that_of_the_kept_verdicts() -> None:
    folder = shipped_folder() / "blind/round-1"
    told = {"commitments": folder / "commitments.txt", "names": folder / "names.toml"}
    found = score_verdicts(folder, folder / "key.json", **told)
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert f"**{found.points} of {found.most} points.**" in text
    assert found.committed == len(found.lines) == 12
    rows = [line for line in text.splitlines() if line.startswith("|")][2:]
    # The second row of a case continues the first.
    said: dict[str, int] = {}
    case = ""
    for row in rows:
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        case = cells[0] or case
        said[case] = said.get(case, 0) + int(cells[-1].split()[0])
    assert said == {line.case.removeprefix("sealed-"): line.points for line in found.lines}
