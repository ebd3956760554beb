"""The integrators: what steps the equations of a model over a sample with its inputs held."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Literal, Protocol

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.model import Trace
from workbench.simulation.compiled import compiled
from workbench.simulation.equations import Buffered, Equations
from workbench.simulation.runge_kutta import MOST_STEPS, RungeKutta
from workbench.work.machine_code import compiler

Method = Literal["erk", "rosenbrock"]

METHODS: tuple[Method, ...] = ("erk", "rosenbrock")
"""Explicit Runge-Kutta pair 5(4), and Rosenbrock-Wanner 5(4) for stiff models; both adaptive."""


class Integrator(Protocol):
    """What steps the equations of a model."""

    @property
    def method(self) -> Method:
        """Its name."""

    @property
    def compiled(self) -> bool:
        """Whether it is machine code."""

    @property
    def equations(self) -> Equations:
        """Rates and outputs, functions of states, inputs and parameters."""

    def run(self, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike) -> Vector:
        """Return the states after each of several samples, shape (m, n_states), as far as it gets.

        Args:
            x: States at the start, shape (n_states,), in SI.
            u: Inputs held over each sample, shape (n, n_inputs), in SI.
            p: Parameters, shape (n_parameters,), in SI.
        """

    def holding(self, x: Vector, u: Vector, p: Vector, y: Vector) -> Callable[[], bool]:
        """Return what advances x by one sample in place, reads the sensors into y, and says if.

        Args:
            x: States, shape (n_states,), in SI; like the others read and written at every call.
            u: Inputs, shape (n_inputs,), in SI.
            p: Parameters, shape (n_parameters,), in SI.
            y: Measurements, shape (n_outputs,), in SI.
        """


def integrator_of(
    method: Method, traced: Trace, scale: Vector, sample_time: float, tolerance: float
) -> Integrator:
    """Return an integrator.

    Args:
        scale: Scales of the states, shape (n_states,), in SI.
        sample_time: Time between samples, in s.
        tolerance: Local error allowed in a step, relative to the scales of the states.
    """
    kind = RungeKutta if method == "erk" else Rosenbrock
    return kind(traced, scale, sample_time, tolerance)


def name_of(integrator: Integrator) -> str:
    """Return the name of an integrator, and whether it runs compiled."""
    return f"{integrator.method}, {'compiled' if integrator.compiled else 'interpreted'}"


class Rosenbrock:
    """CasADi's Rosenbrock-Wanner method 5(4), for stiff models.

    Args:
        scale: Scales of the states, shape (n_states,), in SI.
        sample_time: Time between samples, in s.
        tolerance: Local error allowed in a step, relative to the scales of the states.
    """

    method: Method = "rosenbrock"

    def __init__(self, traced: Trace, scale: Vector, sample_time: float, tolerance: float) -> None:
        self.equations = Equations((traced.rates_function, traced.outputs_function))
        self._after = Buffered(_implicit(traced, tuple(scale), sample_time, tolerance))

    @property
    def compiled(self) -> bool:
        """Whether it is machine code."""
        return compiler() is not None

    def run(self, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike) -> Vector:
        """Return the states after each of several samples, as far as it gets."""
        start, held = np.array(x, dtype=float), np.asarray(u, dtype=float)
        states = np.empty((len(held), len(start)))
        for k, inputs in enumerate(held):
            try:
                start = self._after(start, inputs, p)[0]
            except RuntimeError:
                return states[:k]
            if not np.isfinite(start).all():
                return states[:k]
            states[k] = start
        return states

    def holding(self, x: Vector, u: Vector, p: Vector, y: Vector) -> Callable[[], bool]:
        """Return what advances x by one sample in place, reads the sensors into y, and says if."""

        def hold() -> bool:
            after = self.run(x, u[None], p)
            if len(after):
                x[:] = after[0]
                y[:] = self.equations(1, x, u, p)[0]
            return bool(len(after))

        return hold


@lru_cache(maxsize=64)
def _implicit(
    traced: Trace, scale: tuple[float, ...], sample_time: float, tolerance: float
) -> ca.Function:
    """Build (x, u, p) -> x one sample later."""
    size = ca.DM(scale)
    z = ca.SX.sym("z", len(scale))
    rates = ca.cse(ca.substitute(traced.rates, traced.x, z * size) / size)
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
