"""The guides of data/docs run as they stand there."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.system


def _metric(text: str, name: str) -> float:
    (value,) = re.findall(rf"^ +{name} +(\S+)", text, re.MULTILINE)
    return float(value)


def test_from_a_csv_to_a_verdict(tmp_path: Path) -> None:
    page = (ROOT / "data/docs/own-plant.md").read_text(encoding="utf-8")
    for name, text in re.findall(r"^```\w+ (\S+)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL):
        (tmp_path / name).write_text(text)
    commands = re.findall(r"^    ((?:python|workbench) .+)$", page, re.MULTILINE)
    verbs = [shlex.split(command)[1] for command in commands]
    assert verbs == [
        *("make_data.py", "plants", "recording", "recording", "refit", "diagnose"),
        "diagnose",
        *("verify", "verify"),
    ]
    said = []
    for command in commands:
        tool, *words = shlex.split(command)
        start = [sys.executable, *(["-m", "workbench"] if tool == "workbench" else [])]
        run = subprocess.run(
            [*start, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert run.returncode == 0, f"{command}\n{run.stdout}\n{run.stderr}"
        said.append(run.stdout)
    verdict = json.loads((tmp_path / "diagnosis" / "verdict.json").read_text())
    assert verdict["verdict"] == "named"
    (finding,) = verdict["findings"]
    assert finding["class"] == ["coulomb_friction"]
    assert finding["where"] == ["shaft.torque"]
    # The page names the size that the script has, 0.06 N m; a tenth is more than ten deviations.
    level = finding["parameters"]["level"]
    assert level["value"] == pytest.approx(0.06, rel=0.1)
    errors = verdict["fit"]["held_out"]
    assert errors["refitted"]["n"] > 5 * errors["extended"]["n"]
    first, improved = said[-2:]
    assert "my_controllers:design_pi on motor" in first
    assert _metric(first, "settling_time") == pytest.approx(0.44, abs=0.05)
    assert _metric(improved, "settling_time") == pytest.approx(14.0, rel=0.2)
