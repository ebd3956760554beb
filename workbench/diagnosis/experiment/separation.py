"""How well an experiment would separate two explanations, show an effect, or sharpen its size.

Nothing is measured here: one model plays the experiment, the filter of the other runs along what
the sensors would read. Its whitened errors, less what its free parameters can still make up for,
are what the recording would decide on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.filter import Innovations
from workbench.diagnosis.estimation.prediction_error import (
    Observed,
    PredictionError,
    filter_of,
    stack,
)
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, extended_start
from workbench.diagnosis.experiment.menu import Experiment
from workbench.errors import NumericalError
from workbench.model import Model
from workbench.model.model import index_of
from workbench.physics.library import Hypothesis

SENSOR_NOISE = 0.01
"""Noise of a sensor that is not there yet, as a share of the scale of what it reads."""


@dataclass(frozen=True)
class Explanation:
    """A fitted model that could explain the recordings.

    Args:
        size: Name of the parameter that is the size of the effect; empty for none.
    """

    name: str
    fit: ProcessNoiseFit
    size: str = ""

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that were fitted."""
        return tuple(e.name for e in self.fit.refit.estimates)

    @property
    def inflation(self) -> float:
        """Factor by which correlated errors enlarge standard deviations, the largest."""
        factors = self.fit.refit.inflations
        return float(max(1.0, *factors)) if len(factors) else 1.0


class Separator:
    """Filters of fitted models, kept for many experiments.

    Args:
        recording: A recording as `observe` returns it, for the outputs, their noise and the start.
    """

    def __init__(self, recording: Observed, observed_with: Model) -> None:
        self.recording, self.model = recording, observed_with
        self._filters: dict[tuple[str, float], PredictionError] = {}

    def start(self, explanation: Explanation, inputs: Vector) -> Observed:
        """Return the start of the recording for an explanation.

        Args:
            inputs: Inputs of an experiment, shape (n, n_inputs), in SI.
        """
        outputs = self.recording.outputs[:1].repeat(len(inputs), axis=0)
        first = replace(self.recording, inputs=inputs, outputs=outputs)
        return extended_start(first, self.model, explanation.fit.model)

    def played(self, truth: Explanation, experiment: Experiment) -> Observed | None:
        """Return what the sensors would read, without noise, if an explanation is true.

        It is None if the model does not reach the end.
        """
        begin = self.start(truth, experiment.inputs)
        read = experiment.measurements(truth.fit.model, begin.start)
        if read is None:
            return None
        names = [q.name for q in truth.fit.model.outputs]
        used = begin.as_recorded(read[:, [names.index(name) for name in self.recording.used]])
        return replace(self.recording, name=experiment.text, inputs=experiment.inputs, outputs=used)

    def errors(
        self, explanation: Explanation, seen: Observed, experiment: Experiment, noise_scale: float
    ) -> Innovations | None:
        """Run the filter of an explanation along what would be read, at a scale (dimensionless).

        The result is None if the filter leaves the finite numbers.
        """
        key, model = (explanation.name, noise_scale), explanation.fit.model
        if key not in self._filters:
            self._filters[key] = filter_of(model, seen, noise_scale, explanation.free)
        begun = extended_start(seen, self.model, model)
        try:
            return self._filters[key].run(begun, experiment.on(model).values)
        except NumericalError:
            return None

    def both(
        self, truth: Explanation, other: Explanation, experiment: Experiment
    ) -> tuple[Observed, Innovations, Innovations] | None:
        """Return what would be read if an explanation is true, and the errors of it and another.

        The result is None if one of them leaves the finite numbers.
        """
        seen = self.played(truth, experiment)
        if seen is None:
            return None
        noise_scale = min(truth.fit.noise_scale, other.fit.noise_scale)
        right = self.errors(truth, seen, experiment, noise_scale)
        wrong = self.errors(other, seen, experiment, noise_scale)
        return None if right is None or wrong is None else (seen, right, wrong)


