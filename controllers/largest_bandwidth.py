"""The fastest design of a family within limits on the sensitivity peaks, at several loads at once.

A design with one number for its speed is made anew from fast to slow until, on every linear model
given, the sampled loop has

    Ms = max |1 / (1 + L)| <= maximum_sensitivity,   Mt = max |L / (1 + L)| <= maximum_complementary

and, if asked for, Ms <= late_sensitivity with every command one sample late: a loop that oscillates
as soon as the computer is slow has no margin worth the name. With an `Uncertainty`, both hold at
each of its corners, Ms with the loop opened at the command and at each sensor in turn, and the
complementary sensitivity at the command has |T| w <= trusted_frequency.

Models at several angles, and at the load that the design must bear without knowing it, make the
margin a promise about the plant rather than about one operating point.

Source: Åström and Hägglund, Advanced PID Control, 2006, section 4.6 (limits on Ms and Mt);
Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 7.5 (small gain).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from controllers.protocol import Controller
from controllers.sensitivity import frequencies, loops_at, peaks_of
from controllers.uncertainty import NONE, Uncertainty
from workbench.errors import WorkbenchError, check_range
from workbench.linearisation import LinearModel

C = TypeVar("C", bound=Controller)


@dataclass(frozen=True)
class MarginedDesign(Generic[C]):
    """A design and its margins.

    Args:
        speed: The number for its speed, in rad/s.
        sensitivity: Largest Ms over the models, a ratio.
        complementary: Largest Mt over the models, a ratio.
        late: Largest Ms with every command one sample late, a ratio.
        limit: What the next faster design did not hold; empty if none was tried.
    """

    controller: C
    speed: float
    sensitivity: float
    complementary: float
    late: float = float("nan")
    limit: str = ""


class Limits(NamedTuple):
    """Limits of a design.

    Args:
        sensitivity: Limit on Ms, a ratio.
        complementary: Limit on Mt, a ratio.
        late: Limit on Ms with commands one sample late, a ratio; infinite for none.
    """

    sensitivity: float = 2.0
    complementary: float = 1.9
    late: float = float("inf")
    uncertainty: Uncertainty = NONE


class Held(NamedTuple):
    """Largest peaks of a loop over models and corners.

    Args:
        sensitivity: Ms, a ratio.
        complementary: Mt, a ratio.
        late: Ms with every command one sample late, a ratio.
        missed: The limit that it misses, in words; empty if none.
    """

    sensitivity: float = 0.0
    complementary: float = 0.0
    late: float = 0.0
    missed: str = ""


def held(controller: Controller, models: Sequence[LinearModel], limits: Limits) -> Held:
    """Tell which peaks a controller has on every model, up to the first limit that it misses."""
    h, unsure = controller.sample_time, limits.uncertainty
    angle = frequencies()
    ms = mt = late = 0.0
    for model in models:
        *loops, one_late = loops_at(controller, model, (*unsure.corners, (h, 0.0)))
        for corner, loop in zip(unsure.corners, loops, strict=True):
            where = _where(*corner)
            for sensor in _places(controller, unsure):
                s, t, beyond = peaks_of(loop, angle, sensor)
                ms = max(ms, s)
                name = "the command" if sensor is None else controller.sensors[sensor]
                if s > limits.sensitivity:
                    return Held(ms, mt, late, f"Ms {s:.3g} at {name}{where}")
                if sensor == 0:
                    mt = max(mt, t)
                    if t > limits.complementary:
                        return Held(ms, mt, late, f"Mt {t:.3g} at {name}{where}")
                if sensor is None and beyond > unsure.trusted_frequency * h:
                    share = beyond / (unsure.trusted_frequency * h)
                    said = f"|T| w is {share:.3g} times the trusted frequency at {name}{where}"
                    return Held(ms, mt, late, said)
        if math.isfinite(limits.late):
            late = max(late, peaks_of(one_late, angle).sensitivity)
            if late > limits.late:
                return Held(ms, mt, late, f"Ms {late:.3g} with every command one sample late")
    return Held(ms, mt, late)


def _places(controller: Controller, uncertainty: Uncertainty) -> tuple[int | None, ...]:
    """Return where a loop is opened: at the first sensor, and everywhere if it is uncertain."""
    if uncertainty == NONE:
        return (0,)
    return (0, None, *range(1, len(controller.sensors)))


def _where(delay: float, lag: float) -> str:
    parts = [f"{1e3 * v:.3g} ms of {name}" for name, v in (("delay", delay), ("lag", lag)) if v]
    return f" with {' and '.join(parts)}" if parts else ""


def largest_bandwidth(
    design: Callable[[float], C],
    models: Sequence[LinearModel],
    speeds: Sequence[float],
    limits: Limits = Limits(),  # noqa: B008 -- Frozen.
) -> MarginedDesign[C]:
    """Find the fastest design within the limits on every model; speeds in rad/s, from fast to slow.

    Raises:
        WorkbenchError: If no speed meets the limits.
    """
    check_range("limit on Ms", limits.sensitivity, 1.05, 10.0)
    check_range("limit on Mt", limits.complementary, 1.0, 10.0)
    if not models or not speeds:
        raise WorkbenchError("a design under limits needs at least one model and one speed")
    missed = ""
    for speed in speeds:
        controller = design(speed)
        found = held(controller, models, limits)
        if not found.missed:
            return MarginedDesign(controller, speed, *found[:3], limit=missed)
        missed = found.missed
    raise WorkbenchError(
        f"no speed from {speeds[0]:g} to {speeds[-1]:g} rad/s meets Ms <= {limits.sensitivity:g}"
        f" and Mt <= {limits.complementary:g} on all {len(models)} models (at the last, {missed}"
        f"{_bearable(controller, models, limits)}); allow larger peaks, tolerate less, or design"
        " for a load nearer to the models"
    )


def _bearable(controller: Controller, models: Sequence[LinearModel], limits: Limits) -> str:
    """Say how much of the uncertainty a design bears."""
    whole = limits.uncertainty
    if whole == NONE:
        return ""
    for share in (0.75, 0.5, 0.25, 0.0):
        part = whole.reduced(share)
        if not held(controller, models, limits._replace(uncertainty=part)).missed:
            return (
                f"; it bears {1e3 * part.delay[1]:.3g} ms of delay with"
                f" {1e3 * part.sensor_lag[1]:.3g} ms of lag"
            )
    return "; it bears no delay at all"
