"""The integrators: what steps the equations of a model over a sample with its inputs held."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.computing.buffered import Buffered
from workbench.computing.counted import count, place
from workbench.computing.machine_code import compiler
from workbench.model import Trace
from workbench.model.expressions import with_rounded_signs
from workbench.simulation.equations import CFunction, Equations, address, compiled, in_c

MOST_STEPS = 2000
"""Steps in one sample, at most."""

_A = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_E = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)


class _Integrator(ctypes.Structure):
    _fields_ = [
        ("rates", CFunction),
        ("states", ctypes.c_int64),
        ("inputs", ctypes.c_int64),
        ("most_steps", ctypes.c_int64),
        ("scale", ctypes.c_void_p),
        ("sample_time", ctypes.c_double),
        ("tolerance", ctypes.c_double),
        ("step", ctypes.c_double),
        ("work", ctypes.c_void_p),
        ("steps", ctypes.c_void_p),
        ("evaluations", ctypes.c_void_p),
    ]


@cache
def integrator_library() -> ctypes.CDLL | None:
    """Return `integrator.c` as a library, or None where there is no C compiler."""
    library = in_c(Path(__file__).with_name("integrator.c"))
    if library is not None:
        pointer, whole = ctypes.c_void_p, ctypes.c_int64
        library.integrate.restype = library.hold.restype = library.evaluate.restype = whole
        library.integrate.argtypes = [pointer, whole, *[pointer] * 4]
        library.hold.argtypes = [pointer] * 6
        library.evaluate.argtypes = [pointer, *[whole] * 4, *[pointer] * 4]
    return library


Method = Literal["erk", "rosenbrock"]

METHODS: tuple[Method, ...] = ("erk", "rosenbrock")
"""Explicit Runge-Kutta pair 5(4), and Rosenbrock-Wanner 5(4) for stiff models; both adaptive."""


class Integrator:
    """What steps the equations of a model: rates and outputs of states, inputs and parameters.

    Args:
        scale: Scales of the states, shape (n_states,), in SI.
        sample_time: Time between samples, in s.
        tolerance: Local error allowed in a step, relative to the scales of the states.
    """

    method: Method

    def __init__(self, traced: Trace, scale: Vector, sample_time: float, tolerance: float) -> None:
        self.equations = Equations((traced.rates_function, traced.outputs_function))
        self._scale = np.ascontiguousarray(scale, dtype=float)
        self._sample_time, self._tolerance = sample_time, tolerance
        self._prepare(traced)

    def _prepare(self, traced: Trace) -> None:
        """Build what the method needs beside the equations."""
        raise NotImplementedError

    @property
    def compiled(self) -> bool:
        """Whether it is machine code."""
        return compiler() is not None

    @property
    def name(self) -> str:
        """Its method, and whether it runs compiled."""
        return f"{self.method}, {'compiled' if self.compiled else 'interpreted'}"

    def run(self, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike) -> Vector:
        """Return the states after each of several samples, shape (m, n_states), as far as it gets.

        Args:
            x: States at the start, shape (n_states,), in SI.
            u: Inputs held over each sample, shape (n, n_inputs), in SI.
            p: Parameters, shape (n_parameters,), in SI.
        """
        start, held, values = (np.ascontiguousarray(v, dtype=float) for v in (x, u, p))
        states = np.empty((len(held), len(start)))
        for k, inputs in enumerate(held):
            after = self._sample(start, inputs, values)
            if after is None:
                return states[:k]
            states[k] = start = after
        return states

    def _sample(self, x: Vector, u: Vector, p: Vector) -> Vector | None:
        """Return the states a sample later; None where it gives up."""
        raise NotImplementedError

    def holding(self, x: Vector, u: Vector, p: Vector, y: Vector) -> Callable[[], bool]:
        """Return what advances x by one sample in place, reads the sensors into y, and says if.

        Args:
            x: States, shape (n_states,), in SI; like the others read and written at every call.
            u: Inputs, shape (n_inputs,), in SI.
            p: Parameters, shape (n_parameters,), in SI.
            y: Measurements, shape (n_outputs,), in SI.
        """

        def hold() -> bool:
            after = self._sample(x, u, p)
            if after is not None:
                x[:] = after
                y[:] = self.equations(1, x, u, p)
            return after is not None

        return hold


class RungeKutta(Integrator):
    """Dormand and Prince's pair 5(4) for the equations of a model.

    The error of a step is held below ``tolerance (scale + |x|)`` for every state.

    Source:
        Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, 1993, table II.5.2 and
        section II.4.
    """

    method = "erk"

    def _prepare(self, traced: Trace) -> None:
        self._step = self._sample_time
        self._c: _Integrator | None = None
        library = integrator_library() if self.equations.compiled else None
        if library is not None:
            self._in_c = library
            self._work = np.zeros(9 * max(1, len(self._scale)))
            self._outputs = self.equations.in_c(1)
            self._c = _Integrator(
                self.equations.in_c(0),
                len(self._scale),
                traced.u.numel(),
                MOST_STEPS,
                address(self._scale),
                self._sample_time,
                self._tolerance,
                self._step,
                address(self._work),
                place("integrator_steps"),
                place("model_evaluations"),
            )

    @property
    def compiled(self) -> bool:
        return self._c is not None

    def run(self, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike) -> Vector:
        if self._c is None:
            return super().run(x, u, p)
        start, held, values = (np.ascontiguousarray(v, dtype=float) for v in (x, u, p))
        states = np.empty((len(held), len(start)))
        places = (address(array) for array in (start, held, values, states))
        return states[: self._in_c.integrate(ctypes.byref(self._c), len(held), *places)]

    def holding(self, x: Vector, u: Vector, p: Vector, y: Vector) -> Callable[[], bool]:
        if self._c is None:
            return super().holding(x, u, p, y)
        hold = self._in_c.hold
        called: list[object] = [ctypes.byref(self._c), ctypes.byref(self._outputs)]
        called += [ctypes.c_void_p(address(array)) for array in (x, u, p, y)]
        # What C works in stays alive as long as the function does.
        kept = self, x, u, p, y
        return lambda: bool(kept) and not hold(*called)

    def _sample(self, x: Vector, u: Vector, p: Vector) -> Vector | None:
        done, h = 0.0, self._step
        first = self.equations(0, x, u, p)
        count("model_evaluations")
        for _ in range(MOST_STEPS):
            left = self._sample_time - done
            last = h >= left
            taken = left if last else h
            count("integrator_steps")
            count("model_evaluations", len(_A))
            end, slope, wrong = (v.flatten() for v in self._one(x, u, p, first, taken))
            size = self._scale + np.maximum(np.abs(x), np.abs(end))
            parts = np.abs(wrong) / (self._tolerance * size)
            error = float(parts.max(initial=0.0)) if np.all(parts <= 1e30) else 1e30
            factor = min(5.0, max(0.2, 0.9 * max(error, 1e-10) ** -0.2))
            if error <= 1.0:
                done += taken
                x, first = end, slope
                h = max(h, taken * factor) if last else taken * factor
                if last:
                    self._step = min(h, self._sample_time)
                    return x
            else:
                h = taken * factor
        return None

    @cached_property
    def _one(self) -> Buffered:
        return Buffered(_one_step(self.equations.functions[0]))


@lru_cache(maxsize=64)
def _one_step(rates: ca.Function) -> ca.Function:
    """Build (x, u, p, rates at x, h) -> (x after h, rates there, estimate of the error)."""
    x, u, p, first = (ca.SX.sym(name, rates.size1_in(i % 3)) for i, name in enumerate("xupk"))
    h = ca.SX.sym("h")
    k, end = [first], x
    for row in _A:
        end = x + h * _weighted(row, k)
        k.append(rates(end, u, p))
    return ca.Function("step", [x, u, p, first, h], [end, k[6], h * _weighted(_E, k)])


def _weighted(weights: tuple[float, ...], slopes: list[ca.SX]) -> ca.SX:
    total = ca.SX(0)
    for weight, slope in zip(weights, slopes, strict=True):
        total += weight * slope
    return total


def at_every_row(equations: Equations, i: int, x: Vector, u: Vector, p: Vector) -> Vector:
    """Evaluate a function of states, inputs and parameters at every sample, shape (n, n_results).

    All are in SI: states (n, n_states), inputs (n, n_inputs), parameters (n_parameters,).
    """
    x, u, p = (np.ascontiguousarray(v, dtype=float) for v in (x, u, p))
    table = np.empty((len(x), equations.functions[i].numel_out(0)))
    library = integrator_library() if equations.compiled else None
    count("model_evaluations", len(x))
    if library is None:
        for row, states, inputs in zip(table, x, u, strict=True):
            row[:] = equations(i, states, inputs, p)
        return table
    function = equations.in_c(i)
    sizes = x.shape[1], u.shape[1], table.shape[1]
    places = (address(array) for array in (x, u, p, table))
    library.evaluate(ctypes.byref(function), len(x), *sizes, *places)
    return table


WITHIN = 10.0
"""Changes of states, over those that the tolerance leaves open, within which a sign goes over: what
sticks by one is held, where steps that see it jump swing about it ever faster."""


class Rosenbrock(Integrator):
    """CasADi's Rosenbrock-Wanner method 5(4), for stiff models and for what sticks."""

    method = "rosenbrock"

    def _prepare(self, traced: Trace) -> None:
        scale = tuple(self._scale.tolist())
        self._after = Buffered(_implicit(traced, scale, self._sample_time, self._tolerance))

    def _sample(self, x: Vector, u: Vector, p: Vector) -> Vector | None:
        try:
            after = self._after(x, u, p)[0].flatten()
        except RuntimeError:
            return None
        return after if np.isfinite(after).all() else None


