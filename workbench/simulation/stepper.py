"""One sample of a model: the states after holding the inputs for a sample time."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.errors import NumericalError, check_choice, check_range
from workbench.model import EXACT, Form, Model, Trace
from workbench.model.model import check_vector
from workbench.simulation.compiled import Buffered, compiled, compiler

Vector = npt.NDArray[np.float64]
Method = Literal["erk", "rosenbrock"]

METHODS: tuple[Method, ...] = ("erk", "rosenbrock")
"""Explicit Runge-Kutta pair 5(4), and Rosenbrock-Wanner 5(4) for stiff models; both adaptive."""

_MAX_STEPS_PER_SAMPLE = 2000


@lru_cache(maxsize=64)
def _interval(
    traced: Trace,
    scale: tuple[float, ...],
    method: Method,
    sample_time: float,
    samples: int,
    tolerance: float,
) -> ca.Function:
    """Build a function (z, u, p) -> z at the ends of ``samples`` intervals, z = x / scale."""
    size = np.array(scale)
    z = ca.SX.sym("z", len(size))
    # Common subexpressions written once: 13 % fewer operations for the arm.
    rates = ca.cse(ca.substitute(traced.rates, traced.x, z * size) / size)
    integrator = ca.integrator(
        "interval",
        method,
        {"x": z, "u": traced.u, "p": traced.p, "ode": rates},
        0.0,
        [sample_time * (i + 1) for i in range(samples)],
        {
            "abstol": tolerance,
            "reltol": tolerance,
            "max_num_steps": _MAX_STEPS_PER_SAMPLE,
        },
    )
    z0 = ca.MX.sym("z0", len(size))
    u = ca.MX.sym("u", traced.u.numel(), samples)
    p = ca.MX.sym("p", traced.p.numel())
    end = integrator(x0=z0, u=u, p=p)["xf"]
    return compiled(ca.Function("samples", [z0, u, p], [end]))


@dataclass
class Stepper:
    """Steps a model sample by sample, with the inputs held between samples.

    Args:
        sample_time: Time between samples, in s.
        tolerance: Local error allowed in a step, relative to the scales of the states.
        method: ``"erk"`` or ``"rosenbrock"``.
        form: Exact or regularised equations.
        values: Parameter values, shape (n_parameters,), in SI; the model's own by default.

    Raises:
        WorkbenchError: If the sample time or the tolerance is outside its range.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> stepper = Stepper(servo_axis(), 0.001)
        >>> stepper.step([0.0, 1.0], [0.0])[0] > 0.0
        np.True_
    """

    model: Model
    sample_time: float
    tolerance: float = 1e-7
    method: Method = "erk"
    form: Form = EXACT
    values: npt.ArrayLike | None = None
    scale: Vector = field(init=False)
    parameters: Vector = field(init=False)

    def __post_init__(self) -> None:
        """Check the arguments and build the functions."""
        check_range("sample time", self.sample_time, 1e-7, 1e4, "s")
        check_range("integration tolerance", self.tolerance, 1e-13, 1e-2)
        check_choice("integration method", self.method, METHODS)
        self.scale = np.array([q.scale for q in self.model.states])
        self.parameters = (
            self.model.values
            if self.values is None
            else check_vector("parameter", self.values, self.model.parameters)
        )
        self._blocks: dict[int, Buffered] = {}
        n_x, n_u, n_p = len(self.scale), len(self.model.inputs), len(self.parameters)
        outputs = compiled(self.model.form(self.form).outputs_function)
        self._read = Buffered(outputs, (n_x, 1), (n_u, 1), (n_p, 1))
        self._read.arguments[2][:, 0] = self.parameters

    @property
    def integrator(self) -> str:
        """Name of the integrator, and whether it runs compiled."""
        return f"{self.method}, {'compiled' if compiler() else 'interpreted'}"

    def step(self, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        """Return the states one sample later.

        Args:
            x: States, shape (n_states,), in SI.
            u: Inputs held over the sample, shape (n_inputs,), in SI.

        Returns:
            States, shape (n_states,), in SI.

        Raises:
            NumericalError: If the integrator gives up or the states are no longer finite.
        """
        return self.run(x, np.asarray(u, dtype=float).reshape(1, -1)).ravel()

    def run(self, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        """Return the states after each of several samples.

        Args:
            x: States at the start, shape (n_states,), in SI.
            u: Inputs held over each sample, shape (n_samples, n_inputs), in SI.

        Returns:
            States at the ends of the samples, shape (n_samples, n_states), in SI.

        Raises:
            NumericalError: If the integrator gives up or the states are no longer finite.
        """
        held = np.asarray(u, dtype=float)
        block = self._block(len(held))
        z = np.asarray(x, dtype=float) / self.scale
        try:
            end = block(z[:, None], held.T, self.parameters[:, None])
        except RuntimeError:
            raise self._failure("gave up: more than 2000 steps in a sample") from None
        if not np.isfinite(end).all():
            raise self._failure("returned numbers that are not finite")
        return np.asarray(end.T * self.scale, dtype=float)

    def read(self, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        """Return what the sensors would read, without noise and quantisation.

        Args:
            x: States, shape (n_states,), in SI.
            u: Inputs, shape (n_inputs,), in SI.

        Returns:
            Measurements, shape (n_outputs,), in SI.
        """
        read = self._read
        read.arguments[0][:, 0] = x
        read.arguments[1][:, 0] = u
        read.evaluate()
        return read.result[:, 0].copy()

    def _block(self, samples: int) -> Buffered:
        if samples not in self._blocks:
            function = _interval(
                self.model.form(self.form),
                tuple(self.scale),
                self.method,
                self.sample_time,
                samples,
                self.tolerance,
            )
            n_x, n_u, n_p = len(self.scale), len(self.model.inputs), len(self.parameters)
            self._blocks[samples] = Buffered(function, (n_x, 1), (n_u, samples), (n_p, 1))
        return self._blocks[samples]

    def _failure(self, what: str) -> NumericalError:
        stiff = ", or the model is stiff (use method='rosenbrock')" if self.method == "erk" else ""
        return NumericalError(
            f"the {self.method} integrator of {self.model.name!r} {what}; the states or the"
            f" parameters have left the range of the model{stiff}"
        )
