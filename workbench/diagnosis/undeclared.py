"""What a plant does not declare, taken from its recordings."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import clipped, free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.process_noise import PERFECT, likely_scale
from workbench.diagnosis.estimation.start import FEW, fit_to_few
from workbench.diagnosis.estimation.windows import settled, windowed_run
from workbench.diagnosis.selection.rules import SAME
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Input, Model, Output
from workbench.model.own_units import InSI
from workbench.model.traits import LEFT_OUT
from workbench.model.units import from_si, in_time, of_difference, strangers, with_unit
from workbench.recordings.checks.expected import reached
from workbench.recordings.checks.noise import (
    all_white_rms,
    growing_rms,
    noise_of,
    usual_rms,
    white_rms,
)
from workbench.recordings.checks.quantisation import recorded_quantum
from workbench.recordings.checks.units import beyond_range
from workbench.recordings.recording import Recording
from workbench.recordings.resampling import refined
from workbench.simulation import simulate

_MOST = 10.0
"""How many times its value a parameter may become that declares no bounds: what a machine is built
of is known to a factor of some."""

_ROUNDS = 3
"""Refits that look for the noise beside a model."""

_CLEARLY_LESS = 0.7
"""Part of what successive samples do not share below which a model has foretold the rest."""

_WHITE = 1.1
"""Error of a run over what successive samples of it do not share up to which it is white."""

_EVEN = 0.5
"""Part of a white error's rms that its usual differences have, unless it comes in jumps."""

_MOVING = 0.5
"""Part of the samples at which an input changes that does not go in steps."""

_LEVELS = 8
"""Values of an input that goes through a coarse converter rather than in steps of its own."""

_AROUND = ((-1, 0, 1), (0,), (-2, -1, 0))
"""Rows of an input around one of which means are compared."""

_PARTS, _MOST_SAMPLES = 4, 20_000
"""Parts into which a step is divided for an input that goes straight, and samples that may come."""

_INDEPENDENT = 1e-6
"""Part by which directions, of length 1, must differ to be more than one."""

_COARSE = 2.0
"""Multiple of the declared noise and resolution beyond which a recorded step counts."""


class Misread(NamedTuple):
    """Noise of inputs that a meter read, which moves the model and not the machine.

    Args:
        inputs: Root mean square in SI, by input.
        outputs: What of it the measurements get at once, root mean square in SI, by output.
    """

    inputs: tuple[tuple[str, float], ...]
    outputs: dict[str, float]
    notes: tuple[str, ...]


def as_coarse_as_recorded(
    model: Model, recordings: Sequence[Recording]
) -> tuple[Model, tuple[dict[str, str], ...]]:
    """Take the steps of measurements that are coarser than the plant declares, and say so.

    Rounding to steps of q is an error of q / sqrt(12) rms (W. R. Bennett 1948), which no law of the
    process explains.

    Returns:
        The model, and a row for each such measurement, as those of the checks of recordings.
    """
    outputs, rows = [], []
    for q in model.outputs:
        steps = {r.name: recorded_quantum(r, q.name) for r in recordings if q.name in r}
        name = max(steps, key=lambda recording: steps[recording], default="")
        if not name or steps[name] <= _COARSE * np.hypot(q.resolution, np.sqrt(12) * q.noise_rms):
            outputs.append(q)
            continue
        outputs.append(replace(q, resolution=steps[name]))
        unit = of_difference(q.display_unit)
        shown = [from_si(step, unit) for step in (steps[name], q.resolution)]
        note = (
            f"{q.name} has steps of {shown[0]:.3g} {unit}, where its sensor declares"
            f" {shown[1]:.3g}; they count as its noise"
        )
        rows.append({"recording": name, "check": "resolution", "result": "corrected", "note": note})
    return replace(model, outputs=tuple(outputs)), tuple(rows)


