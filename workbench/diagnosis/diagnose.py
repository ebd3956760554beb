"""Diagnosis: locate a mismatch, name what was left out, model it, prove it on held-out data."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from workbench.diagnosis.conclude import IMPERFECT, conclude, explained, held_out_errors
from workbench.diagnosis.diagnosis import Diagnosis
from workbench.diagnosis.estimation.fixed_parameters import with_held
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, fit_with_process_noise
from workbench.diagnosis.experiment.next_experiment import next_experiment
from workbench.diagnosis.location.locate import locate
from workbench.diagnosis.nonparametric.fit import free_form
from workbench.diagnosis.selection.held_out import settled_run
from workbench.diagnosis.selection.search import search, started, withdraw_all
from workbench.diagnosis.verdict import Verdict
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Model
from workbench.physics.library import Hypothesis
from workbench.recordings.checks import check_recording
from workbench.recordings.recording import Recording

Progress = Callable[[str], None]

LEAST_EXPLAINED = 0.3
"""Share of the held-out free-run error beyond the noise that everything found must remove."""

MOST_SEARCHES = 3
"""How many effects may be tried as the first one found."""


def diagnose(
    model: Model,
    fit_on: Sequence[Recording],
    hold_out: Sequence[Recording],
    *,
    entries: Sequence[Hypothesis] | None = None,
    priors: Sequence[Prior] | None = None,
    jobs: int = 2,
    advise: bool = True,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose a model on recordings of the machine.

    Args:
        model: The nominal model.
        fit_on: Recordings to fit on.
        hold_out: Recordings to judge on.
        entries: Effects that may be missing; the whole library by default.
        priors: Free parameters of the nominal model; `default_priors` by default.
        jobs: Number of processes.
        advise: Whether to work out what to record next.
        progress: Called with a line of text before each step.

    Returns:
        The diagnosis, with the verdict.

    Raises:
        WorkbenchError: If there are no recordings or they do not belong to the model.
        NumericalError: If the nominal model cannot be refitted.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up_recording, pushes
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> runs = [
        ...     made_up_recording(axis, pushes(400, largest=200.0, seed=i), sample_time=0.01)
        ...     for i in (1, 2)
        ... ]
        >>> diagnose(axis, runs[:1], runs[1:], jobs=1).verdict.kind
        'nothing_missing'
    """
    if not fit_on or not hold_out:
        raise WorkbenchError(
            f"a diagnosis needs recordings to fit on and others to judge on; it got {len(fit_on)}"
            f" and {len(hold_out)}"
        )
    say = progress or (lambda text: None)
    began = time.perf_counter()
    say("checking the recordings")
    needed = [q.name for q in model.inputs]
    # What drives the model is held between samples, whatever its column was taken for.
    fit_on, hold_out = (
        [r.with_roles({n: "command" for n in needed if n in r}) for r in recordings]
        for recordings in (fit_on, hold_out)
    )
    reports = [
        check_recording(
            r,
            model=model,
            required=[*needed, *(q.name for q in model.outputs if q.name in r)],
        )
        for r in (*fit_on, *hold_out)
    ]
    data = tuple(row for report in reports for row in report.as_data())
    if not all(report.fit for report in reports):
        bad = next(report for report in reports if not report.fit)
        reason = next(c.note for c in bad.checks if c.result == "unfit")
        unfit = ProcessNoiseFit.__new__(ProcessNoiseFit)
        diagnosis = Diagnosis(model, unfit, unfit)
        diagnosis.verdict = Verdict(
            "data_unfit",
            f"Recording {bad.name} cannot be judged: {reason}",
            model,
            data=data,
            seconds=time.perf_counter() - began,
        )
        return diagnosis
    fitting = [observe(model, report.recording) for report in reports[: len(fit_on)]]
    judging = [observe(model, report.recording) for report in reports[len(fit_on) :]]
    known = tuple(priors if priors is not None else default_priors(model))
    say("refitting the nominal model")
    base = with_held(fit_with_process_noise(model, fitting, known), fitting)
    diagnosis = Diagnosis(model, base, base)
    say("locating the mismatch")
    diagnosis.before = locate(base.model, fitting)
    # What gains the most at first may lead nowhere: then the next best begins.
    failed: list[str] = []
    while len(failed) < MOST_SEARCHES:
        began_with = search(
            diagnosis, fitting, judging, known, entries, jobs, say, without=tuple(failed)
        )
        if diagnosis.accepted:
            say("running the improved model freely on the held-out recordings")
            _run_freely(diagnosis, judging, ("refitted", "extended"))
            if explained(held_out_errors(diagnosis, judging)) < LEAST_EXPLAINED:
                withdraw_all(
                    diagnosis,
                    "what was found takes away less than"
                    f" {100 * LEAST_EXPLAINED:.0f} % of the error of the free run on held-out"
                    " recordings",
                )
        if diagnosis.accepted or began_with is None:
            break
        failed.append(began_with)
    if not diagnosis.accepted and base.share > IMPERFECT:
        _free(diagnosis, fitting, judging, known, say)
    if diagnosis.extended is not base:
        diagnosis.extended = with_held(diagnosis.extended, started(fitting, diagnosis))
        say("locating what is left")
        diagnosis.after = locate(diagnosis.extended.model, started(fitting, diagnosis))
    say("running the models freely on the held-out recordings")
    _run_freely(diagnosis, judging, ("nominal", "refitted", "extended"))
    advice: dict[str, object] = {}
    if advise:
        say("choosing what to record next")
        advice = next_experiment(diagnosis, fitting)
    seconds = time.perf_counter() - began
    diagnosis.verdict = conclude(diagnosis, judging, data, advice, seconds)
    return diagnosis


def _run_freely(diagnosis: Diagnosis, judging: Sequence[Observed], labels: Sequence[str]) -> None:
    """Simulate models along the held-out recordings, unless that was done before."""
    models = {
        "nominal": diagnosis.nominal,
        "refitted": diagnosis.base.model,
        "extended": diagnosis.extended.model,
    }
    for label in labels:
        if label in diagnosis.runs:
            continue
        diagnosis.runs[label] = {
            r.name: settled_run(models[label], diagnosis.nominal, r) for r in judging
        }
    diagnosis.runs = {label: diagnosis.runs[label] for label in models if label in diagnosis.runs}


def _free(
    diagnosis: Diagnosis,
    fitting: Sequence[Observed],
    judging: Sequence[Observed],
    priors: Sequence[Prior],
    say: Progress,
) -> None:
    """Fit a law without a name where nothing of the library explains the recordings."""
    ports = diagnosis.before.ports(diagnosis.nominal) if diagnosis.before else ()
    if not ports:
        return
    say(f"fitting a law without a name at {', '.join(ports)}")
    try:
        diagnosis.free_form = free_form(diagnosis.base, fitting, judging, ports, priors)
    except NumericalError:
        return
    if diagnosis.free_form.accepted:
        diagnosis.extended = diagnosis.free_form.fit
