"""The commands of the campaign, on small cases, and what must hold of their folders."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import uuid
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.study.small_study import small_study
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated_recording
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.saving import write_recording

MARK = "WORKBENCH_CAMPAIGN"
"""Variable by which all processes of a command are found."""

ENDS_S = 20.0
"""Time within which the processes of a killed command must have ended, in s."""

TIMED = ("seconds", "work", "solve_time_median", "solve_time_p99", "solve_time_max")
"""What differs from run to run: times, and the work that a killed process took with it."""


@dataclass
class Command:
    """A command that writes into a folder.

    Args:
        result: Name of its file of results.
        parts: Folder of its finished parts within that of the results; empty if it has none.
        program: What Python runs.
    """

    name: str
    words: tuple[str, ...]
    result: str
    parts: str = ""
    program: tuple[str, ...] = ("-m", "workbench")
    environment: dict[str, str] = field(default_factory=dict)

    def start(self, out: Path) -> Running:
        """Begin it in a process of its own."""
        token = uuid.uuid4().hex
        process = subprocess.Popen(
            [sys.executable, *self.program, *self.words, "--out", str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **self.environment, MARK: token},
        )
        return Running(process, token)

    def finished(self, out: Path) -> tuple[int, str]:
        """Run it to its end; returns exit status and what it said."""
        running = self.start(out)
        said = running.process.communicate()[0]
        return running.process.returncode, said

    def answer(self, out: Path) -> Any:
        """Return what it found, without times."""
        return without_times(json.loads((out / self.result).read_text(encoding="utf-8")))

    def finished_parts(self, out: Path) -> dict[Path, tuple[int, bytes]]:
        """Return time of writing and content of each finished part."""
        folder = out / self.parts
        if not self.parts or not folder.is_dir():
            return {}
        files = [p for p in folder.glob("*.json") if not p.name.startswith(".")]
        return {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in files}


@dataclass
class Running:
    """A command at work."""

    process: subprocess.Popen[str]
    token: str

    def kill(self, after: float) -> bool:
        """Kill it after a time, in s; returns whether it was still at work."""
        try:
            said = self.process.communicate(timeout=after)[0]
        except subprocess.TimeoutExpired:
            self.process.kill()
            # Ends when the last worker has closed the pipe.
            self.process.communicate(timeout=ENDS_S)
            return True
        assert self.process.returncode in (0, 1), said
        return False

    def left(self) -> list[int]:
        """Return the processes that it left behind, once they had time to end."""
        end = time.monotonic() + ENDS_S
        while (alive := processes(self.token)) and time.monotonic() < end:
            time.sleep(0.05)
        return alive


def processes(token: str) -> list[int]:
    """Return the processes that have a token in their environment."""
    mark, found = f"{MARK}={token}".encode(), []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                if mark in (folder / "environ").read_bytes():
                    found.append(int(folder.name))
            except OSError:
                continue
    return found


def without_times(value: Any) -> Any:
    """Return data without what differs from run to run."""
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if k not in TIMED}
    return [without_times(v) for v in value] if isinstance(value, list) else value


def half_files(out: Path) -> list[str]:
    """Return the files below a folder that are not whole."""
    found = []
    for path in sorted(out.rglob("*")):
        if path.name.startswith(".") or not path.is_file():
            continue
        content = path.read_bytes()
        try:
            if path.suffix == ".json":
                json.loads(content)
            elif path.suffix == ".xml":
                ET.fromstring(content)
            elif path.suffix in (".html", ".svg"):
                assert content.rstrip().endswith(f"</{path.suffix[1:]}>".encode())
            elif path.suffix == ".png":
                assert b"IEND" in content[-16:]
            else:
                assert content
        except (ValueError, AssertionError, ET.ParseError):
            found.append(str(path))
    return found


def recordings(folder: Path) -> tuple[str, ...]:
    """Write two recordings of a servo axis and return the options that name them."""
    for seed, name in ((1, "a"), (2, "b")):
        force = pushes(200, largest=200.0, seed=seed)
        made = simulated_recording(servo_axis(), force, sample_time=0.01, name=name)
        write_recording(made, folder / f"{name}.csv")
    return ("--fit", str(folder / "a.csv"), "--hold-out", str(folder / "b.csv"))


_SMALLER = """
import sys
from pathlib import Path
from workbench.study import read
read.shipped_study = lambda name: Path({study!r})
from workbench.cli.main import main
main()
"""
"""The program with a small study in place of each that is shipped."""


def commands(folder: Path) -> dict[str, Command]:
    """Return the commands by name, with what they need in a folder."""
    given = recordings(folder)
    box = '\n[robustness]\nscenarios = ["step"]\ndraws = 6\nsearch = 2\nhard = false\n'
    box += '[robustness.box]\nload = ["2 kg", "4 kg"]\n'
    study = small_study(folder)
    study.write_text(study.read_text(encoding="utf-8") + box, encoding="utf-8")
    axis = ("--plant", "servo-axis", *given)
    found = (
        Command("compare", ("compare", str(study), "--jobs", "2"), "results.json", "runs"),
        Command("refit", ("refit", *axis), "results.json"),
        Command(
            "diagnose",
            ("diagnose", *axis, "--without", "coulomb_friction"),
            "verdict.json",
            "stages",
        ),
        Command(
            "controllers",
            ("controllers", "--no-limits", "--jobs", "2"),
            "results.json",
            "runs",
            ("-c", _SMALLER.format(study=str(study))),
        ),
    )
    return {command.name: command for command in found}
