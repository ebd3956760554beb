"""Force laws on a measured force map: intervals of their numbers, and two ways of holding out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError, check_choice
from workbench.physics.force_laws import ForceLaw, PaperLaw, Petrovic, Sarosi, TonduLopez

LAW_LENGTH = 0.2
"""Nominal length of the muscle for which the laws were published, in m."""

LAW_CONTRACTION = 33e-3
"""Largest contraction at which the published laws may be used, in m of a 200 mm muscle."""

ORDERS = (0, 1, 2, 3)
"""Orders of phi that are tried."""

FOLDS = 5
"""Groups of pressures, each held out once."""

_DMSP_20_FORCE = 1600.0
"""Largest force of the muscle whose numbers the laws start from, in N."""

_BLOCKED_FORCE = 10.0
"""Forces below this may be those of a slack muscle, in N."""


@dataclass(frozen=True)
class ForceMap:
    """Measured static forces of a muscle.

    Args:
        pressure: Gauge pressures, shape (n,), in Pa.
        length: Lengths, shape (n,), in m.
        force: Forces, shape (n,), in N; zero where the muscle is slack.
        longest: Length that counts as not contracted, in m; the longest of the points if 0.
    """

    pressure: Vector
    length: Vector
    force: Vector
    longest: float = 0.0

    @cached_property
    def contraction(self) -> Vector:
        """Contraction of a 200 mm muscle that is contracted by the same ratio, in m.

        A muscle of the same diameter and fibre angle pulls as hard at the same relative
        contraction, whatever its length.
        """
        return LAW_LENGTH * (1 - self.length / (self.longest or float(self.length.max())))

    def take(self, rows: npt.NDArray[np.bool_]) -> ForceMap:
        """Return some of the points, with the contraction they had."""
        longest = self.longest or float(self.length.max())
        return ForceMap(self.pressure[rows], self.length[rows], self.force[rows], longest)


@dataclass(frozen=True)
class Family:
    """A force law with numbers to be fitted.

    Args:
        start: Numbers to start from, in the law's own units.
    """

    title: str
    build: Callable[[Vector], ForceLaw]
    start: tuple[float, ...]
    published: ForceLaw


def _tondu(x: Vector) -> ForceLaw:
    k = (float(x[2]) if len(x) > 2 else 1.0, float(x[3]) if len(x) > 3 else 0.0)
    return TonduLopez(*k, nominal_diameter=float(x[0]), fibre_angle=float(x[1]))


def _paper(x: Vector) -> ForceLaw:
    # The polynomial without its constant branch: the map has no contractions near its switch.
    return PaperLaw(
        (float(x[0]), float(x[1]), float(x[2])), tuple(x[3:].tolist()), 0.0, phi_switch=-1.0
    )


FAMILIES: dict[str, Family] = {
    "tondu_lopez": Family("equation (1), Tondu-Lopez", _tondu, (0.02, 0.436), TonduLopez()),
    "tondu_lopez_k": Family(
        "equation (2), constant k", _tondu, (0.02, 0.436, 1.1), TonduLopez.constant_k()
    ),
    "tondu_lopez_kp": Family(
        "equation (2), k of pressure",
        _tondu,
        (0.02, 0.436, 0.86, 13.2),
        TonduLopez.pressure_dependent_k(),
    ),
    "petrovic": Family(
        "equation (3), Petrovic",
        lambda x: Petrovic((float(x[0]), float(x[1]), float(x[2]))),
        (280.0, -2.2, 0.033),
        Petrovic(),
    ),
    "paper": Family(
        "equation (4), with φ(q)", _paper, (280.0, -2.2, 0.033, -10.0, -10.0, -0.3), PaperLaw()
    ),
    "sarosi": Family(
        "Sárosi",
        lambda x: Sarosi(*(float(v) for v in x)),
        (-4.0018, 292.462, -0.32931, -9.33564, 294.054, -280.498),
        Sarosi(),
    ),
}
"""The laws of the plant, in the order of the paper."""


@dataclass(frozen=True)
class LawOnMap:
    """A force law fitted to a map, and its errors there, on what was held out, and as published.

    Args:
        values: Fitted numbers, in the law's own units.
        std: Their standard deviations, in the law's own units.
    """

    name: str
    title: str
    law: ForceLaw
    values: Vector
    std: Vector
    fitted_rms_N: float
    fitted_largest_N: float
    lengths_held_out_rms_N: float
    lengths_held_out_largest_N: float
    pressures_held_out_rms_N: float
    published_rms_N: float


@dataclass(frozen=True)
class MapStudy:
    """Force laws compared on one map."""

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
        return min(self.laws, key=lambda law: law.lengths_held_out_rms_N)

    def law(self, name: str) -> LawOnMap:
        """Return a law by its short name."""
        check_choice("law", name, [law.name for law in self.laws])
        return next(law for law in self.laws if law.name == name)

    @property
    def need_for_phi(self) -> float:
        """Error of (3) over that of the best (4), on lengths held out, dimensionless."""
        errors = {law.name: law.lengths_held_out_rms_N for law in self.laws}
        return errors["petrovic"] / min(e for n, e in errors.items() if n.startswith("paper"))

    @property
    def headline(self) -> str:
        """The best law, and whether a part of the force does not depend on pressure, in words."""
        best = self.best
        percent = 100 * best.lengths_held_out_largest_N / self.largest_force
        return (
            f"Best on lengths left out: {best.title}, {best.lengths_held_out_rms_N:.1f} N rms, at"
            f" most {percent:.1f} % of the largest force. Without phi, equation (3) errs"
            f" {self.need_for_phi:.1f} times as much as equation (4): the force of the tube that"
            " does not depend on pressure is really there."
        )

    def table(self) -> dict[str, Any]:
        """Return everything as plain numbers, with units in their names."""
        return {
            "name": self.name,
            "largest_force_N": self.largest_force,
            "need_for_phi": self.need_for_phi,
            "laws": {
                law.name: {k: v for k, v in vars(law).items() if k not in ("name", "law")}
                for law in self.laws
            },
        }


_STRENGTH = (1.5e-3, 1.0)
"""Force over pressure and squared length, a ratio: pi/4 (D/L)^2 times some 10 for a braid, with
diameters D of a fiftieth to a third of the length L."""


def check_units(points: ForceMap) -> None:
    """Check that forces are those of a muscle of that length at that pressure."""
    strongest = int(np.argmax(points.force))
    force, pressure = float(points.force[strongest]), float(points.pressure[strongest])
    length = float(points.length.max())
    ratio = force / (pressure * length**2) if pressure > 0 and length > 0 else np.nan
    if not _STRENGTH[0] <= ratio <= _STRENGTH[1]:
        low, high = (bound * abs(pressure) * length**2 for bound in _STRENGTH)
        raise WorkbenchError(
            f"the force map has {force:.4g} N at {pressure / 1e5:.4g} bar (gauge) and a length of"
            f" {1e3 * length:.4g} mm, where a muscle pulls {low:.2g} to {high:.2g} N; check the"
            " units of pressure, length and force in the header (pressure_Pa, length_m, force_N)"
        )


def study_map(
    points: ForceMap,
    name: str,
    *,
    families: Mapping[str, Family] | None = None,
    progress: Callable[[str], None] = lambda law: None,
) -> MapStudy:
    """Fit every law to a map and judge it on lengths and on pressures left out of the fit.

    A force of zero is censored: it says that the tension is not positive, and a law that says the
    same has no error there. Each inner length at which the muscle pulls is left out once, and each
    of `FOLDS` random groups of pressures.

    Args:
        families: The laws; by default `families_for` the strength of the muscle.
    """
    check_units(points)
    levels = np.unique(points.length[points.force > _BLOCKED_FORCE])
    if len(levels) < 4:
        raise WorkbenchError(
            f"the muscle pulls at {len(levels)} length(s) of the force map; a comparison of laws"
            " needs 4 or more"
        )
    pressures = np.random.default_rng(0).permutation(np.unique(points.pressure))
    groups = [np.isin(points.pressure, pressures[i::FOLDS]) for i in range(FOLDS)]
    lengths = [points.length == level for level in levels[1:-1]]
    in_range = points.take(points.contraction <= LAW_CONTRACTION)
    laws = []
    for key, family in (families or families_for(float(points.force.max()))).items():
        progress(family.title)
        values, std, law = fit_law(family, points)
        error = _error(law, points)
        # A part of the map hardly moves the numbers: its fits start from those of the whole.
        near = replace(family, start=tuple(np.where(values == 0.0, family.start, values).tolist()))
        by_length = np.concatenate([_held_out(near, points, rows) for rows in lengths])
        by_pressure = np.concatenate([_held_out(near, points, rows) for rows in groups])
        published = _rms(_error(family.published, in_range))
        fitted = (key, family.title, law, values, std, *_size(error))
        laws.append(LawOnMap(*fitted, *_size(by_length), _rms(by_pressure), published))
    return MapStudy(name, points, tuple(laws))


def families_for(largest_force: float) -> dict[str, Family]:
    """Return the laws with starting numbers for a muscle whose largest force is given, in N.

    Equation (4) comes with phi of every order of `ORDERS`.
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