def with_undeclared(
    model: Model, recordings: Sequence[Recording], read_too: Mapping[str, float] | None = None
) -> tuple[Model, tuple[str, ...]]:
    """Take what a plant does not declare from its recordings, and say so.

    The noise of a sensor comes from what successive samples do not share, its resolution from the
    steps of the measurements. What the refitted model does not foretell is taken instead where it
    is clearly less, as an input shakes the plant from sample to sample, or where it is white. Of a
    plant that declares no disturbance at any port, a fraction of the signal along the recordings
    may be left out at each port that acts on a rate (`LEFT_OUT`). Inputs of which it says nothing
    go as far as they were recorded, and so do those that leave their range, unless the measurements
    do not follow. What nobody sets, such as a wave or a wind, goes straight from sample to sample
    where that is clearly likelier than that it is held.

    Args:
        read_too: Noise that measurements get through inputs of the model that are read with noise,
            in SI, by output.
    """
    read_too = read_too or {}
    model, bounded = _bounded(model)
    model = model.sized_by(reached(model, recordings) | _ranged(model, recordings))
    told, sizes = _with_data(model, recordings)
    wider = _wider(told, recordings)
    if wider is not told:
        model = replace(model, inputs=wider.inputs)
        told, sizes = _with_data(model, recordings)
    straight = _straight(told, recordings)
    if straight:
        known = (*model.traits.straight, *straight)
        model = replace(model, traits=replace(model.traits, straight=known))
        told, sizes = _with_data(model, recordings)
    undeclared = [q for q, own in zip(told.outputs, model.outputs, strict=True) if q != own]
    all_noise = {q.name: math.hypot(q.noise_rms, read_too.get(q.name, 0.0)) for q in told.outputs}
    told = replace(
        told, outputs=tuple(replace(q, noise_rms=all_noise[q.name]) for q in told.outputs)
    )
    if undeclared:
        even = [q.name for q in undeclared if not q.relative_noise_rms and q.name not in read_too]
        noise = _unforetold(told, _as_taken(recordings), even)
        if noise:
            outputs = tuple(
                replace(q, noise_rms=noise.get(q.name, q.noise_rms)) for q in told.outputs
            )
            told, sizes = _with_data(replace(model, outputs=outputs), recordings)
    read = {q.name: q for q in told.outputs}
    notes = [*_unit_notes(model), *bounded]
    notes += [f"{q.name} declares no noise_rms; {_noise_text(read[q.name])}" for q in undeclared]
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
        for name in straight
    ]
    return told, tuple(notes)


def _unit_notes(model: Model) -> list[str]:
    """Tell in which units equations count that are not those of the SI."""
    quantities = (*model.states, *model.inputs, *model.outputs, *model.parameters)
    units = dict.fromkeys(q.stated or q.unit for q in quantities)
    notes = []
    if isinstance(model.equations, InSI):
        own = dict.fromkeys(q.stated for q in quantities if q.stated)
        time = in_time(model.equations.time)
        notes.append(f"{model.name} counts in {', '.join(own)}, with {time} for its unit of time")
    unknown = dict.fromkeys(word for unit in units for word in strangers(unit))
    if unknown:
        notes.append(f"{', '.join(unknown)} in the units of {model.name} stands for itself")
    return notes


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


def opened(model: Model, recordings: Sequence[Recording]) -> tuple[Model, tuple[str, ...]]:
    """Open ports where the author of a plant trusts its equations, and give them disturbances.

    Args:
        model: A plant that declares noise, or has taken it from its recordings.

    Returns:
        The plant with further ports, the same one where there are none; their names. An input
        that stays as it is is no place to look at: an error of it is one of a parameter. Nor is a
        rate that the author's own ports change as it may be changed: what acts there acts at them.
    """
    further = model.opened()
    still = {
        f"{q.name}.command"
        for q in model.inputs
        if all(np.ptp(r[q.name]) == 0.0 for r in recordings if q.name in r)
    }
    known = still | {q.name for q in model.ports} | _carried(model)
    new = tuple(q.name for q in further.ports if q.name not in known)
    return (_with_data(further, recordings)[0], new) if new else (model, ())


def _carried(model: Model) -> set[str]:
    """Return the ports of rates that the ports of a plant together change, each by itself."""
    raised = model.exact.function("by_port", model.exact.rates_by_port)
    scales = np.array([[q.scale] for q in model.states])
    at = np.asarray(raised(model.initial_state(), model.nominal_input, model.values)) / scales
    at = at[:, np.all(np.isfinite(at), axis=0) & np.any(at != 0.0, axis=0)]
    directions, sizes, _ = np.linalg.svd(at / np.linalg.norm(at, axis=0), full_matrices=False)
    spanned = np.sum(directions[:, sizes > _INDEPENDENT] ** 2, axis=1)
    found = zip(model.states, spanned, strict=True)
    return {f"{q.name}.rate" for q, part in found if part > 1.0 - _INDEPENDENT}


