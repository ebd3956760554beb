"""Linear systems of python-control and ``scipy.signal`` as models."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from workbench.arrays import Complex, Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_choice, check_finite, check_range
from workbench.model.model import Model
from workbench.model.quantities import Input, Output, Parameter, State
from workbench.model.scope import Scope
from workbench.model.sizes import poles_of
from workbench.model.trace import Equations
from workbench.model.traits import Traits

Rows = tuple[tuple[float, ...], ...]
Entry = tuple[str, int, int]
Limits = Mapping[str, tuple[float, float] | float] | float | None


@dataclass(frozen=True)
class LinearEquations:
    """Equations of a linear system in the language of plants; numbers only, so they pickle.

    Args:
        A: State matrix, in SI.
        B: Input matrix, in SI.
        C: Output matrix, in SI.
        D: Feedthrough, in SI.
        sample_time: Time between the samples that the system was given by, in s; 0 if continuous.
        late: Whether states between others stand for a delay.
        delays: Time by which each output is late behind each input, in s, by a Pade function; none
            if empty.
        free: Coefficients that are parameters of the model: matrix, row and column, from 0 on.
    """

    A: Rows
    B: Rows
    C: Rows
    D: Rows
    names: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]
    sample_time: float = 0.0
    late: bool = False
    delays: Rows = ()
    free: tuple[Entry, ...] = ()

    def __call__(self, m: Scope) -> Equations:
        """Write down ``dx/dt = A x + B u``, ``y = C x + D u``."""
        states, inputs, outputs = self.names
        x = [getattr(m.x, name) for name in states]
        u = [getattr(m.u, name) for name in inputs]
        free = {entry: getattr(m.p, _coefficient(entry)) for entry in self.free}

        def row(i: int, *matrices: str) -> Any:
            terms = [
                free.get((name, i, j), a) * v
                for name, signals in zip(matrices, (x, u), strict=True)
                for j, (a, v) in enumerate(zip(getattr(self, name)[i], signals, strict=True))
                if a
            ]
            return sum(terms[1:], start=terms[0]) if terms else 0.0 * u[0]

        rates = {name: row(i, "A", "B") for i, name in enumerate(states)}
        return rates, {name: row(i, "C", "D") for i, name in enumerate(outputs)}

    @property
    def matrices(self) -> Parts:
        """A, B, C and D, shapes (n, n), (n, m), (p, n) and (p, m), in SI."""
        n, m, p = map(len, self.names)
        A, B, C, D = (np.array(rows, dtype=float) for rows in (self.A, self.B, self.C, self.D))
        return A.reshape(n, n), B.reshape(n, m), C.reshape(p, n), D.reshape(p, m)


def _coefficient(entry: Entry) -> str:
    return "{}_{}_{}".format(*entry)


_MOST_FREE = 24
"""Coefficients beyond which a system is a black box: none of them says anything of the machine."""


def with_free_coefficients(model: Model) -> Model:
    """Return a linear system with those of its coefficients as parameters that responses tell.

    What scales a state shows in no response: a coefficient for each state stays as it is, of ones
    rather than others, those that read it rather than those between states. So does a rate that is
    a state, as that of a position, and all of a delay of the commands. Each may be anything from 0
    to twice its value, or to four times where it changes the rate of a position: the product of
    two poles of twice their value is four times theirs. A model that is no linear system or has
    parameters, a system with other delays and one of many coefficients are returned as they are.
    """
    equations = model.equations
    if not isinstance(equations, LinearEquations) or model.parameters or equations.late:
        return model
    entries: dict[Entry, float] = {
        (name, i, j): a
        for name in "CABD"
        for i, row in enumerate(getattr(equations, name))
        for j, a in enumerate(row)
        if abs(a) > _NOTHING * max(map(abs, row))
    }
    ones = {e for e, a in entries.items() if math.isclose(abs(a), 1.0)}
    passing = {k for k, q in enumerate(model.states) if q.name in model.traits.passing}
    # Kruskal's tree of the states and what is outside: what it holds cannot be told.
    group = list(range(len(model.states) + 1))
    kept = set[Entry]()
    ends = {
        e: {"A": (i, j), "B": (i, -1), "C": (-1, j), "D": (-1, -1)}[name]
        for e in entries
        for name, i, j in (e,)
    }
    rows = [(name, i) for name, i, _ in entries]
    places = {
        e
        for e in ones
        if e[0] == "A" and e[1] != e[2] and rows.count(e[:2]) == 1 and ("B", e[1]) not in rows
    }
    given = places | {e for e in entries if passing & {*ends[e]}}
    speeds = {j for _, _, j in places}
    for entry in sorted(entries, key=lambda e: (e not in given, e not in ones)):
        one, other = (group[end] for end in ends[entry])
        if one != other or entry in given:
            group = [one if g == other else g for g in group]
            kept.add(entry)
    free = tuple(e for e in entries if e not in kept)
    if len(free) > _MOST_FREE:
        return model
    parameters = []
    for e in free:
        most = (4.0 if e[0] in "AB" and e[1] in speeds else 2.0) * entries[e]
        unit = "1/s" if e[0] in "AB" else "1"
        parameters.append(
            Parameter(
                _coefficient(e), unit, value=entries[e],
                lower=min(0.0, most), upper=max(0.0, most), fitted=True,
            )
        )  # fmt: skip
    equations = replace(equations, free=free)
    return replace(model, equations=equations, parameters=tuple(parameters))


def is_system(found: object) -> bool:
    """Tell whether an object is a linear system of python-control or ``scipy.signal``."""
    # What differentiates has no state space and is such a system still.
    return (hasattr(found, "ninputs") or hasattr(found, "to_ss")) and not is_nonlinear(found)


def is_nonlinear(found: object) -> bool:
    """Tell whether an object is a nonlinear system of python-control."""
    return hasattr(found, "updfcn") and not hasattr(found, "A")


def model_of_system(
    system: Any,
    *,
    limits: Limits = None,
    delay: float = 0.0,
) -> Model:
    """Return a linear system as a plant; units and arguments are those of `linear_model`.

    A pole at z = 0 of a sampled system is a delay by a sample, and a pole on the negative axis one
    of two that turn by half a circle in it.
    """
    title = str(getattr(system, "name", "system"))
    # The number that python-control gives differs from run to run, as no baseline may.
    title = "linear system" if title.startswith("sys[") else title
    sampled = getattr(system, "dt", None) or 0.0
    if sampled is True:
        raise WorkbenchError(
            f"system {title!r} is sampled and does not say how often; give its sample time"
            " (dt), in s, or the continuous plant"
        )
    late = check_range("delay", delay, 0.0, TIMES_S[1], "s")
    given = proper_system(system, "the plant of a design")
    named: Any = system if hasattr(system, "input_labels") else given
    inputs, outputs = signal_names(named.input_labels), signal_names(named.output_labels)
    called = {f"{name}_0": name for name in ("u", "y") if name in (*inputs, *outputs)}
    told = dict.fromkeys(inputs, limits) if isinstance(limits, (int, float)) else limits or {}
    ends = {
        called.get(_plain(n), _plain(n)): (-own, own) if isinstance(own, (int, float)) else own
        for n, own in told.items()
    }
    for name in ends:
        check_choice("name of a limited signal", name, (*inputs, *outputs))
        if not ends[name][0] < ends[name][1]:
            raise WorkbenchError(
                f"limits of {name} are {ends[name][0]:g} and {ends[name][1]:g}; give the lower end"
                " and then the upper one"
            )
    parts = _parts(given)
    delays = np.zeros((len(outputs), len(inputs))) + late + getattr(system, "delays", 0.0)
    if sampled:
        parts, behind = _continuous(system, parts, float(sampled))
        delays = delays + behind
    grown = len(parts[0]) > len(given.A)
    passing = getattr(system, "passing", 0)
    if late:
        before = late_by((late,) * len(inputs))
        parts, passing = in_series(parts, before), passing + len(before[0])
    A, B, C, D = parts
    states = labels(given.state_labels)
    if len(states) != len(A):
        states = tuple(f"x_{i}" for i in range(len(A)))
    infinite = (-math.inf, math.inf)
    model = Model(
        _plain(title),
        LinearEquations(
            _rows(A),
            _rows(B),
            _rows(C),
            _rows(D),
            (states, inputs, outputs),
            float(sampled),
            late=grown or getattr(system, "late", False),
            delays=_rows(delays) if delays.any() else (),
        ),
        states=tuple(State(name, "1") for name in states),
        inputs=tuple(
            Input(n, "1", _scale(n, ends) or 1.0, lower=low, upper=high, sized=n in ends)
            for n in inputs
            for low, high in (ends.get(n, infinite),)
        ),
        outputs=tuple(
            Output(n, "1", _scale(n, ends), lower=low, upper=high)
            for n in outputs
            for low, high in (ends.get(n, infinite),)
        ),
        description="linear system",
        traits=Traits(passing=states[len(states) - passing :]),
    )
    size = np.array([q.scale or 1.0 for q in model.states])
    a = A * size / size[:, None]

    def read(q: Output, row: Vector) -> Output:
        """Return an output; one that integrates goes anywhere, and counts by its unit at most."""
        seen, _ = reached(a.T, (row * size)[:, None])
        endless = not q.sized and np.any(poles_of(seen.T @ a @ seen) == 0.0)
        return replace(q, scale=min(q.scale, 1.0)) if endless else q

    return replace(model, outputs=tuple(map(read, model.outputs, C)))


def proper_system(system: Any, what: str) -> Any:
    """Return a system of python-control or ``scipy.signal`` as a ``control.StateSpace``.

    Args:
        what: What it is, as the user knows it.

    Raises:
        WorkbenchError: If it is none, or has no state space since it differentiates.

    Example:
        >>> import scipy.signal
        >>> proper_system(scipy.signal.lti([2.0], [1.0, 3.0]), "the plant").A.tolist()
        [[-3.0]]
    """
    import control as ct

    scipys = type(system).__module__.startswith("scipy.signal")
    if not scipys and not isinstance(system, (ct.StateSpace, ct.TransferFunction)):
        raise WorkbenchError(
            f"{what} is a {type(system).__name__}; give a LinearModel, or a python-control"
            " StateSpace or TransferFunction"
        )
    told = {letter: f"matrix {letter}" for letter in "ABCD"}
    for part, called in (told | {"num": "the numerator", "den": "the denominator"}).items():
        held = getattr(system, part, ())
        nested = isinstance(held, list) or np.asarray(held).dtype.hasobject
        each = [p for row in held for p in row] if nested else [held]
        check_finite(f"{called} of {what}", np.concatenate([np.ravel(p) for p in each]))
    try:
        if not scipys:
            fraction = isinstance(system, ct.TransferFunction) and not system.dt
            parts: Parts | None = None
            if fraction and system.issiso():
                parts = _in_motion(system.num[0][0], system.den[0][0])
            elif fraction and np.any(system.poles().real >= 0.0):
                # What integrates twice is two rates that are not quite zero by other ways.
                pairs = zip(system.num, system.den, strict=True)
                rows = [[[Late(*t)] for t in zip(*pair, strict=True)] for pair in pairs]
                parts = _parts(late_system(rows, what))
            if parts is None:
                return ct.ss(system)
            names = {"inputs": system.input_labels, "outputs": system.output_labels}
            return ct.ss(*parts, name=system.name, **names)
        given = system.to_ss()
    except ValueError as error:
        raise WorkbenchError(
            f"{what} has no state space ({error}); if it differentiates, add the lag of its filter"
        ) from None
    return ct.ss(given.A, given.B, given.C, given.D, given.dt or 0)


Parts = tuple[Matrix, Matrix, Matrix, Matrix]


def _in_motion(num: Vector, den: Vector) -> Parts | None:
    """Return a transfer function as a speed and its place, as laws of motion ask for, behind lags.

    The slowest two poles are the motion. Of a pole at 0 and a pair, such as those of a cylinder, a
    force moves it that its speed takes away. The other poles lead to what moves it. At rest the
    output is the place.

    Args:
        num: Coefficients, highest powers of s (in rad/s) first, shape (m,).
        den: The same of the denominator, shape (n,).

    Returns:
        The matrices, the place behind its speed, the lags last; None for one of first order, or
        with more zeros than the motion has poles.
    """
    from scipy.signal import tf2ss

    num, den = (np.trim_zeros(np.asarray(part, dtype=float), "f") for part in (num, den))
    poles = np.array(sorted(np.roots(den), key=lambda p: (abs(p), p.imag)))
    turning = np.abs(poles.imag) > _NOTHING * np.abs(poles)
    size, first = 2, 0
    if len(poles) > 2 and turning[1] and not turning[0]:
        size, first = (3, 0) if poles[0] == 0.0 else (2, 1)
    moved = slice(first, first + size)
    before = np.delete(poles, moved)
    if not 1 < len(poles) >= size >= len(num) - 1 or not before.all():
        return None
    gain = num / den[0] / np.real(np.prod(-before))
    A, B, C, D = tf2ss(gain, np.real(np.poly(poles[moved])))
    sizes = np.ones(size) / (gain[-1] or 1.0)
    if size == 3:
        # The force is of the size of the speed, and no rate that is known already.
        pace = float(abs(poles[1]))
        sizes[0] *= pace if pace != 1.0 else 2.0
    whole: Parts = A * sizes / sizes[:, None], B / sizes[:, None], C * sizes, D
    none = np.zeros((1, 1))
    for pole in before[before.imag >= 0.0]:
        rate, pace = float(pole.real), abs(pole)
        own = np.array([[rate]]), np.array([[-rate]]), np.eye(1), none
        if pole.imag:
            turning_by = np.array([[2.0 * rate, -pace], [pace, 0.0]])
            own = turning_by, np.array([[pace], [0.0]]), np.array([[0.0, 1.0]]), none
        whole = in_series(whole, own)
    return whole


class Late(NamedTuple):
    """A transfer function behind a delay.

    Args:
        num: Coefficients, highest powers of s (in rad/s) first, shape (m,).
        den: The same of the denominator, shape (n,).
        delay: How late it is, in s.
    """

    num: Vector
    den: Vector
    delay: float = 0.0


def late_system(rows: Sequence[Sequence[Sequence[Late]]], what: str) -> Any:
    """Return a matrix of sums of transfer functions as a ``control.StateSpace``.

    Common factors are taken out of each; delays are by Pade functions, that by which all that a
    command does is late once for all outputs.

    Args:
        rows: For each output, for each command, the terms of the sum.
        what: What it is, as the user knows it.

    Raises:
        WorkbenchError: If one differentiates.

    Example:
        >>> lag = np.array([1.0]), np.array([2.0, 1.0])
        >>> late_system([[[Late(*lag), Late(*lag, delay=0.1)]]], "the plant").nstates
        5
    """
    import control as ct

    common = [min(t.delay for entry in column for t in entry) for column in zip(*rows, strict=True)]
    table: list[Parts] = []
    for row in rows:
        entries = []
        for entry, least in zip(row, common, strict=True):
            whole: Parts | None = None
            for term in entry:
                quotient = ct.minreal(ct.tf(term.num, term.den), verbose=False)
                late = late_by((term.delay - least,))
                one = in_series(_parts(proper_system(quotient, what)), late)
                whole = _beside(whole, one) if whole is not None else one
            assert whole is not None
            entries.append(whole)
        table.append(_block(entries, stacked=False))
    apart = any(
        term.delay > least
        for row in rows for entry, least in zip(row, common, strict=True) for term in entry
    )  # fmt: skip
    whole = _block(table, stacked=True)
    # Among delays, integrators may stand there twice, lest these be no longer seen as such.
    if not apart or np.linalg.eigvals(whole[0]).real.max() > _SAME_POLE * np.abs(whole[0]).max():
        whole = _growing_once(whole)
    found = ct.ss(*in_series(whole, late_by(common)), name="linear system")
    found.late = apart
    found.passing = len(late_by(common)[0])
    found.delays = np.array([[max(t.delay for t in entry) for entry in row] for row in rows])
    return found


def _growing_once(parts: Parts) -> Parts:
    """Return a system in which what grows or integrates in several entries does so once.

    A cart and its pendulum have their poles in common; of a copy for each, no command moves the
    difference. What fades may stand there twice.

    Source: canonical structure of Kalman, by the ranks of controllability and observability.
    """
    from scipy.linalg import schur, solve_sylvester

    A, B, C, D = parts
    poles = np.linalg.eigvals(A)
    still = -_SAME_POLE * max(float(np.abs(poles).max(initial=0.0)), 1e-300)
    if np.count_nonzero(poles.real >= still) < 2:
        return parts
    T, Z, k = schur(A, output="real", sort=lambda real, imaginary: real >= still)
    X = solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:])
    b, c = Z.T @ B, C @ Z
    own: Parts = T[:k, :k], b[:k] - X @ b[k:], c[:, :k], np.zeros_like(D)
    for transposed in (False, True):
        a, entry, shown, none = own
        a, entry, shown = (a.T, shown.T, entry.T) if transposed else (a, entry, shown)
        basis, _ = reached(a, entry, unseen=_SAME_POLE)
        a, entry, shown = basis.T @ a @ basis, basis.T @ entry, shown @ basis
        own = (a.T, shown.T, entry.T, none) if transposed else (a, entry, shown, none)
    if len(own[0]) == k:
        return parts
    fading: Parts = T[k:, k:], b[k:], c[:, :k] @ X + c[:, k:], D
    return _beside(own, fading)


_SAME_POLE = 1e-6
"""Distance of two poles, over the largest, up to which they are one."""


def _parts(system: Any) -> Parts:
    A, B, C, D = (np.asarray(getattr(system, name), dtype=float) for name in "ABCD")
    return A, B, C, D


UNSEEN = 1e-10
"""What rounding may leave of a direction that a matrix does not lead to, relative to the rest."""


def reached(A: Matrix, B: Matrix, *, unseen: float = UNSEEN) -> tuple[Matrix, Matrix]:
    """Return orthonormal bases of what inputs move by way of a state matrix, and of the rest.

    Args:
        A: Shape (n, n), of states that are comparable in size.
        B: Shape (n, m).
        unseen: Share of a direction that may be left where it is one of those before,
            dimensionless.

    Source: Saad, Iterative Methods for Sparse Linear Systems, 2003, section 6.3 (Arnoldi).

    Example:
        >>> moved, still = reached(np.diag([-1.0, -2.0, -3.0]), np.array([[1.0], [1.0], [0.0]]))
        >>> moved.shape, still.ravel()
        ((3, 2), array([0., 0., 1.]))
    """
    found = np.zeros((len(A), 0))
    waiting = list(B.T)
    while waiting:
        v = waiting.pop(0)
        whole = np.linalg.norm(v)
        for _ in range(2):
            v = v - found @ (found.T @ v)
        if np.linalg.norm(v) > unseen * whole:
            found = np.column_stack([found, v / np.linalg.norm(v)])
            waiting.append(A @ found[:, -1])
    n = found.shape[1]
    return found, np.linalg.qr(found, mode="complete")[0][:, n:]


def before_hold(a: Matrix, b: Matrix, sample_time: float) -> tuple[Matrix, Matrix]:
    """Return the continuous matrices, in SI, of which a sampled model with held inputs is made.

    Of those with the same samples it is the one that swings least in between; each pole on the
    negative real axis has one more state, with which it turns by half a circle.

    Args:
        a: Shape (n, n), dimensionless, without a pole at 0.
        b: Shape (n, m), in SI.
        sample_time: Time between samples, in s.

    Source:
        Åström and Wittenmark, Computer-Controlled Systems, 1997, section 2.3 (inverse of sampling).

    Example:
        >>> A, B = before_hold(np.array([[-0.5]]), np.array([[1.5]]), 0.1)
        >>> from scipy.linalg import expm
        >>> bool(np.allclose(expm(0.1 * A), -0.5 * np.eye(2)))
        True
    """
    from scipy.linalg import eig, logm

    n, m = b.shape
    whole = np.vstack([np.hstack([a, b]), np.hstack([np.zeros((m, n)), np.eye(m)])])
    poles, left, right = eig(whole, left=True)
    turning = np.flatnonzero((poles.real < 0.0) & (np.abs(np.angle(-poles)) < _TURNING))
    rows = [left[:, k].real / (left[:, k].real @ right[:, k].real) for k in turning]
    columns = [right[:, k].real for k in turning]
    for k, row, column in zip(turning, rows, columns, strict=True):
        whole = whole - 2.0 * poles[k].real * np.outer(column, row)
    rates = np.real(logm(whole))
    more = len(turning)
    A, B = np.zeros((n + more, n + more)), np.zeros((n + more, m))
    A[:n, :n], B[:n] = rates[:n, :n], rates[:n, n:]
    for i, (k, row, column) in enumerate(zip(turning, rows, columns, strict=True), start=n):
        A[:n, i], A[i, :n], A[i, i] = -np.pi * column[:n], np.pi * row[:n], np.log(-poles[k].real)
        B[i] = np.pi * row[n:]
    return A / sample_time, B / sample_time


_TURNING = 1e-6
"""Angle, in rad, from the negative axis within which a pole lies on it."""

_NOTHING = 1e-12
"""Coefficient of a polynomial that is zero, over the largest."""


def _continuous(system: Any, parts: Parts, h: float) -> tuple[Parts, Matrix]:
    """Return a continuous system with the samples of one with held inputs, and its delays, in s.

    Whole samples by which an output is late are delays by Pade functions; what answers within some
    samples and is then gone is a sum of held inputs that are late.
    """
    import control as ct

    A, B, C, D = parts
    entries: list[list[tuple[int, Vector, Vector, tuple[float, ...]] | None]] = []
    if np.min(np.abs(np.linalg.eigvals(A)), initial=1.0) < _GONE:
        table = ct.tf(system if hasattr(system, "ninputs") else ct.ss(*parts, h))
        entries = [
            [_without_delay(*pair) for pair in zip(*rows, strict=True)]
            for rows in zip(table.num, table.den, strict=True)
        ]
    if not any(entry and (entry[0] or entry[3]) for row in entries for entry in row):
        a, b = before_hold(A, B, h)
        return (a, b, np.hstack([C, np.zeros((len(C), len(a) - len(A)))]), D), np.zeros(D.shape)
    common = [min((e[0] for e in column if e), default=0) for column in zip(*entries, strict=True)]
    rows: list[Parts] = []
    for row in entries:
        columns = []
        for j, entry in enumerate(row):
            whole: Parts = (
                np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 1)),
            )  # fmt: skip
            if entry:
                late, num, den, taps = entry
                slow = _parts(ct.ss(ct.tf(num, den, h)))
                a, b = before_hold(slow[0], slow[1], h)
                c = np.hstack([slow[2], np.zeros((1, len(a) - len(slow[0])))])
                whole = a, b, c, slow[3]
                for k, tap in enumerate(taps, start=1):
                    if tap:
                        held = late_by(((k - 0.5) * h,))
                        whole = _beside(whole, (held[0], held[1], tap * held[2], tap * held[3]))
                whole = in_series(whole, late_by(((late - common[j]) * h,)))
            columns.append(whole)
        rows.append(_block(columns, stacked=False))
    delays = np.array([[(e[0] + len(e[3])) * h if e else 0.0 for e in row] for row in entries])
    return in_series(_block(rows, stacked=True), late_by([k * h for k in common])), delays


_GONE = 0.2
"""Pole, in the unit circle, below which it may be one of several at z = 0 that rounding moved."""


def _without_delay(
    num: Vector, den: Vector
) -> tuple[int, Vector, Vector, tuple[float, ...]] | None:
    """Split a sampled transfer function z^-late (N / D + sum of taps z^-k), k = 1, 2, ...

    Returns:
        late, in samples, N, D without a root at 0, and taps; None if it is zero.
    """
    num, den = (np.trim_zeros(np.asarray(part, dtype=float), "f") for part in (num, den))
    num = np.trim_zeros(
        np.where(np.abs(num) > _NOTHING * np.abs(num).max(initial=0.0), num, 0.0), "f"
    )
    if not len(num):
        return None
    small = np.abs(den) <= _NOTHING * np.abs(den).max()
    at_zero = int(np.argmax(~small[::-1]))
    kept = den[: len(den) - at_zero]
    # Held inputs are late by a sample anyway, if they do not act at once.
    late = min(at_zero, max(len(den) - len(num) - 1, 0))
    left = at_zero - late
    if not left:
        return late, num, kept, ()
    # num / kept = c_0 + c_1 z + ..., by long division from the lowest powers up.
    rest, c = num[::-1].copy(), []
    rest = np.append(rest, np.zeros(max(0, left + len(kept) - len(rest))))
    for k in range(left):
        c.append(rest[k] / kept[-1])
        rest[k : k + len(kept)] -= c[-1] * kept[::-1]
    remainder = np.trim_zeros(rest[left:][::-1], "f")
    return late, remainder if len(remainder) else np.zeros(1), kept, tuple(c[::-1])


PADE_ABOVE, PADE_BELOW = np.array([3.0, -24.0, 60.0]), np.array([9.0, 36.0, 60.0])
"""Pade function of a delay of 1 s: the second in 1/s, 1/s^2 and 1/s^3 below s^3."""


def late_by(times: Sequence[float]) -> Parts:
    """Return signals that are late by times in s, by the Pade function of second over third order.

    Its states are as large as the signal, and the last of them is it at rest.

    Source: H. Pade 1892.
    """
    from scipy.linalg import block_diag

    one = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
    a = np.diag(PADE_BELOW[1:] / PADE_BELOW[:-1], -1)
    a[0] = -PADE_BELOW[0]
    b, c = np.array([[PADE_BELOW[0]], [0.0], [0.0]]), (PADE_ABOVE / PADE_BELOW)[None]
    each = [(a / t, b / t, c, np.zeros((1, 1))) if t else one for t in times]
    A, B, C, D = (block_diag(*part) for part in zip(*each, strict=True))
    return A, B, C, D


def pade(turn: npt.ArrayLike) -> tuple[Complex, Vector]:
    """Return the Pade function of a delay at frequencies, and by how much less it turns, in rad.

    Args:
        turn: What the delay turns, its time by the frequency, in rad, any shape.

    Example:
        >>> value, less = pade(6.0)
        >>> float(abs(value).round(2)), float(less.round(2))
        (0.57, 0.97)
    """
    s = 1j * np.asarray(turn)
    above, below = np.polyval(PADE_ABOVE, s), np.polyval([1.0, *PADE_BELOW], s)
    # Both turn one way, by less than a circle.
    left = np.mod(-np.angle(above), 2.0 * np.pi) + np.mod(np.angle(below), 2.0 * np.pi)
    return above / below, np.asarray(turn - left)


def in_series(system: Parts, before: Parts) -> Parts:
    """Return a system behind another that leads to its inputs."""
    (A, B, C, D), (a, b, c, d) = system, before
    whole = np.block([[A, B @ c], [np.zeros((len(a), len(A))), a]])
    return whole, np.vstack([B @ d, b]), np.hstack([C, D @ c]), D @ d


def _beside(one: Parts, other: Parts) -> Parts:
    """Return the sum of two systems of the same inputs and outputs."""
    (A, B, C, D), (a, b, c, d) = one, other
    whole = np.block([[A, np.zeros((len(A), len(a)))], [np.zeros((len(a), len(A))), a]])
    return whole, np.vstack([B, b]), np.hstack([C, c]), D + d


def _block(each: Sequence[Parts], *, stacked: bool) -> Parts:
    """Return systems side by side: of the same inputs (stacked), or of the same outputs."""
    from scipy.linalg import block_diag

    A, B, C, D = zip(*each, strict=True)
    if stacked:
        return block_diag(*A), np.vstack(B), block_diag(*C), np.vstack(D)
    return block_diag(*A), block_diag(*B), np.hstack(C), np.hstack(D)


def _rows(matrix: Vector) -> Rows:
    return tuple(tuple(row) for row in matrix.tolist())


def labels(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of signals as those of a plant: ``x[0]`` is ``x_0``."""
    return tuple(_plain(name) for name in names)


def signal_names(given: Sequence[str]) -> tuple[str, ...]:
    """Return names of inputs or outputs; of one that python-control has numbered, the letter."""
    return labels([given[0].removesuffix("[0]")] if len(given) == 1 else given)


def _plain(label: str) -> str:
    return re.sub(r"\W+", "_", label).strip("_") or "system"


def _scale(name: str, limits: Mapping[str, Sequence[float]]) -> float:
    """Return half of the range of a signal; 0, which leaves it to the equations, without one."""
    low, high = limits.get(name, (0.0, 0.0))
    return (high - low) / 2.0 if math.isfinite(high - low) else 0.0
