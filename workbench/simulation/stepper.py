"""One sample of a model: the states after holding the inputs for a sample time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import TIMES_S, NumericalError, check_choice, check_range
from workbench.model import EXACT, Form, Model
from workbench.model.model import check_vector
from workbench.simulation.integrators import METHODS, MOST_STEPS, Method, integrator_of


@dataclass
class Stepper:
    """Steps a model sample by sample, with the inputs held between samples.

    Args:
        sample_time: Time between samples, in s.
        tolerance: Local error allowed in a step, relative to the scales of the states.
        values: Parameter values, shape (n_parameters,), in SI; the model's own by default.
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
        check_range("sample time", self.sample_time, *TIMES_S, "s")
        check_range("integration tolerance", self.tolerance, 1e-13, 1e-2)
        check_choice("integration method", self.method, METHODS)
        self.scale = np.array([q.scale for q in self.model.states])
        self.parameters = (
            self.model.values
            if self.values is None
            else check_vector("parameter", self.values, self.model.parameters)
        )
        self._method = integrator_of(
            self.method, self.model.form(self.form), self.scale, self.sample_time, self.tolerance
        )

    @property
    def integrator(self) -> str:
        """Name of the integrator, and whether it runs compiled."""
        return self._method.name

    def step(self, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        """Return the states one sample later, shape (n_states,), in SI.

        Args:
            x: States, shape (n_states,), in SI.
            u: Inputs held over the sample, shape (n_inputs,), in SI.

        Raises:
            NumericalError: If the integrator gives up or the states are no longer finite.
        """
        return self.run(x, np.asarray(u, dtype=float).reshape(1, -1)).ravel()

    def run(self, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        """Return the states after each of several samples, shape (n_samples, n_states), in SI.

        Args:
            x: States at the start, shape (n_states,), in SI.
            u: Inputs held over each sample, shape (n_samples, n_inputs), in SI.

        Raises:
            NumericalError: If the integrator gives up or the states are no longer finite.
        """
        states = self.run_as_far(x, u)
        if len(states) < len(np.asarray(u)):
            raise self.failure()
        return states

    def run_as_far(self, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        """Return the states after each of several samples, as far as the integrator gets.

        Args:
            x: States at the start, shape (n_states,), in SI.
            u: Inputs held over each sample, shape (n_samples, n_inputs), in SI.

        Returns:
            States at the ends of the samples, shape (m, n_states), in SI; m < n_samples where the
            integrator gives up or the next states are not finite.
        """
        return self._method.run(x, u, self.parameters)

    def read(self, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        """Return what the sensors would read, without noise, shape (n_outputs,), in SI.

        Args:
            x: States, shape (n_states,), in SI.
            u: Inputs, shape (n_inputs,), in SI.
        """
        return self._method.equations(1, x, u, self.parameters)

    def failure(self) -> NumericalError:
        """Return the error that says why the integrator got no further."""
        stiff = ", or the model is stiff (use method='rosenbrock')" if self.method == "erk" else ""
        return NumericalError(
            f"the {self.method} integrator of {self.model.name!r} gave up: more than {MOST_STEPS}"
            " steps in a sample, or numbers that are not finite; the states or the parameters have"
            f" left the range of the model{stiff}, or it sticks where a condition jumps, as of"
            " np.where(v > 0, 1, -1): take np.sign(v)"
        )
