"""The signals that a model lacks, and the laws that were found, on the same recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.process_noise import as_it_reads, extended_start
from workbench.diagnosis.location.locate import PARALLEL, directions_of
from workbench.diagnosis.location.missing_signal import (
    LocalSignal,
    MissingSignal,
    correlation_ratio,
    known_rows,
    occurrence,
)
from workbench.diagnosis.location.unknown_input import UnknownInput, unknown_input
from workbench.diagnosis.selection.moments import acts_in
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import AWAY
from workbench.errors import NumericalError
from workbench.model import Effect, Model, Port
from workbench.model.model import index_of
from workbench.model.quantities import declared_unit
from workbench.model.units import per


def missing_signals(diagnosis: Diagnosis) -> tuple[tuple[tuple[MissingSignal, ...], ...], str]:
    """Estimate the signal that each finding adds, or that nothing was found for.

    What was found is judged on the held-out recordings, or on the fitted ones where an event comes
    to none of these; what nothing was found for may act in any recording. Where no port was
    located, the signal is the error of the filter's predictions.

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
            held = _that_hold(diagnosis, index) or recordings
            found.append(located_signal(diagnosis, held, ports, index=index) if ports else ())
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


def _that_hold(diagnosis: Diagnosis, index: int) -> Sequence[Observed]:
    """Return the fitted recordings that hold an event of which the others hold nothing."""
    if not diagnosis.accepted:
        return ()
    model, prepared = diagnosis.extended.model, diagnosis.prepared
    effect = model.effect(diagnosis.accepted[index][0].name)
    if not effect.about.moment or effect.about.period:
        return ()
    if any(acts_in(model, effect, seen) for seen in prepared.judging):
        return ()
    return [seen for seen in prepared.fitting if acts_in(model, effect, seen)]


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
    started = [extended_start(seen, diagnosis.nominal, model) for seen in recordings]
    runs = filter_of(model, first, base.noise_scale).along(started, model.values)
    square = np.concatenate([np.nan_to_num(run.whitened) ** 2 for run in runs])
    worst = int(np.argmax(square.mean(axis=0)))
    output = model.outputs[first.rows(model)[worst]]
    if np.max(square) > AWAY**2:
        raise NumericalError("the predictions of the refitted model run away")
    parts = []
    for seen, run in zip(recordings, runs, strict=True):
        std = np.exp(run.log_deviation[:, [worst]]) * output.scale
        error = np.nan_to_num(run.whitened[:, [worst]]) * std
        own = ((output.name,), (output.unit,), seen.time, error, std, run.states, seen.inputs)
        parts.append(UnknownInput(seen.name, *own))
    arguments = _arguments(model, parts)
    signal = _joined(parts, "signal")[:, 0]
    argument = max(arguments, key=lambda a: correlation_ratio(signal, a.values))
    shown = declared_unit(output.name, output.unit, model.outputs, difference=True)
    return _missing(parts, 0, argument, arguments, shown, signal)


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
    laws: Vector | None = None
    if taken_out is not None:
        effect = extended.effect(taken_out.effect)
        again = [extended_start(seen, diagnosis.nominal, extended) for seen in recordings]
        laws = np.concatenate(
            [
                added_at_ports(extended, effect, taken_out.absent, seen, model, part)
                for seen, part in zip(again, parts, strict=True)
            ]
        )
    arguments = _arguments(model, parts)
    found = []
    for i, name in enumerate(ports):
        signal, std = (_joined(parts, of)[:, i] for of in ("signal", "std"))
        law = None if laws is None else laws[:, i]
        port = next(q for q in model.ports if q.name == name)
        rows, found_there = known_rows(signal, std), taken_out or _Found("", {})
        along = _argument(signal if law is None else law, arguments, port, found_there, rows)
        own = model.read_at([name], port.unit)
        local = _local(model, port, parts, arguments)
        missing = _missing(parts, i, along, local, own, law if np.any(law) else None)
        if taken_out is not None and law is not None:
            whole = float(np.mean(signal[rows] ** 2))
            explained = 1 - float(np.mean((signal - law)[rows] ** 2)) / whole if whole else math.nan
            missing = replace(missing, law=law, explained=explained, law_name=taken_out.name)
        found.append(missing)
    return tuple(found)


def _missing(
    parts: Sequence[UnknownInput],
    column: int,
    argument: LocalSignal,
    local: Sequence[LocalSignal],
    shown: str,
    acting: Vector | None,
) -> MissingSignal:
    """Return what is missing at a port, with when and where it acts.

    Args:
        shown: Unit declared for reading it.
        acting: What acts there for certain, shape (n,), in its unit; None if the signal alone is
            known.
    """
    signal, std = (_joined(parts, of)[:, column] for of in ("signal", "std"))
    port, unit = parts[0].ports[column], parts[0].units[column]
    times = [(part.name, part.time) for part in parts]
    told = (signal, std) if acting is None else (acting, np.zeros(len(acting)))
    starts = np.cumsum([0.0, *(time[-1] for _, time in times[:-1])])
    return MissingSignal(
        port,
        unit,
        np.concatenate([time + start for (_, time), start in zip(times, starts, strict=True)]),
        signal,
        std,
        None,
        argument,
        occurrence=occurrence(port, unit, times, *told, local, shown),
        shown=shown,
    )


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


