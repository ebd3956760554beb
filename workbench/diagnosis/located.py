"""The signal that a model lacks at a port, and the law that was found, on the same recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.diagnosis.diagnose import Diagnosis
from workbench.diagnosis.likely import extended_start
from workbench.diagnosis.prediction_error import Observed, PredictionError
from workbench.diagnosis.unknown_input import UnknownInput, unknown_input
from workbench.model import Model
from workbench.model.model import index_of

Vector = npt.NDArray[np.float64]

BINS = 24
"""Classes into which an argument is divided to see what depends on it."""


@dataclass(frozen=True)
class Located:
    """The signal that the refitted nominal model lacks at a port, on held-out recordings.

    Args:
        port: Name of the port.
        unit: SI unit of the signal.
        time: Times, recordings one after the other, shape (n,), in s.
        signal: Smoothed unknown input, shape (n,), in ``unit``.
        std: Its standard deviation, shape (n,), in ``unit``.
        law: What the extended model adds there, moved parameters included, shape (n,), in
            ``unit``; None if nothing was found.
        own: The part of it that is the effect alone, shape (n,), in ``unit``; None likewise.
        argument: Name of the quantity that the effect depends on most.
        argument_unit: Its SI unit.
        argument_values: Its values, shape (n,), in ``argument_unit``.
        explained: Share of the mean square of the signal that the law takes away where the
            readings determine it, dimensionless; NaN without law.
        recordings: Names of the recordings.

    Example:
        >>> one = np.ones(2)
        >>> Located("axis.force", "N", one, one, one, one, one, "speed", "m/s", one).law is None
        False
    """

    port: str
    unit: str
    time: Vector
    signal: Vector
    std: Vector
    law: Vector | None
    own: Vector | None
    argument: str
    argument_unit: str
    argument_values: Vector
    explained: float = math.nan
    recordings: tuple[str, ...] = ()

    @property
    def component(self) -> Vector:
        """The signal less what the moved parameters account for, shape (n,), in ``unit``.

        What is left if the effect alone was missing: its component plus the residual.
        """
        if self.law is None or self.own is None:
            return self.signal
        return np.asarray(self.signal - self.law + self.own)

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Where the readings determine the signal to half its own size or better, shape (n,)."""
        return _known(self.signal, self.std)


def located_signal(
    diagnosis: Diagnosis, recordings: Sequence[Observed], ports: Sequence[str]
) -> tuple[Located, ...]:
    """Estimate what the refitted nominal model lacks at some ports, and what was found to be there.

    Args:
        diagnosis: A finished diagnosis.
        recordings: Recordings with a start for the nominal model.
        ports: Names of the ports.

    Returns:
        One signal per port.

    Raises:
        NumericalError: If the refitted model cannot follow the recordings at all.

    Example:
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> found, hold_out = example_diagnosis()
        >>> from workbench.diagnosis.observe import observe
        >>> seen = [observe(found.nominal, recording) for recording in hold_out]
        >>> located_signal(found, seen, ["axis.force"])[0].explained > 0.5
        True
    """
    base = diagnosis.base.model
    shared = tuple(port for port in ports if port in {q.name for q in base.ports})
    parts = [unknown_input(base, seen, shared) for seen in recordings]
    laws: list[tuple[Vector, Vector]] | None = None
    if diagnosis.accepted:
        laws = [
            added_at_ports(base, diagnosis.extended.model, _absent(diagnosis), seen, part)
            for seen, part in zip(recordings, parts, strict=True)
        ]
    starts = np.cumsum([0.0, *(part.time[-1] for part in parts[:-1])])
    time = np.concatenate([part.time + s for part, s in zip(parts, starts, strict=True)])
    arguments = _arguments(base, parts)
    found = []
    for i, port in enumerate(shared):
        signal = np.concatenate([part.signal[:, i] for part in parts])
        std = np.concatenate([part.std[:, i] for part in parts])
        law = None if laws is None else np.concatenate([both[0][:, i] for both in laws])
        own = None if laws is None else np.concatenate([both[1][:, i] for both in laws])
        known = _known(signal, std)
        chosen = _argument(signal if own is None else own, arguments, known)
        name, unit, values = chosen
        found.append(
            Located(
                port,
                parts[0].units[i],
                time,
                signal,
                std,
                law,
                own,
                name,
                unit,
                values,
                math.nan if law is None else _explained(signal, std, law),
                tuple(part.name for part in parts),
            )
        )
    return tuple(found)


def _absent(diagnosis: Diagnosis) -> dict[str, float]:
    """Sizes of zero by parameter: the extended model without what was found."""
    entries = [candidate.entry for candidate, _ in diagnosis.accepted]
    return {f"{entry.effect.name}.{entry.size_parameter}": 0.0 for entry in entries}


