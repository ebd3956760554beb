"""Noise of sensors that one sample shares with the next, told from what a model leaves out.

What is left out follows what drives the machine; noise does not (L. Ljung, System Identification,
2nd ed. (1999), 16.6: the residuals of a right model are independent of past inputs).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.optimize import minimize
from scipy.special import fdtrc

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import FreeRun, free_run
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.estimation.start import fit_to_few
from workbench.diagnosis.estimation.windows import settled
from workbench.errors import WorkbenchError
from workbench.model import Model, Output
from workbench.model.units import from_si, in_time, of_difference, with_unit
from workbench.recordings.checks.report import check_row
from workbench.recordings.recording import Recording

_ORDER, _LAGS = 12, 6
"""Order of the autoregression that makes an error white; lags of each input that it may follow."""

BY_CHANCE = 1e-3
"""Probability of so much dependence by chance below which an error follows what drives."""

_COLOURED = 1.3
"""All of an error over its white part and over the known noise from which on its colour counts."""

_LASTING = 0.1
"""Time of correlation over that in which the plant's response shows, or which was recorded, from
which on an error may be the response to a disturbance of the process that nobody reads."""

_CLEARLY = 20.0
"""Log likelihood by which recordings must be likelier with correlated noise."""


@dataclass(frozen=True)
class Colour:
    """Noise of a sensor: a white part, and a part that is correlated.

    Args:
        white: Root mean square of the white part, in SI.
        rms: Root mean square of the correlated part, in SI.
        time: Time of its correlation, in s.
    """

    white: float
    rms: float
    time: float


def colour_of(errors: Sequence[Vector], sample_time: float) -> Colour:
    """Return white and correlated noise whose spectrum is that of errors, by Whittle's likelihood.

    ``S(w) = white^2 + rms^2 (1 - a^2) / |1 - a e^(-i w)|^2``, ``a = exp(-sample_time / time)``.

    Args:
        errors: Errors of each recording, shape (n,), in SI, without gaps.
        sample_time: Time between samples, in s.

    Source:
        P. Whittle, Ark. Mat. 2 (1953) 423.

    Example:
        >>> from workbench.diagnosis.estimation.prediction_error import gauss_markov
        >>> rng = np.random.default_rng(1)
        >>> shared = gauss_markov(20_000, 1.0, 0.095, 0.01, rng)
        >>> found = colour_of([shared + 0.5 * rng.normal(size=20_000)], 0.01)
        >>> round(found.white, 1), round(found.rms, 1), round(found.time, 2)
        (0.5, 1.0, 0.09)
    """
    spectra, angles = [], []
    for error in errors:
        n = len(error)
        spectra.append(np.abs(np.fft.rfft(error - np.mean(error))[1 : n // 2]) ** 2 / n)
        angles.append(2.0 * np.pi * np.arange(1, n // 2) / n)
    power, angle = np.concatenate(spectra), np.concatenate(angles)
    total = max(float(np.mean(power)), 1e-300)

    def cost(q: Vector) -> float:
        white, rms, time = np.exp(q)
        kept = math.exp(-1.0 / time)
        shape = (1.0 - kept**2) / np.abs(1.0 - kept * np.exp(-1j * angle)) ** 2
        s = (white**2 + rms**2 * shape) * total
        return float(np.mean(np.log(s) + power / s))

    bounds = [(-12.0, 2.0), (-12.0, 2.0), (math.log(0.5), math.log(0.2 * len(errors[0])))]
    tries = [
        minimize(cost, [-1.0, -0.3, math.log(t)], bounds=bounds, method="L-BFGS-B")
        for t in (2.0, 10.0, 40.0)
        if math.log(t) < bounds[2][1]
    ]
    best = min(tries, key=lambda found: float(found.fun))
    white, rms, time = np.exp(best.x)
    size = math.sqrt(total)
    return Colour(float(white) * size, float(rms) * size, float(time) * sample_time)


def _regressors(seen: Observed, run: FreeRun, horizon: float) -> Vector:
    """Return what drives a machine and where it is, in many shapes, (n, n_regressors)."""
    n = len(run.simulated)
    lags = np.unique(np.geomspace(1, max(2.0, horizon / seen.sample_time), _LAGS).astype(int))
    columns = [np.ones(n), np.linspace(-1.0, 1.0, n)]
    signals = [*seen.inputs.T, *run.simulated.T]
    for signal in signals:
        middle, half = np.mean(signal), np.std(signal) or 1.0
        z = (signal - middle) / half
        rate = np.gradient(z)
        quick = np.std(rate) or 1.0
        columns += [z, z**2, z**3, rate / quick, np.tanh(3.0 * rate / quick)]
    for u in seen.inputs.T:
        z = (u - np.mean(u)) / (np.std(u) or 1.0)
        columns += [np.r_[np.full(lag, z[0]), z[:-lag]] for lag in lags if lag < n]
    return np.column_stack(columns)


def follows(errors: Sequence[Vector], regressors: Sequence[Vector]) -> tuple[float, list[Vector]]:
    """Tell whether errors follow regressors.

    Both pass through the autoregression that makes the errors white; then they are regressed.

    Args:
        errors: Errors of each recording, shape (n,), in any unit.
        regressors: Of each recording, shape (n, n_regressors).

    Returns:
        Probability of so much dependence by chance, and what the regressors leave of each error.
    """
    together = [np.correlate(e - e.mean(), e - e.mean(), "full")[len(e) - 1 :] for e in errors]
    order = min(_ORDER, min(map(len, errors)) // 10)
    shared = np.sum([c[: order + 1] for c in together], axis=0)
    shared[0] *= 1.0 + 1e-9
    filtering = np.r_[1.0, -solve_toeplitz(shared[:-1], shared[1:])] if order else np.ones(1)
    white = np.concatenate([np.convolve(e, filtering, "valid") for e in errors])
    along = partial(np.apply_along_axis, np.convolve, 0)
    passed = np.concatenate([along(z, filtering, "valid") for z in regressors])
    # As many as the samples can tell of, the first ones first.
    passed = passed[:, : max(2, len(white) // 10)]
    slopes, _, rank, _ = np.linalg.lstsq(passed, white, rcond=1e-9)
    left = white - passed @ slopes
    spare = len(white) - int(rank)
    ratio = (white @ white - left @ left) / max(int(rank), 1) / max(left @ left / spare, 1e-300)
    chance = float(fdtrc(max(int(rank), 1), spare, max(ratio, 0.0)))
    rest = [e - z[:, : len(slopes)] @ slopes for e, z in zip(errors, regressors, strict=True)]
    return chance, rest


@dataclass(frozen=True)
class Leftover:
    """What the free runs of a fitted model are off by, of one output.

    Args:
        errors: Errors of each recording, shape (n,), in SI.
        chance: Probability that they follow by chance alone what drives the machine.
        rest: What they hold beside that, shape (n,) each, in SI.
    """

    errors: list[Vector]
    chance: float
    rest: list[Vector]


def leftovers(
    fit: ProcessNoiseFit, nominal: Model, seen: Sequence[Observed]
) -> dict[str, Leftover]:
    """Run a fitted model freely and tell of each output whether its error follows what drives.

    Returns:
        By output; none of outputs with gaps, and none at all where a plant drifts or a run failed.
    """
    if any(one.drifts for one in seen):
        return {}
    runs = [free_run(fit.model, settled(fit.model, nominal, one)) for one in seen]
    if not all(run.finite for run in runs):
        return {}
    found = {}
    for k, name in enumerate(seen[0].used):
        errors = [run.error[:, k] for run in runs]
        if all(np.isfinite(e).all() and np.ptp(e) > 0.0 and len(e) > 2 * _ORDER for e in errors):
            given = [_regressors(s, r, nominal.horizon) for s, r in zip(seen, runs, strict=True)]
            found[name] = Leftover(errors, *follows(errors, given))
    return found


def with_correlated_noise(
    model: Model,
    recordings: Sequence[Recording],
    left: Mapping[str, Leftover] | None = None,
    better: ProcessNoiseFit | None = None,
) -> tuple[Model, tuple[dict[str, str], ...]]:
    """Take noise of sensors that is correlated from the recordings, and say so.

    It is taken where the refitted model runs to errors that are not white and do not follow what
    drives the machine, and where the recordings are clearly likelier with it than with small
    disturbances of the process, which are coloured too.

    Args:
        left: What a better model leaves of each output: the part of it that follows nothing is
            taken for noise, even if another part does.
        better: That model, beside which the noise must be likelier; this one by default.

    Returns:
        The model, the same one where there is none, and a row for each such measurement, as those
        of the checks of recordings.
    """
    closest = model if better is None else better.model
    priors = None if better is None else better.refit.priors
    try:
        fit, seen = fit_to_few(closest, recordings, priors)
        if left is None:
            left = leftovers(fit, model, seen)
            if any(x.chance < BY_CHANCE for x in left.values()):
                return model, ()
    except (WorkbenchError, np.linalg.LinAlgError):
        return model, ()
    colours = {}
    for name, x in left.items():
        q = next(q for q in model.outputs if q.name == name)
        colour = colour_of(x.rest, seen[0].sample_time)
        known = math.hypot(q.noise_rms, q.resolution / math.sqrt(12.0))
        if math.hypot(colour.white, colour.rms) > _COLOURED * max(colour.white, known):
            white = math.sqrt(max(colour.white**2 - q.resolution**2 / 12.0, 0.0))
            colours[name] = replace(colour, white=white)
    lasting = min(model.horizon, *(one.sample_time * len(one.outputs) for one in seen))
    slow = any(c.time > _LASTING * lasting for c in colours.values())
    if not colours or slow:
        return model, ()
    try:
        other = fit_to_few(_beside(closest, colours), recordings, priors)[0]
    except (WorkbenchError, np.linalg.LinAlgError):
        return model, ()
    if other.cost > fit.cost - _CLEARLY:
        return model, ()
    coloured = _beside(model, colours)
    return coloured, tuple(
        check_row(recordings[0].name, "noise", "corrected", _note(coloured, name, colour))
        for name, colour in colours.items()
    )


def _beside(model: Model, colours: Mapping[str, Colour]) -> Model:
    def coloured(q: Output) -> Output:
        white, rms, time = astuple(colours[q.name])
        return replace(q, noise_rms=white, correlated_noise_rms=rms, noise_correlation_time=time)

    outputs = tuple(coloured(q) if q.name in colours else q for q in model.outputs)
    return replace(model, outputs=outputs)


def _note(model: Model, name: str, colour: Colour) -> str:
    unit = of_difference(next(q.display_unit for q in model.outputs if q.name == name))
    white, shared = (with_unit(f"{from_si(v, unit):.3g}", unit) for v in (colour.white, colour.rms))
    return (
        f"the noise of {name} is not white: beside {white} there are {shared} rms that are"
        f" correlated over {in_time(colour.time)}, taken from what the recordings hold beside all"
        " that follows the inputs"
    )
