"""Compensation of muscle hysteresis by a fitted law, along the planned move.

Two antagonistic muscles with the force loop of Dahl's law, half width ``level + slope p`` each,
lose at the joint, with the lever r and the mean pressure pm,

    tau = 2 r (level + slope pm) z,      dz/dt = (v - |v| z) / breakaway,      v = r omega_r

z follows the *planned* speed omega_r, which has no noise and turns when the plan turns: the loss is
known before it is felt. It is added to the reference of the pressure difference, and taken from the
acceleration that the observer expects, so that nothing is compensated twice. What the fit gets
wrong stays for the feedback. The numbers are those of a fitted effect, never of the plant.

Source: P. R. Dahl 1968 (law); Vo-Minh, Tjahjowidodo, Ramon and Van Brussel, Mechatronics 20, 2010
(compensation of a muscle's hysteresis by a model).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, replace
from typing import Any

import numpy as np

from controllers.arithmetic import Arithmetic, Number
from controllers.specification import Checked, number
from workbench.errors import WorkbenchError
from workbench.model import Model


@dataclass(frozen=True)
class HysteresisCompensation(Checked):
    """Fitted hysteresis of two muscles as the joint feels it.

    Args:
        level: Half width of a muscle's loop without pressure, in N.
        slope: Growth of the half width with gauge pressure, in N/Pa.
        breakaway: Contraction over which the loop turns, in m.
        lever: Lever of the muscles, in m.
        torque_per_difference: Torque per pressure difference, in N m/Pa.
    """

    level: float = number(MISSING, 0.0, 1e4, "N", "half width of the hysteresis")
    slope: float = number(MISSING, 0.0, 1e-2, "N/Pa", "growth of the hysteresis")
    breakaway: float = number(MISSING, 1e-6, 1.0, "m", "breakaway of the hysteresis")
    lever: float = number(MISSING, 1e-4, 10.0, "m", "lever of the muscles")
    torque_per_difference: float = number(MISSING, 1e-9, 1.0)

    def difference(self, turn: Number, mean: Number) -> Number:
        """Return the pressure difference lost at a position z and a mean pressure, in Pa."""
        force = 2.0 * (self.level + self.slope * mean) * turn
        return force * self.lever / self.torque_per_difference

    def turned(self, turn: Number, speed: Number, h: float, arithmetic: Arithmetic) -> Number:
        """Advance the position z in the loop by a sample h, in s, at a planned speed, in rad/s.

        Returns:
            Position (dimensionless): exact for |z| <= 1 to first order, and never beyond 1.
        """
        way = h * self.lever * speed / self.breakaway
        size = arithmetic.largest(way, -way)
        return (turn + way) / (1.0 + size)


LEVER = 0.0295
"""Lever of the muscles of the arm, in m."""


def hysteresis_compensation(
    fitted: Mapping[str, float], *, torque_per_difference: float
) -> HysteresisCompensation:
    """Build the compensation from a fitted effect.

    Args:
        fitted: Values of the fitted model's parameters by name, in SI, as a refit returns them.
        torque_per_difference: Torque per pressure difference, in N m/Pa: inertia times the ``b`` of
            the joint model.

    Example:
        >>> fitted = {"muscle_hysteresis.level": 9.0, "muscle_hysteresis.level_per_pressure": 6e-5,
        ...           "muscle_hysteresis.breakaway": 6e-4}
        >>> hysteresis_compensation(fitted, torque_per_difference=7.6e-5).level
        9.0
    """
    names = [f"muscle_hysteresis.{name}" for name in ("level", "level_per_pressure", "breakaway")]
    missing = [name for name in names if name not in fitted]
    if missing:
        raise WorkbenchError(
            f"the fitted values have no {missing[0]!r}; refit a model with the effect"
            " 'muscle_hysteresis'"
        )
    level, slope, breakaway = (float(fitted[name]) for name in names)
    return HysteresisCompensation(level, slope, breakaway, LEVER, torque_per_difference)


def with_compensation(law: Any, model: Model) -> Any:
    """Return a controller that also compensates the hysteresis that a model's muscles have.

    Elements that slip after d_i are replaced by Dahl's law of the same half width which, after a
    turn, loses the same work: its breakaway is the mean of the d_i. A controller without planned
    moves of a joint, or for muscles without hysteresis, is returned as it is.
    """
    values = {q.name: q.value for q in model.parameters}
    names = {effect.name for effect in model.effects}
    if "maxwell_slip_hysteresis" in names and "muscle_hysteresis" not in names:
        values = _as_dahl(values)
    elif "muscle_hysteresis" not in names:
        return law
    if not hasattr(law, "tracking"):
        return law
    schedule = law.tracking.schedule
    middle = {"angle": math.radians(30.0)}
    inertia = model.signals(model.initial_state(middle), model.nominal_input)["joint.inertia"]
    b = schedule.at(middle["angle"], 0.5 * (schedule.mean_low + schedule.mean_high)).b
    own = hysteresis_compensation(values, torque_per_difference=float(inertia * b))
    return replace(law, tracking=replace(law.tracking, hysteresis=own))


def _as_dahl(values: Mapping[str, float]) -> dict[str, float]:
    own = {
        name.removeprefix("maxwell_slip_hysteresis."): value
        for name, value in values.items()
        if name.startswith("maxwell_slip_hysteresis.")
    }
    count = 1 + sum(name.startswith("weight_") for name in own)
    weights = np.array([1.0, *(own[f"weight_{i + 1}"] for i in range(1, count))])
    slips = own["breakaway"] * own.get("spread", 1.0) ** np.arange(count)
    return {
        "muscle_hysteresis.level": own["level"],
        "muscle_hysteresis.level_per_pressure": own["level"] * own["growth"],
        "muscle_hysteresis.breakaway": float(weights @ slips / weights.sum()),
    }
