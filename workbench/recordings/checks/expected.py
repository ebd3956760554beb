"""What is known about a machine before its recording is judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model.sizes import horizon
from workbench.recordings.recording import Recording

if TYPE_CHECKING:
    from workbench.model import Input, Model, Output, State


_MANY = 10.0
"""Time constants of an unstable mode along a recording beyond which a loop must have held it."""

_LOOKS = 5
"""Points along a recording at which a response must have the sign that it has at the start."""


@dataclass(frozen=True)
class Expected:
    """What the notes of an experiment and a model say about a recording.

    Args:
        required: Signals that must be fit; the others only get a note.
        sample_rate_Hz: Rate in the notes of the experiment; None if unknown.
        ranges: Smallest and largest plausible value by signal, in SI.
        reach: The same of a state that an output without range reads, such as an angle between
            stops, in SI.
        signs: Sign of the response to a cause, by (cause, response).
        scales: Typical size by signal, in SI.
        believed: Signals whose typical size somebody declared, or that of the state which they
            read; of others the inputs' ranges tell how far they may go, not how far they do go.
        speed: Middle one of the magnitudes of the model's eigenvalues, in rad/s; NaN if unknown.
        unstable: Whether only a loop can have held the machine where it was.
        moves: How far a model goes along a recording, over what was measured, dimensionless.
        slopes: How strongly a measured cause accelerates a motion, by (cause, motion), in SI.
    """

    required: tuple[str, ...] = ()
    sample_rate_Hz: float | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    signs: Mapping[tuple[str, str], int] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    speed: float = math.nan
    slopes: Mapping[tuple[str, str], float] = field(default_factory=dict)
    reach: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    believed: frozenset[str] = frozenset()
    unstable: bool = False
    moves: Callable[[Recording], float] = lambda _: 0.0


Point = tuple[Vector, Vector]


def _at_start(model: Model, point: Point | None = None) -> tuple[Vector, ...]:
    """Return A, B, C and D of a model at its start, or at other states and inputs, in SI."""
    x, u = point or (model.initial_state(), model.nominal_input)
    return tuple(np.asarray(m) for m in model.exact.jacobian_function(x, u, model.values))


def _read_states(C: Vector) -> dict[int, int]:
    """Return which state an output reads as it is, by the indices of both."""
    return {i: int(np.flatnonzero(row)[0]) for i, row in enumerate(C) if np.count_nonzero(row) == 1}


def _along(model: Model, recording: Recording) -> list[Point]:
    """Return inputs of a model along a recording, with the start and what was measured of it."""
    *_, C, _ = _at_start(model)
    read = {model.outputs[i].name: (k, C[i, k]) for i, k in _read_states(C).items()}
    points = []
    for k in np.linspace(0, len(recording) - 1, _LOOKS + 2).astype(int)[1:-1]:
        x, u = model.initial_state().copy(), model.nominal_input.copy()
        for name, (at, slope) in read.items():
            if name in recording and math.isfinite(recording[name][k]):
                x[at] = recording[name][k] / slope
        for j, q in enumerate(model.inputs):
            if q.name in recording and math.isfinite(recording[q.name][k]):
                u[j] = recording[q.name][k]
        points.append((x, u))
    return points


def sure_signs(model: Model, recording: Recording) -> dict[tuple[str, str], int]:
    """Return the signs that responses have at the start of a model and all along a recording.

    More of a flow warms a tank or cools it, by the temperature of what flows in: what stands at the
    start in place of an input that nobody declared, zero kelvin, does not tell.
    """
    signs = response_signs(model)
    for point in _along(model, recording):
        slopes = _at_start(model, point)
        # Where an equation has no slope, as one over a pressure read as zero, it tells nothing.
        if all(np.isfinite(m).all() for m in slopes):
            there = response_signs(model, slopes)
            signs = {k: s for k, s in signs.items() if there.get(k) == s}
    return signs


def response_signs(
    model: Model, slopes: Sequence[Vector] | None = None
) -> dict[tuple[str, str], int]:
    """Return the signs of responses that follow from the structure of a model.

    With the linear model (A, B, C, D), by default that at the start, an input u first shows in an
    output y through the first of D, CB, CAB, ... that is not zero; the outputs in which it shows
    earliest count, because all others answer to them, unless they swing twice as far the other way
    afterwards, as the voltage of a boost converter does. A measured state accelerates a measured
    position (a state whose rate is another state) if it stands in its second derivative.
    """
    A, B, C, D = slopes or _at_start(model)
    n = len(model.states)
    signs: dict[tuple[str, str], int] = {}
    for j, cause in enumerate(model.inputs):
        reached, first = D[:, j], B[:, j]
        for _ in range(n + 1):
            if np.any(reached):
                break
            reached, first = C @ first, A @ first
        swings = np.sign(reached) * _pulse(A, B[:, j], C)
        begins = np.where(np.minimum.accumulate(swings) >= 0.0, swings, 0.0).max(axis=0)
        kept = (reached != 0.0) & (2.0 * begins >= -swings.min(axis=0))
        signs |= {
            (cause.name, y.name): int(np.sign(reached[i]))
            for i, y in enumerate(model.outputs)
            if kept[i] or D[i, j]
        }
    return signs | {pair: int(np.sign(slope)) for pair, slope in acceleration_slopes(model).items()}


def _pulse(A: Vector, b: Vector, C: Vector) -> Vector:
    """Return C exp(A t) b at times from a thousandth of the fastest on, shape (n_times, n).

    It ends after three time constants of an unstable mode; without finite slopes it is zero.
    """
    from scipy.linalg import expm

    if not np.isfinite(A).all():
        return np.zeros((1, len(C)))
    poles = np.linalg.eigvals(A).astype(complex)
    longest = min(horizon(poles), 3.0 / max(poles.real.max(initial=0.0), 1e-9))
    first = 1e-3 * min(longest, 1.0 / np.abs(poles).max(initial=1e-9))
    return np.array([C @ expm(A * t) @ b for t in np.geomspace(first, longest, 80)])


def acceleration_slopes(model: Model) -> dict[tuple[str, str], float]:
    """Return how strongly measured states accelerate measured positions, by the model's equations.

    Of positions that nothing accelerates but what is measured.

    Returns:
        Acceleration over cause at the start, in SI, by (cause, motion).
    """
    A, B, C, _ = _at_start(model)
    found: dict[tuple[str, str], float] = {}
    read = {state: i for i, state in _read_states(C).items()}
    twice, position = A @ A, np.count_nonzero(np.hstack([A, B]), axis=1) == 1
    for m, motion in read.items():
        # Where more acts that nobody reads, what is read may go with that.
        unread = (twice[m] != 0) & (A[m] == 0) & ~np.isin(np.arange(len(A)), list(read))
        for c, cause_ in read.items():
            if c != m and position[m] and A[m, c] == 0 and twice[m, c] != 0 and not unread.any():
                pair = model.outputs[cause_].name, model.outputs[motion].name
                found[pair] = float(twice[m, c] * C[motion, m] / C[cause_, c])
    return found


def drifting(model: Model) -> frozenset[str]:
    """Return the outputs that add up what drives them: no size follows from the model's equations.

    They show a mode without a rate at the start of the model.
    """
    A, _, C, _ = _at_start(model)
    of_x = np.array([q.scale for q in model.states])
    scaled = A * of_x / of_x[:, None]
    if not np.isfinite(scaled).all():
        return frozenset()
    _, sizes, modes = np.linalg.svd(scaled)
    shown = np.abs(C * of_x @ modes[sizes <= 1e-9 * sizes.max(initial=0.0)].T)
    shares = shown.max(axis=1, initial=0.0) / np.array([q.scale for q in model.outputs])
    return frozenset(q.name for q, s in zip(model.outputs, shares, strict=True) if s > 1e-6)


def _falls_over(model: Model, recording: Recording) -> bool:
    """Tell whether a model would leave its start many times over along a recording."""
    A, *_ = _at_start(model)
    if not A.size or not np.isfinite(A).all() or len(recording) < 2:
        return False
    return bool(np.linalg.eigvals(A).real.max() * recording.duration > _MANY)


def moves(model: Model, recording: Recording) -> float:
    """Return how far a model goes along a recording, over what was measured, dimensionless.

    Linear from its start, of the measurement that it moves least. A large store that is filled
    moves long before its time constant.
    """
    from scipy.linalg import expm

    A, B, C, D = _at_start(model)
    x, usual = model.initial_state(), model.nominal_input
    read = {i: recording[q.name] for i, q in enumerate(model.outputs) if q.name in recording}
    seen = {i: np.ptp(v[np.isfinite(v)]) for i, v in read.items() if np.isfinite(v).any()}
    n, m = B.shape
    step = np.zeros((n + m + 1, n + m + 1))
    step[:n] = np.column_stack([A, B, model.rates(x, usual)])
    if not (any(seen.values()) and np.isfinite(step).all()):
        return 0.0
    step = expm(recording.sample_time * step)
    driven = np.zeros((len(recording), m))
    for j, q in enumerate(model.inputs):
        if q.name in recording:
            driven[:, j] = np.nan_to_num(recording[q.name] - usual[j])
    gone = np.zeros((len(driven) + 1, n))
    for k, u in enumerate(driven):
        gone[k + 1] = step[:n] @ np.concatenate([gone[k], u, [1.0]])
    swings = np.ptp(gone[:-1] @ C.T + driven @ D.T, axis=0)
    return min(float(swings[i] / s) for i, s in seen.items() if s > 0.0)


def middle_speed(model: Model) -> float:
    """Return the middle one of the magnitudes of a model's eigenvalues at its start, in rad/s.

    Integrators have none and do not count; NaN if there is nothing else.
    """
    A, *_ = _at_start(model)
    if not A.size or not np.isfinite(A).all():
        return math.nan
    sizes = np.abs(np.linalg.eigvals(A))
    sizes = sizes[sizes > 1e-9 * float(sizes.max())]
    return float(np.median(sizes)) if sizes.size else math.nan


def _rate(recording: Recording) -> float | None:
    value = recording.metadata.get("sample_rate_Hz")
    if isinstance(value, (int, float)) and not isinstance(value, bool) and 0.0 < value < math.inf:
        return float(value)
    return None


def _required(recording: Recording) -> tuple[str, ...]:
    """Take signals that somebody declared: by a unit, a mapping file or a model."""
    if recording.mapping is None:
        return recording.names
    stated = {row.signal for row in recording.mapping.rows if row.stated}
    # A file that states no unit at all leaves no way to tell what matters.
    return tuple(n for n in recording.names if n in stated)


def reached(model: Model, recordings: Iterable[Recording]) -> dict[str, float]:
    """Return how far the inputs of a model went along recordings, by name, in SI."""
    found: dict[str, float] = {}
    for recording in recordings:
        for q in model.inputs:
            if q.name in recording:
                values = np.abs(recording[q.name])
                most = float(values[np.isfinite(values)].max(initial=0.0))
                found[q.name] = max(most, found.get(q.name, 0.0))
    return found


def _bounds(quantities: Iterable[Input | Output | State]) -> dict[str, tuple[float, float]]:
    """Return smallest and largest value of quantities that have both, in SI."""
    bounds = {q.name: (q.lower, q.upper) for q in quantities}
    return {name: ends for name, ends in bounds.items() if all(map(math.isfinite, ends))}


def expectations(
    recording: Recording,
    *,
    model: Model | None = None,
    required: Iterable[str] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    signs: Mapping[tuple[str, str], int] | None = None,
) -> Expected:
    """Collect what is known about a recording.

    Args:
        recording: The recording; its metadata may give ``sample_rate_Hz``.
        model: Model whose signals are required; its limits, scales and `response_signs` count.
        required: Names of the signals that must be fit; by default those of the model, else those
            whose unit is stated.
        ranges: Plausible ranges by signal, in SI; take precedence over the model's.
        signs: Sign of the response by (cause, response); take precedence over the model's.
    """
    told = Expected(_required(recording)) if model is None else _of_model(model, recording)
    names = told.required if required is None else tuple(required)
    for name in names:
        if name not in recording:
            raise WorkbenchError(
                f"recording {recording.name!r} has no signal {name!r}; it has "
                f"{', '.join(recording.names)}"
            )
    known = told.signs if signs is None else signs
    return replace(
        told,
        required=names,
        sample_rate_Hz=_rate(recording),
        ranges={**told.ranges, **(ranges or {})},
        signs={k: s for k, s in known.items() if k[0] in recording and k[1] in recording},
    )


def _of_model(model: Model, recording: Recording) -> Expected:
    model = model.sized_by(reached(model, [recording]))
    quantities: tuple[Input | Output, ...] = (*model.inputs, *model.outputs)
    *_, C, _ = _at_start(model)
    told = {model.outputs[i].name for i, k in _read_states(C).items() if model.states[k].sized}
    believed = frozenset(told | {q.name for q in quantities if q.sized})
    # What is far from zero at rest, such as an absolute temperature, is of that size.
    u = model.nominal_input
    rest = np.abs([*u, *model.read(model.initial_state(), u)])
    unsized = drifting(model) - believed
    ranges = _bounds(quantities)
    read = {y.name for y in model.outputs}.difference(ranges)
    # Dry friction holds at rest, and says nothing about a motion.
    free = model.without(*model.dry_effects)
    return Expected(
        tuple(q.name for q in quantities),
        ranges=ranges,
        reach={name: ends for name, ends in _bounds(model.states).items() if name in read},
        scales={
            q.name: float(np.fmax(q.scale, value if math.isfinite(value) else 0.0))
            for q, value in zip(quantities, rest, strict=True)
            if q.name not in unsized
        },
        believed=believed,
        signs=sure_signs(free, recording),
        slopes=acceleration_slopes(free),
        speed=middle_speed(free),
        unstable=_falls_over(free, recording),
        moves=partial(moves, free),
    )
