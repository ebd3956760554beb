"""Refits of real machines, by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from workbench.diagnosis.estimation.refit_report import RefitTask
from workbench.diagnosis.tasks.cylinder import cylinder_task
from workbench.diagnosis.tasks.emps import emps_task
from workbench.diagnosis.tasks.pendulum import pendulum_task
from workbench.diagnosis.tasks.tanks import tanks_task
from workbench.errors import check_choice
from workbench.recordings.public_data import public_file

MACHINES: dict[str, tuple[str, Callable[[Callable[[str], Path]], RefitTask]]] = {
    "emps": ("emps", emps_task),
    "tanks": ("cascaded-tanks", tanks_task),
    "cylinder": ("zillen-pneumatic-seal-friction", cylinder_task),
    "pendulum": ("bam-servo-friction", pendulum_task),
}
"""Data set and builder of each refit."""


def machine_task(name: str, *, data: Path | None = None) -> RefitTask:
    """Build the refit of a real machine.

    Args:
        name: ``"emps"``, ``"tanks"``, ``"cylinder"`` or ``"pendulum"``.
        data: Data folder; by default the environment's, and what it does not hold is fetched from
            the publisher.

    Raises:
        WorkbenchError: If the name is unknown or a file can neither be found nor fetched.
    """
    check_choice("machine", name, MACHINES)
    data_set, build = MACHINES[name]
    return build(lambda file: public_file(f"{data_set}/{file}", data=data))
