"""An extended Kalman filter with sensitivities along a recording.

The exponential of the linearised equations carries the state, its covariance and its derivatives
with respect to the free parameters, however fast a lag is beside the sampling interval; what is
not linear is added. Where that is no parabola over time, such as dry friction at a reversal or a
contact that is met, a sample is halved, and its smallest parts are gone along in Runge-Kutta steps.
`filter.c` does the same as machine code; `_sample_of` is the version to read, and the one that runs
without a C compiler.
"""

from __future__ import annotations

import ctypes
import functools
import math
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.computing.buffered import Buffered
from workbench.computing.counted import count
from workbench.model import Model, Trace
from workbench.model.sizes import BEYOND
from workbench.simulation.equations import CFunction, Equations, address, in_c

OUTLIER_SIGMA = 5.0
"""Innovations beyond this many standard deviations are taken as outliers: their variance is
enlarged so that they count as this many."""


_STEPS, _FINER = 3, 8
"""Runge-Kutta steps that a sample gets at least of equations that bend, and parts of such a step
along which something bends: contacts are stiffer than the states that are looked at show. In three
steps of 0.7 ms without parts a stop's damping came out 3 % wrong, and with it all torques 1.5 %."""

MOST_STEPS = 50
"""Runge-Kutta steps that a sample gets at the most."""

_HALVINGS = 3
"""How often a sample is halved at the least before Runge-Kutta steps carry its parts."""

_LATE = 3e-4
"""Angle by which a swinging mode may be late, in rad."""

_FORGOTTEN = 1e-3
"""Part of a mode that fades in one sample at least: what is older than a thousand samples is
corrected by the measurements."""

_FADED = 1e-50
"""Covariance and sensitivity, relative to the scales, that are none any more."""

_LITTLE, _DOUBLINGS = 1.0, 40
"""Size of a matrix of which Taylor's polynomial of sixth order is the exponential, and how often a
part like that is doubled at the most."""

_ALIKE = 1e-6
"""Size of what slopes differ from those kept, up to which the exponential of these serves on: those
of a linear plant never change."""

_LITTLE_BENT, _MUCH_BENT, _CURVED, _NOTHING = 3e-3, 0.01, 0.03, 1e-8
"""What rates may differ from a parabola in an exponential step, what a method of third order may
add to a Runge-Kutta step that is not taken in parts, and what rates may differ from the slopes
kept, as a fraction of what the states move; and what counts as nothing, of their scales."""

_STIFF, _DEEPER = 1.0, 8
"""Fastest mode times the finest Runge-Kutta step, beyond which a part that bends is halved once
more, and how often at the most. The method is stable up to 2.8, and what bends is faster beside
where its slopes were taken: flow through an opening is a root, whose slope near zero no start
shows."""

_TRIED, _ONCE = 5, 3
"""Evaluations of the equations in a Runge-Kutta step, with the one that looks for bends, and in an
exponential one."""

_NUMBERS = {
    "faded": _FADED, "little": _LITTLE, "alike": _ALIKE, "little_bent": _LITTLE_BENT,
    "much_bent": _MUCH_BENT, "curved": _CURVED, "nothing": _NOTHING, "stiff": _STIFF,
}  # fmt: skip
"""What `filter.c` is told of the numbers above."""


class Steps(NamedTuple):
    """How a filter goes through the time between two samples.

    Args:
        halvings: How often it is halved where one exponential step bends.
        number: Runge-Kutta steps in a sample that bends all the same, each in parts if it bends.
    """

    halvings: int
    number: int

    @property
    def each(self) -> int:
        """Runge-Kutta steps in the smallest part."""
        return math.ceil(self.number / (1 << self.halvings))


