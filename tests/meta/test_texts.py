"""The texts of the checkout are clean and its files have names that say what is in them."""

from __future__ import annotations

import pytest

from tests.meta.hygiene import SUFFIXES, check_text
from tests.meta.sources import ROOT, SKIPPED_FOLDERS, module_files, texts

DRAWERS = {"utils", "util", "helpers", "misc", "common", "tools", "stuff"}
TOP_LEVEL = {"workbench", "controllers", "notebooks", "tests", "data"}


def test_texts_are_clean() -> None:
    problems = [
        problem
        for path in texts(SUFFIXES)
        for problem in check_text(
            path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        )
    ]
    assert not problems, "\n".join(problems)


def test_the_texts_that_count_are_read() -> None:
    names = {path.relative_to(ROOT).as_posix() for path in texts(SUFFIXES)}
    assert {
        ".ci/run",
        "Makefile",
        "README.md",
        "data/README.md",
        "pyproject.toml",
        "workbench/errors.py",
    } <= names


@pytest.mark.parametrize(
    "line",
    [
        "path = '/" + "work/main'",
        "open('/" + "tmp/x')",
        "see ../sha" + "red/design.md",
        "# TO" + "DO: finish",
        "# FIX" + "ME",
        "https://py" + "pi.org",
        "as iss" + "ue 12 asks",
    ],
)
def test_a_forbidden_word_is_found(line: str) -> None:
    assert list(check_text("README.md", f"First line.\n{line}\n"))


def test_the_exception_holds_for_one_file_only() -> None:
    line = "../sha" + "red/recordings"
    assert not list(check_text(".ci/run", line))
    assert list(check_text("Makefile", line))


def test_a_files_name_says_what_is_in_it() -> None:
    assert not {path.stem for path in module_files()} & DRAWERS


def test_top_level_folders() -> None:
    folders = {path.parent for package in ROOT.iterdir() for path in package.glob("*.py")}
    # Hidden folders, builds and environments hold no sources of the project.
    names = {path.name for path in folders if not path.name.startswith(".")} - SKIPPED_FOLDERS
    assert names <= TOP_LEVEL
