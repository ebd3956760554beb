"""A model with recordings to fit on and to judge on: what `refit` and `diagnose` start from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from workbench.diagnosis.averaging import averaged
from workbench.diagnosis.division import with_some_held_out, without_gaps
from workbench.diagnosis.estimation.observe import observe, recorded_outputs
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.undeclared.inputs import misread, more_finely
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.errors import WorkbenchError
from workbench.model import Input, Model, Output
from workbench.model.units import to_si
from workbench.physics.library import every_name
from workbench.recordings.case import Case, RefitSettings
from workbench.recordings.checks.check import Finding
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.gaps import check_gaps
from workbench.recordings.checks.loop import check_loop
from workbench.recordings.checks.time_base import evened, in_order
from workbench.recordings.checks.units import beyond_range
from workbench.recordings.column_matching import driven_by
from workbench.recordings.read import MappingLike, read_recording
from workbench.recordings.recording import Recording
from workbench.recordings.resampling import at_one_pace

Read = TypeVar("Read", Input, Output)


@dataclass(frozen=True)
class Problem:
    """A model, recordings to fit on, recordings to judge on, and how to estimate.

    Args:
        title: What is looked at, in a few words.
        in_loop: Further recordings to judge on, each with the model that runs on it.
        published: Values that others identified, by parameter, in SI.
    """

    name: str
    title: str
    model: Model
    fit: tuple[Recording, ...]
    hold_out: tuple[Recording, ...]
    in_loop: tuple[tuple[Model, Recording], ...] = ()
    refit: RefitSettings = field(default_factory=RefitSettings)
    published: Mapping[str, float] = field(default_factory=dict)
    published_from: str = ""
    notes: tuple[str, ...] = ()

    def observed(self, recording: Recording, model: Model | None = None) -> Observed:
        """Return a recording as the filter of its model needs it, with the noise that is given.

        One of uneven steps is interpolated.

        Raises:
            WorkbenchError: If it lacks an input, or has no output of the model.
        """
        seen = observe(model or self.model, _even(recording))
        noise = [
            self.refit.noise.get(name, rms)
            for name, rms in zip(seen.used, seen.noise_rms, strict=True)
        ]
        return replace(seen, noise_rms=np.array(noise))


def problem_of_case(case: Case, model: Model | None = None) -> Problem:
    """Build the problem of a case.

    Raises:
        WorkbenchError: If the case does not give what its plant needs.
    """
    model = case.model() if model is None else model
    fit, cut = without_gaps(model, tuple(case.fit.values()))
    held, also = without_gaps(model, tuple(case.hold_out.values()))
    return Problem(
        name=case.name,
        title=case.title or f"{case.plant.name}, case {case.name}",
        model=model,
        fit=fit,
        hold_out=held,
        in_loop=tuple(
            (case.loops[name].model() if name in case.loops else case.model(), recording)
            for name, recording in case.used("in_loop").items()
        ),
        refit=case.refit,
        published=case.published,
        published_from=case.published_from,
        notes=(*case.remarks, *cut, *also),
    )


def problem_of_files(
    model: Model, fit: Sequence[Path], hold_out: Sequence[Path], *, mapping: MappingLike = None
) -> Problem:
    """Read recordings of a model; where none is held out, a part of them is.

    Raises:
        WorkbenchError: If there is none to fit on, one is given twice, or cannot be read.
    """
    names = dict(zip((*fit, *hold_out), _titles((*fit, *hold_out)), strict=True))
    if len(names) < len(fit) + len(hold_out):
        raise WorkbenchError(
            "a recording is given twice; what a model is judged on must not be fitted on"
        )
    inputs = [q.name for q in model.inputs]
    read = {}
    for path, title in names.items():
        recording = read_recording(path, mapping=mapping, name=title, signals=driven_by(model))
        recorded_outputs(model, recording)
        # What drives the model may stand still without being stuck.
        read[path] = recording.with_roles(
            dict.fromkeys([n for n in inputs if n in recording], "command")
        )
    given = list(read.values())
    paces_differ = any(a is not b for a, b in zip(at_one_pace(given), given, strict=True))
    (fits, held), divided = with_some_held_out(
        model, [read[path] for path in fit], [read[path] for path in hold_out]
    )
    given = [*fits, *held]
    if paces_differ:
        # Of clocks that are uneven alone the paces show without that, and without their gaps.
        given = at_one_pace([_even(r) for r in given])
    model, given, fewer = averaged(model, given, _even)
    declared = model = _read_as_recorded(model, given)
    # Runs need even steps, where rows are missing too.
    ordered = [in_order(r) for r in given]
    whole = [(check_gaps(r).recording if r.increasing else None) or r for r in ordered]
    model, notes = with_undeclared(model, whole)
    noisy = misread(model, whole)
    if noisy:
        declared = _as_read(declared, noisy.inputs)
        model, again = with_undeclared(declared, whole, noisy.outputs)
        notes = (*noisy.notes, *again)
    # Within a step, too, what goes straight pushes a plant otherwise than its mean does.
    finer = more_finely(model, given)
    if finer:
        given = finer
        straight = replace(declared.traits, straight=model.traits.straight)
        model, again = with_undeclared(replace(declared, traits=straight), finer)
        notes = (*again, *(note for note in notes if note not in again and "straight" in note))
    said = [text for text in (divided, fewer) if text]
    said += [note for recording in given for note in recording.notes]
    said += _taken_as_si(declared, given)
    said += [f"{r.name}: {found.note}" for r in whole if (found := _loop(r)) and found.doubt]
    for recording in given:
        for q, taken in zip(declared.inputs, model.inputs, strict=True):
            clipped = (q.lower, q.upper) == (taken.lower, taken.upper)
            note = beyond_range(recording.signal(q.name), q.lower, q.upper, clipped=clipped)
            said += [f"{recording.name}: {note}"] if note else []
    return Problem(
        name=", ".join(names[path] for path in fit),
        title=model.description or model.name,
        model=model,
        fit=tuple(given[: len(fits)]),
        hold_out=tuple(given[len(fits) :]),
        notes=(*dict.fromkeys(said), *notes),
    )


def _loop(recording: Recording) -> Finding | None:
    """Look for a loop in a recording of which every cell is a number."""
    complete = recording.increasing and all(np.isfinite(s.values).all() for s in recording.signals)
    return check_loop(recording, Expected()) if complete else None


def _even(recording: Recording) -> Recording:
    """Return a recording with even steps, after the rows of its gaps, which are no uneven steps.

    One whose time does not increase stays as it is.
    """
    ordered = in_order(recording)
    if not ordered.increasing:
        return recording
    found = check_gaps(ordered)
    return evened(ordered if found.result == "unfit" else found.recording or ordered)


def _read_as_recorded(model: Model, recordings: Sequence[Recording]) -> Model:
    """Let people read in the units of the headings what the plant only gives in SI."""
    stated = {m.signal: m.unit for r in recordings for m in r.mapping or () if m.unit}

    def read(channels: Sequence[Read]) -> tuple[Read, ...]:
        return tuple(
            replace(q, display_unit=stated.get(q.name, q.unit)) if q.display_unit == q.unit else q
            for q in channels
        )

    return replace(model, inputs=read(model.inputs), outputs=read(model.outputs))


def _as_read(model: Model, noise: tuple[tuple[str, float], ...]) -> Model:
    """Return a model of which some inputs are read with noise, and so set by nobody."""
    read = dict(noise)
    inputs = (replace(q, commanded=q.commanded and q.name not in read) for q in model.inputs)
    return replace(model, inputs=tuple(inputs), traits=replace(model.traits, misread=noise))


def _taken_as_si(model: Model, recordings: Sequence[Recording]) -> list[str]:
    """Say which numbers count in SI, for want of a unit, where something speaks for another.

    Another recording states one, or the plant is read in one.
    """
    other = {q.name: q.display_unit for q in (*model.inputs, *model.outputs)}
    for recording in recordings:
        other |= {row.signal: row.unit for row in recording.mapping or () if row.unit}
    notes = []
    for recording in recordings:
        notes += [f"{row.signal} is {row.note}" for row in recording.mapping or () if row.note]
        unstated = [
            f"{row.signal} in {row.si_unit}, not {other[row.signal]}"
            for row in recording.mapping or ()
            if not row.unit
            and to_si(1.0, other.get(row.signal) or row.si_unit) != to_si(1.0, row.si_unit)
        ]
        if unstated:
            notes.append(
                f"{recording.name} states no unit, so numbers count {', '.join(unstated)}; else say"
                " the unit in the heading or in a mapping (--mapping)"
            )
    return notes


def sized_by_recordings(problem: Problem, effects: Iterable[str]) -> Problem:
    """Return a problem whose effects of the library know how long and fine its recordings are.

    When something may have happened, and how short a delay may be, follows from that.

    Args:
        effects: Names of attached effects, with the values that the library gives them.
    """
    longest = max((*problem.fit, *problem.hold_out), key=lambda r: r.duration)
    parameters = {q.name: q for q in problem.model.parameters}
    for name in effects:
        before, now = (
            every_name(problem.model.without(name), named=name, **known).get(name)
            for known in ({}, {"duration": longest.duration, "sample_time": longest.sample_time})
        )
        if before is None or now is None:
            continue
        for usual, sized in zip(before.effect.parameters, now.effect.parameters, strict=True):
            key = f"{name}.{usual.name}"
            value = parameters[key].value
            # What the user gave stands.
            value = sized.value if value == usual.value else value
            lower, upper = min(sized.lower, value), max(sized.upper, value)
            parameters[key] = replace(
                parameters[key], value=value, lower=lower, upper=upper, scale=sized.scale
            )
    return replace(problem, model=replace(problem.model, parameters=tuple(parameters.values())))


def _titles(paths: Sequence[Path]) -> list[str]:
    """Name recordings by their files, with the folder where two files share a name."""
    stems = [path.name.split(".")[0] for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{path.parent.name}/{stem}"
        for path, stem in zip(paths, stems, strict=True)
    ]
