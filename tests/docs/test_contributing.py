"""The recipes of CONTRIBUTING.md run as they stand there."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")

pytestmark = pytest.mark.system


def _files(folder: Path) -> list[str]:
    found = re.findall(r"^```\w+ (\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    for name, text in found:
        (folder / name).write_text(text)
    return [name for name, _ in found]


RUN_EACH = """
import json, sys
from workbench.cli.main import run
for words in json.loads(sys.argv[1]):
    if run(words):
        sys.exit(" ".join(words) + " failed")
"""


def test_each_recipe_runs(tmp_path: Path) -> None:
    names = _files(tmp_path)
    assert {"my_plants.py", "my_physics.py", "my_controllers.py", "my_metrics.py"} <= set(names)
    commands = [
        shlex.split(command)
        for command in re.findall(r"^    ((?:workbench|python) .+)$", PAGE, re.MULTILINE)
    ]
    kinds = {words[1] for words in commands}
    assert {"plants", "simulate", "linearise", "verify", "compare", "recording"} <= kinds
    # All verbs in one fresh interpreter: to start one takes longer than most of them.
    verbs = json.dumps([words[1:] for words in commands if words[0] == "workbench"])
    scripts = [words[1:] for words in commands if words[0] == "python"]
    for words in [*scripts, ["-c", RUN_EACH, verbs]]:
        run = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert run.returncode == 0, f"{run.stdout}\n{run.stderr}"
    results = json.loads((tmp_path / "comparison" / "results.json").read_text())
    assert "peak_drive" in json.dumps(results)