def _shown(q: Input | Output, size: float) -> str:
    unit = of_difference(q.display_unit)
    return with_unit(f"{from_si(size, unit):.3g}", unit)


def _noise_text(q: Output) -> str:
    part = q.relative_noise_rms
    if not q.noise_rms and q.resolution:
        return f"the recordings' steps of {_shown(q, q.resolution)} are taken for it"
    growing = f", and {100.0 * part:.2g} % of what it reads" if part else ""
    return f"{_shown(q, q.noise_rms)} is taken from the recordings{growing}"


def _ranged(model: Model, recordings: Sequence[Recording]) -> dict[str, float]:
    """Return half of the range over which each output went along recordings, in SI, by name."""
    seen = {
        q.name: np.concatenate([[], *(r[q.name] for r in recordings if q.name in r)])
        for q in model.outputs
    }
    known = {name: values[np.isfinite(values)] for name, values in seen.items()}
    return {name: 0.5 * float(np.ptp(values)) for name, values in known.items() if len(values)}


def _wider(model: Model, recordings: Sequence[Recording]) -> Model:
    """Widen the ranges of inputs that were recorded beyond them, unless that is less likely.

    That an actuator clips what it gets is found as a law; that it does not is not.
    """
    inputs = []
    for q in model.inputs:
        seen = [r.signal(q.name) for r in recordings if q.name in r]
        if any(beyond_range(signal, q.lower, q.upper) for signal in seen):
            least, most = (f(f(s.values) for s in seen) for f in (min, max))
            inputs.append(replace(q, lower=min(q.lower, least), upper=max(q.upper, most)))
        else:
            inputs.append(q)
    wider = replace(model, inputs=tuple(inputs))
    if wider.inputs == model.inputs:
        return model
    return model if clearly_likelier(model, wider, recordings) else wider


