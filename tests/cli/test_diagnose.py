"""The verb diagnose, and scoring what it said."""

from __future__ import annotations

import json
import re
import shlex
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.axis_case import recording
from tests.shell import Refused, Shell
from workbench.cli.main import INTERRUPTED, main
from workbench.diagnosis import diagnose as engine
from workbench.diagnosis.selection import task
from workbench.diagnosis.selection.selected import Scored
from workbench.errors import WorkbenchError
from workbench.physics.library import library


def _write(folder: Path, seed: int, *, hidden: bool) -> Path:
    seen = recording(seed, hidden=hidden)
    path = folder / f"run-{seed}.csv"
    table = np.column_stack([seen.time, seen["force"], seen["position"]])
    np.savetxt(path, table, delimiter=",", header="time_s,force_N,position_m", comments="")
    return path


@pytest.fixture(scope="module")
def axis_options(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Options that name recordings of an axis with hidden friction."""
    folder = tmp_path_factory.mktemp("axis")
    files = [_write(folder, seed, hidden=True) for seed in (1, 2, 3)]
    one, other, held = map(str, files)
    data = ["--fit", one, "--fit", other, "--hold-out", held]
    return ["--plant", "servo-axis", "--jobs", "1", *data]


@pytest.fixture
def few_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small library: that the axis is named out of the whole one is told by another test."""

    def few(*given: Any, **known: Any) -> Any:
        laws = ("stribeck_friction", "linear_spring", "cubic_drag")
        return [e for e in library(*given, **known) if e.law in laws]

    for place in (engine, task):
        monkeypatch.setattr(place, "library", few)


@pytest.mark.usefixtures("few_effects")
def test_diagnose_writes_verdict_page_and_pictures(
    axis_options: list[str], tmp_path: Path, shell: Shell
) -> None:
    out = tmp_path / "out"
    said = shell("diagnose", *axis_options, "--out", out)
    assert "refitting the nominal model" in said.err and "stribeck friction" in said.out
    assert re.search(r"^work: [1-9][0-9.]* \S+ filtered samples", said.out, re.MULTILINE)
    data = json.loads((out / "verdict.json").read_text())
    assert data["schema"] == "workbench.verdict/2" and data["verdict"].startswith("named")
    assert data["findings"][0]["effect"] == "stribeck_friction"
    assert "interrupted" not in data
    page = (out / "report.html").read_text()
    assert "Stribeck friction" in page and f"workbench diagnose {shlex.join(axis_options)}" in page
    assert {path.name for path in (out / "figures").glob("law-1.*")} == {"law-1.png", "law-1.svg"}
    # The verdict scores as it should.
    key = tmp_path / "key.json"
    key.write_text('{"one": {"truth": [{"effect": "stribeck"}]}}')
    names = tmp_path / "names.toml"
    names.write_text(
        '[effects.stribeck]\nlibrary = ["stribeck_friction"]\nports = ["axis.force"]\n'
    )
    verdicts = tmp_path / "verdicts"
    verdicts.mkdir()
    (verdicts / "one.json").write_bytes((out / "verdict.json").read_bytes())
    score = tmp_path / "score.json"
    options = ("--key", key, "--names", names, "--out", score)
    assert "right" in shell("evaluate blind", verdicts, *options).out
    assert json.loads(score.read_text())["points"] in (3, 6)


def test_what_was_said_of_the_recordings_is_not_said_again(
    axis_options: list[str], monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    known = "no recording is held out (--hold-out), so run-2 is"

    def stages(*_: Any, progress: Callable[[str], None], **__: Any) -> None:
        progress(known)
        progress("scoring")
        raise WorkbenchError("enough")

    monkeypatch.setattr(engine, "stages", stages)
    said = refused("diagnose", *axis_options[:-2])
    assert said.count(known) == 1 and "scoring" in said and "enough" in said


@pytest.mark.usefixtures("few_effects")
@pytest.mark.parametrize(("found", "end"), [(False, "Ctrl-C"), (True, "SIGTERM")])
def test_an_interruption_keeps_what_was_found(
    request: pytest.FixtureRequest,
    axis_options: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    found: bool,
    end: str,
) -> None:
    def stop(*_: Any, **__: Any) -> Any:
        signal.raise_signal(signal.SIGTERM if end == "SIGTERM" else signal.SIGINT)

    monkeypatch.setattr(engine, "settled_run" if found else "locate", stop)
    # A shell in the background lets its children ignore Ctrl-C.
    usual = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, usual))
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["workbench", "diagnose", *axis_options, "--out", str(out)])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == INTERRUPTED
    assert "interrupted" in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == ["stages", "verdict.json"]
    data = json.loads((out / "verdict.json").read_text())
    assert data["interrupted"] is True and data["sentence"].startswith("Interrupted while")
    # Before the search the parameters are known, after it the effect too.
    assert data["parameters"]["mass"]["value"] > 0
    names = [finding["effect"] for finding in data["findings"]]
    assert names == (["stribeck_friction"] if found else [])


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timer that interrupts")
@pytest.mark.parametrize(
    ("stage", "said"),
    [
        ("score", "nothing, but most is missing at axis.force; not tried: any effect"),
        ("search", "not tried to the end: {best}"),
    ],
)
def test_a_time_limit_gives_the_verdict_until_then(
    axis_options: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    shell: Shell,
    stage: str,
    said: str,
) -> None:
    found: list[Scored] = []

    def wait(*given: Any, **__: Any) -> Any:
        found.extend(g for g in given if isinstance(g, Scored))
        signal.setitimer(signal.ITIMER_REAL, 0.01)
        time.sleep(60.0)

    monkeypatch.setattr(engine, stage, wait)
    out = tmp_path / "out"
    told = shell("diagnose", *axis_options, "--quick --out", out).out
    data = json.loads((out / "verdict.json").read_text())
    assert data["interrupted"] is True and data["sentence"].startswith("Ended after 20 s while")
    best = max(found[0].scores.scores, key=lambda s: s.gain).entry.name if found else ""
    assert said.format(best=best.replace("_", " ")) in data["sentence"]
    assert data["sentence"] in told
    assert sorted(path.name for path in out.iterdir()) == ["stages", "verdict.json"]


def test_a_time_limit_that_nothing_meets_or_that_cannot_be_set_is_a_sentence(
    axis_options: list[str], here: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    monkeypatch.setattr(engine, "prepare", lambda *_: signal.raise_signal(signal.SIGALRM))
    words = ["diagnose", *axis_options]
    assert "nothing was found within 100 s" in refused(*words, "--time-limit 100")
    monkeypatch.delattr(signal, "setitimer")
    assert "this platform does not have" in refused(*words, "--quick")


def test_scoring_refuses_what_is_not_there(tmp_path: Path, refused: Refused) -> None:
    key = tmp_path / "key.json"
    key.write_text('{"one": {"truth": []}}')
    assert "there is no folder" in refused("evaluate blind", tmp_path / "none", "--key", key)
    missing = tmp_path / "no.json"
    assert "cannot be read" in refused("evaluate blind", tmp_path, "--key", missing)
