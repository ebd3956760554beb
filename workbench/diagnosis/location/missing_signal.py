"""The signal that a model lacks at a port, and the law that was found, on the same recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError
from workbench.diagnosis.estimation.process_noise import extended_start
from workbench.diagnosis.location.unknown_input import UnknownInput, unknown_input
from workbench.diagnosis.stages import Diagnosis
from workbench.model import Model, Port
from workbench.model.model import index_of

Vector = npt.NDArray[np.float64]

BINS = 24
"""Classes into which an argument is divided to see what depends on it."""

_PARALLEL = 0.999
"""Cosine above which two ports act on the rates in the same way."""


@dataclass(frozen=True)
class Located:
    """The signal that a model lacks at a port, on recordings that it was not fitted on.

    Args:
        unit: SI unit of the signal.
        time: Times, recordings one after the other, shape (n,), in s.
        signal: Smoothed unknown input, shape (n,), in ``unit``.
        std: Its standard deviation, shape (n,), in ``unit``.
        law: What the effect that was found adds there, shape (n,), in ``unit``; None if nothing
            was found.
        argument: Name of the quantity, among those that the port sees, that the law depends on
            most.
        argument_unit: Its SI unit.
        argument_values: Its values, shape (n,), in ``argument_unit``.
        explained: Share of the mean square of the signal that the law takes away where the
            measurements determine it, dimensionless; NaN without law.
        law_name: What the law is, in plain words.
    """

    port: str
    unit: str
    time: Vector
    signal: Vector
    std: Vector
    law: Vector | None
    argument: str
    argument_unit: str
    argument_values: Vector
    explained: float = math.nan
    recordings: tuple[str, ...] = ()
    law_name: str = "the effect that was found"

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Where the signal is determined to half its own size or better, shape (n,)."""
        return _known(self.signal, self.std)


def located_signal(
    diagnosis: Diagnosis, recordings: Sequence[Observed], ports: Sequence[str]
) -> tuple[Located, ...]:
    """Estimate what is missing at some ports, and what was found to be missing there.

    If something was found, the first effect, or the term without a name, is taken out of the
    extended model again and the recordings tell what signal is then missing at its place. The
    other parameters are those fitted with it: the refitted nominal model hides part of what it
    lacks in wrong values of them. If nothing was found, the signal is what the refitted nominal
    model lacks.

    Args:
        recordings: Recordings with a start for the nominal model.

    Returns:
        One signal per port; a single one at the port of the group where the ports act on the same
        rates, so that no measurement can tell them apart.

    Raises:
        NumericalError: If the model without the effect cannot follow the recordings at all.
    """
    model, extended = diagnosis.base.model, diagnosis.extended.model
    taken_out = _taken_out(diagnosis)
    if taken_out is not None:
        model = extended.without(taken_out.effect)
    ports = told_apart(model, ports, recordings[0])
    started = [extended_start(seen, diagnosis.nominal, model) for seen in recordings]
    parts = [unknown_input(model, seen, ports) for seen in started]
    laws: list[Vector] | None = None
    if taken_out is not None:
        laws = [
            added_at_ports(
                extended,
                taken_out.absent,
                extended_start(seen, diagnosis.nominal, extended),
                model,
                part,
            )
            for seen, part in zip(recordings, parts, strict=True)
        ]
    starts = np.cumsum([0.0, *(part.time[-1] for part in parts[:-1])])
    time = np.concatenate([part.time + s for part, s in zip(parts, starts, strict=True)])
    arguments = _arguments(model, parts)
    found = []
    for i, port in enumerate(ports):
        signal = np.concatenate([part.signal[:, i] for part in parts])
        std = np.concatenate([part.std[:, i] for part in parts])
        law = None if laws is None else np.concatenate([values[:, i] for values in laws])
        rows = _known(signal, std)
        name, unit, values = _argument(
            signal if law is None else law,
            arguments,
            next(q for q in model.ports if q.name == port),
            taken_out or _Found("", {}),
            rows,
        )
        found.append(
            Located(
                port,
                parts[0].units[i],
                time,
                signal,
                std,
                law,
                name,
                unit,
                values,
                math.nan if law is None else _explained(signal, std, law),
                tuple(part.name for part in parts),
                *(() if taken_out is None else (taken_out.name,)),
            )
        )
    return tuple(found)


