"""Plants as a sampled controller meets them: hold a command, read the sensors one sample later."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import NumericalError, check_choice
from workbench.linearisation import LinearModel
from workbench.linearisation.exact_delays import Channels, channels_of, held
from workbench.linearisation.state_space import of_equations
from workbench.linearisation.zero_order_hold import zero_order_hold
from workbench.model import Model
from workbench.model.model import check_vector, index_of
from workbench.model.quantities import of_names
from workbench.simulation.integrators import Method, integrator_of

TOLERANCE = 1e-6
"""Local error allowed in a step of the plant, relative to the scales of its states."""


class FullPlant:
    """The full nonlinear plant, advanced sample by sample.

    One call holds the inputs for a sample and reads the sensors at its end, with the inputs that
    led there. Memory is reused: at 500 Hz the call itself is most of the time.

    Args:
        sample_time: Time between samples, in s.
        start: States at the start, shape (n_states,), in SI.
        before: Inputs until the first command, shape (n_inputs,), in SI, which sensors may show;
            nominal by default.
        tolerance: Local error allowed in a step, relative to the scales of the states.
    """

    def __init__(
        self,
        model: Model,
        sample_time: float,
        start: npt.ArrayLike,
        *,
        before: Vector | None = None,
        tolerance: float = TOLERANCE,
        method: Method = "erk",
    ) -> None:
        self.model: Model | None = model
        self.name, self.straight = model.name, False
        self.commanded, self.measured = model.inputs, model.outputs
        self.state_names = tuple(q.name for q in model.states)
        self._parameters = model.parameters
        self.tolerance = tolerance
        scale = np.array([q.scale for q in model.states])
        integrator = integrator_of(method, model.exact, scale, sample_time, tolerance)
        self.integrator = integrator.name
        self._x = check_vector("state", start, model.states).copy()
        self._u = (model.nominal_input if before is None else before).copy()
        self._p = model.values.copy()
        self._y = integrator.equations(1, self._x, self._u, self._p)
        self._hold = integrator.holding(self._x, self._u, self._p, self._y)
        self.outputs: list[float] = self._y.tolist()

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter, in its SI unit, from now on."""
        i = index_of("parameter", name, self._parameters)
        self._p[i] = self._parameters[i].with_value(value).value

    @property
    def parameters(self) -> Vector:
        """Parameter values of now, shape (n_parameters,), in SI."""
        return self._p.copy()

    @property
    def state(self) -> Vector:
        """States of now, shape (n_states,), in SI; overwritten when a command is held."""
        return self._x

    def hold(self, command: tuple[float, ...]) -> None:
        """Hold a command, shape (n_inputs,), in SI, for one sample and read the sensors at its end.

        Raises:
            NumericalError: If the integrator gives up or the states are no longer finite.
        """
        for i, value in enumerate(command):
            self._u[i] = value
        held = self._hold()
        self.outputs = self._y.tolist()
        # A sum is not finite if any term is not; states that no measurement shows are checked at
        # the end of the run.
        if not held or not -1e300 < sum(self.outputs) < 1e300:
            raise NumericalError(
                f"the integrator of {self.name!r} gave up in a closed loop: the states or"
                " the parameters have left the range of the model, or the model is stiff (use"
                " method='rosenbrock')"
            )


