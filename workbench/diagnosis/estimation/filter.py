"""The filter as machine code: one sample of an extended Kalman filter with sensitivities.

Explicit Runge-Kutta steps carry the state, the exponential of the linearised equations its
covariance and its derivatives with respect to the free parameters.
"""

from __future__ import annotations

import time
from functools import lru_cache

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.model import Model, Trace
from workbench.simulation.compiled import compiled

Vector = npt.NDArray[np.float64]

OUTLIER_SIGMA = 5.0
"""Innovations beyond this many standard deviations are taken as outliers: their variance is
enlarged so that they count as this many."""


class FilterCall:
    """A function called on its own memory, without converting arguments and results."""

    def __init__(self, function: ca.Function) -> None:
        """Set the memory aside."""
        self._buffer, self._call = function.buffer()
        # CasADi stores matrices by columns.
        self.arguments = [np.zeros(function.size_in(i), order="F") for i in range(function.n_in())]
        self.results = [np.zeros(function.size_out(i), order="F") for i in range(function.n_out())]
        for i, array in enumerate(self.arguments):
            self._buffer.set_arg(i, array.reshape(-1, order="F").data)
        for i, array in enumerate(self.results):
            self._buffer.set_res(i, array.reshape(-1, order="F").data)

    def __call__(self, *values: npt.ArrayLike) -> list[Vector]:
        """Return the results, in memory that the next call overwrites.

        Args:
            values: The arguments of the function, in its units.
        """
        for array, value in zip(self.arguments, values, strict=True):
            array[...] = value
        self._call()
        return self.results


_STEPS, _SHORTEST_S = 10, 0.7e-3
"""Runge-Kutta steps that a sample gets at least, as long as they are not shorter than this, in s:
contacts are stiffer than the states that are looked at show."""

_LATE = 3e-4
"""Angle by which a swinging mode may be late, in rad."""

_FORGOTTEN = 1e-3
"""Part of a mode that fades in one sample at least: what is older than a thousand samples is
corrected by the measurements."""

_LOOKS = 20
"""Random states at which the fastest mode is looked for, beside the starting state."""


_FADED = 1e-50
"""Covariance and sensitivity, relative to the scales, that are none any more."""

WORTH_S = 10.0
"""Time in quickly built code, in s, after which code that runs twice as fast has paid for the
longer wait for it."""


class Filter:
    """A filter over blocks of samples, built soon at first and to run fast when much is asked."""

    def __init__(self, function: ca.Function) -> None:
        """Build it to be there soon."""
        self._function, self._spent = function, 0.0
        self._call = FilterCall(compiled(function, quick=True))

    def __call__(self, *values: npt.ArrayLike) -> list[Vector]:
        """Return the results, in memory that the next call overwrites.

        Args:
            values: The arguments of the function, in its units.
        """
        if 0.0 <= self._spent < WORTH_S:
            began = time.perf_counter()
            results = self._call(*values)
            self._spent += time.perf_counter() - began
            return results
        if self._spent >= WORTH_S:
            self._call, self._spent = FilterCall(compiled(self._function)), -1.0
        return self._call(*values)


def substeps_of(model: Model, sample_time: float) -> int:
    """Choose Runge-Kutta steps per sample from the fastest mode at states within their scales.

    Args:
        sample_time: Time between samples, in s.
    """
    rng = np.random.default_rng(0)
    start = model.initial_state()
    scale = np.array([q.scale for q in model.states])
    looks = [start, *(start + rng.uniform(-1.0, 1.0, (_LOOKS, len(start))) * scale)]
    within = [q.lower for q in model.states], [q.upper for q in model.states]
    fastest = late = 0.0
    for form in ("exact", "regularised"):
        function = model.form(form).jacobian_function
        for x in looks:
            slopes = function(np.clip(x, *within), model.nominal_input, model.values)[0]
            modes = np.linalg.eigvals(np.nan_to_num(np.asarray(slopes, dtype=float))) * sample_time
            fastest = max(fastest, float(np.abs(modes).max(initial=0.0)))
            # A step of angle w is late by w^5 / 120, summed up for as long as the mode remembers.
            turned, faded = np.abs(modes.imag), np.maximum(np.abs(modes.real), _FORGOTTEN)
            late = max(late, float((turned**5 / (120.0 * faded)).max(initial=0.0)))
    # Half the stability limit of the classical method.
    asked = max(fastest / 1.3, (late / _LATE) ** 0.25, min(_STEPS, sample_time / _SHORTEST_S))
    return int(np.clip(np.ceil(round(asked, 6)), 1, 50))