def fit_law(family: Family, points: ForceMap) -> tuple[Vector, Vector, ForceLaw]:
    """Fit a law to a force map by least squares of the force.

    A slack muscle measures zero; the law's own clamp says the same of every tension below zero, so
    slack points bound the tension without pulling it to zero.

    Returns:
        Fitted numbers and their standard deviations, in the law's own units, and the law.
    """
    from scipy.optimize import curve_fit

    start = np.array(family.start)
    at = points.contraction, points.pressure

    def force(_: Vector, *scaled: float) -> Vector:
        return np.asarray(family.build(np.array(scaled) * start).force(*at))

    try:
        x, covariance = curve_fit(
            force, at[0], points.force, np.ones(len(start)), method="trf", max_nfev=4000
        )
    except RuntimeError:
        raise WorkbenchError(f"the fit of {family.title} did not end within 4000 steps") from None
    std = np.sqrt(np.diag(covariance)) * np.abs(start)
    return x * start, std, family.build(x * start)


def _error(law: ForceLaw, points: ForceMap) -> Vector:
    return np.asarray(law.force(points.contraction, points.pressure)) - points.force


def _held_out(family: Family, points: ForceMap, rows: npt.NDArray[np.bool_]) -> Vector:
    return _error(fit_law(family, points.take(~rows))[2], points.take(rows))


def _rms(error: Vector) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _size(error: Vector) -> tuple[float, float]:
    return _rms(error), float(np.max(np.abs(error)))