@dataclass(frozen=True)
class _Found:
    """An effect that can be taken out again: its parameters at which it is absent."""

    effect: str
    absent: Mapping[str, float]
    memory: bool = False
    over: str = ""
    name: str = "the effect that was found"


def _taken_out(diagnosis: Diagnosis) -> _Found | None:
    """Return the first effect that was found, else the term without a name, else nothing."""
    if diagnosis.accepted:
        entry = diagnosis.accepted[0][0].entry
        size = f"{entry.effect.name}.{entry.size_parameter}"
        return _Found(entry.effect.name, {size: 0.0}, bool(entry.effect.states))
    term = diagnosis.nonparametric
    if term is None or not term.accepted:
        return None
    own = [name for curve in term.curves.values() for name in curve.names]
    own += ["loop"] if term.loop else []
    absent = {f"{term.effect_name}.{short}": 0.0 for short in own}
    return _Found(term.effect_name, absent, term.loop, next(iter(term.curves)), "the fitted curve")


def added_at_ports(
    extended: Model,
    absent: Mapping[str, float],
    observed: Observed,
    model: Model,
    missing: UnknownInput,
) -> Vector:
    """Return what an effect adds at some ports along a recording.

    The difference that it makes to the rates (or, at a sensor, to the measurements) at the same
    states, divided by the effect of a unit signal at the port.

    Args:
        absent: Parameter values at which the effect is absent, in SI.
        observed: A recording with a start for the extended model.
        model: The same without the effect.
        missing: The unknown input of the model without it, whose smoothed states are used where
            both models have them.

    Returns:
        What the effect adds, shape (n, n_ports), in each port's unit.

    Raises:
        NumericalError: If the filter cannot follow the recording.
    """
    rms = {q.name: q.disturbance for q in extended.ports if q.disturbance > 0}
    filter_ = PredictionError(extended, observed.sample_time, observed.used, (), rms)
    every = round((missing.time[1] - missing.time[0]) / observed.sample_time)
    states = filter_.run(observed, extended.values).states[::every][: len(missing.time)]
    shared = [index_of("state", q.name, extended.states) for q in model.states]
    states[:, shared] = missing.states
    rows = [index_of("output", name, model.outputs) for name in observed.used]
    there = [[q.name for q in model.ports].index(name) for name in missing.ports]
    trace, n = model.exact, len(missing.time)
    slopes = trace.function(
        "slopes",
        ca.densify(trace.rates_by_port[:, there]),
        ca.densify(trace.outputs_by_port[rows, there]),
    )
    p = np.tile(model.values[:, None], (1, n))
    by_rate, by_read = (
        np.asarray(result).reshape(len(result), n, -1).transpose(1, 0, 2)
        for result in map(np.asarray, slopes.map(n)(missing.states.T, missing.inputs.T, p))
    )
    with_it = _both(extended, extended.values, states, missing.inputs)
    without = _both(extended, extended.with_parameters(absent).values, states, missing.inputs)
    state_scale = np.array([q.scale for q in model.states])
    read_scale = np.array([model.outputs[i].scale for i in rows])
    rates = (with_it[0] - without[0])[shared].T / state_scale
    reads = (with_it[1] - without[1])[rows].T / read_scale
    return np.column_stack(
        [
            _divided(rates, by_rate[:, :, i] / state_scale)
            if np.any(by_rate[:, :, i])
            else _divided(reads, by_read[:, :, i] / read_scale)
            for i in range(len(there))
        ]
    )


def told_apart(model: Model, ports: Sequence[str], observed: Observed) -> tuple[str, ...]:
    """Return the ports whose signals the measurements can tell apart.

    Args:
        observed: A recording with a start for the model or the one it extends.

    Returns:
        The ports; or, if all of them act on the rates as another port does at which something may
        be left out, that port alone.
    """
    if len(ports) < 2:
        return tuple(ports)
    start = dict(zip((q.name for q in model.states), observed.start.tolist(), strict=False))
    x = model.initial_state(start, u=observed.inputs[0])
    slope = model.exact.function("slope", ca.densify(model.exact.rates_by_port))
    matrix = np.asarray(slope(x, observed.inputs[0], model.values))
    matrix = matrix / np.array([q.scale for q in model.states])[:, None]
    length = np.linalg.norm(matrix, axis=0)
    directions = matrix / np.where(length > 0, length, np.inf)
    names = [q.name for q in model.ports]
    chosen = directions[:, [names.index(name) for name in ports]]
    for i, port in enumerate(model.ports):
        if port.disturbance > 0 and np.all(np.abs(directions[:, i] @ chosen) > _PARALLEL):
            return (port.name,)
    return tuple(ports)


