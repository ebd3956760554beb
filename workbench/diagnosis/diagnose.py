"""Diagnosis: locate a mismatch, name what was left out, model it, prove it on held-out data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from workbench.computing.processes import Call, in_order, processes
from workbench.diagnosis.conclude import conclude
from workbench.diagnosis.division import with_some_held_out
from workbench.diagnosis.doubts import still_missing
from workbench.diagnosis.estimation.error_growth import growth_along
from workbench.diagnosis.estimation.fixed_parameters import (
    with_all_uncertainty,
    with_fixed_refitted,
    with_fixed_uncertainty,
)
from workbench.diagnosis.estimation.noise_colour import with_correlated_noise
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, blocks_as_trusted
from workbench.diagnosis.estimation.start import fit_with_likely_starts, likely_start
from workbench.diagnosis.experiment.next_experiment import Advice, next_experiment
from workbench.diagnosis.location.locate import Location, locate
from workbench.diagnosis.location.located_signal import missing_signals
from workbench.diagnosis.misrecorded_columns import (
    with_breaks_bridged,
    with_columns_tried,
    with_commands_in_time,
)
from workbench.diagnosis.nonparametric.fit import nonparametric_term
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.diagnosis.second_search import EARLY, VIEWS, View, beside
from workbench.diagnosis.selection.held_out import run_errors, settled_run, shown_on_bounds
from workbench.diagnosis.selection.rules import IMPERFECT, LEAST_SHOWN, NO_NAME
from workbench.diagnosis.selection.search import score, search
from workbench.diagnosis.selection.selected import Scored, Selected
from workbench.diagnosis.selection.task import Task
from workbench.diagnosis.selection.withdrawal import all_withdrawn, likely, run_freely
from workbench.diagnosis.stage_files import StageFiles, fingerprint
from workbench.diagnosis.stages import Diagnosis, Fitted, Prepared, Validated
from workbench.diagnosis.undeclared.noise import as_coarse_as_recorded
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.diagnosis.verdict import Verdict
from workbench.display import notebook_progress
from workbench.errors import NumericalError
from workbench.model import Model
from workbench.model.linear_system import with_free_coefficients
from workbench.physics.library import Hypothesis, Law, library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.registry import model_of
from workbench.recordings.checks import check_recording
from workbench.recordings.recording import Recording

_MOST_JOBS = 8
"""Processes that a diagnosis has at the most where nobody says: four laws at a time are compared to
the end, and a process takes some seconds and 250 MB to begin."""

Progress = Callable[[str], None]


def diagnose(
    model: Model | Any,
    fit_on: Sequence[Recording],
    hold_out: Sequence[Recording] = (),
    *,
    entries: Sequence[Hypothesis] | None = None,
    extra: Sequence[Law | Hypothesis] = (),
    priors: Sequence[Prior] | None = None,
    jobs: int | None = None,
    advise: bool = True,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose a model on recordings of the machine.

    Args:
        model: The plant, or what stands for it, such as a system of python-control.
        hold_out: Recordings to judge on; by default the last of several, or a part of the only one.
        entries: Effects that may be missing; the whole library by default.
        extra: Laws and hypotheses of your own that may be missing beside the library.
        priors: Free parameters of the nominal model; `default_priors` by default.
        jobs: Processes that work side by side; one per core by default, 8 at the most.
        advise: Whether to work out what to record next.
        folder: Where stages are kept: what an earlier call reached there is not done again.
        progress: Called with a line of text before each step; by default a notebook shows a bar.

    Raises:
        WorkbenchError: If there are no recordings, or they do not belong to the model.
        NumericalError: If the nominal model cannot be refitted.

    Example:
        >>> from workbench.diagnosis.estimation import simulated_recordings as made
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> forces = [made.pushes(400, largest=200.0, seed=i) for i in (1, 2)]
        >>> runs = [made.simulated_recording(axis, force, sample_time=0.01) for force in forces]
        >>> few = [e for e in library(axis) if e.law in ("creep", "linear_spring")]
        >>> diagnose(axis, runs[:1], runs[1:], entries=few, jobs=1).verdict.kind
        'nothing_missing'
    """
    *_, finished = stages(
        with_free_coefficients(model_of(model)),
        fit_on,
        hold_out,
        entries=entries,
        extra=extra,
        priors=priors,
        jobs=jobs,
        advise=advise,
        folder=folder,
        progress=progress,
    )
    return finished


