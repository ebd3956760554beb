"""Prediction errors of a model along a recording, with their derivatives.

An extended Kalman filter runs along the recording. Its innovations, divided by their own standard
deviations, are white if the model is right; their derivatives with respect to the parameters follow
from the sensitivity of the filtered state, with the filter gain held. One pass gives all that a
Gauss-Newton step and a score test need.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.errors import NumericalError, WorkbenchError, check_choice
from workbench.model import EXACT, Face, Model, Trace
from workbench.model.model import index_of
from workbench.simulation.compiled import compiled

Vector = npt.NDArray[np.float64]

OUTLIER_SIGMA = 5.0
"""Innovations beyond this many standard deviations are taken as outliers: their variance is
enlarged so that they count as this many."""

CORRELATION_TIME = 0.1
"""Time over which an unmodelled signal at a port is taken as correlated, s."""

_BLOCK = 20
"""Samples per call of the filter."""


@dataclass(frozen=True)
class Observed:
    """A recording in the shape that the filter needs.

    Args:
        name: Name of the recording.
        sample_time: Time between samples, in s.
        inputs: Inputs held from each sample to the next, shape (n, n_inputs), in SI.
        outputs: Readings, shape (n, n_used), in SI; NaN where there is none.
        used: Names of the model's outputs that were read, n_used of them.
        noise_rms: Root mean square of the readings' noise, shape (n_used,), in SI.
        start: Estimated states at the first sample, shape (n_states,), in SI.
        start_rms: Their uncertainty, shape (n_states,), in SI.

    Raises:
        WorkbenchError: If shapes do not agree.
    """

    name: str
    sample_time: float
    inputs: Vector
    outputs: Vector
    used: tuple[str, ...]
    noise_rms: Vector
    start: Vector
    start_rms: Vector

    def __post_init__(self) -> None:
        """Check the shapes."""
        if len(self.inputs) != len(self.outputs) or self.outputs.shape[1] != len(self.used):
            raise WorkbenchError(
                f"recording {self.name!r} has inputs of shape {self.inputs.shape} and outputs of"
                f" shape {self.outputs.shape} for {len(self.used)} outputs; the numbers of samples"
                " and of outputs must agree"
            )


@dataclass(frozen=True)
class Innovations:
    """Whitened prediction errors along a recording.

    Args:
        whitened: Prediction errors over their standard deviations, shape (n, n_used).
        jacobian: Their derivatives with respect to the scaled parameters, shape
            (n, n_used, n_free).
        log_deviation: Logarithm of the standard deviations, shape (n, n_used).
        states: Filtered states, shape (n, n_states), in SI.
    """

    whitened: Vector
    jacobian: Vector
    log_deviation: Vector
    states: Vector

    @property
    def cost(self) -> float:
        """Half the sum of squares plus the logarithms: minus the log likelihood."""
        used = np.isfinite(self.whitened)
        return float(0.5 * np.sum(self.whitened[used] ** 2) + np.sum(self.log_deviation[used]))


@dataclass
class PredictionError:
    """The filter of a model for a choice of free parameters.

    Args:
        model: The plant.
        sample_time: Time between samples, in s.
        used: Names of the outputs that were read.
        free: Names of the parameters whose derivatives are wanted.
        disturbances: Root mean square of an unmodelled signal at a port, by name of the port, in
            the port's unit; it is taken as correlated over `CORRELATION_TIME`.
        face: Exact or smooth equations.
        certain: Names of states that are simulated but not corrected by the filter. That is exact
            for the derivatives at size zero of effects that own these states: there no reading
            depends on them.

    Raises:
        WorkbenchError: If a name is unknown.
    """

    model: Model
    sample_time: float
    used: tuple[str, ...]
    free: tuple[str, ...]
    disturbances: Mapping[str, float] = field(default_factory=dict)
    face: Face = EXACT
    certain: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Look the names up and build the filter."""
        model = self.model
        self._rows = tuple(index_of("output", name, model.outputs) for name in self.used)
        self._columns = tuple(index_of("parameter", name, model.parameters) for name in self.free)
        self.state_scale = np.array([q.scale for q in model.states])
        self.free_scale = np.array([model.parameters[i].scale for i in self._columns])
        ports = [port.name for port in model.ports]
        self._pushed: dict[int, float] = {}
        for name, rms in self.disturbances.items():
            check_choice("port", name, ports)
            # White noise of the same power at low frequency as the correlated signal.
            self._pushed[ports.index(name)] = rms * np.sqrt(2 * CORRELATION_TIME * self.sample_time)
        self._relative = {
            i: port.relative_disturbance * np.sqrt(2 * CORRELATION_TIME * self.sample_time)
            for i, port in enumerate(model.ports)
            if port.relative_disturbance > 0
        }
        self._output_scale = np.array([model.outputs[i].scale for i in self._rows])
        self._substeps = _substeps(model, self.sample_time)
        certain = {index_of("state", name, model.states) for name in self.certain}
        self._corrected = tuple(i for i in range(len(model.states)) if i not in certain)
        self._functions: dict[int, ca.Function] = {}

    def run(self, observed: Observed, values: npt.ArrayLike) -> Innovations:
        """Run the filter along a recording.

        Args:
            observed: The recording.
            values: Parameter values, shape (n_parameters,), in SI.

        Returns:
            Innovations and their derivatives.

        Raises:
            NumericalError: If the filter leaves the finite numbers.
        """
        n, n_y = observed.outputs.shape
        n_x, n_f = len(self._corrected), len(self.free)
        p = np.asarray(values, dtype=float)
        read = observed.outputs / self._output_scale
        missing = ~np.isfinite(read)
        noise = (observed.noise_rms / self._output_scale) ** 2
        # A reading that is not there is one with a very large noise.
        variance = np.where(missing, 1e12, noise)
        read = np.where(missing, 0.0, read)
        z = observed.start / self.state_scale
        corrected = list(self._corrected)
        covariance = np.diag((observed.start_rms / self.state_scale)[corrected] ** 2)
        sensitivity = np.zeros((n_x, n_f))
        whitened, jacobian = np.empty((n, n_y)), np.empty((n, n_y, n_f))
        log_deviation, states = np.empty((n, n_y)), np.empty((n, len(z)))
        k = 0
        while k < n:
            size = _BLOCK if k + _BLOCK <= n else 1
            block = slice(k, k + size)
            result = self._function(size)(
                z,
                covariance,
                sensitivity,
                observed.inputs[block].T,
                read[block].T,
                variance[block].T,
                p,
            )
            ends, covariances, sensitivities, e, j, logs, filtered = (np.asarray(r) for r in result)
            z, covariance = ends[:, -1], covariances[:, -n_x:]
            sensitivity = sensitivities[:, sensitivities.shape[1] - n_f :]
            whitened[block], log_deviation[block] = e.T, logs.T
            jacobian[block] = j.reshape(n_y, size, n_f, order="C").transpose(1, 0, 2)
            states[block] = filtered.T * self.state_scale
            k += size
        whitened[missing], log_deviation[missing] = np.nan, np.nan
        jacobian[missing] = 0.0
        if not (np.isfinite(states).all() and np.isfinite(jacobian).all()):
            raise NumericalError(
                f"the filter of {self.model.name!r} left the finite numbers on"
                f" {observed.name!r}; the parameters are far from those of the recording"
            )
        return Innovations(whitened, jacobian, log_deviation, states)

    def _function(self, samples: int) -> ca.Function:
        if samples not in self._functions:
            self._functions[samples] = _filter(
                self.model.face(self.face),
                tuple(self.state_scale),
                tuple(self._output_scale),
                self._rows,
                self._columns,
                self._corrected,
                tuple(self.free_scale),
                tuple(self._pushed.items()),
                tuple(self._relative.items()),
                self.sample_time,
                self._substeps,
                samples,
            )
        return self._functions[samples]


