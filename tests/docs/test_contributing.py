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


def test_each_recipe_runs(tmp_path: Path) -> None:
    names = _files(tmp_path)
    assert {"my_plants.py", "my_physics.py", "my_controllers.py", "my_metrics.py"} <= set(names)
    commands = re.findall(r"^    ((?:workbench|python) .+)$", PAGE, re.MULTILINE)
    kinds = {shlex.split(command)[1] for command in commands}
    assert {"plants", "simulate", "linearise", "verify", "compare", "recording"} <= kinds
    for command in commands:
        program, *words = shlex.split(command)
        run = subprocess.run(
            [sys.executable, *(["-m", "workbench"] if program == "workbench" else []), *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, f"{command}\n{run.stdout}\n{run.stderr}"
    results = json.loads((tmp_path / "comparison" / "results.json").read_text())
    assert "peak_drive" in json.dumps(results)
