"""The signal that a model lacks at a port, and the law that was found, on the same recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.process_noise import as_it_reads, extended_start
from workbench.diagnosis.location.locate import PARALLEL, directions_of
from workbench.diagnosis.location.missing_signal import (
    MissingSignal,
    correlation_ratio,
    known_rows,
    occurrence,
)
from workbench.diagnosis.location.unknown_input import UnknownInput, unknown_input
from workbench.diagnosis.stages import Diagnosis
from workbench.model import Effect, Model, Port
from workbench.model.model import index_of
from workbench.model.quantities import declared_unit
from workbench.model.units import per


def missing_signals(diagnosis: Diagnosis) -> tuple[tuple[tuple[MissingSignal, ...], ...], str]:
    """Estimate the signal that each finding adds, or that nothing was found for.

    What was found is judged on the held-out recordings; what nothing was found for may act in any
    recording. Where no port was located, the signal is the error of the filter's predictions.

    Returns:
        Signals by finding, those of the located group where nothing was found, nothing where
        nothing is missing; and why there is no located signal, empty if there is one.
    """
    prepared = diagnosis.prepared
    term = diagnosis.nonparametric
    if diagnosis.complete and not diagnosis.improved:
        return (), ""
    places: list[tuple[str, ...]] = [c.entry.ports for c, _ in diagnosis.accepted]
    if not places and term is not None and term.accepted:
        places = [term.ports]
    recordings = prepared.judging if places else (*prepared.fitting, *prepared.judging)
    if not places and diagnosis.before:
        places = [diagnosis.before.ports(diagnosis.nominal)]
    found, why = [], ""
    for index, ports in enumerate(places):
        try:
            found.append(located_signal(diagnosis, recordings, ports, index=index) if ports else ())
        except Exception as error:  # noqa: BLE001
            # When and where it acts, if that cannot be told, must not cost the verdict.
            found.append(())
            why = why or str(error)
    if not any(found):
        try:
            found = [(prediction_error_signal(diagnosis, recordings),)]
        except Exception as error:  # noqa: BLE001
            why = why or str(error)
    return tuple(found), why


def prediction_error_signal(diagnosis: Diagnosis, recordings: Sequence[Observed]) -> MissingSignal:
    """Return the error with which the filter of the refitted nominal model predicts an output.

    Of all outputs, that whose errors are largest beside what the filter expects.

    Args:
        recordings: Recordings with a start for the nominal model.

    Raises:
        NumericalError: If the filter cannot follow the recordings.
    """
    base = diagnosis.base
    model, first = base.model, recordings[0]
    filter_ = filter_of(model, first, base.noise_scale)
    started = [extended_start(seen, diagnosis.nominal, model) for seen in recordings]
    runs = filter_.along(started, model.values)
    square = np.concatenate([np.nan_to_num(run.whitened) ** 2 for run in runs])
    worst = int(np.argmax(square.mean(axis=0)))
    output = model.outputs[index_of("output", first.used[worst], model.outputs)]
    deviation = np.concatenate([np.exp(run.log_deviation[:, worst]) for run in runs]) * output.scale
    signal = np.concatenate([np.nan_to_num(run.whitened[:, worst]) for run in runs]) * deviation
    parts = [
        _Along(seen.name, seen.time, run.states, seen.inputs)
        for seen, run in zip(recordings, runs, strict=True)
    ]
    arguments = _arguments(model, parts)
    name, unit, values = max(arguments, key=lambda a: correlation_ratio(signal, a[2]))
    read = _shown(model, arguments)
    own = declared_unit(output.name, output.unit, model.outputs, difference=True)
    return MissingSignal(
        output.name,
        output.unit,
        _joined(parts),
        signal,
        deviation,
        None,
        name,
        unit,
        values,
        recordings=tuple(part.name for part in parts),
        occurrence=occurrence(
            output.name,
            output.unit,
            [(part.name, part.time) for part in parts],
            signal,
            np.zeros(len(signal)),
            arguments,
            read,
            own,
        ),
        shown=own,
        argument_shown=read[name, unit],
    )


def _shown(
    model: Model,
    arguments: Sequence[tuple[str, str, Vector]],
    origins: Mapping[str, str] | None = None,
) -> dict[tuple[str, str], str]:
    """Return the units declared for reading arguments, by name and unit.

    A state and an input may have one name.
    """
    origins = origins or {}
    return {
        (name, unit): declared_unit(origins.get(name, name), unit, model.quantities)
        for name, unit, _ in arguments
    }


def located_signal(
    diagnosis: Diagnosis, recordings: Sequence[Observed], ports: Sequence[str], *, index: int = 0
) -> tuple[MissingSignal, ...]:
    """Estimate what is missing at some ports, and what was found to be missing there.

    If something was found, one effect, or the term without a name, is taken out of the extended
    model again and the recordings tell what signal is then missing at its place. The
    other parameters are those fitted with it: the refitted nominal model hides part of what it
    lacks in wrong values of them. If nothing was found, the signal is what the refitted nominal
    model lacks.

    Args:
        recordings: Recordings with a start for the nominal model.
        index: Which of the effects that were found is taken out.

    Returns:
        One signal per port; a single one at the port of the group where the ports act on the same
        rates, so that no measurement can tell them apart.

    Raises:
        NumericalError: If the model without the effect cannot follow the recordings at all.
    """
    model, extended = diagnosis.base.model, as_it_reads(diagnosis.extended.model)
    taken_out = _taken_out(diagnosis, index)
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
                extended.effect(taken_out.effect),
                taken_out.absent,
                extended_start(seen, diagnosis.nominal, extended),
                model,
                part,
            )
            for seen, part in zip(recordings, parts, strict=True)
        ]
    time = _joined(parts)
    arguments = _arguments(model, parts)
    found = []
    for i, port in enumerate(ports):
        signal = np.concatenate([part.signal[:, i] for part in parts])
        std = np.concatenate([part.std[:, i] for part in parts])
        law = None if laws is None else np.concatenate([values[:, i] for values in laws])
        rows = known_rows(signal, std)
        seen_at = next(q for q in model.ports if q.name == port)
        local = _local(model, seen_at, parts, arguments)
        own = declared_unit(port, parts[0].units[i], model.quantities, difference=True)
        origins = dict(zip(seen_at.signals, seen_at.origins, strict=False))
        certain = law is not None and bool(np.any(law))
        name, unit, values = _argument(
            signal if law is None else law, arguments, seen_at, taken_out or _Found("", {}), rows
        )
        found.append(
            MissingSignal(
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
                MissingSignal.law_name if taken_out is None else taken_out.name,
                occurrence(
                    port,
                    parts[0].units[i],
                    [(part.name, part.time) for part in parts],
                    law if law is not None and certain else signal,
                    np.zeros(len(std)) if certain else std,
                    local,
                    _shown(model, local, origins),
                    own,
                ),
                shown=own,
                argument_shown=_shown(model, arguments)[name, unit],
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


def _taken_out(diagnosis: Diagnosis, index: int) -> _Found | None:
    """Return an effect that was found, else the term without a name, else nothing."""
    if diagnosis.accepted:
        entry = diagnosis.accepted[index][0].entry
        return _Found(entry.effect.name, entry.absent, bool(entry.effect.states))
    term = diagnosis.nonparametric
    if term is None or not term.accepted:
        return None
    own = [name for curve in term.curves.values() for name in curve.names]
    own += ["loop"] if term.loop else []
    absent = {f"{term.effect_name}.{short}": 0.0 for short in own}
    return _Found(term.effect_name, absent, term.loop, next(iter(term.curves)), "the fitted curve")


def added_at_ports(
    extended: Model,
    effect: Effect,
    absent: Mapping[str, float],
    observed: Observed,
    model: Model,
    missing: UnknownInput,
) -> Vector:
    """Return what an effect adds at some ports along a recording.

    At its own ports, the difference that it makes to their signals at the same states; elsewhere
    that to the rates (or, at a sensor, to the measurements), divided by the effect of a unit signal
    at the port.

    Args:
        effect: One of the extended model's.
        absent: Parameter values at which it is absent, in SI.
        missing: The unknown input of the model without it, whose smoothed states are used where
            both models have them.

    Returns:
        What the effect adds, shape (n, n_ports), in each port's unit.

    Raises:
        NumericalError: If the filter cannot follow the recording.
    """
    every = round((missing.time[1] - missing.time[0]) / observed.sample_time)
    states = (
        filter_of(extended, observed, 1.0)
        .run(observed, extended.values)
        .states[::every][: len(missing.time)]
    )
    shared = [index_of("state", q.name, extended.states) for q in model.states]
    states[:, shared] = missing.states
    trace, full = model.exact, extended.exact
    either = extended.values, extended.with_parameters(absent).values
    if set(missing.ports) <= set(effect.ports):
        own = full.signals[[full.signal_names.index(name) for name in missing.ports]]
        present, gone = (full.along(states, missing.inputs, v, own)[0][:, :, 0] for v in either)
        return np.asarray(present - gone)
    rows = [index_of("output", name, model.outputs) for name in observed.used]
    there = [[q.name for q in model.ports].index(name) for name in missing.ports]
    by_rate, by_read = trace.along(
        missing.states,
        missing.inputs,
        model.values,
        trace.rates_by_port[:, there],
        trace.outputs_by_port[rows, there],
    )
    with_it, without = (
        full.along(states, missing.inputs, values, full.rates, full.outputs) for values in either
    )
    state_scale = np.array([q.scale for q in model.states])
    read_scale = np.array([model.outputs[i].scale for i in rows])
    rates = (with_it[0] - without[0])[:, shared, 0] / state_scale
    reads = (with_it[1] - without[1])[:, rows, 0] / read_scale
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
    directions = directions_of(model, x, observed.inputs[0])
    names = [q.name for q in model.ports]
    chosen = directions[:, [names.index(name) for name in ports]]
    for i, port in enumerate(model.ports):
        if port.disturbance > 0 and np.all(np.abs(directions[:, i] @ chosen) > PARALLEL):
            return (port.name,)
    return tuple(ports)


def _divided(difference: Vector, direction: Vector) -> Vector:
    """Project a difference on the direction of a port, sample by sample."""
    square = np.sum(direction**2, axis=1)
    # Where the port acts on nothing, nothing can be said of its signal.
    least = 1e-6 * float(np.mean(square)) or 1.0
    return np.asarray(np.sum(difference * direction, axis=1) / np.maximum(square, least))


@dataclass(frozen=True)
class _Along:
    """States and inputs along a recording."""

    name: str
    time: Vector
    states: Vector
    inputs: Vector


def _joined(parts: Sequence[UnknownInput | _Along]) -> Vector:
    """Return times of recordings one after the other."""
    starts = np.cumsum([0.0, *(part.time[-1] for part in parts[:-1])])
    return np.concatenate([part.time + s for part, s in zip(parts, starts, strict=True)])


def _local(
    model: Model,
    port: Port,
    parts: Sequence[UnknownInput],
    arguments: Sequence[tuple[str, str, Vector]],
) -> list[tuple[str, str, Vector]]:
    """Return what a port sees, by its own names; everything else if it sees nothing known.

    Beyond what a law could depend on there, much else goes along by chance.
    """
    trace = model.exact
    states = np.concatenate([part.states for part in parts])
    inputs = np.concatenate([part.inputs for part in parts])
    published = trace.along(states, inputs, model.values, trace.signals)[0][:, :, 0].T
    named = zip(trace.signal_names, trace.signal_units, published, strict=True)
    of = {name: (unit, column) for name, unit, column in named}
    of |= {name: (unit, column) for name, unit, column in arguments}
    own = dict(zip(port.signals, port.origins, strict=False))
    near = [(name, *of[origin]) for name, origin in own.items() if origin in of]
    kept: list[tuple[str, str, Vector]] = []
    for item in near or arguments:
        spread = float(np.std(item[2]))
        if spread > 1e-9 * float(np.abs(item[2]).max()) and not any(
            abs(float(np.corrcoef(item[2], other)[0, 1])) > PARALLEL for *_, other in kept
        ):
            kept.append(item)
    return kept


def _arguments(
    model: Model, parts: Sequence[UnknownInput | _Along]
) -> list[tuple[str, str, Vector]]:
    """States, inputs and rates of states, by which a law may be told."""
    states = np.concatenate([part.states for part in parts])
    inputs = np.concatenate([part.inputs for part in parts])
    rates = np.concatenate([np.gradient(part.states, part.time, axis=0) for part in parts])
    return [
        *((q.name, q.unit, states[:, i]) for i, q in enumerate(model.states)),
        *((q.name, q.unit, inputs[:, i]) for i, q in enumerate(model.inputs)),
        *((f"rate of {q.name}", per(q.unit, "s"), rates[:, i]) for i, q in enumerate(model.states)),
    ]


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


def _explained(signal: Vector, std: Vector, law: Vector) -> float:
    """Share of the mean square that a law takes away, where the measurements tell the signal."""
    rows = known_rows(signal, std)
    whole = float(np.mean(signal[rows] ** 2))
    return 1 - float(np.mean((signal - law)[rows] ** 2)) / whole if whole else math.nan
