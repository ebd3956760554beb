"""How time and counted work grow: with the recording, the hypotheses and the cores."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.selection.score import score_library
from workbench.model import Model
from workbench.physics.library import library
from workbench.speed.estimation import arm_recording, filter_of
from workbench.speed.measure import Curve, timed
from workbench.speed.whole import run, study_file
from workbench.work.counted import Work, done, since

LENGTHS = (1000, 2000, 5000, 10_000, 20_000)
"""Samples of a recording."""

COUNTS = (5, 10, 20, 40)
"""Hypotheses that are scored together."""

_SAMPLES = 2000


def _measured(work: Callable[[], object], repeats: int) -> tuple[tuple[float, ...], Work]:
    """Return times of a work after a first one, in s, and what the last of them counted."""

    def counted() -> Work:
        before = done()
        work()
        return since(before)

    times = timed(counted, repeats=repeats, warm=True)
    return times.seconds, times.result


def with_length(plant: Model) -> Curve:
    """Filter recordings of the arm of growing length, with 8 free parameters."""
    runs, _, _ = filter_of(plant, 8)
    whole = arm_recording(plant, LENGTHS[-1])
    found = []
    for n in LENGTHS:
        part = replace(whole, inputs=whole.inputs[:n], outputs=whole.outputs[:n])
        found.append(_measured(partial(runs.run, part, plant.values), 3))
    return _curve("length", "One run of the filter", "samples of the recording", LENGTHS, found)


def with_hypotheses(plant: Model) -> Curve:
    """Score growing parts of the library on a recording of 4 s."""
    seen, priors = arm_recording(plant, _SAMPLES), default_priors(plant)[:8]
    entries = library(plant, outputs=seen.used, duration=4.0, sample_time=seen.sample_time)
    found = []
    for n in COUNTS:
        chosen = entries[:: max(1, len(entries) // n)][:n]
        score = partial(score_library, plant, [seen], priors, chosen, noise_scale=0.1)
        found.append(_measured(score, 2))
    return _curve("hypotheses", "Scoring laws on 4 s of a recording", "laws", COUNTS, found)


_STUDY = """
import sys
from workbench.study.result import run_study
from workbench.study.schema import load_study
run_study(load_study(sys.argv[1]), sys.argv[2], jobs=int(sys.argv[3]), progress=lambda *_: None)
"""


def with_cores() -> Curve:
    """Run a study with a growing number of processes; by the clock."""
    counts = tuple(n for n in (1, 2, 4, 8, 16) if n <= (os.cpu_count() or 1))
    found: list[tuple[tuple[float, ...], Work]] = []
    with tempfile.TemporaryDirectory() as place:
        file = study_file(Path(place), draws=8)
        for n in counts:
            out = Path(place) / f"with-{n}"
            found.append(((run(["-c", _STUDY, str(file), str(out), str(n)]).wall,), {}))
    return _curve("cores", "A study of 120 runs, by the clock", "processes", counts, found)


def _curve(
    name: str, title: str, x: str, at: tuple[int, ...], found: list[tuple[tuple[float, ...], Work]]
) -> Curve:
    seconds, work = zip(*found, strict=True)
    return Curve(name, title, x, tuple(float(n) for n in at), seconds, work if any(work) else ())
