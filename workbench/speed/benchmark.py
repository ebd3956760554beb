"""Everything that is measured, in one run: comparisons and figures to reach."""

from __future__ import annotations

import math
import os
import platform
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workbench.computing.counted import done, since
from workbench.errors import check_choice
from workbench.experiments import pulse_train
from workbench.linearisation import linearise
from workbench.linearisation.operating_map import operating_map
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.speed import plant_runs, solvers, whole
from workbench.speed.measure import Comparison, Figure, timed
from workbench.speed.whole import run

SCHEMA = "workbench.benchmark/1"


@dataclass
class Benchmark:
    """What a run of the benchmark measured.

    Args:
        seconds: Time that it took, in s.
        load: Load of the machine when it began: processes that were at work (dimensionless).
    """

    figures: list[Figure] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    seconds: float = math.nan
    load: float = math.nan
    raw: dict[str, Any] = field(default_factory=dict)

    def table(self) -> dict[str, Any]:
        """Return everything as plain numbers and words."""
        return {
            "schema": SCHEMA,
            "machine": machine(),
            "load": self.load,
            "seconds": self.seconds,
            "figures": [{**vars(f), "reached": f.reached} for f in self.figures],
            "comparisons": {c.name: c.table() for c in self.comparisons},
            **self.raw,
        }


