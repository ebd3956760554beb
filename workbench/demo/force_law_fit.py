"""Force laws fitted to a measured force map, judged on contractions left out of the fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError
from workbench.physics.force_laws import ForceLaw, PaperLaw, Petrovic, Sarosi, TonduLopez

Vector = npt.NDArray[np.float64]

LAW_LENGTH = 0.2
"""Nominal length of the muscle for which the laws were published, in m."""

LAW_CONTRACTION = 33e-3
"""Largest contraction at which the published laws may be used, in m of a 200 mm muscle."""


@dataclass(frozen=True)
class ForceMap:
    """Measured static forces of a muscle.

    Args:
        pressure: Gauge pressures, shape (n,), in Pa.
        length: Lengths, shape (n,), in m.
        force: Forces, shape (n,), in N; zero where the muscle is slack.

    Example:
        >>> ForceMap(np.zeros(2), np.array([0.3, 0.27]), np.zeros(2)).contraction.round(3).tolist()
        [0.0, 0.02]
    """

    pressure: Vector
    length: Vector
    force: Vector

    @property
    def contraction(self) -> Vector:
        """Contraction of a 200 mm muscle that is contracted by the same ratio, in m.

        A muscle of the same diameter and fibre angle pulls as hard at the same relative
        contraction, whatever its length.
        """
        longest = float(self.length.max())
        return LAW_LENGTH * (1 - self.length / longest)

    def take(self, rows: npt.NDArray[np.bool_]) -> ForceMap:
        """Return some of the points, with the contraction they had."""
        return _Part(
            self.pressure[rows], self.length[rows], self.force[rows], self.contraction[rows]
        )


@dataclass(frozen=True)
class _Part(ForceMap):
    given: Vector

    @property
    def contraction(self) -> Vector:
        return self.given


@dataclass(frozen=True)
class Family:
    """A force law with numbers to be fitted.

    Args:
        title: Name as people read it.
        build: Makes the law from its numbers.
        start: Numbers to start from, in the law's own units.
        published: The law with its published or printed numbers.

    Example:
        >>> FAMILIES["petrovic"].title
        'equation (3), Petrovic'
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
class LawFit:
    """A force law fitted to a map.

    Args:
        title: Name of the law.
        law: The fitted law.
        numbers: How many numbers were fitted.
        fitted_rms: Error on the points fitted on, rms in N.
        held_out_rms: Error on contractions left out, each once, rms in N.
        published_rms: Error of the published law within its range, rms in N.
        largest: Largest error on the points fitted on, in N.

    Example:
        >>> LawFit("law", Petrovic(), 3, 10.0, 12.0, 80.0, 25.0).numbers
        3
    """

    title: str
    law: ForceLaw
    numbers: int
    fitted_rms: float
    held_out_rms: float
    published_rms: float
    largest: float


def fit_law(family: Family, points: ForceMap) -> ForceLaw:
    """Fit a law to a force map by least squares of the force.

    A slack muscle measures zero; the law's own clamp says the same of every tension below zero,
    so slack points bound the tension without pulling it to zero.

    Raises:
        WorkbenchError: If the fit does not end.

    Example:
        >>> q, p = np.meshgrid(np.linspace(0.0, 0.03, 5), np.linspace(1e5, 6e5, 6))
        >>> force = np.asarray(Petrovic().force(q, p)).ravel()
        >>> lengths = 0.2 - q.ravel()
        >>> law = fit_law(FAMILIES["petrovic"], ForceMap(p.ravel(), lengths, force))
        >>> round(law.gain_bar_mm[0])
        280
    """
    from scipy.optimize import least_squares

    start = np.array(family.start)
    contraction, pressure = points.contraction, points.pressure

    def misfit(scaled: Vector) -> Vector:
        law = family.build(scaled * start)
        return np.asarray(law.force(contraction, pressure)) - points.force

    found = least_squares(misfit, np.ones(len(start)), x_scale=1.0, max_nfev=2000)
    if found.status <= 0:
        raise WorkbenchError(f"the fit of {family.title} did not end within 2000 steps")
    return family.build(found.x * start)


def rms(law: ForceLaw, points: ForceMap) -> float:
    """Return the error of a law on a map.

    Returns:
        Root mean square error of the force, in N.

    Example:
        >>> one = ForceMap(np.array([1e5]), np.array([0.2]), np.array([270.0]))
        >>> round(rms(Petrovic(), one))
        10
    """
    error = np.asarray(law.force(points.contraction, points.pressure)) - points.force
    return float(np.sqrt(np.mean(error**2)))


def compare_laws(points: ForceMap, families: Mapping[str, Family] = FAMILIES) -> dict[str, LawFit]:
    """Fit every law to a map and judge it on contractions left out of the fit.

    Each contraction but the smallest and the largest at which the muscle pulls is left out once.

    Raises:
        WorkbenchError: If there are fewer than five contractions.

    Example:
        >>> q, p = np.meshgrid(np.linspace(0.0, 0.03, 6), np.linspace(1e5, 6e5, 6))
        >>> force = np.asarray(Petrovic().force(q, p)).ravel()
        >>> fits = compare_laws(
        ...     ForceMap(p.ravel(), 0.2 - q.ravel(), force), {"petrovic": FAMILIES["petrovic"]}
        ... )
        >>> fits["petrovic"].held_out_rms < 0.1
        True
    """
    levels = np.unique(points.length[points.force > 0])
    if len(levels) < 5:
        raise WorkbenchError(
            f"the muscle pulls at {len(levels)} length(s) of the force map; a comparison of laws"
            " needs 5 or more"
        )
    in_range = points.take(points.contraction <= LAW_CONTRACTION)
    fits = {}
    for name, family in families.items():
        law = fit_law(family, points)
        error = np.asarray(law.force(points.contraction, points.pressure)) - points.force
        squares = []
        for level in levels[1:-1]:
            test = points.length == level
            without = fit_law(family, points.take(~test))
            squares.append(rms(without, points.take(test)) ** 2)
        fits[name] = LawFit(
            family.title,
            law,
            len(family.start),
            rms(law, points),
            float(np.sqrt(np.mean(squares))),
            rms(family.published, in_range),
            float(np.max(np.abs(error))),
        )
    return fits