def _substeps(model: Model, sample_time: float) -> int:
    """Choose Runge-Kutta steps per sample from the fastest mode at the starting state."""
    fastest = 0.0
    for face in ("exact", "smooth"):
        jacobian = model.face(face).jacobian_function(
            model.initial_state(), model.nominal_input, model.values
        )[0]
        matrix = np.nan_to_num(np.asarray(jacobian, dtype=float))
        fastest = max(fastest, float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0)))
    # Half the stability limit of the classical method, and 1 ms at most for contacts, which the
    # starting state does not show.
    return int(np.clip(np.ceil(sample_time * max(fastest / 1.3, 1000.0)), 1, 50))


@lru_cache(maxsize=32)
def _filter(
    traced: Trace,
    state_scale: tuple[float, ...],
    output_scale: tuple[float, ...],
    rows: tuple[int, ...],
    columns: tuple[int, ...],
    corrected: tuple[int, ...],
    free_scale: tuple[float, ...],
    pushed: tuple[tuple[int, float], ...],
    relative: tuple[tuple[int, float], ...],
    sample_time: float,
    substeps: int,
    samples: int,
) -> ca.Function:
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
    process = _process_noise(traced, z, sx, dict(pushed), dict(relative))
    noise = ca.Function("noise", [z, u, p], [process[kept, kept]])
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
    ]
    result = step(*block[:6], ca.repmat(block[6], 1, samples))
    return compiled(ca.Function("filter", block, list(result)))


