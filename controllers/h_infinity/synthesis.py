"""H-infinity mixed sensitivity for the joint behind its pressure loop.

Plant: a joint of the third-order model whose pressure difference follows what is wanted with the
bandwidth v of an inner loop, and a delay of sample, converter and spool (first-order Padé):

    d2x/dt2 = -a0 x - a1 dx/dt + c + d          x angle, d disturbing acceleration
    dc/dt   = v (u delayed - c) - e b dx/dt     c acceleration from the pressure difference

The controller u = K y reads y = n - x, with n a change of the reference or an error of the sensor.
What is measured and not followed is read too, with errors of a size of its own. For n and d of size
1 in their scales, the H-infinity norm gamma from (n, d) to the three weighted
signals is made least:

    z1 = W1 (n - x),   W1 = (s / M + w) / (s + f w)         performance: |S| below 1 / |W1|
    z2 = W2 u,         W2 = 1 / (r w^2)                     input
    z3 = W3 x,         W3 = (s + k w / M') / (f' s + k w)   robustness: |T| below 1 / |W3|

The disturbance among the inputs keeps K from cancelling the joint's lightly damped poles, which a
problem of S, K S and T alone does. Poles of K that are faster than a sampled controller can have
take their static gain, the smallest order by balanced truncation is taken whose norm is within a
few percent, and Tustin's rule makes the sampled controller.

Source: Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, sections 2.8.3 (weights),
9.3 (mixed sensitivity, generalised plant), 11.3 (balanced truncation, as in SLICOT's AB09AD);
Glover and Doyle, Systems and Control Letters 11, 1988 (synthesis, as in SLICOT's SB10FD); Bruinsma
and Steinbuch, Systems and Control Letters 14, 1990 (norm, as in SLICOT's AB13DD).
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import NamedTuple

import numpy as np

from controllers.joint.model import JointModel
from controllers.specification import Checked, number
from workbench.arrays import Matrix
from workbench.errors import NumericalError, missing_package

System = tuple[Matrix, Matrix, Matrix, Matrix]
"""Matrices A, B, C and D of a system in continuous time."""


@dataclass(frozen=True)
class Weights(Checked):
    """The weights, all relative to one speed.

    Args:
        speed: Speed w below which the error is made small, in rad/s.
        peak: Largest wanted |S|, M, a ratio.
        floor: Wanted |S| at rest, f, a ratio: the controller nearly integrates.
        input_size: Size r of the command that weighs as much as an error, in w^2 per rad.
        roll_off: Frequency above which |T| is made small, k, in units of the speed.
        complementary_peak: Largest wanted |T|, M', a ratio.
        complementary_floor: Wanted |T| at high frequency, f', a ratio.
        disturbance: Disturbing acceleration that weighs as much as a change of the reference, in
            w^2 per rad.
        beside: Error of a measurement that nobody follows, over a change of a reference, a ratio.
        paces: Speed for each output over the speed, ratios; alike by default.
    """

    speed: float = number(MISSING, 0.1, 1e3, "rad/s", "speed of the performance weight")
    peak: float = number(2.0, 1.0, 10.0, words="peak of the performance weight")
    floor: float = number(1e-3, 1e-9, 0.5, words="floor of the performance weight")
    input_size: float = number(8.0, 1e-3, 1e6, words="size of the input")
    roll_off: float = number(3.0, 1.0, 100.0, words="roll-off of the robustness weight")
    complementary_peak: float = number(1.6, 1.0, 10.0, words="peak of the robustness weight")
    complementary_floor: float = number(0.1, 1e-6, 0.5, words="floor of the robustness weight")
    disturbance: float = number(0.3, 1e-6, 1e3, words="size of the disturbance")
    beside: float = number(0.1, 1e-6, 1e3, words="error of a further measurement")
    paces: tuple[float, ...] = ()

    def performance(self, pace: float = 1.0) -> System:
        """Return W1 of an output whose pace over the speed is a ratio."""
        w = pace * self.speed
        return _first_order(1.0 / self.peak, w, 1.0, self.floor * w)

    def input_weight(self) -> float:
        """Return W2, in rad per rad/s2."""
        return 1.0 / (self.input_size * self.speed**2)

    def robustness(self, pace: float = 1.0) -> System:
        """Return W3 of an output whose pace over the speed is a ratio."""
        edge = self.roll_off * pace * self.speed
        return _first_order(1.0, edge / self.complementary_peak, self.complementary_floor, edge)


class Synthesis(NamedTuple):
    """A synthesised controller.

    Args:
        A: State matrix of the sampled controller, shape (n, n).
        B: From the errors, of a joint in rad, shape (n, p).
        C: To the commands, of a joint in rad/s2, shape (m, n).
        D: Direct gain, of a joint in rad/s2 per rad, shape (m, p).
        continuous: The same before Tustin's rule.
        gamma: Least norm that the synthesis found, a ratio.
        norm: Norm with the controller of reduced order, a ratio.
        full_order: Order before the reduction (dimensionless).
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    continuous: System
    gamma: float
    norm: float
    full_order: int