def _joined(parts: Sequence[UnknownInput], of: str) -> Vector:
    """Return what is known along recordings one after the other, shape (n, ...)."""
    return np.concatenate([getattr(part, of) for part in parts])


def _local(
    model: Model, port: Port, parts: Sequence[UnknownInput], arguments: Sequence[LocalSignal]
) -> list[LocalSignal]:
    """Return what a port sees, by its own names; everything else if it sees nothing known.

    Beyond what a law could depend on there, much else goes along by chance.
    """
    trace = model.exact
    states, inputs = _joined(parts, "states"), _joined(parts, "inputs")
    published = trace.along(states, inputs, model.values, trace.signals)[0][:, :, 0].T
    named = zip(trace.signal_names, trace.signal_units, published, strict=True)
    of = {name: LocalSignal(name, unit, column) for name, unit, column in named}
    of |= {item.name: item for item in arguments}
    seen = [(n, of[o], o) for n, o in zip(port.signals, port.origins, strict=False) if o in of]
    known = model.quantities
    near = [LocalSignal(n, q.unit, q.values, declared_unit(o, q.unit, known)) for n, q, o in seen]
    kept: list[LocalSignal] = []
    for item in near or arguments:
        values = item.values
        if np.std(values) > 1e-9 * np.abs(values).max() and not any(
            abs(float(np.corrcoef(values, other.values)[0, 1])) > PARALLEL for other in kept
        ):
            kept.append(item)
    return kept


def _arguments(model: Model, parts: Sequence[UnknownInput]) -> list[LocalSignal]:
    """States of the plant, inputs and rates of states, by which a law may be told.

    The clock of an event goes with whatever came once.
    """
    states, inputs = _joined(parts, "states"), _joined(parts, "inputs")
    rates = np.concatenate([np.gradient(part.states, part.time, axis=0) for part in parts])
    own = [
        (q, *both)
        for q, *both in zip(model.states, states.T, rates.T, strict=True)
        if "." not in q.name
    ]
    columns = [
        *((q.name, q.unit, values) for q, values, _ in own),
        *((q.name, q.unit, values) for q, values in zip(model.inputs, inputs.T, strict=True)),
        *((f"rate of {q.name}", per(q.unit, "s"), values) for q, _, values in own),
    ]
    known = model.quantities
    return [LocalSignal(*column, declared_unit(*column[:2], known)) for column in columns]


def _argument(
    signal: Vector,
    arguments: Sequence[LocalSignal],
    port: Port,
    law: _Found,
    rows: npt.NDArray[np.bool_],
) -> LocalSignal:
    """Choose the quantity to draw a signal against: of what the port sees, else of everything.

    A law without a name comes with its argument. One with memory is a function of nothing; it makes
    a loop over the first quantity that the port sees.
    """
    number = port.group.rpartition("_")[2]
    order = [name for own in port.signals for name in (own, f"{own}_{number}")]
    near = sorted((a for a in arguments if a.name in order), key=lambda a: order.index(a.name))
    own = [a for a in near if a.name in (law.over, f"{law.over}_{number}")]
    if own or (law.memory and near):
        return (own or near)[0]
    return max(near or arguments, key=lambda a: correlation_ratio(signal[rows], a.values[rows]))


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
    if set(missing.ports) <= set(effect.ports):
        # Behind what remembers at the same port, such as a lag, nothing is added at once.
        behind = [
            e.name
            for e in extended.effects
            if e.name != effect.name and e.states and {*e.ports} & {*effect.ports}
        ]
        alone = extended.without(*behind)
        columns = [index_of("state", q.name, extended.states) for q in alone.states]
        own = alone.exact.signals[[alone.exact.signal_names.index(n) for n in missing.ports]]
        present, gone = (
            alone.exact.along(states[:, columns], missing.inputs, v.values, own)[0][:, :, 0]
            for v in (alone, alone.with_parameters(absent))
        )
        return np.asarray(present - gone)
    trace, full = model.exact, extended.exact
    either = extended.values, extended.with_parameters(absent).values
    rows = observed.rows(model)
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


def _divided(difference: Vector, direction: Vector) -> Vector:
    """Project a difference on the direction of a port, sample by sample."""
    square = np.sum(direction**2, axis=1)
    # Where the port acts on nothing, nothing can be said of its signal.
    least = 1e-6 * float(np.mean(square)) or 1.0
    return np.asarray(np.sum(difference * direction, axis=1) / np.maximum(square, least))
