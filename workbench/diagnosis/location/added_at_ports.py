"""What an effect adds at ports along a recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.location.unknown_input import UnknownInput
from workbench.model import Effect, Model
from workbench.model.model import index_of


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


def _divided(difference: Vector, direction: Vector) -> Vector:
    """Project a difference on the direction of a port, sample by sample."""
    square = np.sum(direction**2, axis=1)
    # Where the port acts on nothing, nothing can be said of its signal.
    least = 1e-6 * float(np.mean(square)) or 1.0
    return np.asarray(np.sum(difference * direction, axis=1) / np.maximum(square, least))