def synthesise(
    plant: System,
    weights: Weights,
    *,
    followed: int | None = None,
    tolerance: float = 0.03,
    closely: float = 1e-8,
    sample_time: float = 0.002,
) -> Synthesis:
    """Synthesise the controller of least weighted norm, reduce its order and sample it.

    Args:
        plant: From (disturbances, commands) to the outputs, no direct path; about as large as a
            double integrator at the speed of the weights.
        followed: How many outputs are led to references, the first; all by default.
        tolerance: How much larger the norm may become by the reduction, a fraction.
        closely: How closely the least norm is found, as a fraction of it.
        sample_time: Time between samples, in s.

    Raises:
        NumericalError: If there is no stabilising controller, or no stable one.
    """
    require_slycot()
    h = sample_time
    generalised = generalised_plant(plant, weights, followed)
    try:
        ways = plant[1].shape[1] // 2, len(plant[2])
        gamma, least = _least(generalised, ways, closely)
        enough = (1.0 + tolerance) * gamma
        # At the least norm the controller has poles towards infinity, and rounding decides on them;
        # a little above it they are finite.
        for back_off in (0.0, 0.01, 0.02, 0.05, 0.1, 0.2):
            above = (1.0 + back_off) * gamma
            whole = least if back_off == 0.0 else _central(generalised, ways, above)
            found, norm = _reduced(whole, generalised, enough, 2.0 / h)
            if norm <= enough:
                break
        else:
            raise NumericalError(
                f"without its fast poles the H-infinity controller has a norm of {norm:.3g} instead"
                f" of {gamma:.3g}; take a smaller speed or a smaller sample time"
            )
    except (RuntimeError, ValueError, ArithmeticError) as error:
        if isinstance(error, NumericalError):
            raise
        said = " ".join(str(error).split())
        raise NumericalError(
            f"no H-infinity controller was found for a speed of {weights.speed:g} rad/s ({said});"
            " take another speed or a smaller disturbance"
        ) from None
    from scipy.signal import cont2discrete

    sampled: System = cont2discrete(found, h, "bilinear")[:4]
    return Synthesis(*sampled, found, gamma, norm, len(whole[0]))


def has_slycot() -> bool:
    """Tell whether slycot is installed."""
    return importlib.util.find_spec("slycot") is not None


def require_slycot() -> None:
    """Say how to install slycot where it is absent."""
    if not has_slycot():
        raise missing_package("the H-infinity synthesis", "slycot", "hinf", "take another family")


def joint_behind_pressure_loop(joint: JointModel, inner_bandwidth: float, delay: float) -> System:
    """Build the plant from (disturbing acceleration, command) to the angle.

    The pressure loop has a bandwidth v in rad/s, sample, converter and spool a delay in s.
    """
    v, p = inner_bandwidth, 2.0 / delay
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-joint.a0, -joint.a1, 1.0, 0.0],
            [0.0, -joint.e * joint.b, -v, 2.0 * v],
            [0.0, 0.0, 0.0, -p],
        ]
    )
    B = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, -v], [0.0, p]])
    return A, B, np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 2))


def generalised_plant(plant: System, weights: Weights, followed: int | None = None) -> System:
    """Join plant and weights, one for each followed output: from (n, d, u) to (z1, z2, z3, y).

    Measurements behind the followed ones have errors of their own, behind d.
    """
    A, B, C, _ = plant
    (sensors, n), m = C.shape, B.shape[1] // 2
    p = sensors if followed is None else followed
    first, others = C[:p], sensors - p
    one, square, none = np.eye(p), np.zeros((p, p)), np.zeros((others, p))
    paces = weights.paces or (1.0,) * p
    (a1, b1, c1, d1), (a3, b3, c3, d3) = (
        (np.diag(np.ravel(part)) for part in zip(*map(weight, paces), strict=True))
        for weight in (weights.performance, weights.robustness)
    )
    whole = np.block(
        [[A, np.zeros((n, 2 * p))], [-b1 @ first, a1, square], [b3 @ first, square, a3]]
    )
    entries = np.zeros((n + 2 * p, sensors + 2 * m))
    entries[n : n + p, :p] = b1
    entries[:n, p : p + m] = B[:, :m] * weights.disturbance * weights.speed**2
    entries[:n, sensors + m :] = B[:, m:]
    outputs = np.block(
        [
            [-d1 @ first, c1, square],
            [np.zeros((m, n + 2 * p))],
            [d3 @ first, square, c3],
            [-first, square, square],
            [-C[p:], none, none],
        ]
    )
    direct = np.zeros((2 * p + m + sensors, sensors + 2 * m))
    direct[:p, :p], direct[2 * p + m : 3 * p + m, :p] = d1, one
    direct[p : p + m, sensors + m :] = weights.input_weight() * np.eye(m)
    direct[3 * p + m :, p + m : sensors + m] = weights.beside * np.eye(others)
    return whole, entries, outputs, direct


