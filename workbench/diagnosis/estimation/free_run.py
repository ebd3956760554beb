"""Free run: the model alone along the inputs of a recording, beside what was read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Model
from workbench.model.units import in_time
from workbench.simulation import simulate
from workbench.simulation.stepper import Stepper
from workbench.simulation.trajectory import read_outputs

_TOLERANCE = 1e-6


@dataclass(frozen=True)
class FreeRun:
    """A model simulated along a recording, never corrected by the measurements.

    Args:
        time: Time from the first sample, shape (n,), in s.
        measured: Measurements, shape (n, n_used), in SI; NaN where there is none.
        simulated: What the model would read, shape (n, n_used), in SI; NaN if the run failed.
        window: Length of the windows that it was started anew in, in s; 0 for a single run.
    """

    name: str
    used: tuple[str, ...]
    units: tuple[str, ...]
    time: Vector
    measured: Vector
    simulated: Vector
    failure: str = ""
    window: float = 0.0

    @property
    def restarts(self) -> str:
        """In words that it was started anew, and why; empty for a single run."""
        if not self.window:
            return ""
        return (
            "a small error of its start grows along the recording, as it may in the machine: the"
            f" model is started anew every {in_time(self.window, 2)}, from what the filter knows of"
            " its states there"
        )

    @property
    def finite(self) -> bool:
        """Whether the run reached the end."""
        return not self.failure

    @property
    def error(self) -> Vector:
        """Measurements minus simulation, shape (n, n_used), in SI; NaN where not measured."""
        return self.measured - self.simulated

    @property
    def rmse(self) -> dict[str, float]:
        """Root mean square of the error by output, in its SI unit; infinite if the run failed."""
        if not self.finite:
            return dict.fromkeys(self.used, float("inf"))
        with np.errstate(over="ignore"):  # What ran that far off is infinitely wrong.
            rms = np.sqrt(np.nanmean(self.error**2, axis=0))
        return dict(zip(self.used, rms.tolist(), strict=True))

    @property
    def spread(self) -> dict[str, float]:
        """Standard deviation of the measurements by output, in its SI unit."""
        return dict(zip(self.used, np.nanstd(self.measured, axis=0).tolist(), strict=True))

    def __str__(self) -> str:
        lines = [f"free run on {self.name}" + (f": {self.failure}" if self.failure else "")]
        lines += [
            f"  {name:<20} rmse {self.rmse[name]:<12.4g} {unit}"
            for name, unit in zip(self.used, self.units, strict=True)
        ]
        return "\n".join(lines)


def free_run(model: Model, observed: Observed, *, values: npt.ArrayLike | None = None) -> FreeRun:
    """Simulate a model along the inputs of a recording, from the start that it shows.

    Args:
        model: The plant; it may carry effects that the recording was not observed with, whose
            states start where the effects put them.
        values: Parameter values, shape (n_parameters,), in SI; the model's own by default.

    Returns:
        The run beside the measurements. A run that the integrator gives up is returned with the
        reason, because a model that diverges is a result.
    """
    inputs = clipped(model, observed)
    try:
        simulated = simulate(
            model,
            inputs,
            sample_time=observed.sample_time,
            start=_start(model, observed, inputs[0]),
            tolerance=_TOLERANCE,
            values=values,
            check=False,
        ).outputs[:, observed.rows(model)]
    except NumericalError as error:
        return run_along(model, observed, failure=str(error))
    return run_along(model, observed, simulated)


def free_runs(
    model: Model, recordings: Sequence[Observed], *, values: npt.ArrayLike | None = None
) -> list[FreeRun]:
    """Simulate a model along several recordings, or pieces of one, as `free_run` along each.

    What the runs share is built once, which for many short pieces is most of the work.

    Args:
        recordings: Recordings with the same measurements and sample time.
        values: Parameter values, shape (n_parameters,), in SI; the model's own by default.
    """
    first = recordings[0]
    stepper = Stepper(model, first.sample_time, _TOLERANCE, values=values)
    held, states = [], []
    for seen in recordings:
        inputs = clipped(model, seen)
        start = _start(model, seen, inputs[0])
        states.append(np.vstack([start, stepper.run_as_far(start, inputs[:-1])]))
        held.append(inputs[: len(states[-1])])
    at = np.concatenate(states), np.concatenate(held)
    outputs = read_outputs(model, *at, values=stepper.parameters)[:, first.rows(model)]
    parts = np.split(outputs, np.cumsum([len(x) for x in states])[:-1])
    return [
        run_along(model, seen, simulated)
        if len(simulated) == len(seen.outputs)
        # Another method may get further.
        else free_run(model, seen, values=values)
        for seen, simulated in zip(recordings, parts, strict=True)
    ]


def clipped(model: Model, observed: Observed) -> Vector:
    """Return the inputs of a recording as an actuator lets them through, (n, n_inputs), in SI."""
    ends = [q.lower for q in model.inputs], [q.upper for q in model.inputs]
    return np.asarray(np.clip(observed.inputs, *ends))


def run_along(
    model: Model,
    observed: Observed,
    simulated: Vector | None = None,
    failure: str = "",
    window: float = 0.0,
) -> FreeRun:
    """Return the run of a model beside a recording.

    Args:
        simulated: What it would read, shape (n, n_used), in SI; None if it could not be begun.
        window: Length of its windows, in s.
    """
    units = tuple(model.outputs[i].unit for i in observed.rows(model))
    read = np.full_like(observed.outputs, np.nan) if simulated is None else simulated
    name, used = observed.name, observed.used
    return FreeRun(name, used, units, observed.time, observed.outputs, read, failure, window)


def as_recorded(run: FreeRun, seen: Observed, recorded: Observed) -> FreeRun:
    """Return a run along a recording whose measurements were moved ahead beside the recorded ones.

    Args:
        seen: The recording as it was run along.
        recorded: The same with no measurement moved.
    """
    simulated = seen.as_recorded(run.simulated)
    return replace(run, measured=recorded.outputs, simulated=simulated) if seen.ahead else run


def rms_of(runs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the root mean square over runs of their errors by output, in SI."""
    return {k: float(np.sqrt(np.mean(np.square([r[k] for r in runs])))) for k in runs[0]}


def _start(model: Model, observed: Observed, u: Vector) -> Vector:
    """Return the start, with the states of effects attached since it was estimated."""
    own = len(observed.start)
    if own == len(model.states):
        return observed.start
    if own > len(model.states):
        raise WorkbenchError(
            f"recording {observed.name!r} was observed with {own} states; {model.name!r} has"
            f" {len(model.states)}: observe it again with this model"
        )
    given = {q.name: float(v) for q, v in zip(model.states, observed.start, strict=False)}
    return model.initial_state(given, u=u)