def added_at_ports(
    base: Model,
    extended: Model,
    absent: Mapping[str, float],
    observed: Observed,
    missing: UnknownInput,
) -> tuple[Vector, Vector]:
    """Return what an extended model adds at some ports of the model it extends.

    The difference of the rates (or, at a sensor, of the readings) of both models at the same
    states, divided by the effect of a unit signal at the port. Changed parameters count as well:
    the sum is what the unknown input of the base model has to be.

    Args:
        base: The refitted nominal model.
        extended: The extended model.
        absent: Parameter values of the extended model at which its new effects are absent, in SI.
        observed: A recording with a start for the base model.
        missing: The unknown input of the base model on it, for ports and times.

    Returns:
        Signals, shape (n, n_ports), in each port's unit; and the part of them that the new effects
        add themselves.

    Raises:
        NumericalError: If the filter cannot follow the recording.

    Example:
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> found, hold_out = example_diagnosis()
        >>> base, extended = found.base.model, found.extended.model
        >>> from workbench.diagnosis.observe import observe
        >>> seen = observe(found.nominal, hold_out[0])
        >>> missing = unknown_input(base, seen, ["axis.force"])
        >>> law, own = added_at_ports(base, extended, {}, seen, missing)
        >>> law.shape == missing.signal.shape
        True
    """
    started = extended_start(observed, base, extended)
    rms = {q.name: q.disturbance for q in extended.ports if q.disturbance > 0}
    filter_ = PredictionError(extended, observed.sample_time, observed.used, (), rms)
    every = round((missing.time[1] - missing.time[0]) / observed.sample_time)
    states = filter_.run(started, extended.values).states[::every][: len(missing.time)]
    own = [index_of("state", q.name, extended.states) for q in base.states]
    # Where both models know a state, the smoothed one is better than the filtered one.
    states[:, own] = missing.states
    rows = [index_of("output", name, base.outputs) for name in observed.used]
    there = [[q.name for q in base.ports].index(name) for name in missing.ports]
    trace = base.exact
    slopes = trace.function(
        "slopes",
        ca.densify(trace.rates_by_port[:, there]),
        ca.densify(trace.outputs_by_port[rows, there]),
    )
    one, both = _both(base, missing.states, missing.inputs), _both(extended, states, missing.inputs)
    rates = (both[0][own] - one[0]).T / np.array([q.scale for q in base.states])
    reads = (both[1][rows] - one[1][rows]).T / np.array([base.outputs[i].scale for i in rows])
    n = len(missing.time)
    p = np.tile(base.values[:, None], (1, n))
    by_rate, by_read = (
        np.asarray(result).reshape(len(result), n, -1).transpose(1, 0, 2)
        for result in map(np.asarray, slopes.map(n)(missing.states.T, missing.inputs.T, p))
    )
    by_rate = by_rate / np.array([q.scale for q in base.states])[:, None]
    by_read = by_read / np.array([base.outputs[i].scale for i in rows])[:, None]
    law = np.column_stack(
        [
            _divided(rates, by_rate[:, :, i])
            if np.any(by_rate[:, :, i])
            else _divided(reads, by_read[:, :, i])
            for i in range(len(there))
        ]
    )
    return law, _own(extended, absent, states, missing)


def _own(
    extended: Model, absent: Mapping[str, float], states: Vector, missing: UnknownInput
) -> Vector:
    """Difference that the effects make to the signals of the ports."""
    rows = [extended.exact.signal_names.index(name) for name in missing.ports]
    function = extended.exact.function("signals", extended.exact.signals[rows])
    n = len(states)
    values = [extended.values, extended.with_parameters(absent).values]
    there, gone = (
        np.asarray(function.map(n)(states.T, missing.inputs.T, np.tile(p[:, None], (1, n))))
        for p in values
    )
    return np.asarray((there - gone).T)


def _both(model: Model, states: Vector, inputs: Vector) -> tuple[Vector, Vector]:
    n = len(states)
    p = np.tile(model.values[:, None], (1, n))
    function = model.exact.function("both", model.exact.rates, model.exact.outputs)
    rates, outputs = function.map(n)(states.T, inputs.T, p)
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
    signal: Vector, arguments: Iterable[tuple[str, str, Vector]], rows: npt.NDArray[np.bool_]
) -> tuple[str, str, Vector]:
    """Choose the quantity that a signal depends on most, by the correlation ratio."""
    return max(arguments, key=lambda item: correlation_ratio(signal[rows], item[2][rows]))


def correlation_ratio(signal: Vector, argument: Vector, *, bins: int = BINS) -> float:
    """Return which share of a signal's variance is a function of an argument.

    Args:
        signal: The signal, shape (n,), in any unit.
        argument: The argument, shape (n,), in any unit.
        bins: Number of classes of the argument with equally many samples.

    Returns:
        0 for no dependence to 1 for a function, dimensionless.

    Example:
        >>> x = np.linspace(-1.0, 1.0, 1000)
        >>> round(correlation_ratio(np.sign(x), x), 2), correlation_ratio(x, np.ones(1000))
        (1.0, 0.0)
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
    # While a machine rests, its readings say nothing about forces that do not move it.
    known = std < 0.5 * np.sqrt(np.mean(signal**2 + std**2))
    return known if np.count_nonzero(known) > 10 else np.ones(len(signal), dtype=bool)


def _explained(signal: Vector, std: Vector, law: Vector) -> float:
    """Share of the mean square that a law takes away, where the readings tell the signal."""
    rows = _known(signal, std)
    whole = float(np.mean(signal[rows] ** 2))
    return 1 - float(np.mean((signal - law)[rows] ** 2)) / whole if whole else math.nan
