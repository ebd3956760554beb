"""The unknown input at a port, smoothed: what the equations there would have to add.

The signal of one or several ports gets an unknown addition that is random but correlated in time. A
smoother finds the addition, the states and their uncertainty that explain the measurements best;
all other equations are trusted but for a small disturbance. Nothing is assumed of the law behind
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.filter import exponential_of
from workbench.diagnosis.estimation.prediction_error import (
    Observed,
    PredictionError,
    disturbances,
    steps_along,
)
from workbench.errors import NumericalError, check_choice
from workbench.model import Model

TRUSTED = 0.1
"""Share of the expected disturbance that is left to the other ports."""

MEMORY = 0.5
"""Time over which the unknown input is taken as correlated, over that of what a model leaves out,
up to 50 samples."""

_LITTLE = 2.0**-4
"""Size of a matrix of which a polynomial of sixth order is the exponential to 1e-12."""

_PASSES = 2
_MOST_STEPS = 3000


@dataclass(frozen=True)
class UnknownInput:
    """An unknown input along a recording.

    Args:
        time: Times, shape (n,), in s.
        signal: The unknown input, shape (n, n_ports), each in its unit.
        std: Its standard deviation, shape (n, n_ports), each in its unit.
        states: Smoothed states, shape (n, n_states), in SI.
        inputs: Inputs of the model, shape (n, n_inputs), in SI.
    """

    name: str
    ports: tuple[str, ...]
    units: tuple[str, ...]
    time: Vector
    signal: Vector
    std: Vector
    states: Vector
    inputs: Vector


def unknown_input(model: Model, observed: Observed, ports: Sequence[str]) -> UnknownInput:
    """Estimate what is added at some ports along a recording.

    Iterated extended Kalman smoother (Bell 1994) in the form of Bryson and Frazier: the equations
    are linearised about the last estimate, and the size of the unknown input follows from its own
    estimate.

    Raises:
        WorkbenchError: If a port does not exist.
        NumericalError: If the filter cannot follow the recording.
    """
    known = {port.name: i for i, port in enumerate(model.ports)}
    for name in ports:
        check_choice("port", name, known)
    chosen = [known[name] for name in ports]
    every = max(1, -(-len(observed.inputs) // _MOST_STEPS))
    smoother = _Smoother(model, observed, chosen, every)
    grid, scale = smoother.grid, smoother.port_scale
    states = _filtered(model, observed, ports)[grid]
    signal, rms = np.zeros((len(grid), len(chosen))), 0.1 * scale
    for _ in range(_PASSES):
        # What leaves the finite numbers is said in words.
        with np.errstate(over="ignore", invalid="ignore"):
            states, signal, std = smoother.smoothed(states, signal, rms)
            rms = np.maximum(np.sqrt(np.mean(signal**2 + std**2, axis=0)), 1e-12 * scale)
        if not (np.isfinite(states).all() and np.isfinite(rms).all()):
            raise NumericalError(
                f"the smoother left the finite numbers on {observed.name!r}; the model is too far"
                " from the recording to tell what it lacks"
            )
    return UnknownInput(
        observed.name,
        tuple(ports),
        tuple(model.ports[i].unit for i in chosen),
        observed.sample_time * grid.astype(np.float64),
        signal,
        std,
        states,
        observed.inputs[grid],
    )


def _filtered(model: Model, observed: Observed, ports: Sequence[str]) -> Vector:
    """States that follow the measurements, as the first estimate of the smoother."""
    rms = disturbances(model, 1.0) | {q.name: 0.1 * q.scale for q in model.ports if q.name in ports}
    filter_ = PredictionError(model, observed, (), rms)
    return filter_.run(observed, model.values).states


class _Smoother:
    """A smoother of state and unknown input, stacked and scaled, along a recording."""

    def __init__(self, model: Model, observed: Observed, ports: list[int], every: int) -> None:
        self.model, self.observed, self.ports, self.every = model, observed, ports, every
        self.grid = np.arange(0, len(observed.inputs), every)
        self.state_scale = np.array([q.scale for q in model.states])
        self.port_scale = np.array([model.ports[i].scale for i in ports])
        trace = model.exact
        rows = observed.rows(model)
        push = ca.SX.sym("push", len(ports))
        full = ca.SX.zeros(len(trace.ports))
        full[ports] = push
        rates, outputs = ca.substitute(
            [trace.perturbed_rates, trace.perturbed_outputs[rows]], [trace.perturbation], [full]
        )
        given = [trace.u, trace.p, push]
        own = ca.Function("rates", [trace.x, ca.vertcat(*given)], [rates], {"cse": True})
        self._step = ca.simpleRK(own, steps_along(model, observed).number)
        names = [trace.signal_names.index(port.name) for port in trace.ports]
        self._slopes = ca.Function(
            "slopes",
            [trace.x, *given],
            [
                ca.densify(ca.jacobian(rates, trace.x)),
                ca.densify(ca.jacobian(rates, push)),
                ca.densify(ca.jacobian(outputs, trace.x)),
                ca.densify(ca.jacobian(outputs, push)),
                outputs,
                ca.densify(trace.rates_by_port),
                trace.signals[names],
            ],
            {"cse": True},
        )

    def smoothed(self, states: Vector, signal: Vector, rms: Vector) -> tuple[Vector, ...]:
        """Filter forwards about an estimate, smooth backwards: states, signal and its deviation.

        Modified Bryson-Frazier: no covariance is inverted.
        """
        transition, offset, slope, error, noise = self._around(states, signal)
        n, n_x = states.shape
        size = n_x + signal.shape[1]
        decay = transition[0, n_x, n_x]
        level = (rms / self.port_scale) ** 2
        added = np.zeros((n, size, size))
        added[:, :n_x, :n_x] = noise
        added[:, range(n_x, size), range(n_x, size)] = (1 - decay**2) * level
        mean = np.concatenate([self.observed.start / self.state_scale, np.zeros(len(level))])
        start_rms = self.observed.start_rms / self.state_scale
        covariance = np.diag(np.concatenate([start_rms**2, level]))
        means, covariances = np.empty((n, size)), np.empty((n, size, size))
        kept, gains = np.empty((n, size, size)), np.empty((n, size))
        weights = np.empty((n, size, size))
        identity, unit = np.eye(size), np.eye(slope.shape[1])
        for k in range(n):
            h, f = slope[k], transition[k]
            innovation = error[k] - h @ mean
            inverse = np.linalg.inv(h @ covariance @ h.T + unit)
            gain = covariance @ h.T @ inverse
            kept[k] = identity - gain @ h
            gains[k] = h.T @ (inverse @ innovation)
            weights[k] = h.T @ inverse @ h
            mean, covariance = mean + gain @ innovation, kept[k] @ covariance
            covariance = 0.5 * (covariance + covariance.T)
            means[k], covariances[k] = mean, covariance
            mean = f @ mean + offset[k]
            covariance = f @ covariance @ f.T + added[k]
        adjoint, information = np.zeros(size), np.zeros((size, size))
        for k in range(n - 1, -1, -1):
            before = covariances[k]
            means[k] -= before @ adjoint
            covariances[k] = before - before @ information @ before
            f = transition[k - 1]
            adjoint = f.T @ (kept[k].T @ adjoint - gains[k])
            information = f.T @ (weights[k] + kept[k].T @ information @ kept[k]) @ f
        variance = np.maximum(covariances[:, range(n_x, size), range(n_x, size)], 0.0)
        return (
            means[:, :n_x] * self.state_scale,
            means[:, n_x:] * self.port_scale,
            np.sqrt(variance) * self.port_scale,
        )

    def _around(self, states: Vector, signal: Vector) -> tuple[Vector, ...]:
        """Linearise about an estimate.

        Returns:
            Transition and offset, which carry one time to the next; slope and error of the whitened
            measurements; and the covariance that one step adds to the states.
        """
        seen, every, grid = self.observed, self.every, self.grid
        sx, sd = self.state_scale, self.port_scale
        n, n_x, n_d = len(states), states.shape[1], signal.shape[1]
        p = np.tile(self.model.values[:, None], (1, n))

        def told(function: ca.Function, *values: Vector) -> list[Vector]:
            found = [np.asarray(result) for result in function.map(n)(*values)]
            return [m.reshape(len(m), n, m.shape[1] // n).transpose(1, 0, 2) for m in found]

        given = states.T, seen.inputs[grid].T, p, signal.T
        a, b, h, d, read, by_port, at_port = told(self._slopes, *given)
        step = every * seen.sample_time
        # Mean of both ends of the step: second order in its length.
        rate_a = 0.5 * step * (a + np.concatenate([a[1:], a[-1:]]))
        rate_b = 0.5 * step * (b + np.concatenate([b[1:], b[-1:]]))
        forward, integral = told(exponential_of(n_x, _LITTLE), np.hstack(list(rate_a)))
        transition = np.zeros((n, n_x + n_d, n_x + n_d))
        transition[:, :n_x, :n_x] = forward / sx[:, None] * sx
        transition[:, :n_x, n_x:] = integral @ rate_b / sx[:, None] * sd
        memory = min(MEMORY * seen.correlation_time, 50 * seen.sample_time)
        decay = np.exp(-step / max(memory, 5 * step))
        transition[:, n_x:, n_x:] = decay * np.eye(n_d)
        estimate = np.concatenate([states / sx, signal / sd], axis=1)
        offset = np.zeros((n, n_x + n_d))
        reached = self._forward(states, signal) / sx
        offset[:, :n_x] = reached - np.einsum("kij,kj->ki", transition, estimate)[:, :n_x]
        noise_rms = np.where(np.isfinite(seen.outputs[grid]), seen.noise_rms, 1e6 * seen.noise_rms)
        slope = np.concatenate([h * sx, d * sd], axis=2) / noise_rms[:, :, None]
        measured = np.nan_to_num(seen.outputs[grid])
        error = (measured - read[:, :, 0]) / noise_rms
        error += np.einsum("kij,kj->ki", slope, estimate)
        noise = self._noise(by_port, at_port[:, :, 0], step) / np.outer(sx, sx)
        return transition, offset, slope, error, noise

    def _noise(self, by_port: Vector, at_port: Vector, step: float) -> Vector:
        """Covariance that what is left out at the other ports adds in one step."""
        white = 2 * self.observed.correlation_time * step
        ports = self.model.ports
        rms = np.array(
            [0.0 if i in self.ports else TRUSTED * q.disturbance for i, q in enumerate(ports)]
        )
        relative = np.array([q.relative_disturbance for q in ports])
        variance = white * (rms**2 + (relative * at_port) ** 2)
        return np.asarray(np.einsum("kip,kp,kjp->kij", by_port, variance, by_port))

    def _forward(self, states: Vector, signal: Vector) -> Vector:
        """Carry every estimate one step on by the nonlinear equations (Runge-Kutta)."""
        seen, every = self.observed, self.every
        n, x = len(states), states.T
        p = np.tile(self.model.values[:, None], (1, n))
        for i in range(every):
            rows = np.minimum(np.arange(n) * every + i, len(seen.inputs) - 1)
            given = np.vstack([seen.inputs[rows].T, p, signal.T])
            x = self._step.map(n)(x, given, np.full((1, n), seen.sample_time))
        return np.asarray(x).T
