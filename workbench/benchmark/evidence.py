"""What is run as evidence of what keeps a figure from its goal: one obstacle less, another plan.

The ladder is the same designs on a plant without hysteresis; then without noise and converters
too; then with a spool ten times as fast, the feedforward leading by so much less. The plan is the
evidence family with its planned moves stretched or compressed in time,

    plan(t / k)        jerk, acceleration and speed scale with k^-3, k^-2 and k^-1

so that it shows what a faster plan costs where a load is not the known one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from controllers.protocol import Controller
from workbench.benchmark.cases import Case, nominal_plant, scenarios, varied_plant

if TYPE_CHECKING:
    from workbench.model import Model
    from workbench.verification import Scenario

DRY = "without hysteresis"
"""Variation without muscle hysteresis."""

EXACT = "without hysteresis, noise and converters"
"""The same with exact sensors and a command that is not quantised."""

SWIFT = "without hysteresis, noise, converters and lag of the spool"
"""The same with a spool that is ten times as fast."""

LADDER = (DRY, EXACT, SWIFT)
"""One obstacle less at a time."""

EVIDENCE_FAMILY = "state feedback"
"""Family whose plan is varied."""

PACES = (0.4, 0.6, 0.8, 1.3)
"""Durations of the planned moves, relative to those of the design."""

PACED_VARIATIONS = ("nominal", "1 kg", "5 bar")
"""What the varied plans are run on."""

_FASTER = 10.0


def paced_name(variation: str, pace: float) -> str:
    """Return the name of a variation with another plan.

    Args:
        variation: Name of the variation.
        pace: Duration of the plan, a ratio.

    Returns:
        The name; the variation itself for the plan of the design.

    Example:
        >>> paced_name("1 kg", 0.6), paced_name("1 kg", 1.0)
        ('1 kg, plan × 0.6', '1 kg')
    """
    return variation if pace == 1.0 else f"{variation}, plan × {pace:g}"


def is_evidence(variation: str) -> bool:
    """Tell whether a variation is no variation of the comparison but evidence.

    Args:
        variation: Name of the variation.

    Returns:
        Whether it is.

    Example:
        >>> is_evidence("5 bar"), is_evidence(paced_name("5 bar", 0.6))
        (False, True)
    """
    return variation in LADDER or ", plan × " in variation


def paced(controller: Controller, pace: float) -> Controller:
    """Stretch the planned moves of a scheduled controller.

    Args:
        controller: A controller with a `JointTracking`.
        pace: Duration of every move relative to its own, a ratio.

    Returns:
        The same feedback with the other plan.

    Example:
        >>> from controllers.joint.schedule import JointSchedule
        >>> from controllers.pid import design_scheduled_pid
        >>> rows = tuple((v, v) for v in (1.6e-4, 1.0, 100.0, 3.6e7, 6e5, 0.8, 0.0))
        >>> pid = design_scheduled_pid(JointSchedule(0.0, 1.0, rows, rows, 3e5, 4e5))
        >>> moves = [law.tracking.planner.move_time(0.26) for law in (pid, paced(pid, 0.5))]
        >>> round(moves[1] / moves[0], 6)
        0.5
    """
    law = cast(Any, controller)
    own = law.tracking.planner
    planner = replace(
        own,
        jerk=own.jerk / pace**3,
        acceleration=own.acceleration / pace**2,
        speed=own.speed / pace,
        shortest=max(own.shortest * pace, own.sample_time),
    )
    return cast(Controller, replace(law, tracking=replace(law.tracking, planner=planner)))


def evidence_run(
    case: Case, variation: str, controller: Controller
) -> tuple[Controller, Model, Scenario]:
    """Return what a step of the ladder or another plan is run with.

    Args:
        case: Load and plane.
        variation: One of `LADDER`, or a name from `paced_name`.
        controller: The design.

    Returns:
        Controller, plant and staircase.

    Example:
        >>> from controllers.open_loop import HeldCommand
        >>> evidence_run(Case(3.0), DRY, HeldCommand((5.0,)))[2].name
        'steps'
    """
    if variation not in LADDER:
        kind, _, pace = variation.partition(", plan × ")
        return paced(controller, float(pace)), varied_plant(case, kind), scenarios(kind)[0]
    plant, staircase = nominal_plant(case), scenarios("nominal")[0]
    if variation != DRY:
        staircase = staircase.without_imperfections()
    if variation == SWIFT:
        frequency = plant.parameter("spool_frequency")
        slow = 2.0 * plant.parameter("spool_damping").value / frequency.value
        # No valve of this kind is so fast: the bounds of the parameter go with it.
        value = _FASTER * frequency.value
        swift = replace(frequency, value=value, lower=value, upper=value)
        plant = replace(
            plant, parameters=tuple(swift if q is frequency else q for q in plant.parameters)
        )
        law = cast(Any, controller)
        lead = max(law.tracking.lead - (1.0 - 1.0 / _FASTER) * slow, 0.0)
        controller = replace(law, tracking=replace(law.tracking, lead=lead))
    return controller, plant, staircase