def stages(
    model: Model,
    fit_on: Sequence[Recording],
    hold_out: Sequence[Recording],
    *,
    entries: Sequence[Hypothesis] | None = None,
    extra: Sequence[Law | Hypothesis] = (),
    priors: Sequence[Prior] | None = None,
    jobs: int | None = None,
    advise: bool = True,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> Iterator[Diagnosis]:
    """Diagnose a model stage by stage, as `diagnose` does.

    Yields:
        The diagnosis with each stage that is reached, and after each round of the search; the last
        one has a verdict.
    """
    (fit_on, hold_out), divided = with_some_held_out(model, fit_on, hold_out)
    say, jobs = progress or notebook_progress(), processes(jobs, _MOST_JOBS)
    both: Sequence[Recording] = (*fit_on, *hold_out)
    model, notes = with_undeclared(model, both)
    model, rows = as_coarse_as_recorded(model, both)
    both, late = with_commands_in_time(model, both)
    both, broken = with_breaks_bridged(model, both)
    late = (*late, *broken)
    fit_on, hold_out = both[: len(fit_on)], both[len(fit_on) :]
    model, noise = with_correlated_noise(model, both)
    rows = (*rows, *late, *noise)
    for note in filter(None, (divided, *notes, *(row["note"] for row in rows))):
        say(note)
    asked = _Asked(fit_on, hold_out, entries, extra, priors, jobs, advise, say)
    before: list[tuple[Model, View, Diagnosis]] = []

    def under(view: View, found: Diagnosis) -> tuple[View, Diagnosis, bool]:
        """Search again under a view, until that is of no use, and tell whether it is better."""
        view = replace(view, rows=(*rows, *view.rows))
        same = (known for of, early, known in before if of is model and view.searches_as(early))
        again: Diagnosis | None = next(same, None)
        if again is None:
            say(view.why)
            for again in _stages(asked, view, folder and folder / view.name):
                if why := view.ends(again):
                    say(f"{why}: the first search stands")
                    break
            assert again is not None
            if again.concluded is not None:
                before.append((model, view, again))
        return view, again, again.concluded is not None and view.better(again, found)

    found, first_round = None, entries is None and priors is None
    for reached in _stages(asked, View(model, rows=rows), folder):
        found = reached
        if found.concluded is None:
            yield found
        if not (first_round and found.rounds):
            continue
        first_round = False
        for early in EARLY:
            view = None if found.complete else early(found, model, both)
            if view is None:
                continue
            view, again, better = under(view, found)
            if better:
                found, model, rows = beside(again, found), view.model, view.rows
                break
        if found.concluded is not None:
            break
    assert found is not None
    # An early end keeps what the first search found.
    yield found
    for view_of in VIEWS if entries is None else VIEWS[:-1]:
        view = view_of(found, model, both)
        if view is None:
            continue
        view, again, better = under(view, found)
        if better:
            found, model, rows = beside(again, found), view.model, view.rows
        else:
            found = beside(found, again)
    yield found


class _Asked(NamedTuple):
    """What is asked of every search of a diagnosis, as `diagnose` is."""

    fit_on: Sequence[Recording]
    hold_out: Sequence[Recording]
    entries: Sequence[Hypothesis] | None
    extra: Sequence[Law | Hypothesis]
    priors: Sequence[Prior] | None
    jobs: int
    advise: bool
    say: Progress


def _stages(asked: _Asked, view: View, folder: Path | None) -> Iterator[Diagnosis]:
    """Diagnose a model that declares all its noise, under a view of its recordings."""
    fit_on, hold_out, entries, extra, priors, jobs, advise, say = asked
    model = view.model
    known = view.priors or tuple(priors if priors is not None else default_priors(model))
    recorded = tuple(q.name for q in model.outputs if q.name in fit_on[0])
    longest = max(fit_on, key=lambda recording: recording.duration)
    if entries is None:
        facts = RecordedFacts(recorded, longest.duration, longest.sample_time)
        offered = library(model, facts, extra=extra)
        if not view.name and (bare := _without_laws(model, offered)):
            say(
                f"no law acts at {', '.join(bare)}, in no unit that says what it is: state its"
                " role, such as m.port(..., role='force')"
            )
    offered = tuple(filter(view.tries, offered if entries is None else entries))
    files = StageFiles(folder, model, offered)
    files.add(fingerprint(model, (*fit_on, *hold_out), known, split=len(fit_on)))

    say("checking the recordings")
    prepared = files.reached(Prepared, lambda: prepare(model, fit_on, hold_out, known))
    prepared = replace(prepared, data=(*prepared.data, *view.rows))
    found = Diagnosis(model, prepared, **files.spent)
    if prepared.unfit:
        yield replace(found, concluded=conclude(found))
        return
    yield found

    say("refitting the nominal model")
    try:
        fitted = files.reached(Fitted, lambda: fit(model, prepared))
        # What cannot be run along the held-out recordings is judged on nothing.
        blocks_as_trusted(fitted.base, fitted.prepared.judging)
    except NumericalError as error:
        why = f"The nominal model cannot follow the recordings at all: {error}."
        verdict = Verdict("unexplained", why, model, data=prepared.data, **files.spent)
        yield replace(found, concluded=verdict)
        return
    prepared = fitted.prepared
    found = replace(found, prepared=prepared, fitted=fitted, **files.spent)
    yield found

    say("locating the mismatch")
    located = files.reached(Location, lambda: where(fitted.base, prepared))
    found = replace(found, located=located, **files.spent)
    yield found

    files.add(repr([(e.name, e.typical_size, e.effect.parameters) for e in offered]))
    task = Task(
        model,
        fitted.base,
        prepared.fitting,
        prepared.judging,
        known,
        located,
        None if entries is None else offered,
        jobs,
        say,
        tuple(extra),
        view.tries,
        view.complete,
    )
    scored = files.reached(Scored, lambda: score(task))
    found = replace(found, scored=scored, **files.spent)
    yield found

    begun = files.read(Selected)
    if begun is not None and begun.finished:
        found = replace(found, selected=begun, **files.spent)
    else:
        for selected in search(task, scored, begun):
            if (
                selected.finished
                and not view.among
                and not selected.accepted
                and not scored.near_noise(fitted.base)
            ):
                selected = _without_name(task, found, selected)  # noqa: PLW2901
            if selected.finished and _hollow(task, found, selected):
                why = "beside it nearly everything that was missing is missing still"
                selected = all_withdrawn(task, selected, why, told=False)  # noqa: PLW2901
            told = replace(found, selected=selected)
            if selected.finished and not told.improved and not told.complete:
                found, selected = relocated(task, found, selected)  # noqa: PLW2901
            files.write(selected)
            found = replace(found, selected=selected, **files.spent)
            yield found

    files.add(f"advise {advise}")
    finished = found
    validated = files.reached(
        Validated, lambda: validate(finished, advise=advise, jobs=jobs, say=say)
    )
    found = replace(found, validated=validated, **files.spent)
    yield replace(found, concluded=conclude(found))


def _without_laws(model: Model, offered: Sequence[Hypothesis]) -> list[str]:
    """Return the ports of plain numbers at which no law of the library acts."""
    acting = {port for entry in offered for port in entry.ports}
    plain = (q.name for q in model.ports if q.unit == "1" and not q.role)
    return [name for name in plain if name not in acting]


def prepare(
    model: Model,
    fit_on: Sequence[Recording],
    hold_out: Sequence[Recording],
    priors: Sequence[Prior],
) -> Prepared:
    """Check and observe the recordings."""
    needed = [q.name for q in model.inputs]
    reports = [
        with_columns_tried(
            model,
            check_recording(
                # What drives the model is held between samples, whatever its column was taken for.
                r.with_roles({n: "command" for n in needed if n in r}),
                model=model,
                required=[*needed, *(q.name for q in model.outputs if q.name in r)],
            ),
        )
        for r in (*fit_on, *hold_out)
    ]
    data = tuple(row for report in reports for row in report.as_data())
    for report in reports:
        if not report.fit:
            reason = next(c.note for c in report.checks if c.result == "unfit")
            unfit = f"Recording {report.name} cannot be judged: {reason}"
            return Prepared((), (), tuple(priors), data, unfit)
    seen = [observe(model, report.recording) for report in reports]
    return Prepared(tuple(seen[: len(fit_on)]), tuple(seen[len(fit_on) :]), tuple(priors), data)


def fit(model: Model, prepared: Prepared) -> Fitted:
    """Refit the nominal model."""
    base, fitting = fit_with_likely_starts(model, prepared.fitting, prepared.priors)
    judging = tuple(likely_start(base.model, r, r, base.noise_scale) for r in prepared.judging)
    fitting, judging = (tuple(growth_along(base, r) for r in g) for g in (fitting, judging))
    started = replace(prepared, fitting=fitting, judging=judging)
    return Fitted(with_fixed_uncertainty(base, fitting), started)


def where(base: ProcessNoiseFit, prepared: Prepared) -> Location:
    """Locate what the refitted nominal model lacks; nowhere if that cannot be told."""
    try:
        return locate(base.model, prepared.fitting)
    except (NumericalError, np.linalg.LinAlgError):
        return Location({})


def relocated(task: Task, found: Diagnosis, selected: Selected) -> tuple[Diagnosis, Selected]:
    """Locate again what no law explains, where an unknown input at one place explains as much.

    Parameters that stood in for it lead astray: they are refitted beside the input.
    """
    assert found.fitted is not None
    if task.one_place is None:
        return found, selected
    location, base = task.one_place
    fitted = replace(found.fitted, base=base)
    selected = replace(selected, extended=base, fits=(base,), closest={}, runs={})
    return replace(found, fitted=fitted, located=location), selected


def _hollow(task: Task, found: Diagnosis, selected: Selected) -> bool:
    """Whether all that was found is doubted, and nearly all that was missing is left beside it.

    What takes most of the error of free runs is there all the same.
    """
    doubted = [bool(a.candidate.doubts) for a in selected.accepted]
    if not doubted or not all(doubted) or found.before is None:
        return False
    if run_freely(task, selected)[1] >= LEAST_SHOWN:
        return False
    started = tuple(task.started(task.fitting, selected.extended.model))
    left = where(selected.extended, replace(found.prepared, fitting=started))
    return still_missing(found.before, left) >= NO_NAME


def _without_name(task: Task, found: Diagnosis, selected: Selected) -> Selected:
    """Fit a term without a name where nothing of the library explains the recordings."""
    prepared = found.prepared
    location, base = task.one_place or (found.before, found.base)
    ports = location.ports(found.nominal) if location else ()
    if not ports:
        return likely(selected)
    task.say(f"fitting a law without a name at {', '.join(ports)}")
    try:
        term = nonparametric_term(base, prepared.fitting, prepared.judging, ports, prepared.priors)
    except Exception as error:  # noqa: BLE001
        # What was found until here must not be lost.
        term = NonparametricTerm(base, ports, reason=f"it could not be tried, because {error}")
    if term.accepted:
        return replace(selected, nonparametric=term, extended=term.fit)
    return likely(replace(selected, nonparametric=term))


def validate(found: Diagnosis, *, advise: bool = True, jobs: int = 1, say: Progress) -> Validated:
    """Judge what was found on the held-out recordings, and work out what to record next."""
    selected, prepared = found.selected, found.prepared
    assert selected is not None
    task = Task(found.nominal, found.base, prepared.fitting, prepared.judging, prepared.priors)
    known = selected.closest
    refitted = known.get("refitted") or task.closest(found.base, robust=True)
    extended, location, run, judging = refitted, None, dict(selected.runs), prepared.judging
    if found.improved:
        extended = known.get("extended") or task.closest(selected.extended, robust=True)
        started = task.started(prepared.fitting, extended.model)
        if extended.noise_scale <= IMPERFECT:
            judged = task.started(judging, extended.model)
            tried = with_fixed_refitted(extended, started, judged)
            if not np.array_equal(extended.model.values, tried.model.values):
                before, after = (
                    run_errors(fit, found.nominal, judging) for fit in (extended, tried)
                )
                if after.spoilt_from(before):
                    # What predicts the next sample better may run further off.
                    tried = extended
                else:
                    run.pop("extended", None)
            extended = tried
        extended = with_all_uncertainty(extended, started)
        judging = _as_unstable(extended, task, judging)
        if judging is not prepared.judging:
            run.clear()
        say("locating what is left")
        location = where(extended, replace(prepared, fitting=tuple(started)))
    say("running the models freely on the held-out recordings")
    # The nominal model is corrected where windows begin as much as the refitted one.
    models = {
        "nominal": (found.nominal, refitted.noise_scale),
        "refitted": (refitted.model, refitted.noise_scale),
        "extended": (extended.model, extended.noise_scale),
    }
    runs = {
        label: run.get(label)
        or {r.name: settled_run(model, found.nominal, r, scale) for r in judging}
        for label, (model, scale) in models.items()
    }
    wrong: tuple[str, ...] = ()
    if not found.improved and found.base.noise_scale <= IMPERFECT:
        wrong = shown_on_bounds(
            found.base, found.nominal, prepared.fitting, prepared.judging, prepared.priors
        )
    validated = Validated(refitted, extended, runs, location, wrong=wrong)
    found = replace(found, validated=validated)
    questions: list[Call[Any]] = [(missing_signals, (found,))]
    if location is not None and extended.noise_scale > IMPERFECT:
        assert found.fitted is not None
        told = replace(found.fitted, base=extended)
        left = Diagnosis(found.nominal, prepared, told, location)
        questions.append((missing_signals, (left,)))
    if advise:
        questions.append((_advice, (found,)))
    say("telling when and where it acts" + (", choosing what to record next" if advise else ""))
    (missing, why), *others = in_order(questions, jobs=jobs)
    validated = replace(validated, missing=missing, not_shown=why)
    if advise:
        advice = others.pop()
        validated = replace(validated, advice=advice.said, plan=advice.plan)
    for (left, *_), _ in others:
        validated = replace(validated, left=left)
    return validated


def _as_unstable(
    extended: ProcessNoiseFit, task: Task, judging: tuple[Observed, ...]
) -> tuple[Observed, ...]:
    """Return recordings as a model has them that runs away where the nominal one does not.

    The spring of a hull that is pressed together the deeper it is lets a submarine sink: a run of
    all of a recording would tell how well its start is known.
    """
    own = [growth_along(extended, r) for r in task.started(judging, extended.model)]
    if all(r.diverges or not q.diverges for r, q in zip(judging, own, strict=True)):
        return judging
    return tuple(replace(r, growth=q.growth) for r, q in zip(judging, own, strict=True))


def _advice(found: Diagnosis) -> Advice:
    try:
        return next_experiment(found, found.prepared.fitting)
    except Exception as error:  # noqa: BLE001
        # Advice that fails must not cost the verdict.
        return Advice({"reason": f"it could not be worked out, because {error}"})