def steps_of(model: Model, sample_time: float, states: Vector, inputs: Vector) -> Steps:
    """Choose halvings and Runge-Kutta steps of a sample from the fastest mode at some states.

    Args:
        sample_time: Time between samples, in s.
        states: Where to look, at rest first, shape (n, n_states), in SI.
        inputs: The inputs there, shape (n, n_inputs), in SI.
    """
    gentle = model.exact.gentle
    # What rubs is stiff at rest. Elsewhere a rounded corner is passed in no time: where it bends, a
    # step is taken in parts.
    each = []
    for form, n in (("exact", len(states)), ("regularised", 1)):
        function = model.form(form).jacobian_function
        slopes = np.asarray(function(states[:n].T, inputs[:n].T, model.values)[0], dtype=float)
        each += np.split(slopes, n, axis=1)
    modes = np.linalg.eigvals(np.where(np.abs(each) < BEYOND, each, 0.0)) * sample_time
    fastest = np.abs(modes).max(axis=1, initial=0.0)
    # A step of angle w is late by w^5 / 120, summed up for as long as the mode remembers.
    turned, faded = np.abs(modes.imag), np.maximum(np.abs(modes.real), _FORGOTTEN)
    late = (turned**5 / (120.0 * faded)).max(axis=1, initial=0.0)
    # Half the stability limit of the classical method, a quarter where nothing else asks for more.
    stable = fastest / (0.65 if gentle else 1.3)
    bends = 0.0 if gentle else _STEPS
    asked = np.maximum(stable, (late / _LATE) ** 0.25)
    halvings = max(_HALVINGS, math.ceil(math.log2(_whole(stable.max()))))
    return Steps(halvings, _whole(max(asked.max(), bends)))


def _whole(steps: float) -> int:
    return int(np.clip(np.ceil(round(float(steps), 6)), 1, MOST_STEPS))


End = tuple[Vector, Vector]
"""State, in SI, and its covariance over the scales, with which a filter goes on."""


class Innovations(NamedTuple):
    """Whitened prediction errors along a recording.

    Args:
        whitened: Prediction errors over their standard deviations, shape (n, n_used); NaN where
            there was no measurement.
        jacobian: Their derivatives by the scaled parameters, shape (n, n_used, n_free).
        log_deviation: Logarithm of the standard deviations, shape (n, n_used).
        states: Filtered states, shape (n, n_states), in SI.
        end: State and covariance that the filter expects after the last sample, those of coloured
            noise among them, to go on from.
    """

    whitened: Vector
    jacobian: Vector
    log_deviation: Vector
    states: Vector
    end: End

    @property
    def cost(self) -> float:
        """Half the sum of squares plus the logarithms: minus the log likelihood, dimensionless."""
        used = np.isfinite(self.whitened)
        return float(0.5 * np.sum(self.whitened[used] ** 2) + np.sum(self.log_deviation[used]))


def is_outlier(whitened: Vector) -> npt.NDArray[np.bool_]:
    """Tell which whitened errors are those of outliers, which count as `OUTLIER_SIGMA`."""
    return np.asarray(np.abs(whitened) > (1.0 - 1e-9) * OUTLIER_SIGMA)


class _Struct(ctypes.Structure):
    _fields_ = [
        *((name, CFunction) for name in ("slope", "rates", "read", "noise")),
        *((n, ctypes.c_int64) for n in ("states", "inputs", "measurements", "corrected", "free")),
        *((name, ctypes.c_int64) for name in ("halvings", "steps", "finer", "deeper")),
        *((name, ctypes.c_void_p) for name in ("places", "scale")),
        *((name, ctypes.c_double) for name in ("sample_time", "outlier", *_NUMBERS)),
        *((name, ctypes.c_int64) for name in ("most_doublings", "tries", "bent", "kinks")),
        ("work", ctypes.c_void_p),
    ]


@functools.cache
def _library() -> ctypes.CDLL | None:
    library = in_c(Path(__file__).with_name("filter.c"))
    if library is not None:
        library.filter.restype = ctypes.c_int64
        library.filter.argtypes = [ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 12]
    return library


