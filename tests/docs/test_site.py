"""The documentation site: texts are taken in whole, commands are right, and it builds offline."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
import typer

from workbench.cli.main import app
from workbench.plants.arm.arm import ARM

DOCS = Path(__file__).resolve().parents[2] / "data/docs"


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("site_hooks", DOCS / "hooks.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_a_section_ends_at_the_next_one_of_its_level(hooks: ModuleType) -> None:
    text = "# A\n\n## B\n\n```\n# no heading\n```\n\n### C\n\n## D\n"
    assert hooks.section(text, "B") == "## B\n\n```\n# no heading\n```\n\n### C\n\n"
    with pytest.raises(ValueError, match="no section 'E'"):
        hooks.section(text, "E")


def test_what_is_included_must_exist(hooks: ModuleType) -> None:
    with pytest.raises(ValueError, match="no file of the repository"):
        hooks.taken_in("<!-- include nothing.md -->")


def test_a_pattern_includes_every_file(hooks: ModuleType) -> None:
    text = hooks.taken_in("<!-- include data/[bo]*/**/README.md -->")
    assert "# Blind round 1" in text and "# Cases of our own" in text


def test_links_of_included_texts_lead_to_pages(hooks: ModuleType) -> None:
    text = hooks.taken_in("<!-- include README.md # Your own machine -->", "evidence")
    assert text.startswith("# Your own machine")
    assert "](../how-to/own-plant.md)" in text


def test_commands_of_the_pages_are_right(hooks: ModuleType) -> None:
    commands = []
    for page in sorted((DOCS / "pages").rglob("*.md")):
        # Included texts are run by tests of their own.
        text = page.read_text(encoding="utf-8")
        commands += re.findall(r"(?:^    |`)(workbench .+?)(?:`|$)", text, re.MULTILINE)
    assert len(commands) > 10
    group = typer.main.get_command(app)
    known = {option.name for option in ARM.options} | set(ARM.design_map)
    for command in commands:
        verb, *words = shlex.split(command)[1:]
        if verb == "--help":
            continue
        found = group.commands[verb]  # type: ignore[attr-defined]
        while hasattr(found, "commands") and words:
            verb, *words = words
            found = found.commands[verb]
        # Raises a usage error at an option or argument that the verb does not take.
        context = found.make_context(verb, words)
        # What the verb does not know it passes on as an option of the plant, here of the arm.
        passed = {
            text.partition("=")[0].replace("-", "_") for text in context.params.get("short") or ()
        }
        assert passed <= known, command


@pytest.mark.long
def test_it_builds_without_a_warning_and_needs_no_network(tmp_path: Path) -> None:
    site = tmp_path / "site"
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
        + ["--config-file", str(DOCS / "mkdocs.yml")],
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (site / "reference/workbench.model.html").is_file()
    assert len(list((site / "notebooks").glob("*.html"))) > 1
    loaded = re.compile(r'<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)="?(https?://[^">]+)')
    for page in site.rglob("*.html"):
        assert not loaded.findall(page.read_text(encoding="utf-8")), page.name
