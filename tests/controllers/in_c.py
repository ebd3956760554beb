"""Exported controllers, built and called."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.c_export import ExportedC, export_c
from controllers.guard import Guarded
from workbench.computing.machine_code import compiler

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


def agrees(law: Any, folder: Path, measured: Any, references: Any, near: float) -> None:
    """Let the exported law see what the law in Python sees: its commands are as near, in SI.

    Args:
        measured: A row of measurements for each sample, in SI.
        references: As many rows of references, in SI.
    """
    in_c, guard = InC(law, folder), Guarded(law)
    # What was seen before t = 0 is not in the record: both start anew at the first row.
    memory = guard.initial_state(tuple(measured[0]))
    in_c.start(measured[0])
    for seen, asked in zip(measured, references, strict=True):
        own, memory, _ = guard.step(memory, tuple(seen), tuple(asked))
        assert in_c.step(seen, asked) == 0
        np.testing.assert_allclose(in_c.command, own, rtol=0, atol=near)


def agrees_on(run: Any, law: Any, folder: Path, near: float) -> None:
    """Let the exported law see the measurements of a run; see `agrees`."""
    asked = np.column_stack(list(run.references.values()))
    sensors = len(law.sensors)
    agrees(law, folder, run.measured[:, :sensors].tolist(), asked.tolist(), near)
