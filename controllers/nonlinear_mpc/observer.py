"""An extended Kalman filter for the states of a nonlinear model and constant disturbances.

The states x of a model are joined by disturbances w on the rates of some of them, dw/dt = 0. With
z = (x, w), counted in scales, its derivatives F and C at the estimate, measurements y with noise of
covariance R and random walks of covariance Q per second:

    K = P C' (C P C' + R)^-1,    z = z + K (y - g(x)),    P = P - K C P          (correction)
    z = f(z, u),                 P = F P F' + Q h                                 (prediction)

With as many disturbances as sensors the estimate at rest agrees with every measurement.

Source: Rawlings, Mayne and Diehl, Model Predictive Control, 2017, section 4.2; Pannocchia and
Rawlings, AIChE Journal 49, 2003 (disturbance models).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.nonlinear_mpc.prediction import Called, Dynamics
from workbench.arrays import Matrix

START_SPREAD = 0.01
"""Standard deviation of the states at the start, as a fraction of their scales."""


@dataclass(frozen=True, eq=False)
class ExtendedKalmanFilter:
    """The filter of one model, without memory of its own.

    Args:
        sample: Map over one sample, (x, u, w) -> next x and its derivatives by x, u and w.
        read: Measurements in SI, (x, u) -> measurements and their derivatives by x.
        rest: States about which it starts, shape (n,), scaled.
        walk: Random walk of states and disturbances over one second, shape (n + n_w,), scaled.
        noise: Noise rms of the measurements, shape (n_sensors,), in SI.
        sample_time: Time between samples, in s.
    """

    rates: Dynamics
    sample: Called
    read: Called
    rest: Matrix
    walk: Matrix
    noise: Matrix
    sample_time: float

    def initial(self, measurement: tuple[float, ...], u: float) -> tuple[Matrix, Matrix]:
        """Return the scaled state nearest to rest that measurements agree with, and its covariance.

        Measurements and input are in SI.
        """
        y, by_x = self.read(self.rest, [u])
        x = self.rest + np.linalg.pinv(by_x) @ (np.array(measurement) - y.ravel())
        spread = np.where(np.arange(len(self.walk)) < len(x), START_SPREAD, 0.3 * self.walk)
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
        return estimate + gain @ residual, 0.5 * (corrected + corrected.T)

    def predict(self, estimate: Matrix, covariance: Matrix, u: float) -> tuple[Matrix, Matrix]:
        """Predict estimate and covariance, scaled, a sample later under an input in SI."""
        n = len(self.rest)
        x, by_x, _, by_w = self.sample(estimate[:n], [u], estimate[n:])
        F = np.eye(len(estimate))
        F[:n, :n], F[:n, n:] = by_x, by_w
        P = F @ covariance @ F.T
        P[np.diag_indices_from(P)] += self.walk**2 * self.sample_time
        return np.concatenate([x.ravel(), estimate[n:]]), P
