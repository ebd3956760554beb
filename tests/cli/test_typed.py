"""The command on a page is the one that was typed, as a shell reads it."""

from __future__ import annotations

import gzip
import html
import re
import shlex
from pathlib import Path

import pytest

from tests.study.small_study import small_study
from workbench.cli.main import run
from workbench.cli.running import typed
from workbench.data_folder import shipped_folder


def commands(page: Path) -> list[str]:
    """Return the commands on a page."""
    text = html.unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8")))
    return re.findall(r"^\s*(workbench [a-z-]+ .*--out .*?)\s*$", text, re.MULTILINE)


def test_nothing_was_typed_where_a_verb_is_called_as_code() -> None:
    assert typed() == ""


WORDS = {
    "recording": ["recording", "my run.csv", "--plant", "arm", "--mapping", "m.toml"],
    "linear analysis": ["report", "small.toml", "--bode", "--angle", "20deg", "-c", "pid"],
    "study": ["compare", "small.toml", "--jobs", "1"],
}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.system
@pytest.mark.parametrize("name", WORDS)
def test_the_command_on_a_page_is_the_one_that_wrote_it(
    name: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small_study(here)
    source = shipped_folder() / "practice-07" / "identify_open.csv.gz"
    rows = gzip.decompress(source.read_bytes()).decode().splitlines()[:3000]
    Path("my run.csv").write_text("\n".join(rows))
    Path("m.toml").write_text('[signals.valve]\ncolumn = "valve_V"\nunit = "V"\n')
    out = Path("the page")
    words = [*WORDS[name], "--out", str(out)]
    assert run(words) in (0, 1), capsys.readouterr().err
    # What was typed is what runs again.
    (command,) = commands(out / "report.html")
    assert shlex.split(command) == ["workbench", *words]
