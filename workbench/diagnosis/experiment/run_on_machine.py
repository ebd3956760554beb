"""Playing an experiment on a machine, and taking its recording into a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from workbench.diagnosis.division import in_two
from workbench.diagnosis.estimation.simulated_recordings import simulated_recording
from workbench.diagnosis.experiment.menu import Experiment
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.recordings.recording import Recording
from workbench.recordings.saving import csv_text


@runtime_checkable
class Machine(Protocol):
    """A machine that an input can be played on."""

    def play(self, experiment: Experiment) -> Recording:
        """Play the inputs of an experiment from rest and return what was recorded."""


@dataclass(frozen=True)
class SimulatedMachine:
    """A model that stands for a machine, with the noise and the resolution of its sensors."""

    model: Model
    seed: int = 1

    def play(self, experiment: Experiment) -> Recording:
        """Play the inputs of an experiment from rest and return what was recorded.

        Raises:
            WorkbenchError: If the model has other inputs than the experiment.
        """
        return simulated_recording(
            experiment.on(self.model),
            experiment.inputs,
            sample_time=experiment.sample_time,
            seed=self.seed,
            name="experiment",
        )


def plan_csv(model: Model, experiment: Experiment) -> str:
    """Write the inputs of an experiment as a file to be played on a device.

    CSV text: time in s and each input in the unit in which people read it, held until the next row.
    """
    time = experiment.sample_time * np.arange(len(experiment.inputs))
    return csv_text(
        time,
        [
            (q.name, q.display_unit, column)
            for q, column in zip(model.inputs, experiment.inputs.T, strict=True)
        ],
    )


def with_experiment(
    model: Model,
    experiment: Experiment,
    machine: Machine,
    fit_on: Sequence[Recording],
    hold_out: Sequence[Recording],
) -> tuple[Recording, tuple[Recording, ...], tuple[Recording, ...]]:
    """Play an experiment on a machine and add its recording, a part of it to those held out.

    Returns:
        The recording, then recordings to fit on and to judge on.

    Raises:
        WorkbenchError: If the recording lacks an input, has no output or is too short.
    """
    recording: object = machine.play(experiment)
    if not isinstance(recording, Recording):
        raise WorkbenchError(
            f"play of the machine returned a {type(recording).__name__}; return a Recording"
        )
    lacking = [q.name for q in model.inputs if q.name not in recording]
    if lacking:
        raise WorkbenchError(
            f"the machine recorded no {lacking[0]!r}, an input of {model.name!r}; it recorded"
            f" {', '.join(recording.names)}: record every input with the outputs"
        )
    outputs = [q for q in model.outputs if q.name in recording]
    if not outputs:
        raise WorkbenchError(
            f"the machine recorded no output of {model.name!r}; it recorded"
            f" {', '.join(recording.names)}, and one of {', '.join(q.name for q in model.outputs)}"
            " is needed"
        )
    n = len(recording.time)
    if n < 0.5 * len(experiment.inputs):
        raise WorkbenchError(
            f"the machine recorded {n} samples of {len(experiment.inputs)}; it must play at least"
            " half of the experiment"
        )
    begun, rest = in_two(model, recording)
    return recording, (*fit_on, begun), (*hold_out, rest)