def _process_noise(
    traced: Trace,
    z: ca.SX,
    scale: Vector,
    pushed: Mapping[int, float],
    relative: Mapping[int, float],
) -> ca.SX:
    """Covariance that the disturbances at the ports add in one sample."""
    ports = sorted({*pushed, *relative})
    if not ports:
        return ca.SX.zeros(len(scale), len(scale))
    sizes = []
    for i in ports:
        signal = traced.signals[traced.signal_names.index(traced.ports[i].name)]
        sizes.append(ca.sqrt(pushed.get(i, 0.0) ** 2 + (relative.get(i, 0.0) * signal) ** 2))
    slope = ca.mtimes(traced.rates_by_port[:, ports], ca.diag(ca.vcat(sizes)))
    slope = ca.substitute(slope, traced.x, z * scale) / scale
    return ca.densify(ca.mtimes(slope, slope.T))


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
    sample_time: float,
    substeps: int,
) -> ca.Function:
    z0, covariance0 = ca.MX.sym("z", n_x), ca.MX.sym("P", len(kept), len(kept))
    sensitivity0 = ca.MX.sym("G", len(kept), n_f)
    u, y, r = ca.MX.sym("u", n_u), ca.MX.sym("y", n_y), ca.MX.sym("r", n_y)
    p = ca.MX.sym("p", n_p)
    predicted, by_state, by_free = read(z0, u, p)
    moved, covariance, sensitivity = ca.MX.zeros(len(kept)), covariance0, sensitivity0
    whitened, rows, logs = [], [], []
    for i in range(n_y):
        h = by_state[i, :]
        error = y[i] - predicted[i] - ca.mtimes(h, moved)
        gain = ca.mtimes(covariance, h.T)
        variance = ca.mtimes(h, gain) + r[i]
        # An outlier counts as OUTLIER_SIGMA and corrects the state no more than that.
        variance = ca.fmax(variance, (error / OUTLIER_SIGMA) ** 2)
        row = -(ca.mtimes(h, sensitivity) + by_free[i, :])
        deviation = ca.sqrt(variance)
        whitened.append(error / deviation)
        rows.append(row / deviation)
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
        middle = z + 0.5 * h * rate(z, u, p)
        a, b = slope(middle, u, p)
        k1 = rate(z, u, p)
        k2 = rate(middle, u, p)
        k3 = rate(z + 0.5 * h * k2, u, p)
        k4 = rate(z + h * k3, u, p)
        z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        ha = h * a
        half = identity + 0.5 * ca.mtimes(ha, identity + ha / 3)
        transition = identity + ca.mtimes(ha, half)
        sensitivity = ca.mtimes(transition, sensitivity) + h * ca.mtimes(half, b)
        covariance = ca.mtimes(ca.mtimes(transition, covariance), transition.T)
    covariance = 0.5 * (covariance + covariance.T) + noise(filtered, u, p)
    return ca.Function(
        "sample",
        [z0, covariance0, sensitivity0, u, y, r, p],
        [
            z,
            covariance,
            sensitivity,
            ca.vcat(whitened),
            ca.vcat(rows),
            ca.vcat(logs),
            filtered,
        ],
    )


def stack(parts: Sequence[Innovations]) -> tuple[Vector, Vector]:
    """Stack the innovations of several recordings for least squares.

    Args:
        parts: Innovations of each recording.

    Returns:
        Whitened errors, shape (m,), and their derivatives, shape (m, n_free); samples without a
        reading are left out.

    Example:
        >>> one = Innovations(np.ones((2, 1)), np.ones((2, 1, 3)), np.zeros((2, 1)), np.ones((2, 1)))
        >>> [array.shape for array in stack([one, one])]
        [(4,), (4, 3)]
    """
    errors = np.concatenate([part.whitened.ravel() for part in parts])
    rows = np.concatenate([part.jacobian.reshape(errors_of(part), -1) for part in parts])
    used = np.isfinite(errors)
    return errors[used], rows[used]


def errors_of(part: Innovations) -> int:
    """Return how many prediction errors a recording has, samples times outputs.

    Args:
        part: Innovations of a recording.

    Example:
        >>> errors_of(
        ...     Innovations(np.ones((2, 3)), np.ones((2, 3, 1)), np.ones((2, 3)), np.ones((2, 1)))
        ... )
        6
    """
    return int(part.whitened.size)