@lru_cache(maxsize=32)
def filter_function(
    traced: Trace,
    state_scale: tuple[float, ...],
    output_scale: tuple[float, ...],
    rows: tuple[int, ...],
    columns: tuple[int, ...],
    corrected: tuple[int, ...],
    free_scale: tuple[float, ...],
    ports: tuple[int, ...],
    sample_time: float,
    substeps: int,
    samples: int,
) -> Filter:
    """Build the filter over a block of samples.

    The states are divided by their scales and called z, P is their covariance, G their derivatives
    with respect to the free parameters, each divided by its scale too.

    Args:
        state_scale: Scale of each state, in its SI unit.
        output_scale: Scale of each measurement used, in its SI unit.
        rows: Places of those measurements among the model's outputs.
        corrected: Places of the states that measurements correct.
        free_scale: Scale of each free parameter, in its SI unit.
        ports: Places of the ports at which an unmodelled signal may act.
        sample_time: Time between samples, in s.
        substeps: Runge-Kutta steps per sample.
        samples: Samples per call.

    Returns:
        Function of z, P, G, the inputs, measurements and variances of the measurements, sample by
        sample,
        the parameters, and the variance that one sample adds to the signal of each port: a part
        that is constant and a part relative to its square, shape (n_ports, 2). It returns z, P and
        G after each sample, whitened errors, their derivatives, the logarithms of their standard
        deviations and the filtered z.
    """
    sx, sy, sp = np.array(state_scale), np.array(output_scale), np.array(free_scale)
    z, u, p = ca.SX.sym("z", len(sx)), traced.u, traced.p
    rates = ca.substitute(traced.rates, traced.x, z * sx) / sx
    reads = ca.substitute(traced.outputs[list(rows)], traced.x, z * sx) / sy
    free = p[list(columns)] if columns else ca.SX(0, 1)
    kept = list(corrected)

    def by_parameters(expression: ca.SX) -> ca.SX:
        if not columns:
            return ca.SX(expression.numel(), 0)
        return ca.mtimes(ca.jacobian(expression, free), ca.diag(ca.SX(sp)))

    rate = ca.Function("rate", [z, u, p], [rates], {"cse": True})
    slope = ca.Function(
        "slope",
        [z, u, p],
        [
            ca.densify(ca.jacobian(rates[kept], z)[:, kept]),
            ca.densify(by_parameters(rates[kept])),
        ],
        {"cse": True},
    )
    read = ca.Function(
        "read",
        [z, u, p],
        [reads, ca.densify(ca.jacobian(reads, z)[:, kept]), ca.densify(by_parameters(reads))],
        {"cse": True},
    )
    d = ca.SX.sym("d", len(ports), 2)
    process = _process_noise(traced, z, sx, ports, d)
    noise = ca.Function("noise", [z, u, p, d], [process[kept, kept]])
    step = _sample(
        rate,
        slope,
        read,
        noise,
        kept,
        len(sx),
        u.numel(),
        p.numel(),
        len(sy),
        len(sp),
        len(ports),
        sample_time,
        substeps,
    )
    if samples > 1:
        step = step.mapaccum("samples", samples, 3)
    block = [
        ca.MX.sym("z", len(sx)),
        ca.MX.sym("P", len(kept), len(kept)),
        ca.MX.sym("G", len(kept), len(sp)),
        ca.MX.sym("u", u.numel(), samples),
        ca.MX.sym("y", len(sy), samples),
        ca.MX.sym("r", len(sy), samples),
        ca.MX.sym("p", p.numel()),
        ca.MX.sym("d", len(ports), 2),
    ]
    result = step(*block[:6], *(ca.repmat(constant, 1, samples) for constant in block[6:]))
    return Filter(ca.Function("filter", block, list(result)))


