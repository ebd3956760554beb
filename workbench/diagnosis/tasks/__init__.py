"""Refits that are ready to run: the arm's cases and plants of real machines."""

from __future__ import annotations

from workbench.diagnosis.tasks.machines import MACHINES, machine_task

__all__ = ["MACHINES", "machine_task"]
