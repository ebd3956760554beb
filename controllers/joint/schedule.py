"""The joint over its range: the third-order model interpolated over angle and mean pressure.

At every point of a map of linear models the six numbers of `controllers.joint.model`, opening and
pressure difference at rest are read off; a controller then works with

    d2theta/dt2 = b (dp - dp0(theta, pm)) - a1 dtheta/dt + w
    d(dp)/dt    = g (o - o0(theta, pm)) - e dtheta/dt - d (dp - dp0)

whose numbers move with the measured angle and the measured mean pressure pm. Forces of muscles are
straight lines over pressure, so two mean pressures give ``dp0`` for all. Straight lines between the
angles keep gains continuous: there is nothing to switch, hence no bump.

The load is that of the map: a known load gets a map, and a schedule, of its own.

Source: Rugh and Shamma, Research on gain scheduling, Automatica 36, 2000, section 3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.joint.model import JointModel, joint_model
from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.linearisation.operating_map import OperatingMap

NAMES = ("b", "a1", "a0", "g", "e", "d", "opening", "difference")
"""Numbers of the joint model that are scheduled."""


@dataclass(frozen=True)
class JointSchedule:
    """Joint models on an even grid of angles and two mean pressures.

    Args:
        first_angle: First angle, in rad.
        spacing: Distance of two angles, in rad.
        low: Rows of numbers over angle at the lower mean pressure, 8 rows in the order of
            `JointModel`, in SI.
        high: The same at the higher one, in SI.
        mean_low: Lower mean gauge pressure, in Pa.
        mean_high: Higher mean gauge pressure, in Pa.
    """

    first_angle: float
    spacing: float
    low: tuple[tuple[float, ...], ...]
    high: tuple[tuple[float, ...], ...]
    mean_low: float
    mean_high: float

    @property
    def angles(self) -> Vector:
        """Angles of the grid, shape (n,), in rad."""
        steps = np.arange(len(self.low[0]), dtype=float)
        return np.asarray(self.first_angle + self.spacing * steps, dtype=float)

    def at(self, angle: Number, mean: Number, arithmetic: Arithmetic = FLOATS) -> JointModel:
        """Return the joint model, in SI, at an angle (rad) and a mean pressure (Pa), interpolated.

        Beyond the grid only the difference continues.
        """
        count = len(self.low[0])
        place = arithmetic.place(angle, self.first_angle, self.spacing, count)
        inside = (place[0], arithmetic.clip(place[1], 0.0, 1.0))
        share = (mean - self.mean_low) / (self.mean_high - self.mean_low)
        # Other numbers than forces are no straight lines over pressure: not far beyond the map.
        near = arithmetic.clip(share, -1.0, 2.0)
        found = []
        for low, high in zip(self.low[:-1], self.high[:-1], strict=True):
            value = arithmetic.between(inside, low)
            found.append(value + near * (arithmetic.between(inside, high) - value))
        rest = arithmetic.between(place, self.low[-1])
        rest = rest + share * (arithmetic.between(place, self.high[-1]) - rest)
        b, a1, a0, g, e, d, opening = found
        return JointModel(b, a1, a0, g, e, d, opening, rest, angle)

    def with_inertia_of(self, heavier: JointSchedule) -> JointSchedule:
        """Return this schedule with the inertia of another load.

        A feedback that must bear a change of load is best designed for the middle of the loads; the
        pressures that hold the joint are those of the known load all the same.

        Returns:
            The schedule: accelerations per pressure, damping and stiffness over inertia from the
            other, the rest from this one.
        """
        if len(self.low[0]) != len(heavier.low[0]) or not np.allclose(self.angles, heavier.angles):
            raise WorkbenchError(
                f"the schedules have {len(self.low[0])} and {len(heavier.low[0])} angles; make both"
                " maps on the same angles"
            )
        return replace(
            self, low=heavier.low[:3] + self.low[3:], high=heavier.high[:3] + self.high[3:]
        )

    def models(self, mean: float) -> tuple[JointModel, ...]:
        """Return the joint models on the grid of angles at a mean gauge pressure, in Pa."""
        return tuple(self.at(angle, mean) for angle in self.angles.tolist())


def joint_schedule(found: OperatingMap) -> JointSchedule:
    """Build the schedule from a map of linear models.

    A point without operating point takes the values of the straight line through its two nearest
    neighbours in angle.

    Args:
        found: Map over evenly spaced angles, in rad, and two mean gauge pressures, in Pa.

    Raises:
        WorkbenchError: If the angles are not evenly spaced, there are not two mean pressures, or
            fewer than two operating points at one of them.
    """
    if tuple(found.axes) != ("angle", "mean_pressure"):
        raise WorkbenchError(
            f"the map is over {', '.join(found.axes)}; a schedule needs one over angle and"
            " mean_pressure"
        )
    theta, mean_pressures = found.axes["angle"], found.axes["mean_pressure"]
    steps = np.diff(theta)
    if len(theta) < 2 or not np.allclose(steps, steps[0], rtol=1e-6):
        raise WorkbenchError(
            f"a schedule needs two or more evenly spaced angles, not {len(theta)}; make the map on"
            " numpy.linspace(first, last, count)"
        )
    if len(mean_pressures) != 2:
        raise WorkbenchError(
            f"a schedule needs two mean pressures, not {len(mean_pressures)}; make the map with"
            " mean_pressure = 2.8e5 and 3.6e5 Pa"
        )

    def numbers(linear: LinearModel) -> list[float]:
        joint = joint_model(linear)
        return [getattr(joint, name) for name in NAMES]

    means = mean_pressures.tolist()
    whole = np.moveaxis(found.table(numbers), 0, -1)
    low, high = (_filled(theta, table, mean) for table, mean in zip(whole, means, strict=True))
    return JointSchedule(float(theta[0]), float(steps[0]), low, high, *means)


def _filled(theta: Vector, table: Vector, mean: float) -> tuple[tuple[float, ...], ...]:
    known = np.flatnonzero(np.isfinite(table[0]))
    if len(known) < 2:
        raise WorkbenchError(
            f"the map has {len(known)} operating points at a mean pressure of {mean / 1e5:g} bar; a"
            " schedule needs two or more: choose a mean pressure that the load allows"
        )
    for i in np.flatnonzero(~np.isfinite(table[0])):
        near = known[np.argsort(np.abs(theta[known] - theta[i]))[:2]]
        share = (theta[i] - theta[near[0]]) / (theta[near[1]] - theta[near[0]])
        slope = table[:, near[1]] - table[:, near[0]]
        table[:, i] = table[:, near[0]]
        # Only the difference at rest is far from constant between neighbours.
        table[-1, i] += share * slope[-1]
    return tuple(tuple(row) for row in table.tolist())
