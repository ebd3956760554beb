"""The workflow files do what they say: their shell lines run in a clean folder.

Installing and posting need a network; here the package is the one under test, and ``gh`` and
``curl`` are stand-ins for a service that keeps comments in a file, and refuses to write for a fork.
"""

from __future__ import annotations

import json
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
from workbench.files import write_whole
from workbench.reports.summary import mark_of
from workbench.study.baseline import baseline_text
from workbench.study.conditions import conditions
from workbench.study.execution import Store, Workers
from workbench.study.read import load_study
from workbench.study.tasks import tasks

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

SERVICE = """\
import json, os, pathlib, re, sys
words, place = sys.argv[2:], pathlib.Path(os.environ["SERVICE"])
kept = json.loads(place.read_text()) if place.exists() else []
address = next(w for w in words if re.search("comments|notes", w))
way = next((w for w in words if w in ("POST", "PATCH", "PUT")), "GET")
if way != "GET":
    if os.environ.get("READ_ONLY"):
        sys.exit("403: Resource not accessible by integration")
    body = pathlib.Path(next(w for w in words if "body" in w).split("@")[1]).read_text()
    if way == "POST":
        kept.append({"id": len(kept) + 1, "body": body})
    else:
        kept[int(address.rsplit("/", 1)[1]) - 1]["body"] = body
    place.write_text(json.dumps(kept))
elif sys.argv[1] == "gh":
    mark = re.search(r'contains\\("(.*)"\\)', words[words.index("--jq") + 1]).group(1)
    print(*[c["id"] for c in kept if mark in c["body"]], sep="\\n")
else:
    print(json.dumps(kept))
"""


ALONE = ('[variations."4 kg"]\nparameters = { load = "4 kg" }\n', "")
"""One run needs no processes beside its own."""

UNDRAWN = """\
from workbench.cli import main
from workbench.reports import page
if __name__ == "__main__":
    page.inline_svg = lambda picture: ""
    main()
"""
"""The program; its pictures are looked at by other tests."""


Lines = list[tuple[str, bool]]
"""Lines of a shell, and whether they run after a failure."""


def github_lines() -> Lines:
    """Return the shell lines of the GitHub workflow."""
    steps = workflow("github.yml")["jobs"]["compare"]["steps"]
    return [(s["run"], s.get("if") == "always()") for s in steps if "run" in s]