class Asked(NamedTuple):
    """What a filter is built for.

    Args:
        state_scale: Scale of each state, shape (n_states,), in SI.
        output_scale: Scale of each measurement used, in its SI unit.
        rows: Places of those measurements among the model's outputs.
        free_scale: Scale of each free parameter, in its SI unit.
        ports: Places of the ports at which an unmodelled signal may act.
        coloured: Noise of measurements that is correlated: the place among ``rows``, its root mean
            square over the output's scale, and the time of its correlation, in s, of each. It is a
            state of the filter behind those of the plant.
        misread: Places of the inputs whose noise moves the model, but not the machine.
        absent: Places of the parameters that are zero, whatever the filter is told.
    """

    traced: Trace
    state_scale: tuple[float, ...]
    output_scale: tuple[float, ...]
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    corrected: tuple[int, ...]
    free_scale: tuple[float, ...]
    ports: tuple[int, ...]
    coloured: tuple[tuple[int, float, float], ...] = ()
    misread: tuple[int, ...] = ()
    absent: tuple[int, ...] = ()


class Filter:
    """The filter of a model's equations.

    Args:
        sample_time: Time between samples, in s.
    """

    def __init__(self, asked: Asked, sample_time: float, steps: Steps) -> None:
        self._equations = Equations(_functions(asked, sample_time))
        own, plant = len(asked.coloured), len(asked.state_scale)
        self._scale = np.array([*asked.state_scale, *[1.0] * own])
        self._kept = np.array([*asked.corrected, *range(plant, plant + own)], dtype=np.int64)
        self._sample_time, self._steps = sample_time, steps
        self._coloured = np.array([rms for _, rms, _ in asked.coloured])
        self._struct: _Struct | None = None
        library = _library() if self._equations.compiled else None
        if library is not None:
            self._in_c = library.filter
            n_x, n = plant + own, len(self._kept)
            n_y, n_f = len(asked.rows), len(asked.columns)
            size = 7 * n_x + n_y * (1 + n + n_f) + 11 * n + n_f + 12 * n * n + 2 * n * n_f
            self._work = np.zeros(max(1, size))
            functions = (self._equations.in_c(i) for i in range(4))
            sizes = n_x, asked.traced.u.numel(), n_y, n, n_f
            ways = steps.halvings, steps.each, _FINER, _DEEPER
            at, work = (self._kept.ctypes.data, address(self._scale)), address(self._work)
            numbers = (sample_time, OUTLIER_SIGMA, *_NUMBERS.values())
            self._struct = _Struct(*functions, *sizes, *ways, *at, *numbers, _DOUBLINGS, work=work)

    def run(
        self,
        x: npt.ArrayLike,
        covariance: npt.ArrayLike,
        u: npt.ArrayLike,
        y: npt.ArrayLike,
        r: npt.ArrayLike,
        p: npt.ArrayLike,
        d: npt.ArrayLike,
    ) -> tuple[int, Innovations]:
        """Run along a recording.

        It returns the samples before the states left the finite numbers; the rows after them are
        not to be used.

        Args:
            x: States at the first sample, shape (n_states,), in SI.
            covariance: Their covariance over the scales (dimensionless), shape (n_corrected,
                n_corrected). Both may be those of an ``end``.
            u: Inputs held from each sample on, shape (n, n_inputs), in SI.
            y: Measurements over their scales (dimensionless), shape (n, n_used); NaN where there
                is none.
            r: Variances of their noise over the scales squared (dimensionless), shape
                (n, n_used).
            p: Parameters, shape (n_parameters,), in SI.
            d: Variance that one sample adds to the signal of each port, and to each input that is
                misread: a part that is constant and a part relative to its square, shape
                (n_ports + n_misread, 2), in their SI units.
        """
        # Copies: they are overwritten.
        x, covariance = np.array(x, dtype=float), np.array(covariance, dtype=float)
        plant = len(self._scale) - len(self._coloured)
        if len(x) == plant:
            x = np.concatenate([x, np.zeros(len(self._coloured))])
            grown = np.diag(np.concatenate([np.zeros(len(covariance)), self._coloured**2]))
            grown[: len(covariance), : len(covariance)] = covariance
            covariance = grown
        u, y, r, p = (np.ascontiguousarray(v, dtype=float) for v in (u, y, r, p))
        d = np.asarray(d, dtype=float).reshape(-1, 2)
        n, n_y = y.shape
        n_f = self._equations.functions[0].size1_out(2)
        covariance, sensitivity = (
            _with_room(a) for a in (covariance, np.zeros((len(self._kept), n_f)))
        )
        found = Innovations(
            np.full((n, n_y), np.nan),
            np.zeros((n, n_y, sensitivity.shape[1])),
            np.full((n, n_y), np.nan),
            np.full((n, len(x)), np.nan),
            (x, covariance),
        )
        if self._struct is None:
            done = self._interpreted(x, covariance, sensitivity, u, y, r, p, d, found)
            tries, bent, kinks = done, 0, 0
        else:
            # CasADi takes matrices by columns.
            d = np.ascontiguousarray(d.T)
            arrays = (x, covariance, sensitivity, u, y, r, p, d, *found[:4])
            places = (address(array) for array in arrays)
            for name in ("tries", "bent", "kinks"):
                setattr(self._struct, name, 0)
            done = int(self._in_c(ctypes.byref(self._struct), n, *places))
            tries, bent, kinks = (getattr(self._struct, k) for k in ("tries", "bent", "kinks"))
        count("filtered_samples", done)
        # Measurements and process noise once, the equations in each step.
        carried = _ONCE * tries + _TRIED * self._steps.each * bent + 4 * _FINER * kinks
        count("model_evaluations", 2 * done + carried)
        states = np.ascontiguousarray(found.states[:, :plant])
        return done, found._replace(states=states)

    def _interpreted(
        self, x: Vector, P: Vector, G: Vector, u: Vector, y: Vector, r: Vector, p: Vector,
        d: Vector, found: Innovations,
    ) -> int:  # fmt: skip
        """Filter sample by sample in CasADi's own interpreter; returns the samples done."""
        missing = np.isnan(y)
        # A measurement that is not there is one with a very large noise.
        variance, measured = np.where(missing, 1e12, r), np.where(missing, 0.0, y)
        slopes = np.zeros_like(P)
        for t, inputs in enumerate(u):
            now = inputs, measured[t], variance[t], p, d
            told = self._sample(x, P, G, slopes, float(t == 0), *now, self._scale)
            places = x, P, G, slopes, *(table[t] for table in found[:4])
            for into, values in zip(places, told, strict=True):
                into[:] = values.reshape(into.shape)
            if not np.isfinite(x).all():
                return t + 1
        found.whitened[missing], found.log_deviation[missing] = np.nan, np.nan
        found.jacobian[missing] = 0.0
        return len(u)

    @functools.cached_property
    def _sample(self) -> Buffered:
        functions = self._equations.functions
        kept = tuple(self._kept.tolist())
        return Buffered(_sample_of(functions, kept, self._sample_time, self._steps))


