"""Automatic tuning on the full plant: the worst requirement score over a box of plants, lowered.

A design from a linear model is the start. Its specification (bandwidths, weights, speeds) is then
varied within a box; every candidate is designed anew, run on the full plant with every variation
of its parameters in every scenario, and judged by

    J = max over runs and hard requirements of the score + 0.01 * mean of the scores

A score is at most 1 where a requirement is met, so J <= 1.01 means that all are met by all plants;
the mean decides between candidates of equal worst score. A quarter of the evaluations is drawn
about the start, the rest follows Nelder and Mead's simplex from the best of them. Variables with
positive bounds are searched on a logarithmic scale. Drawing and search depend on the seed only,
whatever the number of processes.

Source: Nelder and Mead, A simplex method for function minimization, The Computer Journal 7, 1965;
McKay, Beckman, Conover, Technometrics 21, 1979 (Latin hypercubes).
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from controllers.protocol import Controller
from workbench.errors import NumericalError, WorkbenchError, check_choice, check_range
from workbench.model import Model
from workbench.verification.loop import verify
from workbench.verification.metrics import Metrics, metrics
from workbench.verification.requirements import Requirement, Verdict, score
from workbench.verification.scenario import Scenario

Vector = npt.NDArray[np.float64]
Values = Mapping[str, float]
Design = Callable[[Values], Controller]
"""Designs a controller from values of the variables, by name."""

FAILED = 1000.0
"""Score of a run that could not be finished and of a design that does not exist."""

_WORST_SINGLE = 100.0
_FIRST_STEP = 0.15


@dataclass(frozen=True)
class Candidate:
    """One evaluated design.

    Args:
        values: Values of the variables, by name, each in its own unit.
        objective: The number J that is lowered (a ratio).
        worst: Worst score of the hard requirements (a ratio; at most 1 means all met).

    Example:
        >>> Candidate({"bandwidth": 30.0}, 0.9, 0.89).worst
        0.89
    """

    values: Values
    objective: float
    worst: float


@dataclass(frozen=True)
class Tuning:
    """Result of a tuning.

    Args:
        controller: The tuned controller.
        start: The design that it started from.
        best: The tuned design.
        history: Every evaluated design, in order.
        verdicts: Requirements of the tuned design that came out worst, one per requirement and
            scenario, over all variations.

    Example:
        >>> "best" in Tuning.__dataclass_fields__
        True
    """

    controller: Controller
    start: Candidate
    best: Candidate
    history: tuple[Candidate, ...]
    verdicts: tuple[Verdict, ...]

    def __str__(self) -> str:
        """Return a short aligned table."""
        lines = [
            f"tuning of {self.controller.name}: worst score {self.start.worst:.3g} ->"
            f" {self.best.worst:.3g} in {len(self.history)} evaluations"
        ]
        for name, value in self.best.values.items():
            lines.append(f"  {name:<24} {self.start.values[name]:>10.4g} -> {value:<10.4g}")
        lines += [f"  {verdict}" for verdict in self.verdicts]
        return "\n".join(lines)


def variations(
    model: Model, box: Mapping[str, tuple[float, float]], *, draws: int = 8, seed: int = 0
) -> tuple[Values, ...]:
    """Draw variations of a plant's parameters from a box.

    Args:
        model: The plant.
        box: Lowest and highest value of some parameters, by name, in SI.
        draws: Number of draws of a Latin hypercube, besides the nominal plant.
        seed: Seed of the draws.

    Returns:
        The nominal values of these parameters, then the draws, each by name, in SI.

    Raises:
        WorkbenchError: If a parameter is unknown or a bound outside its range.

    Source:
        McKay, Beckman, Conover 1979.

    Example:
        >>> from workbench.plants.arm import arm
        >>> loads = variations(arm(3), {"load": (0.0, 8.0)}, draws=4)
        >>> len(loads), loads[0]
        (5, {'load': 3.0})
    """
    from scipy.stats import qmc

    check_range("number of draws", draws, 0, 10_000)
    for name, (low, high) in box.items():
        model.parameter(name).with_value(low)
        model.parameter(name).with_value(high)
        check_range(f"upper bound of {name}", high, low, math.inf)
    names = list(box)
    nominal = {name: model.parameter(name).value for name in names}
    if not names or not draws:
        return (nominal,)
    unit = qmc.LatinHypercube(len(names), rng=np.random.default_rng(seed)).random(draws)
    low_, high_ = np.array(list(box.values()), dtype=float).T
    return (
        nominal,
        *(dict(zip(names, (low_ + row * (high_ - low_)).tolist(), strict=True)) for row in unit),
    )


def tune(
    design: Design,
    variables: Mapping[str, tuple[float, float]],
    plant: Model,
    scenarios: Sequence[Scenario],
    requirements: Sequence[Requirement],
    *,
    start: Values,
    plants: Sequence[Values] = ({},),
    evaluations: int = 40,
    seed: int = 0,
    jobs: int = 1,
    progress: bool = False,
) -> Tuning:
    """Tune a design so that its worst requirement score over a box of plants is lowest.

    Args:
        design: Designs a controller from values of the variables.
        variables: Lowest and highest value of each variable, by name, each in its own unit.
        plant: The full plant.
        scenarios: What is asked of the loop.
        requirements: What is wanted; the hard ones count.
        start: Values of the variables to start from, each in its own unit.
        plants: Variations of the plant's parameters, by name, in SI; see `variations`.
        evaluations: Number of designs to evaluate.
        seed: Seed of the draws and of the sensors' noise.
        jobs: Number of processes.
        progress: Whether progress is shown on the error stream.

    Returns:
        The tuned controller, its values and how they were found.

    Raises:
        WorkbenchError: If a name is unknown, a bound is wrong, the start is outside the box, or the
            start cannot be designed.

    Source:
        Nelder and Mead 1965.

    Example:
        >>> from controllers.open_loop import HeldCommand
        >>> from workbench.plants.servo_axis import servo_axis
        >>> from workbench.verification.signals import Steps
        >>> rest = Scenario("rest", {"position": Steps((0.0,), (0.0,))}, 0.1, settle=0.0)
        >>> def held(values):
        ...     command = (values["force"],)
        ...     return HeldCommand(command, actuators=("force",), follows=("position",))
        >>> tuned = tune(
        ...     held,
        ...     {"force": (0.0, 5.0)},
        ...     servo_axis(),
        ...     [rest],
        ...     [Requirement("rmse", 1e-3)],
        ...     start={"force": 4.0},
        ...     evaluations=12,
        ... )
        >>> tuned.best.worst < tuned.start.worst
        True
    """
    from scipy.optimize import minimize
    from tqdm import tqdm

    check_range("number of evaluations", evaluations, 1, 100_000)
    check_range("number of processes", jobs, 1, 1024)
    search = _Search(variables, start)
    if not any(r.hard for r in requirements):
        raise WorkbenchError("there is no hard requirement to tune for; give at least one")
    design(start)
    history: list[Candidate] = []
    with (
        _Runner(design, plant, tuple(plants), scenarios, requirements, seed, jobs) as runner,
        tqdm(total=evaluations, disable=not progress, desc="tuning", unit="design") as bar,
    ):

        def evaluate(point: Vector) -> float:
            if len(history) >= evaluations:
                raise _EnoughError
            values = search.values(point)
            found = runner.judge(values)
            history.append(found)
            bar.update()
            bar.set_postfix(best=f"{min(c.worst for c in history):.3g}")
            return found.objective

        rng = np.random.default_rng(seed)
        first = search.point(start)
        points = [first]
        try:
            evaluate(first)
            for _ in range(evaluations // 4):
                points.append(np.clip(first + 0.2 * rng.standard_normal(len(first)), 0.0, 1.0))
                evaluate(points[-1])
            best = points[int(np.argmin([c.objective for c in history]))]
            minimize(
                evaluate,
                best,
                method="Nelder-Mead",
                bounds=[(0.0, 1.0)] * len(best),
                options={
                    "initial_simplex": _simplex(best),
                    "maxfev": 10 * evaluations,
                    "xatol": 1e-3,
                    "fatol": 1e-4,
                },
            )
        except _EnoughError:
            pass
        found = min(history, key=lambda c: c.objective)
        verdicts = runner.verdicts(found.values)
    return Tuning(design(found.values), history[0], found, tuple(history), verdicts)


class _EnoughError(Exception):
    """All evaluations are used."""


class _Search:
    """The box of variables as a unit cube."""

    def __init__(self, variables: Mapping[str, tuple[float, float]], start: Values) -> None:
        if not variables:
            raise WorkbenchError("there is no variable to tune; give at least one with its bounds")
        self._variables = dict(variables)
        for name in start:
            check_choice("variable", name, variables)
        for name, (low, high) in variables.items():
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise WorkbenchError(
                    f"the bounds of {name} are {low:g} to {high:g}; give a lower and an upper one"
                )
            if name not in start:
                raise WorkbenchError(f"the start has no value of {name!r}; add it")
            check_range(f"start of {name}", start[name], low, high)

    def point(self, values: Values) -> Vector:
        """Return the place of values in the unit cube."""
        place = []
        for name, (low, high) in self._variables.items():
            a, b, v = (math.log(q) if low > 0 else q for q in (low, high, values[name]))
            place.append((v - a) / (b - a))
        return np.array(place)

    def values(self, point: Vector) -> dict[str, float]:
        """Return the values at a place in the unit cube."""
        found = {}
        for share, (name, (low, high)) in zip(point.tolist(), self._variables.items(), strict=True):
            value = low * (high / low) ** share if low > 0 else low + share * (high - low)
            found[name] = min(max(value, low), high)
        return found


def _simplex(best: Vector) -> Vector:
    corners = [best]
    for i in range(len(best)):
        corner = best.copy()
        corner[i] += _FIRST_STEP if best[i] < 0.5 else -_FIRST_STEP
        corners.append(corner)
    return np.array(corners)


class _Runner:
    """Runs designs on all variations, in this process or in several."""

    def __init__(
        self,
        design: Design,
        plant: Model,
        plants: tuple[Values, ...],
        scenarios: Sequence[Scenario],
        requirements: Sequence[Requirement],
        seed: int,
        jobs: int,
    ) -> None:
        from joblib import Parallel

        if not plants or not scenarios:
            raise WorkbenchError(
                f"there are {len(plants)} plants and {len(scenarios)} scenarios; give at least one"
                " of each"
            )
        self._requirements = tuple(requirements)
        self._count = len(plants)
        self._jobs = jobs
        shared = (design, plant, plants, tuple(scenarios), seed)
        self._shared = shared
        self._key = uuid.uuid4().hex
        self._parallel = Parallel(n_jobs=jobs) if jobs > 1 else None

    def __enter__(self) -> _Runner:
        if self._parallel is not None:
            self._parallel.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        if self._parallel is not None:
            self._parallel.__exit__(*error)

    def _measure(self, values: Values) -> list[list[Metrics] | None]:
        if self._parallel is None:
            return [_runs(self._shared, values, i) for i in range(self._count)]
        from joblib import delayed

        calls = (
            delayed(_runs_kept)(self._key, self._shared, values, i) for i in range(self._count)
        )
        return list(self._parallel(calls))

    def judge(self, values: Values) -> Candidate:
        """Return the score of a design."""
        worst, parts = 0.0, []
        for measured in self._measure(values):
            if measured is None:
                return Candidate(values, FAILED, FAILED)
            _, verdicts = score(self._requirements, measured)
            hard = [min(v.score, _WORST_SINGLE) for v in verdicts if v.requirement.hard]
            parts += hard
            worst = max(worst, *hard)
        return Candidate(values, worst + 0.01 * float(np.mean(parts)), worst)

    def verdicts(self, values: Values) -> tuple[Verdict, ...]:
        """Return the worst verdict of every requirement in every scenario."""
        found: dict[tuple[Requirement, str], Verdict] = {}
        for measured in self._measure(values):
            for verdict in score(self._requirements, measured or [])[1] if measured else ():
                key = (verdict.requirement, verdict.scenario)
                if key not in found or verdict.score > found[key].score:
                    found[key] = verdict
        return tuple(found.values())


def _runs(shared: tuple[Any, ...], values: Values, index: int) -> list[Metrics] | None:
    """Return the metrics of one variation in all scenarios, None where there are none."""
    design, plant, plants, scenarios, seed = shared
    try:
        controller = design(values)
        varied = plant.with_parameters(plants[index])
        return [metrics(verify(controller, varied, s, seed=seed)) for s in scenarios]
    except NumericalError:
        return None
    except WorkbenchError:
        # A specification that cannot be met has no controller; names were checked at the start.
        return None


_SHARED: dict[str, tuple[Any, ...]] = {}


def _runs_kept(
    key: str, shared: tuple[Any, ...], values: Values, index: int
) -> list[Metrics] | None:
    """Run with the plant that this process keeps: a new one would be compiled for every run."""
    if key not in _SHARED:
        _SHARED.clear()
        _SHARED[key] = shared
    return _runs(_SHARED[key], values, index)
