"""Baseline: sparse regression of what the refitted equations leave of the measured derivatives.

After Brunton, Proctor and Kutz (2016): smoothed derivatives of angle and pressures, less what the
refitted nominal equations say, are regressed on a library of terms by sequentially thresholded
least squares; the threshold is chosen by cross-validation over blocks of time. The dominant term of
an equation stands for an effect by a fixed table.

Units: all numbers are dimensionless.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.files import picked
from workbench.model import Model

Table = Mapping[str, tuple[str | None, Callable[[Any], Vector]]]
"""Terms of an equation: the effect that each stands for when it dominates, and what it is."""

JOINT: Table = {
    "1": ("constant_torque", lambda s: np.ones_like(s.q)),
    "cos q": ("tilt_gravity", lambda s: np.cos(s.q)),
    "q": ("linear_spring", lambda s: s.q),
    "q^2": ("force_shape", lambda s: s.q**2),
    "q^3": ("cubic_stiffness", lambda s: s.q**3),
    "sin 20 q": ("ripple", lambda s: np.sin(20 * s.q)),
    "cos 20 q": ("ripple", lambda s: np.cos(20 * s.q)),
    "w": ("direction_dependent_viscous", lambda s: s.w),
    "sign w": ("stribeck_friction", lambda s: s.sign_w),
    "w |w|": ("quadratic_drag", lambda s: s.w * np.abs(s.w)),
    "dw/dt": ("load_error", lambda s: s.dw),
    "p1": ("force_gain_1", lambda s: s.p1),
    "p2": ("force_gain_2", lambda s: s.p2),
    "p1 q": ("contraction_force_correction", lambda s: s.p1 * s.q),
    "p2 q": ("contraction_force_correction", lambda s: s.p2 * s.q),
    "p1 p2": ("pressure_force_correction", lambda s: s.p1 * s.p2),
    "p1^2": ("pressure_force_correction", lambda s: s.p1**2),
    "p2^2": ("pressure_force_correction", lambda s: s.p2**2),
    "(p1 + p2) sign w": ("load_dependent_friction", lambda s: (s.p1 + s.p2) * s.sign_w),
    "(p1 + p2) w": ("muscle_viscosity", lambda s: (s.p1 + s.p2) * s.w),
    "u": (None, lambda s: s.u),
}

CHAMBER: Table = {
    "1": ("edge_leakage_supply_{k}", lambda s: np.ones_like(s.q)),
    "p": ("chamber_leakage_{k}", lambda s: s.p),
    "p - other": ("cross_leakage", lambda s: s.p - s.other),
    "u": ("asymmetric_gain", lambda s: s.u),
    "u |u|": ("asymmetric_gain", lambda s: s.u * np.abs(s.u)),
    "u^2": ("valve_offset", lambda s: s.u**2),
    "|u|": ("valve_offset", lambda s: np.abs(s.u)),
    "sign u": ("dead_band", lambda s: s.sign_u),
    "p u": ("supply_droop", lambda s: s.p * s.u),
    "du/dt": ("valve_delay", lambda s: s.du),
    "w": ("polytropic_exchange", lambda s: s.w),
    "p w": ("polytropic_exchange", lambda s: s.p * s.w),
    "dp/dt": ("extra_heat_exchange", lambda s: s.dp),
    "d2p/dt2": ("sensor_lag_pressures", lambda s: s.d2p),
    "q": (None, lambda s: s.q),
}
"""The same for the equation of a chamber's pressure; ``{k}`` is the chamber."""

LEAST_R2 = 0.2
"""Share of the residual's variance that a sparse model must explain on blocks left out."""

_WINDOW, _ORDER, _EVERY, _FOLDS = 51, 3, 5, 5
_THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5)
_FROM_STOP = np.radians(1.5)
_SIGN_SPEED, _SIGN_VOLT = 0.02, 0.05


