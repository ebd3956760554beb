"""Observer of the joint: speed, and the acceleration that the model does not explain.

The encoder gives the angle, the sensors the pressure difference; speed is not measured, and a
difference of encoder counts is coarse. The observer carries the joint's equation along:

    d2theta/dt2 = b (dp - dp0) - a1 dtheta/dt - a0 (theta - theta0) + w,    dw/dt = 0

and corrects it by the measured angle. Its third state w collects friction, muscle hysteresis,
weight and whatever else the linear model leaves out.

Sample k, with x = (theta, speed, w) and the exactly discretised Phi, Gamma:

    x[k]   = xp[k] + M (y[k] - theta_p[k])              correction by the measured angle
    xp[k+1] = Phi x[k] + Gamma (dp[k] - dp0)            prediction

Source: Luenberger observer with a constant-disturbance state; Åström and Wittenmark,
Computer-Controlled Systems, 1997, sections 4.5 (Ackermann's
formula) and 9.3; Johnson, IEEE Trans. AC-16, 1971.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controllers.arithmetic import Number
from controllers.joint.model import JointModel
from controllers.riccati import kalman_gain
from workbench.errors import check_range
from workbench.linearisation.zero_order_hold import zero_order_hold


class JointEstimate(NamedTuple):
    """What a `JointObserver` knows of the joint.

    Args:
        angle: Angle, in rad.
        speed: Speed, in rad/s.
        unexplained: Acceleration that the model does not explain, in rad/s2.
    """

    angle: Number
    speed: Number
    unexplained: Number


@dataclass(frozen=True)
class JointObserver:
    """Observer of speed and unexplained acceleration.

    Args:
        transition: The matrix Phi row by row, 9 numbers in SI.
        input_gain: The vector Gamma, 3 numbers in SI.
        correction: The vector M, 3 numbers in SI.
        angle: Angle theta0 of the operating point, in rad.
        difference: Pressure difference dp0 of the operating point, in Pa.
    """

    transition: tuple[float, ...]
    input_gain: tuple[float, float, float]
    correction: tuple[float, float, float]
    angle: float = 0.0
    difference: float = 0.0

    def correct(self, predicted: JointEstimate, angle: Number) -> JointEstimate:
        """Correct a prediction by the measured angle, in rad."""
        m = self.correction
        residual = angle - predicted.angle
        return JointEstimate(
            predicted.angle + m[0] * residual,
            predicted.speed + m[1] * residual,
            predicted.unexplained + m[2] * residual,
        )

    def predict(self, estimate: JointEstimate, difference: Number) -> JointEstimate:
        """Predict the next sample under a pressure difference, in Pa."""
        f, g = self.transition, self.input_gain
        theta = estimate.angle - self.angle
        speed, unexplained = estimate.speed, estimate.unexplained
        dp = difference - self.difference
        return JointEstimate(
            self.angle + f[0] * theta + f[1] * speed + f[2] * unexplained + g[0] * dp,
            f[3] * theta + f[4] * speed + f[5] * unexplained + g[1] * dp,
            f[6] * theta + f[7] * speed + f[8] * unexplained + g[2] * dp,
        )

    def start(self, joint: JointModel, angle: float, difference: float) -> JointEstimate:
        """Return the estimate, in SI, that holds the joint where it is by what is unexplained."""
        push = joint.b * (difference - self.difference) - joint.a0 * (angle - self.angle)
        return JointEstimate(angle, 0.0, -push)


def design_joint_observer(
    joint: JointModel, *, bandwidth: float, sample_time: float
) -> JointObserver:
    """Design the observer by placing its three poles at ``exp(-bandwidth h)``.

    Args:
        bandwidth: Speed of the observer's poles, in rad/s.
        sample_time: Time h between samples, in s.
    """
    h = check_range("sample time", sample_time, 1e-6, 1.0, "s")
    check_range("bandwidth of the observer", bandwidth, 0.1, 3.0 / h, "rad/s")
    a = np.array([[0.0, 1.0, 0.0], [-joint.a0, -joint.a1, 1.0], [0.0, 0.0, 0.0]])
    b = np.array([[0.0], [joint.b], [0.0]])
    phi, gamma = zero_order_hold(a, b, h)
    pole = float(np.exp(-bandwidth * h))
    c = np.array([1.0, 0.0, 0.0])
    observability = np.array([c, c @ phi, c @ phi @ phi])
    # Ackermann: L = p(Phi) O^-1 e3 for the predictor, and M = Phi^-1 L for the corrector.
    shifted = phi - pole * np.eye(3)
    polynomial = shifted @ shifted @ shifted
    gain = polynomial @ np.linalg.solve(observability, np.array([0.0, 0.0, 1.0]))
    correction = np.linalg.solve(phi, gain)
    return JointObserver(
        tuple(float(v) for v in phi.ravel()),
        (float(gamma[0, 0]), float(gamma[1, 0]), float(gamma[2, 0])),
        (float(correction[0]), float(correction[1]), float(correction[2])),
        joint.angle,
        joint.difference,
    )


def kalman_correction(
    *,
    angle_noise: float = 2e-5,
    acceleration_noise: float = 0.5,
    acceleration_walk: float = 100.0,
    sample_time: float = 0.002,
) -> tuple[float, float, float]:
    """Compute a stationary Kalman filter's gains for angle, speed and acceleration left, in SI.

    The joint is a double integrator driven by the acceleration from the pressures. Its noise, rms,
    and its unexplained part, a random walk, rms over 1 s, are given in rad/s2.

    Source:
        Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, section 6.5.
    """
    h = check_range("sample time", sample_time, 1e-6, 1.0, "s")
    for name, value, unit in (
        ("noise of the angle", angle_noise, "rad"),
        ("noise of the acceleration", acceleration_noise, "rad/s2"),
        ("walk of the acceleration", acceleration_walk, "rad/s2"),
    ):
        check_range(name, value, 1e-12, 1e9, unit)
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    phi, gamma = zero_order_hold(a, np.array([[0.0], [1.0], [0.0]]), h)
    drive = np.hstack([gamma, np.array([[0.0], [0.0], [1.0]])])
    noise = np.diag([acceleration_noise**2, acceleration_walk**2 * h])
    c = np.array([[1.0, 0.0, 0.0]])
    angle, speed, unexplained = kalman_gain(
        phi, c, drive @ noise @ drive.T, [[angle_noise**2]]
    ).ravel()
    return float(angle), float(speed), float(unexplained)