@lru_cache(maxsize=64)
def _implicit(
    traced: Trace, scale: tuple[float, ...], sample_time: float, tolerance: float
) -> ca.Function:
    """Build (x, u, p) -> x one sample later."""
    size = ca.DM(scale)
    z = ca.SX.sym("z", len(scale))
    rates = ca.substitute(traced.rates, traced.x, z * size) / size
    rates = ca.cse(with_rounded_signs(rates, z, WITHIN * tolerance))
    integrator = ca.integrator(
        "interval",
        "rosenbrock",
        {"x": z, "u": traced.u, "p": traced.p, "ode": rates},
        0.0,
        sample_time,
        {"abstol": tolerance, "reltol": tolerance, "max_num_steps": MOST_STEPS},
    )
    x0 = ca.MX.sym("x0", len(scale))
    u = ca.MX.sym("u", traced.u.numel())
    p = ca.MX.sym("p", traced.p.numel())
    end = integrator(x0=x0 / size, u=u, p=p)["xf"] * size
    return compiled(ca.Function("sample", [x0, u, p], [end]))


def integrator_of(
    method: Method, traced: Trace, scale: Vector, sample_time: float, tolerance: float
) -> Integrator:
    """Return an integrator of a method; the other arguments are those of `Integrator`, in SI."""
    kind = RungeKutta if method == "erk" else Rosenbrock
    return kind(traced, scale, sample_time, tolerance)
