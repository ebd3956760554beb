"""An extended Kalman filter for the states of a nonlinear model and constant disturbances.

The states x of a model are joined by disturbances w on the rates of some of them and by what some
of its parameters are off, dw/dt = 0. A rate is missed alike everywhere; a lower supply fills less
the fuller a chamber is, which a prediction must know that plans with it. With z = (x, w), counted
in scales, its derivatives F and C at the estimate, measurements y with noise of covariance R and
random walks of covariance Q per second:

    K = P C' (C P C' + R)^-1,    z = z + K (y - g(x)),    P = P - K C P          (correction)
    z = f(z, u),                 P = F P F' + Q h                                 (prediction)

With as many disturbed rates as sensors the estimate at rest agrees with every measurement. A
parameter shows in motion: what a sample hardly tells of it the small errors of the model outweigh,
however many samples there are, so that it is then taken for independent of the rest. It stays
within its bounds, and is never taken for less known than at the start.

Source: Rawlings, Mayne and Diehl, Model Predictive Control, 2017, section 4.2; Pannocchia and
Rawlings, AIChE Journal 49, 2003 (disturbance models).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from controllers.nonlinear_mpc.prediction import Dynamics
from workbench.arrays import Matrix
from workbench.computing.buffered import Buffered
from workbench.model import Parameter

START_SPREAD = 0.01
"""Standard deviation of the states at the start, as a fraction of their scales."""

FAR = 1e4
"""Size of a state, in its scales, that none is of: an estimate that got there tells nothing."""

SHOWN = 6.0
"""Change of a measurement within a sample from which a parameter shows, relative to the noise."""


@dataclass(frozen=True, eq=False)
class ExtendedKalmanFilter:
    """The filter of one model, without memory of its own.

    Args:
        sample: Map over one sample, (x, u, w) -> next x and its derivatives by x, u and w.
        read: Measurements in SI, (x, u) -> measurements and their derivatives by x.
        rest: States about which it starts, shape (n,), scaled.
        walk: Random walk of states and disturbances over one second, shape (n + n_w,), scaled.
        spread: How far each disturbance is off at the start, rms, shape (n_w,), scaled.
        unknown: Parameters that the last disturbances belong to.
        noise: Noise rms of the measurements, shape (n_sensors,), in SI.
        sample_time: Time between samples, in s.
    """

    rates: Dynamics
    sample: Buffered
    read: Buffered
    rest: Matrix
    walk: Matrix
    spread: Matrix
    unknown: tuple[Parameter, ...]
    noise: Matrix
    sample_time: float

    def initial(self, measurement: tuple[float, ...], u: float) -> tuple[Matrix, Matrix]:
        """Return the scaled state nearest to rest that measurements agree with, and its covariance.

        Measurements and input are in SI.
        """
        y, by_x = self.read(self.rest, [u])
        x = self.rest + np.linalg.pinv(by_x) @ (np.array(measurement) - y.ravel())
        spread = np.concatenate([np.full(len(x), START_SPREAD), self.spread])
        return np.concatenate([x, np.zeros(self.rates.disturbances)]), np.diag(spread**2)

    def correct(
        self, estimate: Matrix, covariance: Matrix, measurement: tuple[float, ...], u: float
    ) -> tuple[Matrix, Matrix]:
        """Correct a prediction and its covariance, scaled, by measurements in SI.

        The prediction has shape (n + n_w,); u is the input held before, in SI.
        """
        n = len(self.rest)
        y, by_x = self.read(estimate[:n], [u])
        # In units of the noise, so that the innovation's covariance is well conditioned.
        C = np.zeros((len(self.noise), len(estimate)))
        C[:, :n] = by_x / self.noise[:, None]
        residual = (np.array(measurement) - y.ravel()) / self.noise
        shared = covariance @ C.T
        gain = np.linalg.solve(C @ shared + np.eye(len(residual)), shared.T).T
        corrected = covariance - gain @ shared.T
        found = estimate + gain @ residual
        for i, q in enumerate(self.unknown, len(found) - len(self.unknown)):
            off = min(max(found[i], (q.lower - q.value) / q.scale), (q.upper - q.value) / q.scale)
            found[i] = off
        return found, 0.5 * (corrected + corrected.T)

    def parameters(self, estimate: Matrix) -> Mapping[str, float]:
        """Return the unknown parameters of an estimate by name, in SI."""
        off = estimate[len(estimate) - len(self.unknown) :]
        return {
            q.name: q.value + q.scale * float(w) for q, w in zip(self.unknown, off, strict=True)
        }

    def predict(self, estimate: Matrix, covariance: Matrix, u: float) -> tuple[Matrix, Matrix]:
        """Predict estimate and covariance, scaled, a sample later under an input in SI.

        An estimate, or its spread, that leaves every state of a plant behind is not a number.
        """
        n = len(self.rest)
        x, by_x, _, by_w = self.sample(estimate[:n], [u], estimate[n:])
        if not np.abs(x).max() < FAR:
            return np.full(len(estimate), np.nan), covariance
        F = np.eye(len(estimate))
        F[:n, :n], F[:n, n:] = by_x, by_w
        P = F @ covariance @ F.T
        P[np.diag_indices_from(P)] += self.walk**2 * self.sample_time
        _, by_x = self.read(x.ravel(), [u])
        for i in range(len(P) - len(self.unknown), len(P)):
            spread = float(self.spread[i - n])
            variance = min(float(P[i, i]), spread**2)
            shows = np.max(np.abs(by_x @ by_w[:, i - n]) / self.noise) * spread >= SHOWN
            shared = (variance / P[i, i]) ** 0.5 if shows else 0.0
            P[i], P[:, i] = shared * P[i], shared * P[:, i]
            P[i, i] = variance
        if not P.diagonal().max() < FAR * FAR:
            return np.full(len(estimate), np.nan), covariance
        return np.concatenate([x.ravel(), estimate[n:]]), P