@dataclass(frozen=True)
class Separation:
    """What an experiment is predicted to tell.

    Args:
        sigma: Standard deviations by which it separates the explanations, dimensionless.
        gain: Log likelihood that the true one would gain over the refitted other, dimensionless.
    """

    experiment: Experiment
    sigma: float
    gain: float


def separation(
    separator: Separator, truth: Explanation, other: Explanation, experiment: Experiment
) -> Separation:
    """Predict by how much an experiment would tell an explanation from a refitted other.

    With the whitened errors e of the other's filter on what the truth would read, their
    derivatives J with respect to its free parameters, and the covariance P of those by the
    recordings that exist, ``gain = min_d (|e + J d|^2 + d' P^-1 d) / 2``; the standard deviations
    are the root of twice the gain over the factor by which correlated errors enlarge the standard
    deviations of the present fits. It is none at all if a model leaves the finite numbers.
    """
    found = separator.both(truth, other, experiment)
    if found is None:
        return Separation(experiment, 0.0, 0.0)
    _, right, wrong = found
    left, own = reduced(wrong, _information(other)), reduced(right, _information(truth))
    gain = max(left - own, 0.0)
    inflation = max(truth.inflation, other.inflation)
    return Separation(experiment, math.sqrt(2 * gain) / inflation, gain)


def _information(explanation: Explanation) -> Vector:
    """Return what the present recordings and the priors know, in scaled parameters."""
    refit = explanation.fit.refit
    scale = np.array([refit.model.parameter(n).scale for n in explanation.free])
    # A parameter on its bound has no spread of its own: it stays there.
    covariance = refit.covariance / np.outer(scale, scale)
    spread = np.maximum(np.diag(covariance), 1e-20)
    covariance = covariance + np.diag(1e-9 * spread)
    return np.asarray(np.linalg.inv(covariance))


def reduced(part: Innovations, information: Vector) -> float:
    """Return ``min_d (|e + J d|^2 + d' information d) / 2``, dimensionless.

    It is half the sum of squares that the free parameters cannot make up for, of which
    ``information``, shape (n_free, n_free), scaled, is known before.
    """
    return 0.5 * _left(*stack([part]), information)


def _left(errors: Vector, rows: Vector, information: Vector) -> float:
    gradient = rows.T @ errors
    step = np.linalg.solve(rows.T @ rows + information, gradient)
    return float(errors @ errors - gradient @ step)


def spread_after(
    separator: Separator, explanation: Explanation, experiment: Experiment
) -> tuple[float, float]:
    """Predict the standard deviation of an effect's size now and after an experiment, in its unit.

    It is the same twice if the model does not reach the end.
    """
    now = explanation.fit.refit.estimate(explanation.size).std
    seen = separator.played(explanation, experiment)
    if seen is None:
        return now, now
    part = separator.errors(explanation, seen, experiment, explanation.fit.noise_scale)
    if part is None:
        return now, now
    rows = stack([part])[1] / explanation.inflation
    after = np.linalg.inv(_information(explanation) + rows.T @ rows)
    k = explanation.free.index(explanation.size)
    return now, now * math.sqrt(after[k, k] / np.linalg.inv(_information(explanation))[k, k])


@dataclass(frozen=True)
class Sight:
    """How clearly an effect shows before and after an experiment.

    Args:
        now: Standard deviation of its size by the present recordings, in the unit of the size.
        then: The same with the experiment, in the same unit.
        collinearity: Share of its signature that the free parameters can then reproduce, 0 to 1,
            dimensionless.
    """

    experiment: Experiment
    entry: Hypothesis
    now: float
    then: float
    collinearity: float


