"""Nobody waits without a word."""

import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from workbench.cli import running
from workbench.cli.main import _as_sentence, run
from workbench.recordings.formats import delimited_text


def test_what_takes_long_is_said_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(running, "QUIET_S", 0.05)
    with running.telling(time.perf_counter()) as say:
        say("racing")
        time.sleep(0.2)
    said = capsys.readouterr().err
    assert said.count("  racing\n") == 1 and "s  still racing\n" in said
    time.sleep(0.1)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "words", [["recording"], ["refit", "--plant", "servo-axis", "--hold-out", "b.csv", "--fit"]]
)
def test_reading_a_long_file_is_said_to_go_on(
    words: Sequence[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def slowly(*_: object) -> list[str]:
        time.sleep(0.2)
        return []

    monkeypatch.setattr(delimited_text, "line_blocks", slowly)
    monkeypatch.setattr(running, "QUIET_S", 0.05)
    (tmp_path / "a.csv").touch()
    run([*words, str(tmp_path / "a.csv")])
    assert "s  still reading" in capsys.readouterr().err


def test_a_warning_of_ours_is_a_sentence() -> None:
    told = [_as_sentence("it is slow", RuntimeWarning, f, 3) for f in (running.__file__, "mine.py")]
    assert told == ["workbench: it is slow\n", "mine.py:3: RuntimeWarning: it is slow\n"]


def test_runs_that_all_failed_have_no_table(capsys: pytest.CaptureFixture[str]) -> None:
    outcome: Any = SimpleNamespace(records=[SimpleNamespace(metrics=None)])
    running.tell_runs(outcome, "tank")
    assert capsys.readouterr().out == ""