@functools.lru_cache(maxsize=32)
def _sample_of(
    functions: tuple[ca.Function, ...], kept: tuple[int, ...], sample_time: float, steps: Steps
) -> ca.Function:
    """Build the filter over a sample from its four functions; the reading version."""
    slope, rates, read, noise = functions
    n_x, n_u, n_p = (slope.size1_in(i) for i in range(3))
    n, n_y, n_f = len(kept), read.size1_out(0), slope.size1_out(2)
    x0, u, p = ca.MX.sym("x", n_x), ca.MX.sym("u", n_u), ca.MX.sym("p", n_p)
    covariance0, sensitivity0 = ca.MX.sym("P", n, n), ca.MX.sym("G", n, n_f)
    slopes0, first = ca.MX.sym("A", n, n), ca.MX.sym("first")
    y, r, d = ca.MX.sym("y", n_y), ca.MX.sym("r", n_y), ca.MX.sym("d", *noise.size_in(3))
    scale = ca.MX.sym("scale", n_x)
    predicted, by_state, by_free = read(x0, u, p)
    moved, covariance, sensitivity = ca.MX.zeros(n), covariance0, sensitivity0
    whitened, rows, logs = [], [], []
    for i in range(n_y):
        h = by_state[:, i].T
        error = y[i] - predicted[i] - ca.mtimes(h, moved)
        gain = ca.mtimes(covariance, h.T)
        variance = ca.mtimes(h, gain) + r[i]
        # An outlier counts as OUTLIER_SIGMA and corrects the state no more than that.
        outlier = error**2 > OUTLIER_SIGMA**2 * variance
        variance = ca.if_else(outlier, error**2 / OUTLIER_SIGMA**2, variance)
        # Its cost grows with the logarithm of the error only, so it pulls that much less: one
        # impact on a stop must not decide on the parameters.
        pull = ca.if_else(outlier, 1 / OUTLIER_SIGMA**2, 1.0)
        row = -(ca.mtimes(h, sensitivity) + by_free[:, i].T)
        deviation = ca.sqrt(variance)
        whitened.append(error / deviation)
        rows.append(pull * row / deviation)
        logs.append(ca.log(deviation))
        moved = moved + gain * (error / variance)
        sensitivity = sensitivity + ca.mtimes(gain / variance, row)
        covariance = covariance - ca.mtimes(gain, gain.T) / variance
    # Rows of the unit matrix put the correction on the states that are corrected.
    x = filtered = x0 + scale * ca.mtimes(ca.DM.eye(n_x)[:, list(kept)], moved)
    # The slopes kept from the sample before, those here in the first one.
    slopes = ca.if_else(first, slope(x, u, p)[1].T, slopes0)
    along = _along(slope, rates, kept, sample_time, steps.halvings, steps.each)
    x, slopes, transition, driven = along(x, slopes, u, p, scale)
    sensitivity = ca.mtimes(transition, sensitivity) + driven
    covariance = _flushed(ca.mtimes(ca.mtimes(transition, covariance), transition.T))
    covariance = 0.5 * (covariance + covariance.T) + noise(filtered, u, p, d)
    told = [ca.vcat(whitened), ca.vcat(rows), ca.vcat(logs), filtered]
    arguments = [x0, covariance0, sensitivity0, slopes0, first, u, y, r, p, d, scale]
    going_on = [x, covariance, _flushed(sensitivity), slopes]
    return ca.Function("sample", arguments, [*going_on, *told])