def _straight(model: Model, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return inputs that are read and that move from sample to sample rather than in steps."""
    moving = tuple(
        q.name
        for q in model.inputs
        if not q.commanded
        and q.name not in model.traits.straight
        and all(_moves(r, q.name) for r in recordings if q.name in r)
    )
    if not moving:
        return ()
    known = (*model.traits.straight, *moving)
    trial = replace(model, traits=replace(model.traits, straight=known))
    return moving if clearly_likelier(trial, model, recordings) else ()


def _moves(recording: Recording, name: str) -> bool:
    """Whether an input moves at most samples, or by single steps of a converter when it does."""
    moves = np.abs(np.diff(recording[name]))
    moves = moves[moves > 0.0]
    often = len(moves) > _MOVING * len(recording)
    return often or bool(
        len(np.unique(recording[name])) > _LEVELS
        and np.median(moves) < 1.5 * recorded_quantum(recording, name)
    )


def clearly_likelier(
    one: Model,
    other: Model,
    recordings: Sequence[Recording],
    as_other: Sequence[Recording] | None = None,
) -> bool:
    """Tell whether one model, refitted, foretells recordings clearly better than another.

    Args:
        as_other: The same recordings as the other model sees them, if that differs.
    """
    costs = []
    for trial, given in ((one, recordings), (other, as_other or recordings)):
        try:
            costs.append(fit_to_few(trial, given)[0].cost)
        except (WorkbenchError, np.linalg.LinAlgError):
            return False
    return costs[0] < costs[1] - SAME


def misread(model: Model, recordings: Sequence[Recording]) -> Misread | None:
    """Return the noise of inputs that a meter read, where there are any.

    The machine follows the noise that a controller passes on: means of three rows foretell it worse
    then. What follows the rows before better than those around is slow itself. A machine that is
    slow beside a row shows no difference: there it is enough that the equations lack nothing else
    beside that noise.
    """
    given = [r for r in recordings[:FEW] if not r.resampled]
    noise = {}
    for q in model.inputs:
        floors = [noise_of(r, q.name) for r in given if q.name in r and _moves(r, q.name)]
        if floors and all(f.noise_rms > 0.0 and not f.upper_bound for f in floors):
            noise[q.name] = min(f.noise_rms for f in floors)
    if not noise:
        return None
    columns = {q.name: k for k, q in enumerate(model.inputs)}
    try:
        fit, seen = fit_to_few(model, given)
        filter_ = filter_of(fit.model, seen[0], fit.noise_scale)

        def cost(name: str, around: Sequence[int]) -> float:
            column, total = columns[name], 0.0
            for one in seen:
                inputs, every = one.inputs.copy(), np.arange(len(one.inputs))
                rows = np.clip(every[:, None] + around, 0, every[-1])
                inputs[:, column] = np.mean(one.inputs[rows, column], axis=1)
                total += filter_.run(replace(one, inputs=inputs), fit.model.values).cost
            return total

        costs = {name: [cost(name, around) for around in _AROUND] for name in noise}
        states = filter_.run(seen[0], fit.model.values).states
    except (WorkbenchError, np.linalg.LinAlgError):
        return None
    found = [
        q
        for q in model.inputs
        if q.name in costs and costs[q.name][0] < min(costs[q.name][1] - SAME, costs[q.name][2])
    ]
    if not found and fit.noise_scale > PERFECT:
        read = tuple(noise.items())
        trial = replace(model, traits=replace(model.traits, misread=read, straight=tuple(noise)))
        with contextlib.suppress(WorkbenchError, np.linalg.LinAlgError):
            other = fit_to_few(trial, given)[0]
            if other.noise_scale <= PERFECT and other.cost < fit.cost + SAME:
                found = [q for q in model.inputs if q.name in noise]
    if not found:
        return None
    trace = fit.model.exact
    through = ca.jacobian(trace.outputs, trace.u)[:, [columns[q.name] for q in found]]
    slopes = trace.along(states, seen[0].inputs, fit.model.values, through)[0]
    each = [noise[q.name] for q in found]
    # Half-way between two samples a mean of both is taken.
    passed = np.sqrt(0.5 * np.mean(np.sum((slopes * each) ** 2, axis=2), axis=0)).tolist()
    return Misread(
        tuple((q.name, noise[q.name]) for q in found),
        dict(zip((q.name for q in model.outputs), passed, strict=True)),
        tuple(
            f"{q.name} was read with {_shown(q, noise[q.name])} rms of noise, which the machine"
            " does not follow"
            for q in found
        ),
    )


def more_finely(model: Model, recordings: Sequence[Recording]) -> list[Recording]:
    """Return recordings with divided steps, where inputs that go straight are better followed so.

    The mean of a step gives a plant the right momentum, but not quite the right place. Lines
    between what a meter read have no white noise.

    Returns:
        The recordings; none where the steps are short enough, or where too many samples would come.
    """
    parts = min(_PARTS, _MOST_SAMPLES // max(len(r.time) for r in recordings))
    if not model.traits.straight or model.traits.misread or parts < 2:
        return []
    finer = [refined(r, parts, model.traits.straight) for r in recordings]
    return finer if clearly_likelier(model, model, finer, recordings) else []


def _unforetold(
    model: Model, recordings: Sequence[Recording], names: Sequence[str]
) -> dict[str, float]:
    """Return the noise of measurements beside a refitted model, in SI, by output.

    Of those that have clearly less noise than the model says, and of those that run freely to an
    error that is white: there nothing is missing, and the error is the noise.
    """
    found: dict[str, float] = {}
    for _ in range(_ROUNDS):
        outputs = tuple(replace(q, noise_rms=found.get(q.name, q.noise_rms)) for q in model.outputs)
        trial = replace(model, outputs=outputs)
        other: dict[str, float] = {}
        with contextlib.suppress(WorkbenchError, np.linalg.LinAlgError):
            fit, seen = fit_to_few(trial, recordings)
            for one in seen:
                if one.drifts:
                    run = windowed_run(fit.model, trial, one, fit.noise_scale)
                else:
                    run = free_run(fit.model, settled(fit.model, trial, one))
                if not run.finite:
                    continue  # A run that diverged tells nothing of noise.
                for name, column, rms in zip(one.used, run.error.T, one.noise_rms, strict=True):
                    error = column[np.isfinite(column)]
                    # Lines between uneven samples leave neighbours noise in common, no others.
                    least, white = white_rms(error, quantile=0.25), all_white_rms(error[::2])
                    if name in names and least < _CLEARLY_LESS * rms:
                        other[name] = min(least, other.get(name, math.inf))
                    elif (
                        name in names
                        and run.rmse[name] < _WHITE * white
                        and white > rms
                        # What jumps now and then, as a limit cycle out of step, is no noise.
                        and usual_rms(error[::2]) > _EVEN * white
                    ):
                        other[name] = max(white, other.get(name, 0.0))
        if not other:
            break
        found |= other
    return found


def _as_taken(recordings: Sequence[Recording]) -> Sequence[Recording]:
    """Return the recordings that tell the noise of a sample: others only where there are none."""
    return [r for r in recordings if not r.resampled] or recordings


def _with_data(model: Model, recordings: Sequence[Recording]) -> tuple[Model, dict[str, float]]:
    """Take noise and what is left out from the data; the model, and the signals at its ports."""
    outputs = []
    for q in model.outputs:
        # Of a sensor slower than the others there are numbers in some rows only.
        measured = _as_taken([r for r in recordings if q.name in r])
        read = [r[q.name][r.valid(q.name)] for r in measured]
        if q.noise_rms == 0 and q.resolution == 0 and read:
            step = max(recorded_quantum(r, q.name) for r in recordings if q.name in r)
            white = [white_rms(v, order=order, quantile=0.25) for v in read for order in (4, 6)]
            white += [usual_rms(v) for v in read]
            least = min((w for w in white if np.isfinite(w)), default=0.0)
            # Between steps that are coarser than the noise it does not show how it grows.
            rest, growing = growing_rms(read) if step < least else (least, 0.0)
            noise = max((rest if growing else least) ** 2 - step**2 / 12, 0.0) ** 0.5
            told = replace(q, noise_rms=noise, relative_noise_rms=growing, resolution=step)
            outputs.append(told)
        else:
            outputs.append(q)
    model = replace(model, outputs=tuple(outputs))
    declares = any(p.disturbance or p.relative_disturbance for p in model.ports)
    if declares and not model.traits.opened:
        return model, {}
    sizes: dict[str, float] = {}
    for recording in recordings:
        with contextlib.suppress(WorkbenchError):  # Refit and checks say what is wrong with it.
            for name, rms in _signals_along(model, observe(model, recording)).items():
                sizes[name] = max(rms, sizes.get(name, 0.0))
    return _with_sizes(model, sizes), sizes


def _with_sizes(model: Model, sizes: Mapping[str, float]) -> Model:
    return replace(model, traits=replace(model.traits, sizes=tuple(sizes.items())))


def _signals_along(model: Model, seen: Observed) -> dict[str, float]:
    """Return the rms of the signal at each port that acts on a rate, in its SI unit."""
    acting = ca.DM(model.exact.rates_by_port.sparsity(), 1).full().any(axis=0)
    ports = [
        port
        for port, acts in zip(model.ports, acting, strict=True)
        if (acts or not acting.any()) and not port.name.endswith((".command", ".reading"))
    ]
    inputs = clipped(model, seen)
    if not seen.diverges:
        with contextlib.suppress(NumericalError):
            run = simulate(
                model, inputs, sample_time=seen.sample_time, start=seen.start, check=False
            )
            return _rms({port.name: run.signals[port.name] for port in ports})
    # The measurements hold what would run away; how much is left out shows in how it is held.
    trial = _with_sizes(model, {port.name: port.scale for port in ports})
    scale = likely_scale(trial, [seen], {})
    states = filter_of(trial, seen, scale).run(seen, trial.values).states
    trace = trial.exact
    signals = trace.along(states, inputs, trial.values, trace.signals)[0][:, :, 0]
    named = dict(zip(trace.signal_names, signals.T, strict=True))
    return _rms({port.name: named[port.name] for port in ports})


def _rms(signals: Mapping[str, Vector]) -> dict[str, float]:
    sizes = {name: float(np.sqrt(np.mean(v**2))) for name, v in signals.items()}
    return {name: rms for name, rms in sizes.items() if rms > 0}
