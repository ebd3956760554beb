"""The valve's opening as the input: the plant a controller sees when it inverts the valve's curve.

The curve of a valve with soft overlap is almost flat at rest, 2 % of the opening per volt against
20 % on average, so a linear model by the voltage is wrong from 0.1 V on. A controller decides the
signed opening instead (positive fills chamber 1 and vents chamber 2) and sends it through the
inverse of the static curve. What it then controls is the plant whose edges open in proportion to
the spool; that plant has one kink left, between filling and venting.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError
from workbench.model import Effect, Model, PortView, Trace
from workbench.model.face import Expression
from workbench.operating_point import OperatingPoint

Vector = npt.NDArray[np.float64]

EDGES = {
    "valve.supply_1": 1.0,
    "valve.exhaust_2": 1.0,
    "valve.supply_2": -1.0,
    "valve.exhaust_1": -1.0,
}
"""Ports of the metering edges, with the sign of the spool that opens them."""

FULL_STROKE = 5.0
"""Spool voltage from the centre at which a proportional edge is fully open, V."""

_WIDTH = 0.04
_GRID = np.linspace(-FULL_STROKE, FULL_STROKE, 201)

_PLANTS: WeakKeyDictionary[Trace, dict[bytes, Model]] = WeakKeyDictionary()
_MOST_PLANTS = 100


def proportional_edges() -> Effect:
    """Build edges that open in proportion to the spool, in place of the valve's curve.

    ``opening = max(0, +-spool / 5 V)``

    Returns:
        Effect on the four edges of a 5/3 valve, to act before its leakage.

    Example:
        >>> sorted(proportional_edges().ports)[0]
        'valve.exhaust_1'
    """

    def transform(at: PortView) -> Expression:
        return at.face.ramp(EDGES[at.port] * at.signals.spool, _WIDTH) / FULL_STROKE

    return Effect("proportional_edges", tuple(EDGES), transform)


def opening_plant(model: Model) -> Model:
    """Return the plant as it is when the valve's static curve is inverted.

    The spool's dynamics and everything else stay; ``(input - centre) / 5 V`` is then the signed
    opening that is commanded.

    Args:
        model: A plant with a 5/3 valve: the ports of its edges have the signal ``spool``.

    Returns:
        The same plant with proportional edges.

    Raises:
        WorkbenchError: If the plant has no such valve.

    Example:
        >>> from workbench.plants.arm import arm
        >>> plant = opening_plant(arm(3))
        >>> x = plant.initial_state({"spool": 0.5})
        >>> round(plant.signals(x, [5.5])["valve.supply_1"], 4)
        0.104
    """
    known = _PLANTS.setdefault(model.exact, {})
    values = model.values
    key = values.tobytes()
    if key not in known:
        ports = {q.name: q.signals for q in model.ports}
        if any("spool" not in ports.get(name, ()) for name in EDGES):
            raise WorkbenchError(
                f"{model.name!r} has no 5/3 valve with the ports {', '.join(EDGES)}; its linear"
                " model can only have its own inputs"
            )
        if len(known) >= _MOST_PLANTS:
            known.clear()
        known[key] = replace(model, effects=(proportional_edges(), *model.effects))
    return known[key]


def signed_opening_of(model: Model, x: Vector, u: Vector) -> float:
    """Return the signed opening of the valve, leakage apart.

    Args:
        model: A plant with a 5/3 valve.
        x: States, shape (n_states,), in SI.
        u: Inputs, shape (n_inputs,), in SI.

    Returns:
        Supply edge 1 minus supply edge 2, as a fraction of full conductance, -1..1.

    Example:
        >>> from workbench.plants.arm import arm
        >>> plant = arm(3)
        >>> round(signed_opening_of(plant, plant.initial_state({"spool": -0.9}), [4.1]), 3)
        -0.056
    """
    signals = model.signals(x, u)
    return signals["valve.supply_1"] - signals["valve.supply_2"]


@dataclass(frozen=True)
class OpeningToVoltage:
    """The inverse of the valve's static curve, read off the model at its operating point.

    Args:
        operating_point: Where the plant stands.

    Example:
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.arm import arm
        >>> inverse = OpeningToVoltage(operating_point(arm(3)))
        >>> inverse([0.0, 0.056]).round(6).tolist()
        [5.0, 5.9]
    """

    operating_point: OperatingPoint

    @cached_property
    def _table(self) -> tuple[Vector, Vector]:
        point = self.operating_point
        index = [q.name for q in point.model.states].index("spool")
        x = point.x.copy()
        openings = []
        for spool in _GRID:
            x[index] = spool
            openings.append(signed_opening_of(point.model, x, point.u))
        rising = np.concatenate([[True], np.diff(np.maximum.accumulate(openings)) > 0.0])
        return np.array(openings)[rising], _GRID[rising]

    def __call__(self, opening: npt.ArrayLike) -> Vector:
        """Return the voltage that gives an opening at rest.

        Args:
            opening: Signed fraction of full conductance, -1..1, any shape; beyond, full voltage.

        Returns:
            Voltage, same shape, in V, inside the range of the input.
        """
        point = self.operating_point
        index = [q.name for q in point.model.states].index("spool")
        openings, spools = self._table
        voltage = np.interp(np.asarray(opening, dtype=float), openings, spools) + float(
            point.u[0] - point.x[index]
        )
        quantity = point.model.inputs[0]
        return np.asarray(np.clip(voltage, quantity.lower, quantity.upper))