def _along(
    slope: ca.Function,
    rates: ca.Function,
    kept: tuple[int, ...],
    time: float,
    halvings: int,
    each: int,
) -> ca.Function:
    """Build what carries a state along a part of a sample.

    It takes and returns the state and the slopes amid the part before, and returns the transition
    of what the state was, and what the parameters add to it.

    The slopes before carry the state to the middle by their exponential, those there carry it to
    the end. What the rates in the middle and at the end differ from these is a parabola that is
    added, fading as the slopes say; it must be little, and nothing at the end. Parts that bend are
    halved, the smallest ones taken in Runge-Kutta steps, and those that bend in finer ones; where
    even these would grow, a part is halved further.

    Source: M. Hochbruck and A. Ostermann, Exponential integrators, Acta Numerica 19 (2010), section
    2.3; Zonneveld, Automatic Numerical Integration, 1964, and Hairer, Norsett and Wanner, Solving
    Ordinary Differential Equations I, table 4.2, for the test of a Runge-Kutta step.
    """
    n_x, n_u, n_p = (slope.size1_in(i) for i in range(3))
    n, onto = len(kept), ca.DM.eye(n_x)[:, list(kept)]
    x0, before = ca.MX.sym("x", n_x), ca.MX.sym("A", n, n)
    u, p, scale = ca.MX.sym("u", n_u), ca.MX.sym("p", n_p), ca.MX.sym("scale", n_x)
    given = [x0, before, u, p, scale]
    carried = ca.sum2(onto)

    def moved(along: ca.MX, other: ca.MX) -> ca.MX:
        """Return where the states are, those that are not corrected by other steps."""
        return x0 + scale * ca.mtimes(onto, along) + (1 - carried) * other

    def ends(x: ca.MX, slopes: ca.MX, b: ca.MX) -> list[ca.MX]:
        held, mean = exponential_of(n)(0.5 * time * slopes)
        driven = ca.mtimes(mean, 0.5 * time * b.T)
        return [x, slopes, ca.mtimes(held, held), driven + ca.mtimes(held, driven)]

    def at_once() -> tuple[list[ca.MX], ca.MX, ca.MX]:
        k0 = rates(x0, u, p)
        evenly = 0.5 * time * ca.mtimes(onto.T, k0 / scale)
        ahead = ca.mtimes(exponential_of(n)(0.5 * time * before)[1], evenly)
        k1, a, b = slope(moved(ahead, 0.5 * time * k0), u, p)
        changed = ca.mmax(ca.sum2(ca.fabs(a.T - before)))
        slopes = ca.if_else(0.5 * time * changed <= _ALIKE, before, a.T)
        held, mean = exponential_of(n)(0.5 * time * slopes)
        half = ca.mtimes(mean, evenly)
        whole = half + ca.mtimes(held, half)
        k2 = rates(moved(whole, time * k1), u, p)
        amid, end = (
            ca.mtimes(onto.T, (k - k0) / scale) - ca.mtimes(slopes, v)
            for k, v in ((k1, ahead), (k2, whole))
        )

        # A parabola from zero, by its mean over each half.
        first, second = (time / 12 * (4 * amid + part * end) for part in (-0.5, 2.5))
        bent = ca.mtimes(held, ca.mtimes(mean, first)) + ca.mtimes(mean, second)

        def small(value: ca.MX, gone: ca.MX, part: float) -> ca.MX:
            return ca.mmin(ca.fabs(value) <= part * gone + _NOTHING)

        gone = ca.fabs(half) + ca.fabs(whole - half)
        # What is at the end is nothing, if all is smooth.
        easy = small(ca.mtimes(mean, time / 6 * end), gone, _LITTLE_BENT)
        easy *= small(bent, gone, _CURVED)
        others = (1 - carried) / scale
        steps = ca.fabs(k0) + 4 * ca.fabs(k1) + ca.fabs(k2)
        away = time / 6 * (2 * k1 - k0 - k2)
        easy *= small(others * away, others * time / 6 * steps, _CURVED)
        return ends(moved(whole + bent, time / 6 * (k0 + 4 * k1 + k2)), slopes, b), easy, slopes

    once, easy, amid = at_once()
    found = [ca.MX.sym("v", *v.size()) for v in once]
    ways = [ca.Function("once", [*found, *given], found)]
    which = ca.logic_not(easy)
    if halvings <= 0:
        x, a, b = _in_steps(slope, rates, time / each, each)(x0, u, p, scale)
        ways.append(ca.Function("steps", [*found, *given], ends(x, a.T, b)))
        finest = time / (each * _FINER)
        which *= 1 + (finest * ca.fmin(*_sizes(amid)) > _STIFF)
    if halvings > -_DEEPER:
        half = _along(slope, rates, kept, time / 2, halvings - 1, each)
        x, a, transition, driven = half(*given)
        x, a, further, more = half(x, a, u, p, scale)
        both = [x, a, ca.mtimes(further, transition), ca.mtimes(further, driven) + more]
        ways.append(ca.Function("halves", [*found, *given], both))
    chosen = ca.Function.conditional("chosen", ways[:-1], ways[-1])
    return ca.Function("along", given, list(chosen(which, *once, x0, amid, u, p, scale)))


