"""A control-design workbench for an antagonistic pneumatic-muscle arm.

``import workbench as wb`` offers what a notebook needs, each name loaded when it is first used:
``wb.arm``, ``wb.operating_point``, ``wb.linearise``, ``wb.design_pid``, ``wb.verify``,
``wb.metrics``, ``wb.diagnose``; ``dir(wb)`` lists them all.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

_OFFERED = {
    "arm": "workbench.plants.arm",
    "design_mpc": "controllers",
    "design_pid": "controllers",
    "design_sliding_mode": "controllers",
    "diagnose": "workbench.diagnosis.diagnose",
    "external_data": "workbench.data_folder",
    "library": "workbench.physics.library",
    "linear_model": "workbench.linearisation",
    "linearise": "workbench.linearisation",
    "load_study": "workbench.study.read",
    "metrics": "workbench.verification",
    "muscle_hysteresis": "workbench.physics.hysteresis",
    "operating_map": "workbench.linearisation.operating_map",
    "operating_point": "workbench.operating_point",
    "plot": "workbench.notebook",
    "read_case": "workbench.recordings",
    "read_recording": "workbench.recordings",
    "redesign": "workbench.diagnosis.redesign",
    "run_study": "workbench.study.result",
    "servo_axis": "workbench.plants.servo_axis",
    "shipped_data": "workbench.data_folder",
    "simulate": "workbench.simulation",
    "sliders": "workbench.notebook",
    "step_scenario": "workbench.verification",
    "verify": "workbench.verification",
}
"""What ``import workbench as wb`` offers, and the room that it comes from."""


class _Workbench(ModuleType):
    """The package as a module whose names come from the table, not from rooms of the same name."""

    def __setattr__(self, name: str, value: Any) -> None:
        # Importing the room workbench.operating_point would put it in place of the function.
        if not (isinstance(value, ModuleType) and name in _OFFERED):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Workbench


def __getattr__(name: str) -> Any:
    if name not in _OFFERED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_OFFERED[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_OFFERED})