def gitlab_lines() -> Lines:
    """Return the shell lines of the GitLab job."""
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
    path = small_study(place / "checkout" / "studies", ALONE, name="arm.toml")
    study = load_study(path)
    records = Workers(Store(place / "runs", "0")).records(tasks(study))
    write_whole(
        path.with_name("arm.baseline.json"), baseline_text(study.name, records, conditions(study))
    )
    (place / "bin").mkdir()
    root = Path(__file__).resolve().parents[2]
    (place / "service.py").write_text(SERVICE)
    (place / "undrawn.py").write_text(UNDRAWN)
    service = f'exec "{sys.executable}" "{place}/service.py"'
    undrawn = f'exec "{sys.executable}" "{place}/undrawn.py" "$@"'
    texts = {
        "gh": f'#!/bin/sh\n{service} gh "$@"\n',
        "curl": f'#!/bin/sh\n{service} curl "$@"\n',
        "python": f'#!/bin/sh\nexec "{sys.executable}" "$@"\n',
        "workbench": f'#!/bin/sh\nPYTHONPATH="{root}" {undrawn}\n',
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


def play(lines: Lines, folder: Path, **more: str) -> tuple[bool, list[dict[str, Any]]]:
    """Run shell lines as a runner does; return whether all went well, and the comments."""
    sent = folder.parent / "comments.json"
    environment = {
        **os.environ,
        "PATH": f"{folder.parent / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "SERVICE": str(sent),
        "GITHUB_STEP_SUMMARY": str(folder.parent / "step-summary.md"),
        "PULL_REQUEST": "7",
        "SUMMARY_TOKEN": "none",
        "CI_API_V4_URL": "https://gitlab.example/api/v4",
        "CI_PROJECT_ID": "1",
        "CI_MERGE_REQUEST_IID": "7",
        "REPOSITORY": "owner/name",
        "GITHUB_ACTIONS": "true",
        **more,
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
    return good, json.loads(sent.read_text(encoding="utf-8")) if sent.exists() else []


def posting(host: str) -> Lines:
    """Return the lines that run after the study."""
    return [(line, True) for line, always in LINES[host]() if always]


OTHERS = [{"id": 1, "body": "Looks good to me."}, {"id": 2, "body": "<!-- workbench study b -->"}]


def summarised(checkout: Path, text: str) -> None:
    (checkout / "comparison").mkdir(exist_ok=True)
    (checkout / "comparison" / "summary.md").write_text(f"{text}\n\n{mark_of('small')}\n")


@pytest.mark.parametrize("host", LINES)
def test_one_comment_is_found_by_its_mark_and_edited(host: str, checkout: Path) -> None:
    (checkout.parent / "comments.json").write_text(json.dumps(OTHERS))
    for text in ("first", "second"):
        summarised(checkout, text)
        good, comments = play(posting(host), checkout)
        assert good and comments[:2] == OTHERS and len(comments) == 3
        assert comments[2]["body"].startswith(text)


@pytest.mark.parametrize("host", LINES)
def test_a_fork_that_may_not_write_ends_well(host: str, checkout: Path) -> None:
    (checkout.parent / "comments.json").write_text(json.dumps(OTHERS))
    summarised(checkout, "first")
    more = {"READ_ONLY": "1"} if host == "github" else {"SUMMARY_TOKEN": ""}
    good, comments = play(posting(host), checkout, **more)
    assert good and comments == OTHERS
    if host == "github":
        assert "first" in (checkout.parent / "step-summary.md").read_text()


@pytest.mark.parametrize("host", LINES)
def test_a_study_that_did_not_end_leaves_no_error_behind(host: str, checkout: Path) -> None:
    good, comments = play(posting(host), checkout)
    assert good and comments == []


def test_runs_are_kept_after_a_failure_and_taken_again() -> None:
    steps = workflow("github.yml")["jobs"]["compare"]["steps"]
    uses = [s.get("uses", s.get("name", "")) for s in steps]
    restore, save = (uses.index(f"actions/cache/{way}@v4") for way in ("restore", "save"))
    assert restore < uses.index("Compare") < save
    assert steps[save]["if"] == "always()" and steps[save]["with"]["path"] == "comparison/runs"
    assert steps[save]["with"]["key"] == steps[restore]["with"]["key"]
    assert "run_attempt" in steps[save]["with"]["key"]
    job = workflow("gitlab.yml")["controllers"]
    assert job["cache"]["when"] == "always" and job["cache"]["paths"] == ["comparison/runs"]


@pytest.mark.system
def test_an_unchanged_controller_is_green_and_reported(checkout: Path) -> None:
    good, comments = play(github_lines(), checkout)
    assert good and len(comments) == 1 and "small passed" in comments[0]["body"]
    for name in ("report.html", "results.json", "summary.md", "junit.xml"):
        assert (checkout / "comparison" / name).stat().st_size > 100


@pytest.mark.system
def test_a_worse_controller_is_red_and_still_reported(checkout: Path) -> None:
    # On the other host: both end in the same command.
    small_study(checkout / "studies", ALONE, WORSE, name="arm.toml")
    good, comments = play(gitlab_lines(), checkout)
    assert not good and len(comments) == 1 and "small failed" in comments[0]["body"]
    text = (checkout / "comparison" / "summary.md").read_text(encoding="utf-8")
    assert "settling time" in text and "Worse than the baseline" in text


@pytest.mark.parametrize("host", LINES)
def test_what_is_kept_is_what_is_written(host: str) -> None:
    text = (shipped_folder() / "ci" / f"{host}.yml").read_text(encoding="utf-8")
    for name in ("report.html", "results.json", "summary.md", "junit.xml"):
        assert f"comparison/{name}" in text
    installs = [line for line, _ in LINES[host]() if "pip install" in line]
    assert len(installs) == 1


@pytest.mark.parametrize("host", LINES)
def test_a_pull_request_that_brings_its_own_results_is_red(host: str, checkout: Path) -> None:
    (guard,) = [(line, always) for line, always in LINES[host]() if "ls-files" in line]
    lines = [line for line, _ in LINES[host]()]
    assert lines.index(guard[0]) < next(i for i, t in enumerate(lines) if "compare" in t)
    for words in (["init", "-q"], ["add", "-f", "studies"]):
        subprocess.run(["git", *words], cwd=checkout, check=True)
    assert play([guard], checkout)[0]
    forged = checkout / "comparison" / "runs" / f"{'0' * 32}.json"
    forged.parent.mkdir(parents=True)
    forged.write_text("{}")
    assert play([guard], checkout)[0]
    subprocess.run(["git", "add", "-f", "comparison"], cwd=checkout, check=True)
    assert not play([guard], checkout)[0]


@pytest.mark.parametrize("host", LINES)
def test_a_module_that_ends_the_process_is_red(host: str, checkout: Path) -> None:
    (checkout / "studies" / "gone.py").write_text("import os\nos._exit(0)\n")
    path = checkout / "studies" / "arm.toml"
    path.write_text(path.read_text().replace('design = "pid"', 'design = "gone:design"'))
    assert not play(LINES[host](), checkout)[0]
