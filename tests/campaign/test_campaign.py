"""Kills at random times, full disks, missing compilers: nothing lost, nothing wrong.

One command runs it: ``make campaign``. The variable ``WORKBENCH_CAMPAIGN_SEED`` draws other times.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.campaign.commands import Command, commands, half_files

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs /proc"),
]

KILLS = {"compare": 30, "refit": 25, "diagnose": 20, "controllers": 25}
"""How often each command is killed: 100 times together."""

SEED = int(os.environ.get("WORKBENCH_CAMPAIGN_SEED", "2026"))

WRONG_USE = 2


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Command]:
    return commands(tmp_path_factory.mktemp("given"))


@pytest.fixture(scope="module")
def undisturbed(
    given: dict[str, Command], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[Any, float]]:
    """What each command finds when nothing disturbs it, and how long it takes, in s."""
    found = {}
    for name, command in given.items():
        out = tmp_path_factory.mktemp(name) / "out"
        began = time.monotonic()
        status, said = command.finished(out)
        assert status in (0, 1), said
        found[name] = command.answer(out), time.monotonic() - began
    return found


@pytest.mark.parametrize("name", KILLS)
def test_kills_at_random_times_lose_nothing(
    name: str, given: dict[str, Command], undisturbed: dict[str, tuple[Any, float]], tmp_path: Path
) -> None:
    command, (answer, duration) = given[name], undisturbed[name]
    rng = np.random.default_rng([SEED, len(name)])
    kills = folder = 0
    while kills < KILLS[name]:
        # A new folder after each run that came to its end.
        out, before = tmp_path / f"out-{folder}", {}
        folder += 1
        while kills < KILLS[name]:
            running = command.start(out)
            killed = running.kill(rng.uniform(0.0, 1.1 * duration))
            assert running.left() == [], "workers outlived their parent"
            assert half_files(out) == []
            parts = command.finished_parts(out)
            for path, (written, content) in before.items():
                # What grows from round to round is written again, with more in it.
                if path.name != "selected.json":
                    assert parts.get(path) == (written, content), f"{path} was lost or done again"
            before = parts
            kills += killed
            if not killed:
                break
        if killed:
            status, said = command.finished(out)
            assert status in (0, 1), said
        assert command.answer(out) == answer
        # What a killed run had begun is gone.
        assert not list(out.rglob(".*"))


def test_a_second_run_in_the_same_folder_is_refused(
    given: dict[str, Command], undisturbed: dict[str, tuple[Any, float]], tmp_path: Path
) -> None:
    for name, command in given.items():
        out = tmp_path / name
        first = command.start(out)
        while not (out / ".lock").exists():
            assert first.process.poll() is None
            time.sleep(0.01)
        status, said = command.finished(out)
        assert status == WRONG_USE
        assert "in use by another run" in said and "Traceback" not in said
        first.process.communicate()
        assert command.answer(out) == undisturbed[name][0]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 64 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    asked = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)]
    if subprocess.run(asked, capture_output=True, check=False).returncode:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


@pytest.mark.parametrize("name", KILLS)
def test_a_full_disk_is_a_sentence(name: str, given: dict[str, Command], small_disk: Path) -> None:
    status, said = given[name].finished(small_disk / "out")
    assert status == WRONG_USE, said
    assert "cannot be written: no space left" in said and "Traceback" not in said
    assert half_files(small_disk / "out") == []


@pytest.mark.parametrize("name", KILLS)
def test_a_folder_that_cannot_be_written_is_a_sentence(
    name: str, given: dict[str, Command], small_disk: Path
) -> None:
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    status, said = given[name].finished(small_disk / "out")
    assert status == WRONG_USE
    assert "cannot be written: read-only" in said and "Traceback" not in said


def _close(one: Any, other: Any, place: str = "") -> None:
    """Compare answers of machine code and of the interpreter: numbers to rounding."""
    if isinstance(one, dict):
        assert one.keys() == other.keys(), place
        for key in one:
            _close(one[key], other[key], f"{place}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(other), place
        for i, pair in enumerate(zip(one, other, strict=True)):
            _close(*pair, f"{place}.{i}")
    elif isinstance(one, float) and isinstance(other, float):
        assert one == pytest.approx(other, rel=1e-4, abs=1e-12), place
    else:
        assert one == other, place


def _elsewhere(command: Command, **variables: str) -> Command:
    return replace(command, environment=variables)


@pytest.mark.parametrize("name", ["compare", "refit"])
def test_without_a_compiler_it_is_slower_and_the_same(
    name: str, given: dict[str, Command], undisturbed: dict[str, tuple[Any, float]], tmp_path: Path
) -> None:
    status, said = _elsewhere(given[name], WORKBENCH_CC="none").finished(tmp_path / "out")
    assert status in (0, 1), said
    _close(given[name].answer(tmp_path / "out"), undisturbed[name][0])


BROKEN = ("exit 1", "true", 'while [ "$1" != -o ]; do shift; done; echo x > "$2"')
"""Programs in place of a compiler: one that fails, that makes nothing, that makes rubbish."""


@pytest.mark.parametrize("how", BROKEN)
def test_a_compiler_that_fails_is_the_slower_path(
    how: str, given: dict[str, Command], undisturbed: dict[str, tuple[Any, float]], tmp_path: Path
) -> None:
    broken = tmp_path / "cc"
    broken.write_text(f"#!/bin/sh\n{how}\n")
    broken.chmod(0o755)
    variables = {"WORKBENCH_CC": str(broken), "WORKBENCH_CACHE": str(tmp_path / "cache")}
    status, said = _elsewhere(given["refit"], **variables).finished(tmp_path / "out")
    assert status == 0, said
    assert "interpreted, which is slower" in said and "Traceback" not in said
    _close(given["refit"].answer(tmp_path / "out"), undisturbed["refit"][0])


@pytest.mark.parametrize("name", ["compare", "refit"])
def test_a_damaged_cache_is_built_again(
    name: str, given: dict[str, Command], undisturbed: dict[str, tuple[Any, float]], tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    command = _elsewhere(given[name], WORKBENCH_CACHE=str(cache))
    command.finished(tmp_path / "first")
    libraries = sorted(cache.rglob("*.so"))
    assert libraries
    for i, library in enumerate(libraries):
        content = library.read_bytes()
        library.write_bytes((b"", content[: len(content) // 2], b"\0" * len(content))[i % 3])
    status, said = command.finished(tmp_path / "second")
    assert status in (0, 1), said
    assert command.answer(tmp_path / "second") == undisturbed[name][0]


def test_a_full_cache_is_the_slower_path(
    given: dict[str, Command],
    undisturbed: dict[str, tuple[Any, float]],
    small_disk: Path,
    tmp_path: Path,
) -> None:
    (small_disk / "workbench").mkdir()
    with suppress(OSError), (small_disk / "rest").open("wb") as stream:
        stream.write(b"0" * 100_000)
    command = _elsewhere(given["refit"], WORKBENCH_CACHE=str(small_disk))
    status, said = command.finished(tmp_path / "out")
    assert status == 0, said
    assert "Traceback" not in said
    _close(given["refit"].answer(tmp_path / "out"), undisturbed["refit"][0])


def test_a_half_file_would_be_found(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text(json.dumps({"a": 1})[:-1])
    (tmp_path / "report.html").write_text("<html>")
    assert len(half_files(tmp_path)) == 2
