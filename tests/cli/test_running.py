"""Nobody waits without a word."""

import time

import pytest

from workbench.cli import running


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
