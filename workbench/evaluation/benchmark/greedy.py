"""Baseline: the best-scored effect of the library is added as long as the fit's criterion improves.

No location, no held-out recording, no rule on sign or size: what plain forward selection with the
Bayesian information criterion would name.
"""

from __future__ import annotations

import math
import time
from typing import Any

from workbench.diagnosis.estimation.free_run import free_run, rms_of
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import entry_priors, entry_start
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    start_values,
)
from workbench.diagnosis.selection.score import Score, Scores, score_library
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
        diagnosis: The tool's diagnosis, whose refit, first scores and refits are taken over.

    Returns:
        Findings as a verdict has them, their held-out errors by output in SI, and why it stopped.
    """
    began = time.process_time()
    prepared, nominal, current = diagnosis.prepared, diagnosis.nominal, diagnosis.base
    heads = [_head(r, FIT_S) for r in prepared.fitting]
    measurements = sum(r.outputs.size for r in heads)
    free, findings = list(prepared.priors), list[dict[str, Any]]()
    scores, refits = diagnosis.rounds[0] if diagnosis.rounds else (None, ())
    known = {c.entry.name: c.fit for c in refits}

    def cost(fit: ProcessNoiseFit) -> float:
        try:
            started = [extended_start(r, nominal, fit.model) for r in heads]
            return float(blocks_of_cost(fit, started).sum())
        except NumericalError:
            return math.inf

    def scored(fit: ProcessNoiseFit) -> Scores:
        short = [extended_start(_head(r, SCORE_S), nominal, fit.model) for r in heads]
        entries = library(fit.model, RecordedFacts(heads[0].used))
        entries = tuple(e for e in entries if not e.stiff)
        return score_library(fit.model, short, free, entries, noise_scale=fit.noise_scale)

    def refitted(fit: ProcessNoiseFit, best: Score) -> ProcessNoiseFit | None:
        entry = best.entry
        effect = entry.at_size(1.0) if entry.replaces else entry.at_size(0.0, best.shape)
        model = fit.model.with_effect(effect)
        try:
            return fit_with_process_noise(
                model,
                [extended_start(r, nominal, model) for r in heads],
                (*free, *entry_priors(entry)),
                start=entry_start(entry, best.size) | start_values(fit.refit, free),
                noise_scale=fit.noise_scale,
                follow=False,
                enough=10.0,
            )
        except (NumericalError, WorkbenchError):
            return None

    stopped = "three effects"
    while len(findings) < MOST:
        if time.process_time() - began > SECONDS:
            stopped = "time"
            break
        best = max((scores or scored(current)).scores, key=lambda s: s.gain)
        if best.gain <= 0.0:
            stopped = "no score"
            break
        name, own = best.entry.name, entry_priors(best.entry)
        fit = known.get(name) or refitted(current, best)
        if fit is None:
            stopped = "the refit failed"
            break
        gain = cost(current) - cost(fit)
        if gain <= 0.5 * len(own) * math.log(measurements):
            stopped = "the criterion"
            break
        sizes = {
            e.name.removeprefix(f"{name}."): picked(e, "value unit")
            | {"std": e.std if math.isfinite(e.std) else None}
            for e in fit.refit.estimates
            if e.name.startswith(f"{name}.")
        }
        told = {"effect": name, "where": list(best.entry.ports), "class": [name]}
        findings.append(told | {"gain": gain, "parameters": sizes})
        free += own
        current, scores, known = fit, None, {}
    if not findings:
        return [], {}, stopped
    begun = (extended_start(r, nominal, current.model) for r in prepared.judging)
    return findings, rms_of([free_run(current.model, r).rmse for r in begun]), stopped


def _head(observed: Observed, seconds: float) -> Observed:
    count = max(1, round(seconds / observed.sample_time))
    return observed.part(slice(count))
