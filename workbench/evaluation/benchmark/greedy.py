"""Baseline: the best-scored effect of the library is added as long as the fit's criterion improves.

No location, no held-out recording, no rule on sign or size: what plain forward selection with the
Bayesian information criterion would name.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

from workbench.diagnosis.estimation.free_run import free_run, rms_of
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior, entry_priors, entry_start
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    start_values,
)
from workbench.diagnosis.selection.score import Score, score_library
from workbench.diagnosis.stages import Diagnosis
from workbench.errors import NumericalError, WorkbenchError
from workbench.files import picked
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts

MOST = 3
"""Effects at the most."""

FIT_S, SCORE_S = 8.0, 5.0
"""Length of each recording on which the baseline refits and scores anew, s."""

SECONDS = 15.0
"""Processor time after which no further effect is tried."""


def greedy(diagnosis: Diagnosis) -> tuple[list[dict[str, Any]], dict[str, float], str]:
    """Name effects by plain forward selection.

    Args:
        diagnosis: The tool's diagnosis, whose refit and first scores are taken over.

    Returns:
        Findings as a verdict has them, their held-out errors by output in SI, and why it stopped.
    """
    began = time.process_time()
    prepared = diagnosis.prepared
    heads = [_head(r, FIT_S) for r in prepared.fitting]
    free, current = list(prepared.priors), diagnosis.base
    findings: list[dict[str, Any]] = []
    stopped = "three effects"
    for _ in range(MOST):
        if time.process_time() - began > SECONDS:
            stopped = "time"
            break
        best = _best(diagnosis, current, heads, free)
        if best is None:
            stopped = "no score"
            break
        fit = _with(diagnosis, current, best, free, heads)
        if fit is None:
            stopped = "the refit failed"
            break
        own = entry_priors(best.entry)
        measurements = sum(r.outputs.size for r in heads)
        gain = _cost(diagnosis, current, heads) - _cost(diagnosis, fit, heads)
        if gain <= 0.5 * len(own) * math.log(measurements):
            stopped = "the criterion"
            break
        name = best.entry.name
        sizes = {
            e.name.removeprefix(f"{name}."): picked(e, "value unit")
            | {"std": e.std if math.isfinite(e.std) else None}
            for e in fit.refit.estimates
            if e.name.startswith(f"{name}.")
        }
        told = {"effect": name, "where": list(best.entry.ports), "class": [name]}
        findings.append(told | {"gain": gain, "parameters": sizes})
        free += own
        current = fit
    return findings, _errors(diagnosis, current) if findings else {}, stopped


def _best(
    diagnosis: Diagnosis,
    current: ProcessNoiseFit,
    heads: Sequence[Observed],
    free: Sequence[Prior],
) -> Score | None:
    if current is diagnosis.base and diagnosis.rounds:
        scores = diagnosis.rounds[0][0]
    else:
        short = [extended_start(_head(r, SCORE_S), diagnosis.nominal, current.model) for r in heads]
        entries = library(current.model, RecordedFacts(heads[0].used))
        entries = tuple(e for e in entries if not e.stiff)
        scores = score_library(current.model, short, free, entries, noise_scale=current.noise_scale)
    best = max(scores.scores, key=lambda s: s.gain)
    return best if best.gain > 0.0 else None


def _with(
    diagnosis: Diagnosis,
    current: ProcessNoiseFit,
    best: Score,
    free: Sequence[Prior],
    heads: Sequence[Observed],
) -> ProcessNoiseFit | None:
    """Refit with an effect, or take the tool's own refit of it."""
    if current is diagnosis.base and diagnosis.rounds:
        for candidate in diagnosis.rounds[0][1]:
            if candidate.entry.name == best.entry.name and candidate.fit is not None:
                return candidate.fit
    entry = best.entry
    effect = entry.at_size(1.0) if entry.replaces else entry.at_size(0.0, best.shape)
    model = current.model.with_effect(effect)
    try:
        return fit_with_process_noise(
            model,
            [extended_start(r, diagnosis.nominal, model) for r in heads],
            (*free, *entry_priors(entry)),
            start=entry_start(entry, best.size) | start_values(current.refit, free),
            noise_scale=current.noise_scale,
            follow=False,
            enough=10.0,
        )
    except (NumericalError, WorkbenchError):
        return None


def _cost(diagnosis: Diagnosis, fit: ProcessNoiseFit, heads: Sequence[Observed]) -> float:
    started = [extended_start(r, diagnosis.nominal, fit.model) for r in heads]
    try:
        return float(blocks_of_cost(fit, started).sum())
    except NumericalError:
        return math.inf


def _errors(diagnosis: Diagnosis, fit: ProcessNoiseFit) -> dict[str, float]:
    judging = diagnosis.prepared.judging
    begun = (extended_start(r, diagnosis.nominal, fit.model) for r in judging)
    return rms_of([free_run(fit.model, r).rmse for r in begun])


def _head(observed: Observed, seconds: float) -> Observed:
    count = max(1, round(seconds / observed.sample_time))
    return observed.part(slice(count))
