"""Run the comparison: every family, case and variation, in parallel and reproducible."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from workbench.benchmark.cases import (
    CASES,
    CHANGES,
    FRESH_CASES,
    FRESH_VARIATIONS,
    VARIATIONS,
    Case,
    changes_at_rest,
    nominal_plant,
    scenarios,
    varied_plant,
)
from workbench.benchmark.designs import (
    FAMILIES,
    available_families,
    design,
    fast_design,
)
from workbench.benchmark.evidence import (
    EVIDENCE_FAMILY,
    LADDER,
    PACED_VARIATIONS,
    PACES,
    evidence_run,
    is_evidence,
    paced_name,
)
from workbench.benchmark.figures_of_run import LIMITED_DEG, figures_of_run, worst_of_all
from workbench.benchmark.one_sample_late import OneSampleLate
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.verification import Run, Scenario, verify
from workbench.verification.responses import Value

Vector = npt.NDArray[np.float64]

FAST = "fast"
"""Name of the design that tolerates no other load, run as evidence."""

LATE = "one sample late"
"""Variation with a delay of one sample between controller and valve, run as evidence."""

BUILT_WHERE_RUN = (FAST, "nonlinear MPC")
"""Designs that are made in the process that runs them."""


class Job(NamedTuple):
    """One controller on one plant through one or several scenarios.

    Args:
        family: One of the families, or `FAST`.
        case: Load and plane that the design knows.
        variation: What differs.
        seed: Seed of the sensors' noise.
        whole: Whether sines are run, or the staircase only.
    """

    family: str
    case: Case
    variation: str
    seed: int = 0
    whole: bool = True


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
        limits: Physical limits by case and size of step in °, in s, with the unknown kilogram too;
            NaN with a reason.
        margins: Speed in rad/s, Ms, Mt and Ms one sample late of each design by family and case.
        seed: Seed of the sensors' noise; with several, the first.
        seeds: Number of seeds; a figure is the worst of all.

    Example:
        >>> Comparison({}, {}, {}, {}, 0).seed
        0
    """

    figures: Mapping[tuple[str, str, str], Mapping[str, Value]]
    curves: Mapping[tuple[str, str, str], Curves] = field(repr=False)
    limits: Mapping[tuple[str, int], Value]
    margins: Mapping[tuple[str, str], tuple[float, float, float, float]]
    seed: int
    seeds: int = 1

    @property
    def variations(self) -> tuple[str, ...]:
        """What differed, in the order of the comparison; the nominal one is among it."""
        every = dict.fromkeys(v for _, _, v in self.figures)
        return tuple(v for v in every if v not in (CHANGES, LATE) and not is_evidence(v))

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
    families: tuple[str, ...] | None = None,
    cases: tuple[Case, ...] = CASES,
    variations: tuple[str, ...] = VARIATIONS,
    limits: bool = True,
    seed: int = 0,
    seeds: int = 1,
    fresh: bool = False,
    jobs: int | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> Comparison:
    """Design every family for every known load and run it through all variations.

    Args:
        families: Families of controllers; by default all that can be designed here.
        cases: Known loads and planes.
        variations: What differs from the design; the first is the nominal one.
        limits: Whether the physical limits are computed.
        seed: Seed of the sensors' noise.
        seeds: Number of seeds of the staircase, from ``seed`` on; a figure is the worst of all. The
            nonlinear MPC, which takes as long as all others together, has one.
        fresh: Whether loads and variations are run that no choice of a design was made with.
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

    families = available_families() if families is None else families
    for family in families:
        check_choice("family of controllers", family, FAMILIES)
    check_range("number of seeds", seeds, 1, 1000)
    for variation in variations:
        check_choice("variation", variation, VARIATIONS)
    count = jobs if jobs is not None else (os.cpu_count() or 1)
    check_range("number of processes", count, 1, 1024)
    whole = cases
    if fresh:
        variations = (*variations, *FRESH_VARIATIONS)
        cases = (*cases, *FRESH_CASES)
    runs = [
        Job(family, case, variation, seed, case in whole and variation not in FRESH_VARIATIONS)
        for case in cases
        for family in families
        for variation in (*variations, CHANGES, LATE)
    ]
    more = [
        job._replace(seed=seed + k, whole=False)
        for job in runs
        for k in range(1, seeds)
        if job.variation not in (CHANGES, LATE) and job.family != "nonlinear MPC"
    ]
    designed = dict(
        Parallel(n_jobs=count)(
            delayed(_design)(family, case)
            for case in cases
            for family in families
            if family not in BUILT_WHERE_RUN
        )
    )
    light = [case for case in cases if case.load == 0.0]
    runs += [
        Job(FAST, case, v, seed, False)
        for case in light
        for v in ("nominal", "1 kg")
        if v in variations
    ]
    runs += [
        Job(family, case, v, seed, False)
        for case in whole
        for family in (*families, *((FAST,) if case in light else ()))
        for v in LADDER
        if family != "nonlinear MPC"
    ]
    runs += [
        Job(EVIDENCE_FAMILY, case, paced_name(v, pace), seed, False)
        for case in whole
        for pace in PACES
        for v in PACED_VARIATIONS
        if EVIDENCE_FAMILY in families and v in variations
    ]
    heavier = [Case(c.changed_load, c.plane) for c in whole if c.changed_load > c.load]
    wanted = [
        (case, round(abs(b - a)), math.radians(a), math.radians(b))
        for case in dict.fromkeys((*whole, *heavier))
        for a, b in LIMITED_DEG
        if limits
    ]
    # The longest first, so that no process idles at the end.
    work = [delayed(_limit)(*move) for move in wanted]
    runs += more
    work += [
        delayed(_run)(job, designed[job.family, job.case.name].controller)
        if job.family not in BUILT_WHERE_RUN
        else delayed(_run)(job, None)
        for job in sorted(runs, key=lambda job: job.family != "nonlinear MPC")
    ]
    figures: dict[tuple[str, str, str], list[Mapping[str, Value]]] = {}
    curves: dict[tuple[str, str, str], Curves] = {}
    found_limits: dict[tuple[str, int], Value] = {}
    found = Parallel(n_jobs=count, return_as="generator_unordered")(work)
    for done, result in enumerate(found, start=1):
        if isinstance(result, _Limit):
            found_limits[result.case, result.size] = result.limit
            what = f"physical limit, {result.case}, {result.size} deg"
        else:
            job, own, drawn = result
            # The run with the sines comes first: its figures are a superset.
            place = len(figures.setdefault(_key(job), [])) if job.seed != seed else 0
            figures.setdefault(_key(job), []).insert(place, own)
            for name, course in drawn.items():
                curves[job.family, job.case.name, name] = course
            what = f"{job.family}, {job.case.name}, {job.variation}"
        if progress is not None:
            progress(done, len(work), what)
    ordered = {_key(job): worst_of_all(figures[_key(job)]) for job in runs}
    margins = {
        key: (own.speed, own.sensitivity, own.complementary, own.late)
        for key, own in designed.items()
    }
    return Comparison(ordered, curves, found_limits, margins, seed, seeds)


def _key(job: Job) -> tuple[str, str, str]:
    return job.family, job.case.name, job.variation


def _design(family: str, case: Case) -> tuple[tuple[str, str], MarginedDesign[Controller]]:
    return (family, case.name), design(family, case)


class _Limit(NamedTuple):
    case: str
    size: int
    limit: Value


def _limit(case: Case, size: int, start: float, end: float) -> _Limit:
    try:
        from workbench.verification.physical_limit import physical_limit
    except ImportError:
        return _Limit(case.name, size, Value(math.nan, "no time-optimal move is available"))
    try:
        found = physical_limit(nominal_plant(case), start, end, until="band")
    except WorkbenchError as error:
        return _Limit(case.name, size, Value(math.nan, str(error)))
    return _Limit(case.name, size, Value(float(found.seconds)))


@lru_cache(maxsize=8)
def _built(family: str, case: Case) -> Controller:
    """Design in this process: machine code does not travel, and is found on disk again."""
    return fast_design(case) if family == FAST else design(family, case).controller


def _run(job: Job, given: Controller | None) -> tuple[Job, dict[str, Value], dict[str, Curves]]:
    controller = _built(job.family, job.case) if given is None else given
    if job.variation == CHANGES:
        own: tuple[Scenario, ...] = (changes_at_rest(job.case),)
        plant = varied_plant(job.case, "nominal")
    elif job.variation == LATE:
        plant, own = varied_plant(job.case, "nominal"), scenarios("nominal")[:1]
        controller = OneSampleLate(controller)
    elif is_evidence(job.variation):
        controller, plant, staircase = evidence_run(job.case, job.variation, controller)
        own = (staircase,)
    else:
        plant, own = varied_plant(job.case, job.variation), scenarios(job.variation)
        own = own if job.whole else own[:1]
    figures: dict[str, Value] = {}
    curves = {}
    for scenario in own:
        run = verify(controller, plant, scenario, seed=job.seed)
        figures.update(figures_of_run(run))
        if job.variation in ("nominal", CHANGES) and job.whole:
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
