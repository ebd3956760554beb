"""Exported controllers, built and called."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import pytest

from controllers.c_export import ExportedC, export_c
from workbench.work.machine_code import compiler

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")
PLAIN = ("-std=c99", "-Wall", "-Wextra", "-Werror")


def built(exported: ExportedC, *flags: str) -> ctypes.CDLL:
    found = compiler()
    if found is None:
        pytest.skip("no C compiler on this machine")
    library = exported.source.with_suffix(".so")
    command = [found, "-O2", "-ffp-contract=off", *flags, "-shared", "-fPIC"]
    subprocess.run([*command, str(exported.source), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


class InC:
    """The exported controller, with the state that it carries itself."""

    def __init__(self, law: Any, folder: Path, *flags: str) -> None:
        exported = export_c(law, folder, name="law")
        self.library = built(exported, *(flags or PLAIN))
        self.is_mpc = "double *report" in exported.header.read_text()
        self.state = (ctypes.c_double * exported.states)()
        self.command = (ctypes.c_double * len(law.actuators))()
        self.report = (ctypes.c_double * (3 + len(law.actuators)))()
        self.reference = (ctypes.c_double * (len(law.controlled) * (1 + law.preview)))()

    def start(self, row: Any) -> None:
        """Start; where a measurement is not finite the guard says so by its status."""
        self.library.law_start((ctypes.c_double * len(row))(*row), self.state)

    def missed(self) -> int:
        """Return the status of a sample whose deadline has passed."""
        return int(self.library.law_missed(self.state, self.command))

    def step(self, row: Any, wanted: Any) -> int:
        """Return the status of one step; its results are in ``command`` and ``report``."""
        self.reference[:] = wanted
        measured = (ctypes.c_double * len(row))(*row)
        told = (self.report,) if self.is_mpc else ()
        step = self.library.law_step
        return int(step(measured, self.reference, self.state, self.command, *told))
