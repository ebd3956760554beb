"""Whole commands, each in a process of its own: start-up, diagnoses, studies, the demonstration."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.computing.counted import Work, in_words
from workbench.diagnosis.stage_files import FOLDER
from workbench.errors import WorkbenchError
from workbench.evaluation.rig.cases import make_case
from workbench.reports.page import template
from workbench.speed.measure import Figure

CORES = os.cpu_count() or 1

ONE, THREE = ("valve_offset",), ("stribeck", "valve_offset", "leak_muscle_1")
"""What the cases hide, by the words of the second simulator of the rig."""


@dataclass(frozen=True)
class Ran:
    """A command that ran.

    Args:
        wall: Wall-clock time, in s.
        processor: Processor time of all its processes, in s.
        memory: Largest resident size of one of its processes, in MB.
    """

    wall: float
    processor: float
    memory: float
    said: str = field(default="", repr=False)

    def words(self, limit_s: float) -> str:
        """Say what the time consists of, and whether others were at work."""
        said = f"{self.processor:.0f} s of processor time on {CORES} cores"
        if self.wall > limit_s >= self.processor / CORES:
            said += f"; others were at work, alone it takes {self.processor / CORES:.0f} s or more"
        return said


def run(
    arguments: Sequence[str],
    *,
    cache: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Ran:
    """Run Python with arguments in a process of its own."""
    variables = {**os.environ, **(environment or {})}
    if cache is not None:
        variables["WORKBENCH_CACHE"] = str(cache)
    began = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [sys.executable, *arguments], stdout=said, stderr=subprocess.STDOUT, env=variables
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - began
        said.seek(0)
        text = said.read().decode(errors="replace").strip()
        if process.returncode not in (0, 1):
            raise WorkbenchError(f"{' '.join(arguments)} failed: {text[-200:]}")
    return Ran(wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0, text)


def start_up() -> list[Figure]:
    """Measure what every command pays."""
    rows = (
        ("import workbench", ["-c", "import workbench"], 0.3, "the interpreter's start included"),
        ("workbench --help", ["-m", "workbench", "--help"], 0.5, ""),
        ("import workbench as wb; wb.arm()", ["-c", "import workbench as wb; wb.arm()"], 1.5, ""),
    )  # fmt: skip
    figures = []
    for what, arguments, reach, words in rows:
        runs = [run(arguments) for _ in range(5)]
        best = min(runs, key=lambda r: r.wall)
        said = f"{best.processor:.2f} s of processor time" + (f", {words}" if words else "")
        if best.wall > reach >= best.processor:
            said += "; others were at work, alone it takes little more than that"
        figures.append(Figure(what, best.wall, "s", reach, False, said))
    return figures


def first_simulation(place: Path) -> Figure:
    """Measure a first simulation with nothing built."""
    words = ["-m", "workbench", "simulate", "--load", "3", "--pulses", "0.9", "--period", "4"]
    words += ["--duration", "12", "--out", str(place / "run.csv")]
    cold = run(words, cache=place / "cold")
    warm = min((run(words, cache=place / "cold") for _ in range(3)), key=lambda r: r.wall)
    more = f"{warm.wall:.2f} s once built; the rest is the C compiler, {cold.words(3.0)}"
    return Figure("first simulation of the arm, nothing built", cold.wall, "s", 3.0, False, more)


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis of made-up recordings of the arm.

    Args:
        stages: Time until each stage was reached, in s, by name.
    """

    ran: Ran
    work: Work
    found: tuple[str, ...]
    stages: Mapping[str, float]

    def words(self, limit_s: float) -> str:
        """Say what it found and what it took."""
        reached = [0.0, *self.stages.values()]
        parts = [
            f"{name} {end - begin:.0f}"
            for name, begin, end in zip(self.stages, reached, reached[1:], strict=False)
        ]
        return (
            f"{self.ran.words(limit_s)}; {', '.join(parts)} s; {in_words(self.work)}; found"
            f" {', '.join(self.found)}"
        )


def diagnosed(place: Path, name: str, hidden: tuple[str, ...], cache: Path, seed: int) -> Diagnosed:
    """Make a case of 76 s and diagnose it with the whole library."""
    case, out = place / name, Path(tempfile.mkdtemp(prefix=f"{name}-", dir=place))
    if not case.exists():
        make_case(seed, list(hidden), 3.0, case)
    ran = run(["-m", "workbench", "diagnose", str(case), "--out", str(out)], cache=cache)
    verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    names = tuple(str(f["effect"]) for f in verdict["findings"])
    files = [json.loads(f.read_text(encoding="utf-8")) for f in (out / FOLDER).glob("*.json")]
    reached = sorted((f["seconds"], f["stage"].lower()) for f in files)
    return Diagnosed(ran, verdict["work"], names, {stage: seconds for seconds, stage in reached})


def diagnoses(place: Path) -> tuple[list[Figure], dict[str, Any]]:
    """Diagnose a case cold and warm, and one with three effects; figures, and their numbers."""
    cache = place / "diagnoses"
    cold = diagnosed(place, "one-effect", ONE, cache, 2501)
    three = diagnosed(place, "three-effects", THREE, cache, 2500)
    warm = diagnosed(place, "one-effect", ONE, cache, 2501)
    more = cold.ran.processor - warm.ran.processor
    busy = cold.ran.wall - warm.ran.wall
    least = max(more / CORES, 0.0)
    said = f"{more:.0f} s of processor time more, {cold.work['compilations']} compilations, on"
    said += f" {CORES} cores; by the clock, with what else ran, {busy:.0f} s"
    memory = 3 * max(d.ran.memory for d in (cold, warm, three)) / 1e3
    largest = "three times the largest of them"
    figures = [
        Figure("diagnosis, 76 s, whole library", warm.ran.wall, "s", 45, False, warm.words(45)),
        Figure("diagnosis, three effects", three.ran.wall, "s", 150, False, three.words(150)),
        Figure("diagnosis, nothing built: longer by", least, "s", 15, False, said),
        Figure("diagnosis, memory of its three processes", memory, "GB", 2, False, largest),
    ]
    named = {"cold": cold, "warm": warm, "three effects": three}
    return figures, {
        name: {k: v for k, v in (vars(d.ran) | vars(d)).items() if k not in ("said", "ran")}
        for name, d in named.items()
    }


def demonstration(place: Path) -> Figure:
    """Measure the demonstration with nothing built."""
    words = ["-m", "workbench", "demo", "--out", str(place / "demo")]
    ran = run(words, cache=place / "demo-cache")
    return Figure("demonstration, nothing built", ran.wall, "s", 60, False, ran.words(60))


def draws(place: Path) -> Figure:
    """Measure 3 controllers x 5 angles x 20 draws."""
    text = template("workbench.speed", "draws.toml").render(angles=(10, 20, 30, 40, 50), draws=20)
    file, out = place / "draws.toml", place / "draws"
    file.write_text(text, encoding="utf-8")
    words = ["-m", "workbench", "compare", str(file), "--out", str(out), "--jobs", "2"]
    ran = run(words)
    work: Mapping[str, int] = json.loads((out / "results.json").read_text(encoding="utf-8"))["work"]
    said = f"{ran.words(30)}; with the page; {in_words(work)}"
    return Figure("3 controllers, 5 angles, 20 draws", ran.wall, "s", 30, False, said)