def machine() -> str:
    """Return processor and Python of this machine, in a line."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(x.split(":", 1)[1].strip() for x in lines if x.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}"


def _spread(low: float, high: float) -> str:
    return f"{low:.3g} to {high:.3g}"


def _open_loop(found: Benchmark, plant: Model, _: Path) -> None:
    sine = plant_runs.open_loop(plant)
    found.comparisons.append(sine)
    voltage, tolerance = pulse_train(duration=60.0), plant_runs.TOLERANCE
    times = timed(lambda: plant_runs.simulated(plant, voltage, tolerance), per=60.0, repeats=5)
    error, where = plant_runs.accuracy(plant)
    before = done()
    plant_runs.simulated(plant, voltage, tolerance)
    each = since(before)["model_evaluations"] / len(voltage)
    said = f"{each:.1f} evaluations of the equations per sample, "
    said += f"{1e9 * times.median * plant_runs.SAMPLE_TIME / each:.0f} ns each"
    beside = f"{where}; with a sine in place of pulses {sine.ways[0].error:.1g}"
    found.figures += [
        Figure("open loop, arm, 60 s of pulses", 1 / times.median, "x real time", 500, True, said),
        Figure("its error on 4 s against DOP853, over the scales", error, "x", 1e-6, False, beside),
    ]
    for name, reach in ((plant_runs.CVODES, 10), (plant_runs.LSODA, 50)):
        low, middle, high = sine.ratio(name)
        spread = _spread(low, high)
        if name == plant_runs.LSODA:
            fast = sine.ratio(plant_runs.LSODA_FAST)[1]
            spread += f"; {fast:.3g} where LSODA is given the workbench's machine code"
        found.figures.append(Figure(f"open loop against {name}", middle, "x", reach, True, spread))
    slow = run(["-c", _INTERPRETED], environment={"WORKBENCH_CC": "none"}).said
    what = "open loop without a compiler"
    found.figures.append(Figure(what, float(slow), "x real time", 20, True, "tolerance 1e-5"))


_INTERPRETED = """
import time
from workbench.experiments import pulse_train
from workbench.plants.arm import arm
from workbench.speed import plant_runs
plant, voltage = arm(load_kg=3), pulse_train(duration=4.0)
plant_runs.simulated(plant, voltage[:100], 1e-5)
began = time.process_time()
plant_runs.simulated(plant, voltage, 1e-5)
print(4.0 / (time.process_time() - began))
"""


def _closed_loop(found: Benchmark, plant: Model, _: Path) -> None:
    comparison, full = plant_runs.closed_loop(plant)
    found.comparisons.append(comparison)
    low, middle, high = comparison.ratio(plant_runs.CONTROL_LOOP)
    step = 1e6 * full.median * plant_runs.SAMPLE_TIME
    parts = f"{step:.1f} us per sample: {plant_runs.loop_parts(plant)}"
    what, beside = "closed loop, PID in Python at 500 Hz", f"{_spread(low, high)}; here {parts}"
    found.figures += [
        Figure(what, 1 / full.median, "x real time", 100, True, parts),
        Figure("closed loop against python-control's", middle, "x", 30, True, beside),
    ]


def _predictive(found: Benchmark, plant: Model, _: Path) -> None:
    linear, nonlinear = solvers.designed(plant)
    problems = solvers.nonlinear_problems(plant, nonlinear)
    found.comparisons.append(problems)
    for name, law, reach in (("linear", linear, (0.5, 2.0)), ("nonlinear", nonlinear, (2.0, 8.0))):
        for value, bound, which in zip(
            solvers.solve_times(plant, law), reach, ("median", "99 % below"), strict=True
        ):
            what = f"{name} MPC, solve, {which}"
            found.figures.append(Figure(what, 1e3 * value, "ms", bound, False))
    low, middle, high = problems.ratio(solvers.DO_MPC)
    found.figures.append(
        Figure("nonlinear MPC against do-mpc", middle, "x", 10, True, _spread(low, high))
    )


def _linear_models(found: Benchmark, plant: Model, _: Path) -> None:
    point = operating_point(plant, {"angle": math.radians(30.0), "mean_pressure": 3e5})
    angles = np.radians(np.arange(61.0))
    given = {"angle": angles, "load": [3.0], "mean_pressure": [3e5]}
    linearise(point)
    operating_map(plant, given)
    single = min(timed(lambda: linearise(point), repeats=10).seconds)
    batch = min(timed(lambda: operating_map(plant, given)).seconds)
    one = {"angle": math.radians(30.0), "mean_pressure": 3e5}
    trim = min(timed(lambda: operating_point(plant, one)).seconds)
    told = f"{1e3 * batch / len(angles):.1f} ms each; finding one operating point alone takes"
    told += f" {1e3 * trim:.1f} ms from afar, processor time with a load of {found.load:.0f}"
    found.figures += [
        Figure("one linear model with its verdict's matrices", 1e3 * single, "ms", 2, False),
        Figure("linear models at 61 angles", 1e3 * batch, "ms", 100, False, told),
    ]


def _diagnoses(found: Benchmark, _: Model, place: Path) -> None:
    figures, found.raw["diagnoses"] = whole.diagnoses(place)
    found.figures += figures


PARTS: dict[str, Callable[[Benchmark, Model, Path], None]] = {
    "open-loop": _open_loop,
    "closed-loop": _closed_loop,
    "linear-models": _linear_models,
    "predictive": _predictive,
    "start-up": lambda found, _, place: found.figures.extend(
        [*whole.start_up(), whole.first_simulation(place)]
    ),
    "study": lambda found, _, place: found.figures.append(whole.draws(place)),
    "diagnoses": _diagnoses,
    "demonstration": lambda found, _, place: found.figures.append(whole.demonstration(place)),
}
"""What is measured, in this order, by name."""


def run_benchmark(
    only: Sequence[str] = (),
    *,
    progress: Callable[[str, Benchmark], None] = lambda name, found: None,
) -> Benchmark:
    """Measure everything once."""
    for name in only:
        check_choice("part of the benchmark", name, PARTS)
    began = time.perf_counter()
    found = Benchmark(load=os.getloadavg()[0])
    plant = arm(load_kg=3)
    with tempfile.TemporaryDirectory(prefix="workbench-benchmark-") as place:
        for name in only or PARTS:
            progress(name, found)
            PARTS[name](found, plant, Path(place))
            found.seconds = time.perf_counter() - began
    return found
