"""Locating a mismatch: which group of equations needs another signal.

An unknown input, random but correlated in time, is allowed at one group of ports after the other;
how much more likely that makes the recordings says where the equations leave something out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError, disturbances
from workbench.errors import NumericalError
from workbench.model import Model

LEVELS = (1.0, 3.0, 10.0, 100.0, 1000.0)
"""Process-noise scales that are tried at a group."""

TRUSTED = (0.03, 0.3)
"""Shares that remain at the other groups: the first with which the filter stays finite."""

PARALLEL = 0.999
"""Cosine above which two ports act on the rates in the same way."""

_LOST = 1e9
"""Cost of a filter that left the finite numbers: larger than any that did not."""


@dataclass(frozen=True)
class Location:
    """Log likelihood that an unknown input gains.

    Args:
        alone: Gain of an input at this group only, by group of ports, dimensionless.
    """

    alone: dict[str, float]

    @property
    def best(self) -> str:
        """The group whose input alone gains the most."""
        return max(self.alone, key=self.alone.__getitem__)

    def ports(self, model: Model) -> tuple[str, ...]:
        """Return where the mismatch is, as far as an unknown input tells.

        Returns:
            The ports of the best group, with those of its twins that gain at least half as much:
            groups that differ by their number only. None if no input gains anything.
        """
        twins = (g for g in self._near if g.rstrip("0123456789") == self.best.rstrip("0123456789"))
        return _ports_of(model, twins)

    def likely(self, model: Model) -> tuple[str, ...]:
        """Return the ports of groups that gain at least half as much as the best, that first."""
        return _ports_of(model, self._near)

    @property
    def _near(self) -> list[str]:
        """Groups that gain at least half as much as the best, that first; none if none gains."""
        order = sorted(self.alone, key=lambda group: -self.alone[group])
        return [g for g in order if 0.0 < self.alone[g] >= 0.5 * self.alone[order[0]]]

    def __str__(self) -> str:
        order = sorted(self.alone, key=lambda g: -self.alone[g])
        lines = [f"  {group:<16} {self.alone[group]:>10.0f}" for group in order]
        return "\n".join(["gain of an unknown input at each group alone", *lines])


def _ports_of(model: Model, groups: Iterable[str]) -> tuple[str, ...]:
    known = groups_of(model)
    return tuple(port for group in groups for port in known[group])


def groups_of(model: Model) -> dict[str, tuple[str, ...]]:
    """Return the ports at which the equations may leave something out, by group.

    Returns:
        Names of ports by the part of the name before the dot.
    """
    groups: dict[str, tuple[str, ...]] = {}
    for port in model.ports:
        if port.disturbance > 0:
            groups[port.group] = (*groups.get(port.group, ()), port.name)
    return groups


def directions_of(model: Model, x: Vector, u: Vector) -> Vector:
    """Return the directions in which ports move the rates, scaled, shape (n_states, n_ports).

    They have length one, or zero where a port moves no rate.

    Args:
        x: States, shape (n_states,), in SI.
        u: Inputs, shape (n_inputs,), in SI.
    """
    slope = model.exact.function("slope", ca.densify(model.exact.rates_by_port))
    matrix = np.asarray(slope(x, u, model.values))
    matrix = matrix / np.array([q.scale for q in model.states])[:, None]
    length = np.linalg.norm(matrix, axis=0)
    return np.asarray(matrix / np.where(length > 0, length, np.inf))


def locate(model: Model, recordings: Sequence[Observed]) -> Location:
    """Find the group of ports that needs another signal.

    Example:
        >>> from workbench.diagnosis.estimation.simulated_recordings import simulated, pushes
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = simulated(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> locate(axis.with_parameters({"mass": 80.0}), [seen]).alone["axis"] > 100.0
        True
    """
    groups = groups_of(model)
    sizes = disturbances(model, 1.0)

    def cost(scales: dict[str, float]) -> float:
        pushed = {
            port: scales[group] * sizes[port] for group, ports in groups.items() for port in ports
        }
        filter_ = PredictionError(model, recordings[0], (), pushed)
        try:
            return sum(part.cost for part in filter_.along(recordings, model.values))
        except NumericalError:
            # Trusted equations that are badly wrong throw the filter out of their range.
            return _LOST

    for trusted in TRUSTED:
        rest = cost(dict.fromkeys(groups, trusted))
        if rest < _LOST:
            break

    def best(free: str) -> float:
        # Beyond a level that gains nothing another one may, if far more is missing than is usual.
        return min(
            cost({g: level if g == free else trusted for g in groups})
            for level in (3 * trusted, *LEVELS)
        )

    return Location({g: max(rest - best(g), 0.0) for g in groups})
