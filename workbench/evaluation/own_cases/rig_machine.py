"""The rig as a machine that an experiment can be played on.

Units: SI.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from workbench.diagnosis.experiment.menu import Experiment
from workbench.errors import check_range
from workbench.evaluation.rig import simulate
from workbench.evaluation.rig.cases import settled
from workbench.evaluation.rig.excitation import RATE
from workbench.recordings.recording import Recording, Signal


@dataclass(frozen=True)
class RigMachine:
    """The rig with what it hides."""

    parameters: dict[str, float] = field(repr=False)
    seed: int = 1

    def play(self, experiment: Experiment) -> Recording:
        """Play the inputs of an experiment from rest at 30 degrees.

        Raises:
            WorkbenchError: If the samples are not those of the rig.
        """
        check_range("sample time", experiment.sample_time, 0.999 / RATE, 1.001 / RATE, "s")
        start = settled(self.parameters, seconds=2.0)
        record = simulate.run(
            self.parameters, start, command=experiment.inputs[:, 0], seed=self.seed
        )
        return recording_of(record, "experiment")


def rig_of(folder: Path) -> RigMachine:
    """Return the rig that made a case."""
    truth = json.loads((folder / "truth.json").read_text())
    return RigMachine(truth["parameters"])


def recording_of(record: simulate.Record, name: str) -> Recording:
    """Return a record of the rig in SI."""
    return Recording(
        name,
        record.time,
        (
            Signal("valve", record.valve, "V", role="command"),
            Signal("angle", np.radians(record.angle), "rad"),
            Signal("pressure_1", 1e5 * record.pressure_1, "Pa"),
            Signal("pressure_2", 1e5 * record.pressure_2, "Pa"),
        ),
    )
