"""Refit, filter and laws without a name, beside general estimators."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.made_up import made_up, made_up_axis, pushes
from workbench.diagnosis.estimation.prediction_error import (
    Observed,
    PredictionError,
    disturbances,
    steps_along,
)
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.nonparametric.fit import nonparametric_term
from workbench.model import Model
from workbench.physics.stiffness import linear_spring
from workbench.plants.servo_axis import servo_axis
from workbench.simulation.equations import Equations, address
from workbench.simulation.integrators import integrator_library
from workbench.speed.measure import Comparison, Way, timed, tried

_STIFFNESS = 200.0
_STEP_S = 0.01
_SHARE = 0.03
"""Process-noise scale at which the refits are compared, dimensionless."""


def refits() -> Comparison:
    """Compare the refit with a general one: filter in Python, likelihood by differences."""
    model, seen = servo_axis(), made_up_axis(3, samples=200)
    priors = default_priors(model)
    names, allowed = tuple(p.name for p in priors), disturbances(model, _SHARE)
    judge = PredictionError(model, seen, names, allowed)
    times = timed(
        lambda: refit(model, [seen], priors=priors, stages=(1.0, _SHARE)), repeats=5, warm=True
    )
    others = timed(lambda: _general_refit(model, seen, priors), repeats=1)
    best = np.array([e.value for e in times.result.estimates]), others.result
    ours, general = (_cost(judge, model, seen, priors, values) for values in best)
    least = min(ours, general)
    return Comparison(
        "refit",
        f"Refit of {len(priors)} parameters of a servo axis on {len(seen.outputs)} samples",
        "refit",
        "log likelihood lost against the better of the two",
        (
            Way("workbench, Gauss-Newton with sensitivities", times, ours - least),
            Way(
                "filter in NumPy, likelihood by SciPy's L-BFGS-B",
                others,
                general - least,
                "as CTSM does it: gradients by differences",
            ),
        ),
        "Both maximise the likelihood of the same one-step prediction errors with the same priors,"
        f" process noise at {_SHARE:g} of what is expected.",
    )


def _cost(
    judge: PredictionError, model: Model, seen: Observed, priors: Sequence[Prior], values: Vector
) -> float:
    named = dict(zip((p.name for p in priors), values.tolist(), strict=True))
    known = sum(((v - p.mean) / p.std) ** 2 for v, p in zip(values, priors, strict=True)) / 2
    return judge.run(seen, model.with_parameters(named).values).cost + float(known)


def _general_refit(model: Model, seen: Observed, priors: Sequence[Prior]) -> Vector:
    """Maximise the likelihood of a continuous-discrete filter that knows nothing of the model."""
    from scipy.linalg import expm
    from scipy.optimize import minimize

    traced = model.exact
    rates, slopes, read = traced.rates_function, traced.jacobian_function, traced.outputs_function
    h, n = seen.sample_time, len(model.states)
    columns = [[q.name for q in model.parameters].index(p.name) for p in priors]
    mean, std = (np.array([getattr(p, k) for p in priors]) for k in ("mean", "std"))
    white = 2 * 0.1 * h
    used = [[q.name for q in model.outputs].index(name) for name in seen.used]
    by_port = np.asarray(
        traced.function("by_port", traced.rates_by_port)(
            model.initial_state(), model.nominal_input, model.values
        )
    )
    rms = disturbances(model, _SHARE)
    variance = np.array([rms.get(p.name, 0.0) ** 2 * white for p in model.ports])
    noise = by_port @ np.diag(variance) @ by_port.T
    r = seen.noise_rms**2

    def cost(scaled: Vector) -> float:
        values = model.values
        values[columns] = mean + std * scaled
        x, P = seen.start.copy(), np.diag(seen.start_rms**2)
        total = 0.5 * float(scaled @ scaled)
        for u, y in zip(seen.inputs, seen.outputs, strict=True):
            A, _, C, _ = (np.asarray(m) for m in slopes(x, u, values))
            C = C[used]
            error = y - np.asarray(read(x, u, values)).ravel()[used]
            S = C @ P @ C.T + np.diag(r)
            K = P @ C.T @ np.linalg.inv(S)
            total += 0.5 * float(error @ np.linalg.solve(S, error)) + 0.5 * np.linalg.slogdet(S)[1]
            x, P = x + K @ error, P - K @ C @ P

            def f(state: Vector, u: Vector = u) -> Vector:
                return np.asarray(rates(state, u, values)).ravel()

            k1 = f(x)
            k2 = f(x + h / 2 * k1)
            k3 = f(x + h / 2 * k2)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x + h * k3))
            transition = expm(h * A[:n, :n])
            P = transition @ P @ transition.T + noise
        return total

    bounds = [((p.lower - p.mean) / p.std, (p.upper - p.mean) / p.std) for p in priors]
    found = minimize(
        cost, np.zeros(len(priors)), method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-7}
    )
    return np.asarray(mean + std * found.x)


def laws() -> Comparison:
    """Compare finding the shape of an unknown force: a spring that no library knows."""
    axis = servo_axis()
    spring = linear_spring("axis.force", stiffness=_STIFFNESS, upper=1000.0)
    fit_on, hold_out = (
        made_up(axis.with_effect(spring), pushes(800, largest=200.0, seed=s), sample_time=_STEP_S)
        for s in (1, 2)
    )
    fit_on, hold_out = observed_by(axis, fit_on), observed_by(axis, hold_out)
    priors = default_priors(axis)
    low, high = np.quantile(fit_on.outputs[:, 0], [0.05, 0.95]).tolist()
    at: Vector = np.linspace(low, high, 50)
    truth = -_STIFFNESS * at

    def ours() -> Vector:
        base = fit_with_process_noise(axis, [fit_on], priors)
        return nonparametric_term(base, [fit_on], [hold_out], ["axis.force"], priors).curve(at)

    times = timed(ours, repeats=2, warm=True)
    ways = [Way("workbench, spline in the equations", times, _off(times.result, truth))]

    def sparse(ps: Any) -> Way:
        x, u = fit_on.outputs[:, :1], fit_on.inputs

        def work() -> Vector:
            smooth = ps.SmoothedFiniteDifference(smoother_kws={"window_length": 15})
            t = _STEP_S * np.arange(len(x))
            speed = smooth(x, t)
            found = ps.SINDy(
                optimizer=ps.STLSQ(threshold=1e-3),
                feature_library=ps.PolynomialLibrary(degree=3),
                differentiation_method=smooth,
            )
            found.fit(np.hstack([x, speed]), t=_STEP_S, u=u)
            zero = np.zeros((len(at), 2))
            states = np.column_stack([at, np.zeros(len(at))])
            still = found.predict(states, u=zero[:, :1])[:, 1]
            pushed = found.predict(zero, u=np.ones((len(at), 1)))[:, 1]
            # The acceleration per newton tells the mass.
            return np.asarray(still / (pushed - found.predict(zero, u=zero[:, :1])[:, 1]))

        times = timed(work)
        return Way("PySINDy", times, _off(times.result, truth), "on derivatives of measurements")

    ways.append(tried("PySINDy", "pysindy", sparse))
    return Comparison(
        "law",
        "The shape of a force that the model lacks, from one recording of 8 s",
        "fit",
        "rms error of the curve over its own rms, its mean left out",
        tuple(ways),
        "The workbench refits the model first and judges the curve on a second recording.",
    )


def observed_by(model: Model, seen: Observed) -> Observed:
    """Return a recording as a model without effects begins it."""
    keep = len(model.states)
    return replace(seen, start=seen.start[:keep], start_rms=seen.start_rms[:keep])


def _off(curve: Vector, truth: Vector) -> float:
    curve, truth = curve - curve.mean(), truth - truth.mean()
    return float(np.sqrt(np.mean((curve - truth) ** 2) / np.mean(truth**2)))


def filter_times(model: Model, free: int = 8) -> tuple[float, dict[str, float]]:
    """Time a sample of the filter, in s, and its parts: equations and the rest.

    Along made-up pulses at 500 Hz, with some free parameters.
    """
    t = 0.002 * np.arange(5000)
    pulses = 5.0 + 0.9 * np.where((t % 4.0) < 2.0, 1.0, -1.0)
    seen = made_up(model, pulses, sample_time=0.002)
    names = tuple(p.name for p in default_priors(model))[:free]
    runs = PredictionError(model, seen, names, disturbances(model, 0.1))
    steps = steps_along(model, seen)
    runs.run(seen, model.values)
    whole = min(timed(lambda: runs.run(seen, model.values), per=len(seen.outputs)).seconds)
    equations: Equations = runs._filter(0)._equations  # noqa: SLF001
    library = integrator_library()
    if library is None or not equations.compiled:
        return whole, {}
    states = np.tile(model.initial_state(), (len(seen.outputs), 1))
    inputs, values = np.ascontiguousarray(seen.inputs), model.values
    found = {}
    for i, (name, times) in enumerate(
        (
            ("slopes", steps.pieces),
            ("rates", 4 * steps.number - steps.pieces),
            ("measurements", 1),
            ("noise", 1),
        )
    ):
        function = equations.in_c(i)
        own = equations.functions[i]
        scratch = [np.zeros(own.numel_out(k)) for k in range(own.n_out())]
        places = (ctypes.c_void_p * own.n_out()).from_address(function.res)
        for k, array in enumerate(scratch):
            places[k] = address(array)
        if own.n_in() > 3:
            extra = np.zeros(own.numel_in(3))
            (ctypes.c_void_p * own.n_in()).from_address(function.arg)[3] = address(extra)
        table = np.zeros((len(states), own.numel_out(0)))
        sizes = states.shape[1], inputs.shape[1], table.shape[1]
        given = [address(array) for array in (states, inputs, values, table)]
        run = partial(library.evaluate, ctypes.byref(function), len(states), *sizes, *given)
        found[name] = times * min(timed(run, per=len(states)).seconds)
    return whole, found