def _norm(generalised: System, controller: System) -> float:
    """Compute the norm from (n, d) to (z1, z2, z3), a ratio; infinite if the loop is not stable."""
    import slycot

    (_, B, C, D), (_, b, c, d) = generalised, controller
    z, w = len(C) - d.shape[1], B.shape[1] - d.shape[0]
    Bw, Bu, Cz, Cy = B[:, :w], B[:, w:], C[:z], C[z:]
    Dzw, Dzu, Dyw = D[:z, :w], D[:z, w:], D[z:, :w]
    closed = _closed(generalised, controller)
    if np.max(np.linalg.eigvals(closed).real) >= 0.0:
        return float("inf")
    entry = np.vstack([Bw + Bu @ d @ Dyw, b @ Dyw])
    out = np.hstack([Cz + Dzu @ d @ Cy, Dzu @ c])
    direct = Dzw + Dzu @ d @ Dyw
    identity = np.eye(len(closed))
    ways = len(closed), w, z
    return float(slycot.ab13dd("C", "I", "S", "D", *ways, closed, identity, entry, out, direct)[0])


def _reduced(
    whole: System, generalised: System, enough: float, fastest: float
) -> tuple[System, float]:
    """Return the controller of least order whose norm is enough, else the largest; and its norm."""
    slow = _without_fast_poles(whole, fastest)
    for found in _truncated(slow):
        norm = _norm(generalised, found)
        if norm <= enough:
            return found, norm
    return slow, _norm(generalised, slow)


def _least(generalised: System, ways: tuple[int, int], closely: float) -> tuple[float, System]:
    """Return the least norm, a ratio, with which a controller is found, and that controller.

    Raises:
        ArithmeticError: If there is none.
    """
    low, high, found = 0.0, 1.0, None
    while found is None or high - low > closely * high:
        tried = high if found is None else 0.5 * (low + high)
        try:
            found, high = _central(generalised, ways, tried), tried
        except ArithmeticError:
            if tried > LARGEST:
                raise
            low, high = tried, 4.0 * high if found is None else high
    return high, found


LARGEST = 1e9
"""Largest norm that is looked for."""


def _central(generalised: System, ways: tuple[int, int], gamma: float) -> System:
    """Return the central controller with a norm below ``gamma``, of so many commands and outputs.

    Raises:
        ArithmeticError: If there is none that makes the loop stable.
    """
    import slycot

    A, B, C, _ = generalised
    m, p = ways
    found: System = slycot.sb10fd(len(A), B.shape[1], len(C), m, p, gamma, *generalised)[:4]
    if np.max(np.linalg.eigvals(_closed(generalised, found)).real) >= 0.0:
        raise ArithmeticError("the closed loop is not stable")
    return found


def _closed(generalised: System, controller: System) -> Matrix:
    """Return the state matrix of a loop; y has no direct path from u, so it needs no inverse."""
    A, B, C, _ = generalised
    a, b, c, d = controller
    Bu, Cy = B[:, -d.shape[0] :], C[-d.shape[1] :]
    return np.block([[A + Bu @ d @ Cy, Bu @ c], [b @ Cy, a]])


def _first_order(b1: float, b0: float, a1: float, a0: float) -> System:
    """Return (b1 s + b0) / (a1 s + a0)."""
    pole, direct = a0 / a1, b1 / a1
    gain = b0 / a1 - direct * pole
    return np.array([[-pole]]), np.array([[1.0]]), np.array([[gain]]), np.array([[direct]])


def _without_fast_poles(system: System, fastest: float) -> System:
    """Replace modes beyond a speed by their static gain."""
    from scipy.linalg import block_diag, schur, solve_sylvester

    A, B, C, D = system
    T, Z, slow = schur(A, output="real", sort=lambda re, im: np.hypot(re, im) < fastest)
    if np.max(np.linalg.eigvals(A).real) >= 0.0:
        raise NumericalError(
            "the H-infinity controller is not stable by itself; take a smaller speed"
        )
    # Decouple the slow block from the fast one, then put the fast one to rest.
    X = solve_sylvester(T[:slow, :slow], -T[slow:, slow:], -T[:slow, slow:])
    n = len(A)
    turn = Z @ np.block([[np.eye(slow), X], [np.zeros((n - slow, slow)), np.eye(n - slow)]])
    blocks = block_diag(T[:slow, :slow], T[slow:, slow:])
    b, c = np.linalg.solve(turn, B), C @ turn
    rest = D - c[:, slow:] @ np.linalg.solve(blocks[slow:, slow:], b[slow:])
    return blocks[:slow, :slow], b[:slow], c[:, :slow], rest


def _truncated(system: System) -> Iterator[System]:
    """Yield the balanced truncations of a stable system, from order 1 (square-root method)."""
    import slycot

    A, B, C, D = system
    told = "C", "B", "S", len(A), B.shape[1], len(C), A, B, C
    # What nothing reaches or shows has no place in a balanced order.
    most = slycot.ab09ad(*told)[0]
    for order in range(1, min(most + 1, len(A))):
        yield *slycot.ab09ad(*told, nr=order)[1:4], D
