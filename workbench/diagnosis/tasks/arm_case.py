"""A case of the arm as a refit."""

from __future__ import annotations

from typing import cast

from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.refit_report import RefitTask
from workbench.plants.arm import arm
from workbench.plants.arm.inertia import Plane
from workbench.recordings.case import Case

START_SAMPLES = 251
"""Half a second, over which temperatures show."""


def arm_case(case: Case) -> RefitTask:
    """Build the refit of the nominal arm to a case.

    Args:
        case: Recordings of an arm with its load, plane and supply.

    Returns:
        The refit: fitted on the recordings to identify with, judged on those to validate with.

    Raises:
        WorkbenchError: If a setting is missing, or a recording lacks the valve voltage.
    """
    model = arm(case.load_kg, plane=cast(Plane, case.plane), supply_bar=case.supply_bar)
    return RefitTask(
        name=case.name,
        title=f"arm, case {case.name}",
        model=model,
        fit=tuple(observe(model, recording) for recording in case.fit.values()),
        hold_out=tuple(observe(model, recording) for recording in case.hold_out.values()),
        start_samples=START_SAMPLES,
    )
