"""Run the comparison: every family, case and variation, in parallel and reproducible."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from workbench.benchmark.cases import (
    CASES,
    CHANGES,
    VARIATIONS,
    Case,
    changes_at_rest,
    nominal_plant,
    scenarios,
    varied_plant,
)
from workbench.benchmark.designs import FAMILIES, design, fast_design
from workbench.benchmark.figures_of_run import LIMITED_DEG, figures_of_run
from workbench.benchmark.one_sample_late import OneSampleLate
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.verification import Run, Scenario, verify
from workbench.verification.responses import Figure

Vector = npt.NDArray[np.float64]

FAST = "fast"
"""Name of the design that tolerates no other load, run as evidence."""

LATE = "one sample late"
"""Variation with a delay of one sample between controller and valve, run as evidence."""


class Job(NamedTuple):
    """One controller on one plant through one or several scenarios.

    Args:
        family: One of the families, or `FAST`.
        case: Load and plane that the design knows.
        variation: What differs.
    """

    family: str
    case: Case
    variation: str


@dataclass(frozen=True)
class Curves:
    """Curves of a run, kept for pictures.

    Args:
        time: Sample times, shape (n,), in s.
        reference: Reference, shape (n,), in rad.
        angle: Angle, shape (n,), in rad.
        command: Valve voltage, shape (n,), in V.
        pressures: Gauge pressures of both muscles, shape (2, n), in Pa.

    Example:
        >>> list(Curves.__dataclass_fields__)[0]
        'time'
    """

    time: Vector
    reference: Vector
    angle: Vector
    command: Vector
    pressures: Vector


@dataclass(frozen=True)
class Comparison:
    """Everything that the comparison found.

    Args:
        figures: Figures by family, case and variation, in the units of their names.
        curves: Curves by family, case and scenario, nominal runs.
        limits: Physical limits by case and size of step in °, in s; NaN with a reason.
        margins: Speed in rad/s, Ms and Mt of each design by family and case.
        seed: Seed of the sensors' noise.

    Example:
        >>> Comparison({}, {}, {}, {}, 0).seed
        0
    """

    figures: Mapping[tuple[str, str, str], Mapping[str, Figure]]
    curves: Mapping[tuple[str, str, str], Curves] = field(repr=False)
    limits: Mapping[tuple[str, int], Figure]
    margins: Mapping[tuple[str, str], tuple[float, float, float]]
    seed: int

    @property
    def families(self) -> tuple[str, ...]:
        """Families in the order of the comparison."""
        return tuple(dict.fromkeys(f for f, _, _ in self.figures if f != FAST))

    @property
    def cases(self) -> tuple[str, ...]:
        """Names of the cases in the order of the comparison."""
        return tuple(dict.fromkeys(c for _, c, _ in self.figures))


def compare_controllers(
    *,
    families: tuple[str, ...] = FAMILIES,
    cases: tuple[Case, ...] = CASES,
    variations: tuple[str, ...] = VARIATIONS,
    limits: bool = True,
    seed: int = 0,
    jobs: int | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> Comparison:
    """Design every family for every known load and run it through all variations.

    Args:
        families: Families of controllers.
        cases: Known loads and planes.
        variations: What differs from the design; the first is the nominal one.
        limits: Whether the physical limits are computed.
        seed: Seed of the sensors' noise.
        jobs: Number of processes; by default the number of processors.
        progress: Called with the number of finished runs, of all runs, and what was finished.

    Returns:
        Figures, curves and limits.

    Raises:
        WorkbenchError: If a family or variation is unknown.

    Example:
        >>> compare_controllers(families=("fuzzy",))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: family of controllers is 'fuzzy'; it must be one of ...
    """
    from joblib import Parallel, delayed

    for family in families:
        check_choice("family of controllers", family, FAMILIES)
    for variation in variations:
        check_choice("variation", variation, VARIATIONS)
    count = jobs if jobs is not None else (os.cpu_count() or 1)
    check_range("number of processes", count, 1, 1024)
    runs = [
        Job(family, case, variation)
        for case in cases
        for family in families
        for variation in (*variations, CHANGES, LATE)
    ]
    designed = dict(
        Parallel(n_jobs=count)(
            delayed(_design)(family, case) for case in cases for family in families
        )
    )
    light = [case for case in cases if case.load == 0.0]
    runs += [Job(FAST, case, v) for case in light for v in ("nominal", "1 kg") if v in variations]
    wanted = [
        (case, round(abs(b - a)), math.radians(a), math.radians(b))
        for case in cases
        for a, b in LIMITED_DEG
        if limits
    ]
    # The longest first, so that no process idles at the end.
    work = [delayed(_limit)(*move) for move in wanted]
    work += [
        delayed(_run)(
            job,
            fast_design(job.case)
            if job.family == FAST
            else designed[job.family, job.case.name].controller,
            seed,
        )
        for job in runs
    ]
    figures: dict[tuple[str, str, str], Mapping[str, Figure]] = {}
    curves: dict[tuple[str, str, str], Curves] = {}
    found_limits: dict[tuple[str, int], Figure] = {}
    found = Parallel(n_jobs=count, return_as="generator_unordered")(work)
    for done, result in enumerate(found, start=1):
        if isinstance(result, _Limit):
            found_limits[result.case, result.size] = result.limit
            what = f"physical limit, {result.case}, {result.size} deg"
        else:
            job, own, drawn = result
            figures[job.family, job.case.name, job.variation] = own
            for name, course in drawn.items():
                curves[job.family, job.case.name, name] = course
            what = f"{job.family}, {job.case.name}, {job.variation}"
        if progress is not None:
            progress(done, len(work), what)
    ordered = {
        (job.family, job.case.name, job.variation): figures[
            job.family, job.case.name, job.variation
        ]
        for job in runs
    }
    margins = {
        key: (own.speed, own.sensitivity, own.complementary) for key, own in designed.items()
    }
    return Comparison(ordered, curves, found_limits, margins, seed)


def _design(family: str, case: Case) -> tuple[tuple[str, str], MarginedDesign[Controller]]:
    return (family, case.name), design(family, case)


class _Limit(NamedTuple):
    case: str
    size: int
    limit: Figure


def _limit(case: Case, size: int, start: float, end: float) -> _Limit:
    try:
        from workbench.verification.physical_limit import physical_limit
    except ImportError:
        return _Limit(case.name, size, Figure(math.nan, "no time-optimal move is available"))
    try:
        found = physical_limit(nominal_plant(case), start, end, until="band")
    except WorkbenchError as error:
        return _Limit(case.name, size, Figure(math.nan, str(error)))
    return _Limit(case.name, size, Figure(float(found.seconds)))


def _run(
    job: Job, controller: Controller, seed: int
) -> tuple[Job, dict[str, Figure], dict[str, Curves]]:
    if job.variation == CHANGES:
        own: tuple[Scenario, ...] = (changes_at_rest(job.case),)
        plant = varied_plant(job.case, "nominal")
    elif job.variation == LATE:
        plant, own = varied_plant(job.case, "nominal"), scenarios("nominal")[:1]
        controller = OneSampleLate(controller)
    else:
        plant, own = varied_plant(job.case, job.variation), scenarios(job.variation)
        if job.family == FAST:
            own = own[:1]
    figures: dict[str, Figure] = {}
    curves = {}
    for scenario in own:
        run = verify(controller, plant, scenario, seed=seed)
        figures.update(figures_of_run(run))
        if job.variation in ("nominal", CHANGES):
            curves[scenario.name] = _curves(run)
    return job, figures, curves


def _curves(run: Run) -> Curves:
    return Curves(
        run.time,
        run.references["angle"],
        run["angle"],
        run["valve"],
        np.array([run["pressure_1"], run["pressure_2"]]),
    )
