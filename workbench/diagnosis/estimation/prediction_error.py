"""Prediction errors of a model along a recording, with their derivatives.

An extended Kalman filter runs along the recording. Its innovations, divided by their own standard
deviations, are white if the model is right; their derivatives with respect to the parameters follow
from the sensitivity of the filtered state, with the filter gain held. One pass gives all that a
Gauss-Newton step and a score test need.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.computing.processes import side_by_side, threads
from workbench.diagnosis.estimation.filter import Asked, End, Filter, Innovations, Steps, steps_of
from workbench.errors import NumericalError, WorkbenchError, check_choice
from workbench.model import Model
from workbench.model.model import index_of

_CORRELATED, _SAMPLES = 0.1, 2
"""Time over which what a model leaves out is taken as correlated, over that in which its response
shows; so many samples at least, for a machine that is recorded slowly is as good as at rest in
each."""

_LOST = 7.0
"""Time constants of an unstable mode after which a thousandth has grown to all of a signal."""

_LOOKS, _CORRECTIONS = 21, 2
"""Samples at which a model's fastest mode is looked for; corrections of the states there, more than
one for sensors that are not linear."""

_SHORT = 2000
"""Samples of all recordings below which a thread costs more than it saves."""


@dataclass(frozen=True)
class Observed:
    """A recording in the shape that the filter needs.

    Args:
        sample_time: Time between samples, in s.
        inputs: Inputs held from each sample to the next, shape (n, n_inputs), in SI.
        outputs: Measurements, shape (n, n_used), in SI; NaN where there is none.
        used: Names of the model's outputs that were read, n_used of them.
        noise_rms: Root mean square of the measurements' noise, shape (n_used,), in SI.
        start: Estimated states at the first sample, shape (n_states,), in SI.
        start_rms: Their uncertainty, shape (n_states,), in SI.
        growth: How fast a deviation from the nominal model's motion grows at the start, in 1/s:
            the largest real part of its eigenvalues; minus infinity if that is not known.
        horizon: Time in which the response of the nominal model shows, in s.
        correlated_noise: Noise of each measurement beside the white one that samples share: root
            mean square, in SI, and time of its correlation, in s, shape (n_used, 2); empty if there
            is none.
        relative_noise: Noise of each measurement that grows with it, as a fraction of it, shape
            (n_used,); empty if there is none.
        coarse: Steps of those measurements that are coarse beside their noise, 0 for the others,
            shape (n_used,), in SI; empty if there is none.
        input_noise: Root mean square of what the inputs were misread by at each sample, shape
            (n_inputs,), in SI; empty if there is none.
        ahead: Samples by which each measurement was moved ahead, n_used of them; empty if none was.
    """

    name: str
    sample_time: float
    inputs: Vector
    outputs: Vector
    used: tuple[str, ...]
    noise_rms: Vector
    start: Vector
    start_rms: Vector
    growth: float = -math.inf
    horizon: float = 1.0
    correlated_noise: Vector = field(default_factory=lambda: np.zeros((0, 2)))
    relative_noise: Vector = field(default_factory=lambda: np.zeros(0))
    coarse: Vector = field(default_factory=lambda: np.zeros(0))
    input_noise: Vector = field(default_factory=lambda: np.zeros(0))
    ahead: tuple[int, ...] = ()

    def moved_ahead(self, samples: Mapping[str, int]) -> Observed:
        """Return the recording with some measurements moved ahead, NaN where they end earlier.

        Args:
            samples: By how many, 0 or more, by output.
        """
        outputs, ahead = self.outputs.copy(), list(self.ahead or (0,) * len(self.used))
        for name, asked in samples.items():
            column, count = self.used.index(name), min(asked, len(outputs))
            outputs[:, column] = np.append(outputs[count:, column], np.full(count, np.nan))
            ahead[column] += count
        return replace(self, outputs=outputs, ahead=tuple(ahead))

    def as_recorded(self, columns: Vector) -> Vector:
        """Return signals like its measurements as late as these were before they were moved ahead.

        Args:
            columns: Shape (n, n_used), in SI; the first value of each stands for what was before.
        """
        late = columns.copy()
        for column, count in enumerate(self.ahead):
            late[count:, column] = columns[: len(columns) - count, column]
            late[:count, column] = columns[0, column]
        return late

    @property
    def correlation_time(self) -> float:
        """Time over which what the model leaves out is taken as correlated, in s."""
        return max(_CORRELATED * self.horizon, _SAMPLES * self.sample_time)

    @property
    def time(self) -> Vector:
        """Time from the first sample, shape (n,), in s."""
        return self.sample_time * np.arange(len(self.outputs), dtype=np.float64)

    def part(self, rows: slice) -> Observed:
        """Return some samples of the recording, with the start that it has."""
        return replace(self, inputs=self.inputs[rows], outputs=self.outputs[rows])

    def rows(self, model: Model) -> list[int]:
        """Return the places of its measurements among the outputs of a model."""
        return [index_of("output", name, model.outputs) for name in self.used]

    @cached_property
    def told(self) -> Vector:
        """Measurements of which each tells something new, shape (n, n_used), in SI; others NaN."""
        told = np.array(self.outputs)
        for column in np.flatnonzero(self.coarse):
            told[:, column] = at_steps(told[:, column], self.coarse[column])
        return told

    @property
    def white_noise_rms(self) -> Vector:
        """Root mean square of the white noise of each sample, shape (n, n_used), in SI."""
        growing = np.zeros_like(self.outputs)
        if len(self.relative_noise):
            growing = np.nan_to_num(self.outputs) * self.relative_noise
        return np.hypot(self.noise_rms, growing)

    @property
    def all_noise_rms(self) -> Vector:
        """Root mean square of all the noise of each measurement, shape (n_used,), in SI."""
        white = self.noise_rms
        if len(self.relative_noise):
            white = np.sqrt(np.mean(self.white_noise_rms**2, axis=0))
        return np.hypot(white, self.correlated_noise[:, 0]) if len(self.correlated_noise) else white

    def unread(self) -> Observed:
        """Return the recording with measurements that tell nothing."""
        noise = 1e9 * np.maximum(self.all_noise_rms, 1e-12 * np.nanmax(np.abs(self.outputs)))
        return replace(self, noise_rms=noise, relative_noise=np.zeros(0))

    def noise(self, rng: np.random.Generator) -> Vector:
        """Draw noise of the measurements, shape (n, n_used), in SI."""
        drawn = self.white_noise_rms * rng.normal(size=self.outputs.shape)
        for k, (rms, time) in enumerate(self.correlated_noise):
            if rms > 0.0:
                drawn[:, k] += gauss_markov(len(drawn), rms, time, self.sample_time, rng)
        return drawn

    @property
    def drifts(self) -> bool:
        """Whether the plant integrates or is unstable, so that its free run drifts off.

        Its slowest mode forgets nothing over the length of the recording.
        """
        return self.growth * self.sample_time * len(self.outputs) > -1.0

    @property
    def diverges(self) -> bool:
        """Whether the plant is so unstable that a run along the whole recording tells nothing."""
        return self.growth * self.sample_time * len(self.outputs) > _LOST

    def __post_init__(self) -> None:
        if len(self.inputs) != len(self.outputs) or self.outputs.shape[1] != len(self.used):
            raise WorkbenchError(
                f"recording {self.name!r} has inputs of shape {self.inputs.shape} and outputs of"
                f" shape {self.outputs.shape} for {len(self.used)} outputs; the numbers of samples"
                " and of outputs must agree"
            )


def gauss_markov(
    n: int, rms: float, time: float, sample_time: float, rng: np.random.Generator
) -> Vector:
    """Draw noise that is correlated over a time in s, shape (n,), in the unit of its rms."""
    kept = math.exp(-sample_time / time)
    fresh = rms * rng.normal(size=n) * np.r_[1.0, np.full(max(n - 1, 0), math.sqrt(1.0 - kept**2))]
    return np.array(list(accumulate(fresh.tolist(), lambda before, new: new + kept * before)))


def _like_the_rest(observed: Observed, whitened: Vector, log_deviation: Vector) -> None:
    """Take what ends earlier because it was moved ahead as likely as the rest of it.

    A likelihood would else depend on how many measurements are left.
    """
    for column, count in enumerate(observed.ahead):
        gone = np.isnan(whitened[:, column])
        gone[: len(gone) - count] = False
        rest = np.isfinite(whitened[:, column])
        if rest.any():
            rms = math.sqrt(float(np.mean(whitened[rest, column] ** 2)))
            whitened[gone, column] = np.where(np.arange(gone.sum()) % 2, -rms, rms)
            log_deviation[gone, column] = np.mean(log_deviation[rest, column])


@dataclass
class PredictionError:
    """The filter of a model for a choice of free parameters.

    Args:
        like: A recording like those along which it runs, with their sample time, their
            measurements, and where these lead the states.
        free: Names of the parameters whose derivatives are wanted.
        disturbances: Root mean square of an unmodelled signal at a port, by name of the port, in
            the port's unit; it is taken as correlated over the recording's correlation time.
        certain: Names of states that are simulated but not corrected by the filter. That is exact
            for the derivatives at size zero of effects that own these states: there no measurement
            depends on them.
        absent: Names of parameters that are zero whatever it is told.
    """

    model: Model
    like: Observed
    free: tuple[str, ...]
    disturbances: Mapping[str, float] = field(default_factory=dict)
    certain: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        model = self.model
        self._rows = tuple(self.like.rows(model))
        self._columns = tuple(index_of("parameter", name, model.parameters) for name in self.free)
        self.state_scale = np.array([q.scale for q in model.states])
        self.free_scale = np.array([model.parameters[i].scale for i in self._columns])
        names = [port.name for port in model.ports]
        # White noise of the same power at low frequency as the correlated signal.
        white = 2 * self.like.correlation_time * self.like.sample_time
        variances: dict[int, list[float]] = {}
        for i, port in enumerate(model.ports):
            if port.disturbance > 0 or port.relative_disturbance > 0:
                variances[i] = [0.0, port.relative_disturbance**2 * white]
        for name, rms in self.disturbances.items():
            check_choice("port", name, names)
            variances.setdefault(names.index(name), [0.0, 0.0])[0] = rms**2 * white
        self._ports = tuple(sorted(variances))
        self._misread = tuple(np.flatnonzero(self.like.input_noise).tolist())
        held = (self.like.input_noise[list(self._misread)] * self.like.sample_time) ** 2
        told = [*(variances[i] for i in self._ports), *([v, 0.0] for v in held)]
        self._variances = np.array(told).reshape(-1, 2)
        self._output_scale = np.array([model.outputs[i].scale for i in self._rows])
        self._steps = steps_along(model, self.like)
        if self.certain:
            # Effects at size zero are many and fast, and move nothing that is corrected.
            self._steps = self._steps._replace(halvings=1)
        certain = {index_of("state", name, model.states) for name in self.certain}
        self._corrected = tuple(i for i in range(len(model.states)) if i not in certain)
        self._filters: list[Filter] = []

    def run(
        self, observed: Observed, values: npt.ArrayLike, begin: End | None = None
    ) -> Innovations:
        """Run the filter along a recording.

        Args:
            values: Parameters, shape (n_parameters,), in SI.
            begin: Where it goes on from an earlier part; the recording's start by default.

        Raises:
            NumericalError: If the filter leaves the finite numbers.
        """
        return self._run(0, observed, values, begin)

    def along(self, recordings: Sequence[Observed], values: npt.ArrayLike) -> list[Innovations]:
        """Run the filter along several recordings, side by side where there are cores for it.

        Args:
            values: As for `run`, in SI.
        """
        short = sum(len(observed.outputs) for observed in recordings) < _SHORT
        count = 1 if short else min(threads(), len(recordings))
        # Each thread has a filter: a filter works in memory of its own.
        for number in range(count):
            self._filter(number)

        def some(number: int) -> list[Innovations]:
            return [self._run(number, observed, values) for observed in recordings[number::count]]

        parts = side_by_side([(some, (number,)) for number in range(count)])
        return [parts[i % count][i // count] for i in range(len(recordings))]

    def expected(self, observed: Observed, run: Innovations) -> Vector:
        """Return the measurements that the filter expected, shape (n, n_used), in SI.

        NaN where there was no measurement.
        """
        error = run.whitened * np.exp(run.log_deviation) * self._output_scale
        return np.asarray(observed.told - error)

    def begin(self, observed: Observed) -> tuple[Vector, Vector]:
        """Return the start of a recording, in SI, and its covariance over the scales."""
        spread = (observed.start_rms / self.state_scale)[list(self._corrected)]
        return observed.start, np.diag(spread**2)

    def _run(
        self, number: int, observed: Observed, values: npt.ArrayLike, begin: End | None = None
    ) -> Innovations:
        done, found = self._filter(number).run(
            *(begin or self.begin(observed)),
            observed.inputs,
            observed.told / self._output_scale,
            (observed.white_noise_rms / self._output_scale) ** 2,
            values,
            self._variances,
        )
        if done < len(observed.outputs) or not np.isfinite(found.jacobian).all():
            raise NumericalError(
                f"the filter of {self.model.name!r} left the finite numbers on"
                f" {observed.name!r}; the parameters are far from those of the recording"
            )
        _like_the_rest(observed, found.whitened, found.log_deviation)
        return found

    def _filter(self, number: int) -> Filter:
        if number < len(self._filters):
            return self._filters[number]
        told = zip(self.like.correlated_noise.tolist(), self._output_scale.tolist(), strict=False)
        coloured = [(k, rms / scale, t) for k, ((rms, t), scale) in enumerate(told) if rms > 0.0]
        asked = Asked(
            self.model.exact,
            tuple(self.state_scale),
            tuple(self._output_scale),
            self._rows,
            self._columns,
            self._corrected,
            tuple(self.free_scale),
            self._ports,
            tuple(coloured),
            self._misread,
            tuple(index_of("parameter", name, self.model.parameters) for name in self.absent),
        )
        self._filters.append(Filter(asked, self.like.sample_time, self._steps))
        return self._filters[-1]


_DISTINCT = 1e-6
"""Least noise of a sensor over what the states make of it, for which numbers are precise enough."""


def steps_along(model: Model, observed: Observed) -> Steps:
    """Choose the steps per sample of a model where a recording leads its states.

    At some samples the states, random within their scales, are corrected by the measurements.
    """
    if not model.states:
        return Steps(0, 1)
    rng = np.random.default_rng(0)
    rows = observed.rows(model)
    scale = np.array([q.scale for q in model.states])
    within = [q.lower for q in model.states], [q.upper for q in model.states]
    noise = np.maximum(observed.noise_rms, 1e-6 * np.array([model.outputs[i].scale for i in rows]))
    at = np.linspace(0, len(observed.outputs) - 1, _LOOKS).round().astype(int)
    seen = observed.outputs[:, np.isfinite(observed.outputs).any(axis=0)]
    ends = np.concatenate([np.nanargmin(seen, axis=0), np.nanargmax(seen, axis=0)])
    at[1 : 1 + len(ends)] = ends[: _LOOKS - 1]  # A contact is met at an end of a course.
    u, read, trace = observed.inputs[at], observed.outputs[at], model.exact
    begin = model.initial_state(u=observed.inputs[0])
    x = np.clip(begin + rng.uniform(-1.0, 1.0, (_LOOKS, len(scale))) * scale, *within)
    x[0] = begin  # What rubs is stiff at rest.
    for _ in range(_CORRECTIONS):
        seen = np.asarray(trace.outputs_function(x.T, u.T, model.values)).T
        slopes = np.asarray(trace.jacobian_function(x.T, u.T, model.values)[2])
        spread = slopes.reshape(len(model.outputs), _LOOKS, -1).transpose(1, 0, 2)[:, rows] * scale
        error = read - seen[:, rows]
        known = np.isfinite(error) & np.isfinite(spread**2).all(axis=2)
        error, spread = np.where(known, error, 0.0), np.where(known[:, :, None], spread, 0.0)
        # Several sensors of what is so steep that it drowns their noise would be one.
        own = noise**2 + (_DISTINCT * np.abs(spread).max(axis=2)) ** 2
        variance = spread @ spread.transpose(0, 2, 1) + own[:, :, None] * np.eye(len(rows))
        gain = spread.transpose(0, 2, 1) @ np.linalg.solve(variance, error[:, :, None])
        x = np.clip(x + scale * gain[:, :, 0], *within)
    return steps_of(model, observed.sample_time, x, u)


def disturbances(model: Model, noise_scale: float) -> dict[str, float]:
    """Return the disturbance at each port, rms in its SI unit: what is expected, times the scale.

    Args:
        noise_scale: Process-noise scale, dimensionless.
    """
    return {
        q.name: noise_scale * q.disturbance for q in model.ports if noise_scale * q.disturbance > 0
    }


def filter_of(
    model: Model,
    observed: Observed,
    noise_scale: float,
    free: Sequence[str] = (),
    *,
    beside: Model | None = None,
    absent: Sequence[str] = (),
) -> PredictionError:
    """Return the filter of a model for recordings like one, at a process-noise scale.

    Args:
        noise_scale: Process-noise scale, dimensionless.
        beside: The model without effects at size zero, whose states are certain.
        absent: Parameters that are zero whatever the filter is told: their slopes alone are wanted.
    """
    own = {q.name for q in (beside or model).states}
    certain = tuple(q.name for q in model.states if q.name not in own)
    pushed = disturbances(model, noise_scale)
    return PredictionError(model, observed, tuple(free), pushed, certain, tuple(absent))


def stack(parts: Sequence[Innovations]) -> tuple[Vector, Vector]:
    """Stack the innovations of several recordings for least squares.

    Returns:
        Whitened errors, shape (m,), and their derivatives, shape (m, n_free); samples without a
        measurement are left out.
    """
    errors = np.concatenate([part.whitened.ravel() for part in parts])
    rows = np.concatenate([p.jacobian.reshape(p.whitened.size, -1) for p in parts])
    used = np.isfinite(errors)
    return errors[used], rows[used]


def at_steps(measured: Vector, step: float) -> Vector:
    """Return what a coarse measurement tells: first, where it steps, and once between two steps.

    Samples that repeat a reading repeat its rounding error. Where it steps by one, the quantity was
    between the two readings, the nearer to their middle the longer the last one had stood.

    Args:
        measured: Samples in steps, shape (n,); NaN where there is none.
        step: The distance of readings, in the same unit.

    Returns:
        Samples, shape (n,); NaN where a sample tells nothing new.

    Example:
        >>> at_steps(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 3.0, 5.0]), 1.0)
        array([0. , nan, 0. , nan, nan, 0.6, 3. , 5. ])
    """
    known = np.flatnonzero(np.isfinite(measured))
    values, told = measured[known], np.full(len(measured), np.nan)
    change = np.diff(values)
    first = np.flatnonzero(np.concatenate([[True], change != 0.0]))[: len(values)]
    stood = np.diff(np.append(first, len(values)))
    middle = (first + (stood - 1) // 2)[stood > 2]
    told[known[:1]], told[known[middle]] = values[:1], values[middle]
    at, moved, before = first[1:], change[first[1:] - 1], stood[:-1]
    part = np.where(np.abs(moved) < 1.5 * step, 0.5 * (1.0 - 1.0 / before), 0.0)
    told[known[at]] = values[at] - part * moved
    return told
