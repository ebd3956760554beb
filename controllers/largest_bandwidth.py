"""The fastest design of a family within limits on the sensitivity peaks, at several loads at once.

A design with one number for its speed is made anew from fast to slow until, on every linear model
given, the sampled loop has

    Ms = max |1 / (1 + L)| <= maximum_sensitivity,   Mt = max |L / (1 + L)| <= maximum_complementary

and, if asked for, Ms <= late_sensitivity with every command one sample late: a loop that oscillates
as soon as the computer is slow has no margin worth the name.

Models at several angles, and at the load that the design must bear without knowing it, make the
margin a promise about the plant rather than about one operating point.

Source: Åström and Hägglund, Advanced PID Control, 2006, section 4.6 (limits on Ms and Mt).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from controllers.protocol import Controller
from controllers.sensitivity import loop_matrices, peaks_of
from workbench.errors import WorkbenchError, check_range

if TYPE_CHECKING:
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
    """

    controller: C
    speed: float
    sensitivity: float
    complementary: float
    late: float = float("nan")


def largest_bandwidth(
    design: Callable[[float], C],
    models: Sequence[LinearModel],
    speeds: Sequence[float],
    *,
    maximum_sensitivity: float = 2.0,
    maximum_complementary: float = 1.9,
    late_sensitivity: float = float("inf"),
) -> MarginedDesign[C]:
    """Find the fastest design within the limits on every model.

    Args:
        design: Makes a controller for a speed in rad/s.
        models: Linear models on which the limits hold.
        speeds: Speeds to try, from fast to slow, in rad/s.
        maximum_sensitivity: Limit on Ms, a ratio.
        maximum_complementary: Limit on Mt, a ratio.
        late_sensitivity: Limit on Ms with commands one sample late, a ratio; infinite for none.

    Raises:
        WorkbenchError: If no speed meets the limits.

    Example:
        >>> from controllers.pid import cascade_pid
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.arm import arm
        >>> model = linearise(operating_point(arm(3), {"angle": 0.5236}), verdict=False)
        >>> make = lambda w: cascade_pid(600 * w * w, 100 * w**3, 1e3 * w, inner=2.7e-6)
        >>> found = largest_bandwidth(make, [model], [300.0, 30.0, 20.0])
        >>> found.speed < 300, found.sensitivity <= 2.0
        (True, True)
    """
    check_range("limit on Ms", maximum_sensitivity, 1.05, 10.0)
    check_range("limit on Mt", maximum_complementary, 1.0, 10.0)
    if not models or not speeds:
        raise WorkbenchError("a design under limits needs at least one model and one speed")
    ms = mt = late = float("nan")
    for speed in speeds:
        controller = design(speed)
        ms = mt = late = 0.0
        for model in models:
            loop, h = loop_matrices(controller, model), controller.sample_time
            peaks = peaks_of(loop, h)
            ms, mt = max(ms, peaks[0]), max(mt, peaks[1])
            late = max(late, peaks_of(loop, h, late=1)[0])
            if ms > maximum_sensitivity or mt > maximum_complementary or late > late_sensitivity:
                break
        else:
            return MarginedDesign(controller, speed, ms, mt, late)
    raise WorkbenchError(
        f"no speed from {speeds[0]:g} to {speeds[-1]:g} rad/s meets Ms <= {maximum_sensitivity:g}"
        f" and Mt <= {maximum_complementary:g} on all {len(models)} models (at the last, Ms is"
        f" {ms:.3g}, Mt {mt:.3g}, and Ms one sample late {late:.3g}); allow larger peaks, or design"
        " for a load nearer to the models"
    )