def _process_noise(
    traced: Trace, z: ca.SX, scale: Vector, ports: tuple[int, ...], d: ca.SX
) -> ca.SX:
    """Covariance that the unmodelled signals at the ports add in one sample."""
    if not ports:
        return ca.SX.zeros(len(scale), len(scale))
    names = [traced.signal_names.index(traced.ports[i].name) for i in ports]
    variances = d[:, 0] + d[:, 1] * traced.signals[names] ** 2
    slope = traced.rates_by_port[:, list(ports)]
    covariance = ca.mtimes(ca.mtimes(slope, ca.diag(variances)), slope.T)
    covariance = ca.substitute(covariance, traced.x, z * scale)
    return ca.densify(covariance / ca.mtimes(ca.SX(scale), ca.SX(scale).T))


def _flushed(matrix: ca.MX) -> ca.MX:
    """Put zero for what has faded out: numbers below the normal range are slow to multiply."""
    return matrix * (ca.fabs(matrix) > _FADED)


def _sample(
    rate: ca.Function,
    slope: ca.Function,
    read: ca.Function,
    noise: ca.Function,
    kept: list[int],
    n_x: int,
    n_u: int,
    n_p: int,
    n_y: int,
    n_f: int,
    n_d: int,
    sample_time: float,
    substeps: int,
) -> ca.Function:
    z0, covariance0 = ca.MX.sym("z", n_x), ca.MX.sym("P", len(kept), len(kept))
    sensitivity0 = ca.MX.sym("G", len(kept), n_f)
    u, y, r = ca.MX.sym("u", n_u), ca.MX.sym("y", n_y), ca.MX.sym("r", n_y)
    p, d = ca.MX.sym("p", n_p), ca.MX.sym("d", n_d, 2)
    predicted, by_state, by_free = read(z0, u, p)
    moved, covariance, sensitivity = ca.MX.zeros(len(kept)), covariance0, sensitivity0
    whitened, rows, logs = [], [], []
    for i in range(n_y):
        h = by_state[i, :]
        error = y[i] - predicted[i] - ca.mtimes(h, moved)
        gain = ca.mtimes(covariance, h.T)
        variance = ca.mtimes(h, gain) + r[i]
        # An outlier counts as OUTLIER_SIGMA and corrects the state no more than that.
        largest = OUTLIER_SIGMA**2 * variance
        outlier = error**2 > largest
        variance = ca.if_else(outlier, error**2 / OUTLIER_SIGMA**2, variance)
        # Its cost grows with the logarithm of the error only, so it pulls that much less: one
        # impact on a stop must not decide on the parameters.
        pull = ca.if_else(outlier, 1 / OUTLIER_SIGMA**2, 1.0)
        row = -(ca.mtimes(h, sensitivity) + by_free[i, :])
        deviation = ca.sqrt(variance)
        whitened.append(error / deviation)
        rows.append(pull * row / deviation)
        logs.append(ca.log(deviation))
        moved = moved + gain * (error / variance)
        sensitivity = sensitivity + ca.mtimes(gain / variance, row)
        covariance = covariance - ca.mtimes(gain, gain.T) / variance
    # Rows of the unit matrix put the correction on the states that are corrected.
    filtered = z0 + ca.mtimes(ca.DM.eye(n_x)[:, kept], moved)
    z = filtered
    h = sample_time / substeps
    identity = ca.DM.eye(len(kept))
    for _ in range(substeps):
        k1 = rate(z, u, p)
        middle = z + 0.5 * h * k1
        a, b = slope(middle, u, p)
        k2 = rate(middle, u, p)
        k3 = rate(z + 0.5 * h * k2, u, p)
        k4 = rate(z + h * k3, u, p)
        z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        ha = h * a
        half = identity + 0.5 * ca.mtimes(ha, identity + ha / 3)
        transition = identity + ca.mtimes(ha, half)
        sensitivity = ca.mtimes(transition, sensitivity) + h * ca.mtimes(half, b)
        covariance = ca.mtimes(ca.mtimes(transition, covariance), transition.T)
    covariance = _flushed(0.5 * (covariance + covariance.T)) + noise(filtered, u, p, d)
    return ca.Function(
        "sample",
        [z0, covariance0, sensitivity0, u, y, r, p, d],
        [
            z,
            covariance,
            _flushed(sensitivity),
            ca.vcat(whitened),
            ca.vcat(rows),
            ca.vcat(logs),
            filtered,
        ],
    )