def _both(model: Model, values: Vector, states: Vector, inputs: Vector) -> tuple[Vector, Vector]:
    function = model.exact.function("both", model.exact.rates, model.exact.outputs)
    n = len(states)
    rates, outputs = function.map(n)(states.T, inputs.T, np.tile(values[:, None], (1, n)))
    return np.asarray(rates), np.asarray(outputs)


def _divided(difference: Vector, direction: Vector) -> Vector:
    """Project a difference on the direction of a port, sample by sample."""
    square = np.sum(direction**2, axis=1)
    # Where the port acts on nothing, nothing can be said of its signal.
    least = 1e-6 * float(np.mean(square)) or 1.0
    return np.asarray(np.sum(difference * direction, axis=1) / np.maximum(square, least))


def _arguments(model: Model, parts: Sequence[UnknownInput]) -> list[tuple[str, str, Vector]]:
    """States, inputs and rates of states, by which a law may be told."""
    states = np.concatenate([part.states for part in parts])
    inputs = np.concatenate([part.inputs for part in parts])
    rates = np.concatenate([np.gradient(part.states, part.time, axis=0) for part in parts])
    return [
        *((q.name, q.unit, states[:, i]) for i, q in enumerate(model.states)),
        *((q.name, q.unit, inputs[:, i]) for i, q in enumerate(model.inputs)),
        *(
            (f"rate of {q.name}", _per_second(q.unit), rates[:, i])
            for i, q in enumerate(model.states)
        ),
    ]


def _per_second(unit: str) -> str:
    return f"{unit.removesuffix('/s')}/s2" if unit.endswith("/s") else f"{unit}/s"


def _argument(
    signal: Vector,
    arguments: Sequence[tuple[str, str, Vector]],
    port: Port,
    law: _Found,
    rows: npt.NDArray[np.bool_],
) -> tuple[str, str, Vector]:
    """Choose the quantity to draw a signal against: of what the port sees, else of everything.

    A law without a name comes with its argument. One with memory is a function of nothing; it makes
    a loop over the first quantity that the port sees.
    """
    number = port.group.rpartition("_")[2]
    order = [name for own in port.signals for name in (own, f"{own}_{number}")]
    near = sorted((item for item in arguments if item[0] in order), key=lambda i: order.index(i[0]))
    own = [item for item in near if item[0] in (law.over, f"{law.over}_{number}")]
    if own or (law.memory and near):
        return (own or near)[0]
    return max(near or arguments, key=lambda i: correlation_ratio(signal[rows], i[2][rows]))


def correlation_ratio(signal: Vector, argument: Vector, *, bins: int = BINS) -> float:
    """Return which share of a signal's variance is a function of an argument.

    Args:
        signal: The signal, shape (n,), in any unit.
        argument: The argument, shape (n,), in any unit.
        bins: Number of classes of the argument with equally many samples.

    Returns:
        0 for no dependence to 1 for a function, dimensionless.
    """
    variance = float(np.var(signal))
    edges = np.unique(np.quantile(argument, np.linspace(0, 1, bins + 1)[1:-1]))
    which = np.searchsorted(edges, argument)
    count = np.bincount(which)
    if variance == 0.0 or np.count_nonzero(count) < 2:
        return 0.0
    mean = np.bincount(which, weights=signal) / np.maximum(count, 1)
    between = float(np.sum(count * (mean - signal.mean()) ** 2)) / len(signal)
    return min(between / variance, 1.0)


def _known(signal: Vector, std: Vector) -> npt.NDArray[np.bool_]:
    # While a machine rests, its measurements say nothing about forces that do not move it.
    known = std < 0.5 * np.sqrt(np.mean(signal**2 + std**2))
    return known if np.count_nonzero(known) > 10 else np.ones(len(signal), dtype=bool)


def _explained(signal: Vector, std: Vector, law: Vector) -> float:
    """Share of the mean square that a law takes away, where the measurements tell the signal."""
    rows = _known(signal, std)
    whole = float(np.mean(signal[rows] ** 2))
    return 1 - float(np.mean((signal - law)[rows] ** 2)) / whole if whole else math.nan
