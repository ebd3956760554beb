"""The workflow files do what they say: their shell lines run in a clean folder.

Installing and posting need a network; here the package is the one under test, and ``gh`` and
``curl`` are stand-ins that keep what they were given.
"""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.study.small_study import WORSE, small_study
from workbench.data_folder import shipped_folder
from workbench.study.baseline import write_baseline
from workbench.study.execution import run_tasks
from workbench.study.schema import load_study
from workbench.study.store import Store
from workbench.study.tasks import tasks

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

STAND_IN = '#!/bin/sh\nfor word in "$@"; do echo "$word" >> "$SENT"; done\n'


def github_lines() -> list[tuple[str, bool]]:
    """Return the shell lines of the GitHub workflow, and whether they run after a failure."""
    steps = workflow("github.yml")["jobs"]["compare"]["steps"]
    return [(s["run"], s.get("if") == "always()") for s in steps if "run" in s]


def gitlab_lines() -> list[tuple[str, bool]]:
    """Return the shell lines of the GitLab job, and whether they run after a failure."""
    job = workflow("gitlab.yml")["controllers"]
    script = [*job["before_script"], *job["script"]]
    return [*((line, False) for line in script), *((line, True) for line in job["after_script"])]


def workflow(name: str) -> dict[str, Any]:
    path = shipped_folder() / "ci" / name
    return dict(yaml.safe_load(path.read_text(encoding="utf-8")))


LINES = {"github": github_lines, "gitlab": gitlab_lines}


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with its baseline, and programs as a runner has them on its path."""
    place = tmp_path_factory.mktemp("prepared")
    (place / "checkout" / "studies").mkdir(parents=True)
    path = small_study(place / "checkout" / "studies", name="arm.toml")
    study = load_study(path)
    records = run_tasks(tasks(study), Store(place / "runs", "0"))
    write_baseline(path.with_name("arm.baseline.json"), study.name, records)
    (place / "bin").mkdir()
    root = Path(__file__).resolve().parents[2]
    texts = {
        "gh": STAND_IN,
        "curl": STAND_IN,
        "workbench": f'#!/bin/sh\nPYTHONPATH="{root}" exec "{sys.executable}" -m workbench "$@"\n',
    }
    for name, text in texts.items():
        program = place / "bin" / name
        program.write_text(text)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return place


@pytest.fixture
def checkout(prepared: Path, tmp_path: Path) -> Path:
    """A clean folder."""
    shutil.copytree(prepared, tmp_path, dirs_exist_ok=True)
    return tmp_path / "checkout"


def play(lines: list[tuple[str, bool]], folder: Path) -> tuple[bool, str]:
    """Run shell lines as a runner does; return whether all went well, and what was sent."""
    sent = folder.parent / "sent"
    environment = {
        **os.environ,
        "PATH": f"{folder.parent / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "SENT": str(sent),
        "GITHUB_STEP_SUMMARY": str(folder.parent / "step-summary.md"),
        "PULL_REQUEST": "7",
        "SUMMARY_TOKEN": "none",
        "CI_API_V4_URL": "https://gitlab.example/api/v4",
        "CI_PROJECT_ID": "1",
        "CI_MERGE_REQUEST_IID": "7",
    }
    good = True
    for line, always in lines:
        if "pip install" in line or not (good or always):
            continue
        done = subprocess.run(
            ["sh", "-e", "-c", line], cwd=folder, env=environment, capture_output=True, check=False
        )
        assert done.returncode in (0, 1), done.stderr.decode()
        good = good and done.returncode == 0
    return good, sent.read_text(encoding="utf-8") if sent.exists() else ""


@pytest.mark.system
def test_an_unchanged_controller_is_green_and_reported(checkout: Path) -> None:
    good, sent = play(github_lines(), checkout)
    assert good and "comparison/summary.md" in sent
    for name in ("report.html", "results.json", "summary.md", "junit.xml"):
        assert (checkout / "comparison" / name).stat().st_size > 100


@pytest.mark.system
@pytest.mark.parametrize("host", LINES)
def test_a_worse_controller_is_red_and_still_reported(host: str, checkout: Path) -> None:
    small_study(checkout / "studies", WORSE, name="arm.toml")
    good, sent = play(LINES[host](), checkout)
    assert not good and "comparison/summary.md" in sent
    text = (checkout / "comparison" / "summary.md").read_text(encoding="utf-8")
    assert "settling_time" in text and "Worse than the baseline" in text


@pytest.mark.parametrize("host", LINES)
def test_what_is_kept_is_what_is_written(host: str) -> None:
    text = (shipped_folder() / "ci" / f"{host}.yml").read_text(encoding="utf-8")
    for name in ("report.html", "results.json", "summary.md", "junit.xml"):
        assert f"comparison/{name}" in text
    installs = [line for line, _ in LINES[host]() if "pip install" in line]
    assert len(installs) == 1
