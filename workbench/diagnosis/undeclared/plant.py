"""A plant with what it does not declare taken from its recordings, and what was taken."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.diagnosis.undeclared.disturbances import with_disturbances
from workbench.diagnosis.undeclared.inputs import straight, wider
from workbench.diagnosis.undeclared.noise import (
    as_noisy_as_recorded,
    noise_text,
    unforetold,
    with_noise,
    with_noise_of,
)
from workbench.model import Model
from workbench.model.own_units import InSI
from workbench.model.traits import LEFT_OUT
from workbench.model.units import from_si, in_time, strangers
from workbench.recordings.checks.expected import reached
from workbench.recordings.recording import Recording

_MOST = 10.0
"""How many times its value a parameter may become that declares no bounds: what a machine is built
of is known to a factor of some."""

_PACE = 0.02
"""Time in which a response is taken to show, over that of the shortest recording, of integrators
alone."""


def with_undeclared(
    model: Model, recordings: Sequence[Recording], read_too: Mapping[str, float] | None = None
) -> tuple[Model, tuple[str, ...]]:
    """Take what a plant does not declare from its recordings, and say so.

    The noise of a sensor comes from what successive samples do not share, its resolution from
    the steps of the measurements; noise that is clearly more than declared counts too. What the
    refitted model does not foretell is taken instead where it is clearly less, as an input
    shakes the plant from sample to sample, or where it is white. Of a plant that declares no
    disturbance at any port, a fraction of the signal along the recordings may be left out at
    each port that acts on a rate (`LEFT_OUT`). Inputs of which it says nothing go as far as
    they were recorded, and so do those that leave their range, unless the measurements do not
    follow. What nobody sets, such as a wave or a wind, goes straight from sample to sample
    where that is clearly likelier than that it is held. Integrators alone take their pace from
    how long they were recorded.

    Args:
        read_too: Noise that measurements get through inputs of the model that are read with noise,
            in SI, by output.
    """
    read_too = read_too or {}
    model, bounded = _bounded(model)
    shortest = min((r.duration for r in recordings), default=0.0)
    if shortest > 0.0:
        model = replace(model, traits=replace(model.traits, pace=_PACE * shortest))
    declared = model.sized_by(reached(model, recordings) | _ranged(model, recordings))
    model, noisier = as_noisy_as_recorded(declared, recordings)
    declared, model = model, with_noise(model, recordings)
    told, sizes = with_disturbances(model, recordings)
    further = wider(told, recordings)
    if further is not told:
        model = replace(model, inputs=further.inputs)
        told, sizes = with_disturbances(model, recordings)
    lines = straight(told, recordings)
    if lines:
        known = (*model.traits.straight, *lines)
        model = replace(model, traits=replace(model.traits, straight=known))
        told, sizes = with_disturbances(model, recordings)
    new = [q for q, own in zip(told.outputs, declared.outputs, strict=True) if q != own]
    every = {q.name: math.hypot(q.noise_rms, read_too.get(q.name, 0.0)) for q in told.outputs}
    told = with_noise_of(told, every)
    if new:
        even = [q.name for q in new if not q.relative_noise_rms and q.name not in read_too]
        noise = unforetold(told, recordings, even)
        if noise:
            told, sizes = with_disturbances(with_noise_of(model, every | noise), recordings)
    read = {q.name: q for q in told.outputs}
    notes = [*_unit_notes(model), *bounded, *noisier]
    notes += [f"{q.name} declares no noise_rms; {noise_text(read[q.name])}" for q in new]
    if sizes:
        notes.append(
            f"no port of {model.name} declares a disturbance; a twentieth of its signal is taken: "
            + ", ".join(
                f"{q.name} {told.size_text(LEFT_OUT * sizes[q.name], q.unit, [q.name])}"
                for q in told.ports
                if q.name in sizes
            )
        )
    notes += [
        f"{name} goes straight from sample to sample; measurements follow it better so than held"
        for name in lines
    ]
    return told, tuple(notes)


def _bounded(model: Model) -> tuple[Model, tuple[str, ...]]:
    """Give bounds to parameters that are refitted and have none, and say so."""
    given, notes = {}, []
    for q in model.parameters:
        if q.fitted and q.value and not (math.isfinite(q.lower) and math.isfinite(q.upper)):
            ends = zip((q.lower, q.upper), sorted((0.0, _MOST * q.value)), strict=True)
            lower, upper = (own if math.isfinite(own) else end for own, end in ends)
            given[q.name] = replace(q, lower=lower, upper=upper)
            shown = q.display_unit or q.unit
            unit = "" if shown == "1" else f" {shown}"
            lower, upper = from_si(lower, shown), from_si(upper, shown)
            notes.append(f"{q.name} declares no bounds; {lower:g} to {upper:g}{unit} is taken")
    parameters = tuple(given.get(q.name, q) for q in model.parameters)
    return (replace(model, parameters=parameters) if given else model), tuple(notes)


def _ranged(model: Model, recordings: Sequence[Recording]) -> dict[str, float]:
    """Return half of the range over which each output went along recordings, in SI, by name."""
    found: dict[str, float] = {}
    for q in model.outputs:
        seen = np.concatenate([[], *(r[q.name] for r in recordings if q.name in r)])
        known = seen[np.isfinite(seen)]
        found |= {q.name: 0.5 * float(np.ptp(known))} if len(known) else {}
    return found


def _unit_notes(model: Model) -> list[str]:
    """Tell in which units equations count that are not those of the SI."""
    quantities = (*model.states, *model.inputs, *model.outputs, *model.parameters)
    units = dict.fromkeys(q.stated or q.unit for q in quantities)
    notes = []
    if isinstance(model.equations, InSI):
        own = ", ".join(dict.fromkeys(q.stated for q in quantities if q.stated))
        counts = f"{model.name} counts in {own}," if own else f"{model.name} counts"
        notes.append(f"{counts} with {in_time(model.equations.time)} for its unit of time")
    unknown = dict.fromkeys(word for unit in units for word in strangers(unit))
    if unknown:
        notes.append(f"{', '.join(unknown)} in the units of {model.name} stands for itself")
    return notes