def _in_steps(slope: ca.Function, rates: ca.Function, h: float, count: int) -> ca.Function:
    """Build what carries a state along Runge-Kutta steps, and gives the slopes amid them."""
    x0, u, p = (ca.MX.sym(name, slope.size1_in(i)) for i, name in enumerate("xup"))
    scale = ca.MX.sym("scale", x0.numel())

    def slopes(x: ca.MX, h: float, amid: int = -1) -> tuple[list[ca.MX], list[ca.MX]]:
        """Return the four slopes of a step, and the linearisation at the one with this number."""
        k: list[ca.MX] = []
        linearised: list[ca.MX] = []
        for s, ahead in enumerate((0.0, 0.5, 0.5, 1.0)):
            at = x + ahead * h * k[-1] if k else x
            if s == amid:
                here, *linearised = slope(at, u, p)
            else:
                here = rates(at, u, p)
            k.append(here)
        return k, linearised

    def gone(x: ca.MX, h: float, k: list[ca.MX]) -> ca.MX:
        return x + h / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])

    end, x = ca.MX.sym("end", x0.numel()), x0
    for _ in range(_FINER):
        x = gone(x, h / _FINER, slopes(x, h / _FINER)[0])
    own = ca.Function("whole", [end, x0, u, p], [end])
    step = ca.Function.if_else("step", own, ca.Function("parts", [end, x0, u, p], [x]))
    x, a, b = x0, ca.MX(), ca.MX()
    for number in range(count):
        # The middle is the midpoint of a step, or begins one where their number is even.
        k, linearised = slopes(x, h, count % 2 if number == count // 2 else -1)
        a, b = linearised or (a, b)
        k5 = rates(x + h / 32 * (5 * k[0] + 7 * k[1] + 13 * k[2] - k[3]), u, p)
        away = h * (2 * (k[1] + k[2] + k[3]) - (2 * k[0] + 16 * k5) / 3)
        moved = gone(ca.MX.zeros(x0.numel()), h, [ca.fabs(v) for v in k])
        easy = ca.mmin(ca.fabs(away) <= _MUCH_BENT * moved + _NOTHING * scale)
        x = step(easy, gone(x, h, k), x, u, p)
    return ca.Function("steps", [x0, u, p, scale], [x, a, b])


@functools.lru_cache(maxsize=32)
def exponential_of(n: int, little: float = _LITTLE) -> ca.Function:
    """Build the exponential of a matrix of n rows, and its mean on the way from the unit matrix.

    Taylor's polynomials of a part a of the matrix, doubled until it is the whole; in a part, the
    root of the largest sum along a row of a^2, and the cubic root of that of a^3, are at most
    little, dimensionless. Golub and Van Loan, Matrix Computations, section 9.3; A. H. Al-Mohy and
    N. J. Higham, SIAM Journal on Matrix Analysis 31 (2009), for the roots.
    """
    matrix, identity = ca.MX.sym("a", n, n), ca.DM.eye(n)
    numbers = []
    for doublings in range(_DOUBLINGS + 1):
        a = matrix / 2**doublings
        square = ca.mtimes(a, a)
        cube = ca.mtimes(a, square)
        mean = identity + a / 2 + square / 6
        mean += ca.mtimes(cube, identity / 24 + a / 120 + square / 720)
        held = identity + ca.mtimes(a, mean)
        for _ in range(doublings):
            mean = 0.5 * (mean + ca.mtimes(held, mean))
            held = ca.mtimes(held, held)
        numbers.append(ca.Function("doubled", [matrix], [held, mean]))
    doubled = ca.Function.conditional("doubled", numbers[:-1], numbers[-1])
    size = ca.fmax(*_sizes(matrix))
    number = ca.ceil(ca.log(ca.fmax(size / little, 1.0)) / math.log(2.0))
    return ca.Function("exponential", [matrix], doubled(number, matrix))


def _sizes(matrix: ca.MX) -> list[ca.MX]:
    """Bounds of the fastest mode of slopes, by their square and their cube."""
    square = ca.mtimes(matrix, matrix)
    powers = square, ca.mtimes(matrix, square)
    return [ca.mmax(ca.sum2(ca.fabs(power))) ** (1 / k) for k, power in enumerate(powers, 2)]


def _with_room(matrix: Vector) -> Vector:
    """Copy a matrix to where three numbers of room are behind it, as `filter.c` wants it."""
    room = np.zeros(matrix.size + 3)
    room[: matrix.size] = matrix.ravel()
    return room[: matrix.size].reshape(matrix.shape)


def _flushed(matrix: ca.MX) -> ca.MX:
    """Put zero for what has faded out: numbers below the normal range are slow to multiply."""
    return matrix * (ca.fabs(matrix) > _FADED)


@functools.lru_cache(maxsize=64)
def _functions(asked: Asked, sample_time: float) -> tuple[ca.Function, ...]:
    """Rates with their slopes, rates, measurements with their slopes, and process noise.

    Matrices are returned transposed: CasADi stores by columns, and so they stand by rows.
    """
    traced, columns, ports = asked.traced, asked.columns, asked.ports
    plant, own = len(asked.state_scale), len(asked.coloured)
    sx, sy = ca.DM([*asked.state_scale, *[1.0] * own]), ca.DM(asked.output_scale)
    kept = [*asked.corrected, *range(plant, plant + own)]
    noise = ca.SX.sym("noise", own)
    x = ca.vertcat(traced.x, noise)
    # A Gauss-Markov process: dn/dt = -n / tau + w, A. Gelb, Applied Optimal Estimation (1974), 3.6.
    fading = [-noise[k] / time for k, (_, _, time) in enumerate(asked.coloured)]
    rates = ca.vertcat(traced.rates, *fading)
    free = traced.p[list(columns)] if columns else ca.SX(0, 1)

    def slopes(values: ca.SX, scale: ca.DM) -> list[ca.SX]:
        by_state = ca.jacobian(values, x)[:, kept] * ca.repmat(sx[kept].T, values.numel(), 1)
        by_free = (
            ca.mtimes(ca.jacobian(values, free), ca.diag(ca.SX(ca.DM(asked.free_scale))))
            if columns
            else ca.SX(values.numel(), 0)
        )
        return [
            ca.densify((m * ca.repmat(1.0 / scale, 1, m.size2())).T) for m in (by_state, by_free)
        ]

    reads = ca.SX(traced.outputs[list(asked.rows)])
    for k, (row, _, _) in enumerate(asked.coloured):
        reads[row] += noise[k] * sy[row]
    d = ca.SX.sym("d", len(ports) + len(asked.misread), 2)
    names = [traced.signal_names.index(traced.ports[i].name) for i in ports]
    # What acts there: signals of ports, and inputs that are misread.
    acting = ca.vertcat(*(traced.signals[i] for i in names), *(traced.u[i] for i in asked.misread))
    by_input = ca.jacobian(rates[:plant], traced.u)[:, list(asked.misread)]
    slope = ca.horzcat(traced.rates_by_port[:, list(ports)], by_input)
    process = _process_noise(slope, acting, d, sx[:plant])
    added = [rms**2 * -math.expm1(-2.0 * sample_time / time) for _, rms, time in asked.coloured]
    process = ca.densify(ca.diagcat(process, *map(ca.SX, added)))
    arguments, cse = [x, traced.u, traced.p], {"cse": True}
    absent = traced.p[list(asked.absent)]

    def function(name: str, values: list[ca.SX], *more: ca.SX) -> ca.Function:
        if asked.absent:
            # Nothing of what is multiplied by zero is left.
            values = ca.substitute(values, [absent], [ca.SX.zeros(absent.shape)])
        return ca.Function(name, [*arguments, *more], values, cse)

    return (
        function("slope", [rates, *slopes(rates[kept], sx[kept])]),
        function("rates", [rates]),
        function("read", [ca.densify(reads / sy), *slopes(reads, sy)]),
        function("noise", [process[kept, kept]], d),
    )


def _process_noise(slope: ca.SX, acting: ca.SX, d: ca.SX, scale: ca.DM) -> ca.SX:
    """Covariance that unmodelled signals at ports and noise of inputs add in one sample."""
    if not d.numel():
        return ca.SX.zeros(scale.numel(), scale.numel())
    variances = d[:, 0] + d[:, 1] * acting**2
    covariance = ca.mtimes(ca.mtimes(slope, ca.diag(variances)), slope.T)
    return ca.densify(covariance / ca.mtimes(ca.SX(scale), ca.SX(scale).T))