def visible(
    separator: Separator,
    explanation: Explanation,
    entries: Sequence[Hypothesis],
    recordings: Sequence[Observed],
    experiments: Sequence[Experiment],
) -> list[Sight]:
    """Predict how clearly experiments would show effects.

    The free parameters can reproduce an effect as far as the present recordings and the experiment
    together let them. The recordings are observed with the separator's model.
    """
    base = explanation.fit.model
    model = base.with_effect(*(e.effect for e in entries))
    sizes = tuple(e.size_name for e in entries)
    scale, free = explanation.fit.noise_scale, (*explanation.free, *sizes)
    filter_ = filter_of(model, separator.recording, scale, free, beside=base)
    n = len(explanation.free)
    known = np.zeros((n + len(sizes), n + len(sizes)))
    priors = [e.prior.std for e in explanation.fit.refit.estimates]
    known[range(n), range(n)] = (filter_.free_scale[:n] / np.array(priors)) ** 2
    for recording in recordings:
        begun = extended_start(recording, separator.model, model)
        known += _known(filter_, begun, model, explanation.inflation)
    found = []

    def spread(total: Vector, i: int) -> tuple[float, float]:
        cross, whole = total[n + i, :n], max(float(total[n + i, n + i]), 1e-300)
        kept = max(float(whole - cross @ np.linalg.solve(total[:n, :n], cross)), 1e-12 * whole)
        return float(filter_.free_scale[n + i]) / math.sqrt(kept), 1.0 - kept / whole

    for experiment in experiments:
        seen = separator.played(explanation, experiment)
        if seen is None:
            continue
        begun = extended_start(seen, separator.model, model)
        total = known + _known(filter_, begun, experiment.on(model), explanation.inflation)
        for i, entry in enumerate(entries):
            found.append(Sight(experiment, entry, spread(known, i)[0], *spread(total, i)))
    return found


def _known(filter_: PredictionError, seen: Observed, model: Model, inflation: float) -> Vector:
    """Return the information of a recording on scaled parameters; none where the filter fails."""
    try:
        rows = stack([filter_.run(seen, model.values)])[1] / inflation
    except NumericalError:
        rows = np.zeros((1, len(filter_.free)))
    return np.asarray(rows.T @ rows)


def sensors(
    separator: Separator, truth: Explanation, other: Explanation, experiment: Experiment
) -> list[tuple[str, float]]:
    """Predict by how much a further sensor would separate two explanations.

    The other explanation's filter follows the present measurements; what its equations make of the
    signal is compared with the signal of the truth, less what its free parameters can make up for.
    Values within the correlation time of disturbances count once.

    Returns:
        Ports and published signals, the best first, with standard deviations, dimensionless.
    """
    told = separator.both(truth, other, experiment)
    if told is None:
        return []
    seen, right, wrong = told
    true, _ = _signals(truth, right.states, experiment)
    followed, slopes = _signals(other, wrong.states, experiment)
    names, known = (e.fit.model.exact.signal_names for e in (other, truth))
    measurements = {*seen.used, *(f"{q}.reading" for q in seen.used)}
    ports = {q.name: q.scale for q in other.fit.model.ports}
    information = _information(other)
    each = min(1.0, seen.sample_time / (2 * min(seen.correlation_time, 50 * seen.sample_time)))
    found = []
    for i, name in enumerate(names):
        if name not in known or name in measurements:
            continue
        scale = ports.get(name, float(np.abs(followed[:, i]).max()))
        if not scale > 0:
            continue
        noise = SENSOR_NOISE * scale / math.sqrt(each)
        error = (true[:, known.index(name)] - followed[:, i]) / noise
        left = _left(error, -slopes[:, i] / noise, information)
        found.append((name, math.sqrt(max(left, 0.0))))
    return sorted(found, key=lambda pair: -pair[1])


def _signals(
    explanation: Explanation, states: Vector, experiment: Experiment
) -> tuple[Vector, Vector]:
    """Return every signal along states, (n, n_signals), and its slope by the free parameters."""
    model = experiment.on(explanation.fit.model)
    traced = model.exact
    columns = [index_of("parameter", n, model.parameters) for n in explanation.free]
    scale = np.array([model.parameters[c].scale for c in columns])
    slope = ca.jacobian(traced.signals, traced.p)[:, columns]
    along = traced.along(states, experiment.inputs, model.values, traced.signals, slope)
    return along[0][:, :, 0], along[1] * scale