class LinearPlant:
    """A linear model, discretised exactly for held inputs and advanced sample by sample.

    ``x[k+1] = Ad x[k] + Bd u[k]`` with ``Ad = exp(A h)``: there is no shift by half a sample, which
    interpolating the inputs between the samples would bring.

    A model by the valve's opening takes the plant's voltage: its curve is applied before.

    Args:
        linear: The linear model; its operating point is added to all signals.
        sample_time: Time between samples, in s.
        start: Outputs at the start by name, in SI; the model starts at rest there.
        rest: Deviations of the states, shape (n_states,), and inputs, shape (n_inputs,), that rest,
            in SI, where they are known.

    Source:
        Zero-order-hold equivalent; Åström and Wittenmark, Computer-Controlled Systems, 1997,
        section 2.3.
    """

    def __init__(
        self,
        linear: LinearModel,
        sample_time: float,
        start: Mapping[str, float] | None = None,
        rest: tuple[Vector, Vector] | None = None,
    ) -> None:
        described = linear.operating_point.model
        self.model: Model | None = None
        self.name = f"linear model of {described.name}"
        # A model by the valve's opening meets the same command as the plant.
        self.straight = linear.inverse is None
        self.commanded = described.inputs
        if self.straight:
            self.commanded = of_names(described.inputs, linear.input_names)
        self.measured = of_names(described.outputs, linear.output_names)
        self.state_names = tuple(linear.state_names)
        self.integrator = "exact discretisation"
        self.tolerance = 0.0
        self._A, self._B, self._C, self._D = (
            np.asarray(matrix, dtype=float) for matrix in linear.discretise(sample_time)
        )
        self._drift = zero_order_hold(linear.A, linear.drift[:, None], sample_time)[1][:, 0]
        self._late: tuple[Channels, Vector] | None = None
        self._x0, self._u0, self._y0 = linear.x0, linear.u0, linear.y0
        self._x, du = rest or _rest(linear, start or {})
        if own := channels_of(linear):
            self._A, self._B, self._C, self._D = held(own, len(du), sample_time)
            # What stands for a delay is told as it rests.
            self._late = own, np.array(self._x)
            sent = np.tile(du, (len(self._A) - len(own.kept)) // len(du))
            self._x, self._drift = np.append(self._x[list(own.kept)], sent), np.zeros(1)
        self._curve: tuple[Vector, Vector] | None = None
        if linear.inverse is not None:
            openings = np.linspace(-1.0, 1.0, 20001)
            self._curve = np.ravel(linear.to_plant(openings)), openings
        self.outputs: list[float] = (self._y0 + self._C @ self._x + self._D @ du).tolist()

    @property
    def parameters(self) -> Vector:
        """No parameters, shape (0,); a linear model has numbers (in SI) in its matrices only."""
        return np.zeros(0)

    @property
    def state(self) -> Vector:
        """States of now with their operating point, shape (n_states,), in SI."""
        if self._late is None:
            return self._x0 + self._x
        kept, found = list(self._late[0].kept), self._x0 + self._late[1]
        found[kept] = self._x0[kept] + self._x[: len(kept)]
        return found

    def hold(self, command: tuple[float, ...]) -> None:
        """Hold a command for one sample and read the outputs at its end.

        Args:
            command: Inputs, shape (n_inputs,), in SI; the plant's own for a model by the opening.
        """
        u = np.asarray(command, dtype=float)
        if self._curve is not None:
            u = np.interp(u, *self._curve)
        du = u - self._u0
        self._x = self._A @ self._x + self._B @ du + self._drift
        self.outputs = (self._y0 + self._C @ self._x + self._D @ du).tolist()


class LatePlant(LinearPlant):
    """A linear system whose commands act after delays, with the delays as they are.

    Args:
        model: A model of which `channels_of` returns some.
        sample_time: Time between samples, in s.
        rest: States at the start, shape (n_states,), and inputs, shape (n_inputs,), in SI.
    """

    def __init__(self, model: Model, sample_time: float, rest: tuple[Vector, Vector]) -> None:
        super().__init__(of_equations(model), sample_time, rest=rest)
        self.name, self.model, self.straight = model.name, model, False


def _rest(linear: LinearModel, outputs: Mapping[str, float]) -> tuple[Vector, Vector]:
    """Return the deviations (x, u) of smallest scaled size that rest with some outputs."""
    for name in outputs:
        check_choice("output of the linear model", name, linear.output_names)
    rows = [linear.output_names.index(name) for name in outputs]
    wanted = np.array(list(outputs.values())) - linear.y0[rows]
    matrix = np.block([[linear.A, linear.B], [linear.C[rows], linear.D[rows]]])
    target = np.concatenate([np.zeros(len(linear.A)), wanted])
    described = linear.operating_point.model
    scales = {q.name: q.scale for q in (*described.inputs, *described.states)}
    size = [scales.get(name, 1.0) for name in (*linear.state_names, *linear.input_names)]
    matrix = matrix * np.array(size)
    weight = np.maximum(np.max(np.abs(matrix), axis=1), 1e-300)
    found = np.linalg.lstsq(matrix / weight[:, None], target / weight, rcond=1e-12)[0] * size
    n = len(linear.A)
    return found[:n], found[n:]
