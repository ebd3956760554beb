"""Force laws on a measured force map: intervals of their numbers, and two ways of holding out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.demo.force_law_fit import FAMILIES, LAW_LENGTH, Family, ForceMap
from workbench.errors import WorkbenchError
from workbench.physics.force_laws import ForceLaw, PaperLaw

Vector = npt.NDArray[np.float64]

ORDERS = (0, 1, 2, 3)
"""Orders of phi that are tried."""

FOLDS = 5
"""Groups of pressures, each held out once."""

_DMSP_20_FORCE = 1600.0
"""Largest force of the muscle whose numbers the laws start from, in N."""

_BLOCKED_FORCE = 10.0
"""Forces below this may be those of a slack muscle, in N."""


@dataclass(frozen=True)
class LawOnMap:
    """A force law fitted to a map, and what it is worth.

    Args:
        name: Short name.
        title: Name as people read it.
        values: Fitted numbers, in the law's own units.
        std: Their standard deviations, in the law's own units.
        fitted_rms: Error on the points fitted on, rms in N.
        largest: Largest error on the points fitted on, in N.
        length_rms: Error on lengths held out, rms in N.
        length_largest: Largest error on lengths held out, in N.
        pressure_rms: Error on pressures held out, rms in N.

    Example:
        >>> LawOnMap("a", "A", np.ones(1), np.ones(1), 1.0, 2.0, 1.5, 3.0, 1.2).title
        'A'
    """

    name: str
    title: str
    values: Vector
    std: Vector
    fitted_rms: float
    largest: float
    length_rms: float
    length_largest: float
    pressure_rms: float


@dataclass(frozen=True)
class MapStudy:
    """Force laws compared on one map.

    Args:
        name: Name of the map.
        points: The map.
        laws: The laws, in the order of the paper.

    Raises:
        WorkbenchError: From `law`, if there is none of that name.
    """

    name: str
    points: ForceMap
    laws: tuple[LawOnMap, ...]

    @property
    def largest_force(self) -> float:
        """Largest force of the map, in N."""
        return float(self.points.force.max())

    @property
    def best(self) -> LawOnMap:
        """The law with the smallest error on lengths held out."""
        return min(self.laws, key=lambda law: law.length_rms)

    def law(self, name: str) -> LawOnMap:
        """Return a law by its short name.

        Raises:
            WorkbenchError: If there is no such law.
        """
        for law in self.laws:
            if law.name == name:
                return law
        raise WorkbenchError(
            f"there is no law {name!r}; there are {', '.join(law.name for law in self.laws)}"
        )

    @property
    def need_for_phi(self) -> float:
        """Error of (3) over that of the best (4), on lengths held out, dimensionless."""
        with_phi = min(law.length_rms for law in self.laws if law.name.startswith("paper"))
        return self.law("petrovic").length_rms / with_phi

    def __str__(self) -> str:
        """Return a short aligned table."""
        percent = 100 / self.largest_force
        lines = [
            f"{self.name}: {len(self.points.force)} points, largest force"
            f" {self.largest_force:.0f} N; errors in N, largest also in % of that",
            f"  {'law':<32} {'numbers':>7} {'fit rms':>8} {'largest':>8} {'%':>6}"
            f" {'length':>8} {'largest':>8} {'%':>6} {'pressure':>8}",
        ]
        lines += [
            f"  {law.title:<32} {len(law.values):>7} {law.fitted_rms:>8.2f} {law.largest:>8.2f}"
            f" {percent * law.largest:>6.2f} {law.length_rms:>8.2f} {law.length_largest:>8.2f}"
            f" {percent * law.length_largest:>6.2f} {law.pressure_rms:>8.2f}"
            for law in self.laws
        ]
        lines.append(
            f"  phi is needed: without it the error on lengths held out is"
            f" {self.need_for_phi:.1f} times as large"
        )
        return "\n".join(lines)


def study_map(
    points: ForceMap, name: str, *, seed: int = 0, progress: Callable[[str], None] | None = None
) -> MapStudy:
    """Fit every law to a map and judge it on lengths and on pressures left out of the fit.

    A force of zero is censored: it says that the tension is not positive, and a law that says the
    same has no error there. Each inner length at which the muscle pulls is left out once, and each
    of `FOLDS` random groups of pressures.

    Raises:
        WorkbenchError: If the muscle pulls at fewer than four lengths.

    Example:
        >>> study_map(made_up_map(), "made up").best.name.startswith("paper")
        True
    """
    levels = np.unique(points.length[points.force > _BLOCKED_FORCE])
    if len(levels) < 4:
        raise WorkbenchError(
            f"the muscle pulls at {len(levels)} length(s) of the force map; a comparison of laws"
            " needs 4 or more"
        )
    pressures = np.random.default_rng(seed).permutation(np.unique(points.pressure))
    groups = [np.isin(points.pressure, pressures[i::FOLDS]) for i in range(FOLDS)]
    lengths = [points.length == level for level in levels[1:-1]]
    laws = []
    for key, family in families_for(float(points.force.max())).items():
        if progress:
            progress(family.title)
        values, std, law = _fit(family, points)
        error = _error(law, points)
        by_length = np.concatenate([_held_out(family, points, rows) for rows in lengths])
        by_pressure = np.concatenate([_held_out(family, points, rows) for rows in groups])
        laws.append(
            LawOnMap(
                key,
                family.title,
                values,
                std,
                _rms(error),
                float(np.max(np.abs(error))),
                _rms(by_length),
                float(np.max(np.abs(by_length))),
                _rms(by_pressure),
            )
        )
    return MapStudy(name, points, tuple(laws))


def families_for(largest_force: float) -> dict[str, Family]:
    """Return the laws with starting numbers for a muscle of some strength.

    Args:
        largest_force: Largest force of the map, in N.

    Returns:
        The laws by short name; equation (4) with phi of every order of `ORDERS`.

    Example:
        >>> list(families_for(600.0))[-2:]
        ['paper_3', 'sarosi']
    """
    size = largest_force / _DMSP_20_FORCE
    found = {}
    for key, family in FAMILIES.items():
        start = np.array(family.start)
        if key.startswith("tondu"):
            start[0] *= np.sqrt(size)
        elif key == "sarosi":
            start[[0, 1, 3, 4, 5]] *= size
        else:
            start *= size
        if key != "paper":
            found[key] = replace(family, start=tuple(start.tolist()))
            continue
        for order in ORDERS:
            phi = [-10.0, -10.0, -0.3, -0.01][: order + 1]
            numbers = (*start[:3].tolist(), *(size * v for v in phi))
            title = f"equation (4), phi of order {order}"
            found[f"paper_{order}"] = replace(family, title=title, start=numbers)
    return found


def made_up_map() -> ForceMap:
    """Compute a force map of a 200 mm muscle that obeys equation (4), without noise.

    Example:
        >>> made_up_map().force.shape
        (70,)
    """
    q, p = np.meshgrid(np.linspace(0.0, 0.03, 7), np.linspace(1e5, 6e5, 10))
    force = np.asarray(PaperLaw().force(q, p))
    return ForceMap(p.ravel(), LAW_LENGTH - q.ravel(), force.ravel())


def _fit(family: Family, points: ForceMap) -> tuple[Vector, Vector, ForceLaw]:
    from scipy.optimize import least_squares

    start = np.array(family.start)
    q, p = points.contraction, points.pressure

    def misfit(scaled: Vector) -> Vector:
        return np.asarray(family.build(scaled * start).force(q, p)) - points.force

    found = least_squares(misfit, np.ones(len(start)), max_nfev=4000)
    freedom = max(1, len(points.force) - len(start))
    information = found.jac.T @ found.jac
    covariance = np.linalg.pinv(information) * 2 * found.cost / freedom
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * np.abs(start)
    return found.x * start, std, family.build(found.x * start)


def _error(law: ForceLaw, points: ForceMap) -> Vector:
    return np.asarray(law.force(points.contraction, points.pressure)) - points.force


def _held_out(family: Family, points: ForceMap, rows: npt.NDArray[np.bool_]) -> Vector:
    return _error(_fit(family, points.take(~rows))[2], points.take(rows))


def _rms(error: Vector) -> float:
    return float(np.sqrt(np.mean(error**2)))