@dataclass(frozen=True)
class Sparse:
    """A sparse model of one equation's residual.

    Args:
        equation: ``joint``, ``chamber_1`` or ``chamber_2``.
        coefficients: Standardised coefficients by term, over the residual's spread.
        alone: Share of the residual's variance that each kept term explains by itself.
        r2: Share of the variance explained on blocks left out.
    """

    equation: str
    coefficients: dict[str, float]
    alone: dict[str, float]
    r2: float

    @property
    def dominant(self) -> str:
        """The kept term that explains the most by itself.

        Coefficients of terms that resemble each other say little.
        """
        return max(self.alone, key=lambda name: self.alone[name])


def sindy(model: Model, recordings: Sequence[Observed], share: float) -> list[dict[str, Any]]:
    """Name what is missing by sparse regression.

    Args:
        share: Share of the expected disturbance at which the model was refitted.

    Returns:
        Findings as a verdict has them, the best explained equation first.
    """
    parts = [_terms_and_residuals(model, observed, share) for observed in recordings]
    findings: list[dict[str, Any]] = []
    sparse = []
    for equation in ("joint", "chamber_1", "chamber_2"):
        terms, left = zip(*(part[equation] for part in parts), strict=True)
        joined = {t: np.concatenate([own[t] for own in terms]) for t in terms[0]}
        sparse.append(_regress(equation, joined, np.concatenate(left)))
    for one in sorted(sparse, key=lambda s: -s.r2):
        if one.r2 < LEAST_R2 or not one.coefficients:
            continue
        table = JOINT if one.equation == "joint" else CHAMBER
        name = (table[one.dominant][0] or "").format(k=one.equation[-1])
        if not name or name in [f["effect"] for f in findings]:
            continue
        told = {"effect": name, "where": [_port(one.equation, name)], "class": [name]}
        findings.append(told | picked(one, "terms=coefficients alone r2"))
    return findings


def _port(equation: str, effect: str) -> str:
    if equation == "joint":
        return "joint.torque"
    if effect.startswith("sensor"):
        return f"pressure_{equation[-1]}.reading"
    if effect.startswith("valve") or effect in ("asymmetric_gain", "dead_band"):
        return "valve.command"
    return "supply.pressure" if "supply_droop" in effect else f"{equation}.flow"


def _terms_and_residuals(
    model: Model, observed: Observed, share: float
) -> dict[str, tuple[dict[str, Vector], Vector]]:
    """Return terms and residual of each equation along a recording."""
    h = observed.sample_time
    read = {name: _filled(observed.outputs[:, i]) for i, name in enumerate(observed.used)}

    def smooth(x: Vector, order: int = 0) -> Vector:
        return np.asarray(savgol_filter(x, _WINDOW, _ORDER, deriv=order, delta=h))

    q, p1, p2 = (smooth(read[n]) for n in ("angle", "pressure_1", "pressure_2"))
    w, dw = smooth(read["angle"], 1), smooth(read["angle"], 2)
    rates = {"joint": dw, "chamber_1": smooth(read["pressure_1"], 1),
             "chamber_2": smooth(read["pressure_2"], 1)}  # fmt: skip
    command = observed.inputs[:, 0]
    predicted = _predicted(model, observed, share, q, w, p1, p2)
    hit = (q < _FROM_STOP) | (q > np.radians(60.0) - _FROM_STOP)
    # Smoothing spreads a contact over its window.
    away = np.convolve(hit, np.ones(2 * _WINDOW), mode="same") < 0.5
    kept, inside = np.zeros(len(q), dtype=bool), slice(_WINDOW, -_WINDOW, _EVERY)
    kept[inside] = away[inside]
    u = smooth(command) - 5.0
    seen = {
        "q": q, "w": w, "dw": dw, "u": u, "du": smooth(command, 1), "p1": p1 * 1e-5,
        "p2": p2 * 1e-5, "sign_w": smooth(np.tanh(w / _SIGN_SPEED)),
        "sign_u": smooth(np.tanh(u / _SIGN_VOLT)),
    }  # fmt: skip

    def left(of: Table, rate: str, state: str, **own: Vector) -> tuple[dict[str, Vector], Vector]:
        signals = SimpleNamespace(**seen, **own)
        terms = {name: term(signals)[kept] for name, (_, term) in of.items()}
        return terms, (rates[rate] - smooth(predicted[state]))[kept]

    result = {"joint": left(JOINT, "joint", "speed")}
    for k, other in ((1, 2), (2, 1)):
        result[f"chamber_{k}"] = left(
            CHAMBER, f"chamber_{k}", f"pressure_{k}", p=seen[f"p{k}"], other=seen[f"p{other}"],
            dp=rates[f"chamber_{k}"], d2p=smooth(read[f"pressure_{k}"], 2),
        )  # fmt: skip
    return result


def _filled(x: Vector) -> Vector:
    """Bridge measurements that were not taken."""
    known = np.isfinite(x)
    at = np.arange(len(x))
    return np.asarray(np.interp(at, at[known], x[known]))


def _predicted(
    model: Model, observed: Observed, share: float, q: Vector, w: Vector, p1: Vector, p2: Vector
) -> dict[str, Vector]:
    """Return what the equations say of the rates, the temperatures integrated along."""
    # Spool and temperatures are not read: the filter of the refitted model says what they were.
    x = filter_of(model, observed, share).run(observed, model.values).states.copy()
    at = {state.name: i for i, state in enumerate(model.states)}
    ambient = model.parameter("ambient_pressure").value
    read = (("pressure_1", p1 + ambient), ("pressure_2", p2 + ambient), ("angle", q), ("speed", w))
    for name, signal in read:
        x[:, at[name]] = signal
    rates = model.exact.along(x, observed.inputs, model.values, model.exact.rates)[0]
    return {name: rates[:, at[name], 0] for name in ("speed", "pressure_1", "pressure_2")}


def _regress(equation: str, terms: dict[str, Vector], y: Vector) -> Sparse:
    names = list(terms)
    columns = np.column_stack([terms[name] for name in names])
    scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-30
    spread = float(np.sqrt(np.mean(y**2))) + 1e-30
    a, b = columns / scale, y / spread
    folds = np.array_split(np.arange(len(b)), _FOLDS)
    errors = []
    for threshold in _THRESHOLDS:
        left = []
        for fold in folds:
            others = np.setdiff1d(np.arange(len(b)), fold)
            found = thresholded(a[others], b[others], threshold)
            left.append(float(np.mean((b[fold] - a[fold] @ found) ** 2)))
        errors.append((float(np.mean(left)), float(np.std(left) / np.sqrt(_FOLDS))))
    best = min(range(len(errors)), key=lambda i: errors[i][0])
    # The sparsest within one standard error of the best.
    chosen = max(i for i in range(len(errors)) if errors[i][0] <= sum(errors[best]))
    found = thresholded(a, b, _THRESHOLDS[chosen])
    sparse = {name: float(c) for name, c in zip(names, found, strict=True) if c != 0.0}
    alone = {
        name: float(np.mean(a[:, i] * b) ** 2) for i, name in enumerate(names) if name in sparse
    }
    return Sparse(equation, sparse, alone, 1.0 - errors[chosen][0])


def thresholded(a: Vector, b: Vector, threshold: float) -> Vector:
    """Solve least squares ``a x = b`` again and again without the terms of small coefficients.

    Coefficients, terms and threshold are dimensionless; those left out are zero.
    """
    kept = np.ones(a.shape[1], dtype=bool)
    found = np.zeros(a.shape[1])
    gram, right = a.T @ a + 1e-8 * len(b) * np.eye(a.shape[1]), a.T @ b
    for _ in range(12):
        found[:] = 0.0
        found[kept] = np.linalg.solve(gram[np.ix_(kept, kept)], right[kept])
        large = np.abs(found) >= threshold
        if not large.any() or np.array_equal(large, kept):
            found[~large] = 0.0
            break
        kept = large
    return found
