"""What a refit is worth: errors on recordings that it has not seen, against the noise."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.computing.counted import Work, done, since
from workbench.diagnosis.estimation.error_growth import growth_along
from workbench.diagnosis.estimation.free_run import FreeRun, free_run
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.estimation.refit_result import Refit
from workbench.diagnosis.estimation.start import fit_with_likely_starts, fitted_start, likely_start
from workbench.diagnosis.estimation.windows import MILD, settled, windowed_run
from workbench.diagnosis.problem import Problem
from workbench.diagnosis.selection.held_out import floor_of
from workbench.diagnosis.selection.rules import IMPERFECT
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import of_difference, parse_unit
from workbench.recordings.case import RefitSettings

AT_NOISE, NEAR_NOISE = 1.5, 3.0
"""Times the noise below which a held-out error is at it, in whole numbers, and up to which it is so
near that a right model may be the cause: dry friction stops some steps of a converter further."""

_LIKELY = 2.0
"""Times the root mean square of errors that one in twenty of them exceeds."""

_DRAWS = 8


@dataclass(frozen=True)
class HeldOut:
    """Free-run errors of one output on one held-out recording, rms in ``unit``.

    Args:
        spread: Standard deviation of the measurements, in ``unit``.
        nominal: Error with the nominal parameters, in ``unit``.
        refitted: Error with the refitted ones, in ``unit``.
        limited: Error that noise alone would leave: that of the measurements and what the
            uncertainty of the start and of the parameters makes of it, in ``unit``.
        noise: Noise of the measurements, in ``unit``.
    """

    recording: str
    output: str
    unit: str
    spread: float
    nominal: float
    refitted: float
    limited: float
    noise: float

    @property
    def as_expected(self) -> bool:
        """Whether the refitted error may be what noise alone would leave."""
        return self.refitted <= _LIKELY * self.limited

    @property
    def times_noise(self) -> float:
        """The refitted error over the noise of the measurements, dimensionless."""
        return self.refitted / self.noise


@dataclass(frozen=True)
class RefitReport:
    """A refit and what it is worth.

    Args:
        nominal: Free runs of the nominal model on the held-out recordings.
        refitted: Free runs of the refitted model on them.
        seconds: Time that the refit took, in s.
    """

    problem: Problem
    refit: Refit
    nominal: tuple[FreeRun, ...]
    refitted: tuple[FreeRun, ...]
    rows: tuple[HeldOut, ...]
    seconds: float
    work: Work = field(default_factory=dict)

    @property
    def reaches_floor(self) -> bool:
        """Whether every held-out error is near the noise of the measurements.

        Where a filter had to take up much at the ports it is not: there the model lacks something.
        """
        return self.refit.noise_scale <= IMPERFECT and self.times_noise <= NEAR_NOISE

    @property
    def times_noise(self) -> float:
        """The largest held-out error over its noise, dimensionless; NaN where that is unknown."""
        return float(np.max([row.times_noise for row in self.rows] or [math.nan]))

    def differences(self) -> tuple[tuple[str, float, float, float], ...]:
        """Return estimates beside published values.

        Returns:
            Name, estimate and published value in SI, and how many standard deviations they are
            apart, dimensionless.
        """
        pairs = ((self.refit.estimate(n), value) for n, value in self.problem.published.items())
        return tuple((e.name, e.value, value, (e.value - value) / e.std) for e, value in pairs)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader has to know of the recordings and of how the model was run along them."""
        restarts = (run.restarts for run in self.refitted if run.restarts)
        return (*self.problem.notes, *dict.fromkeys(restarts))

    def __str__(self) -> str:
        lines = [f"{self.problem.title}: refitted on {len(self.problem.fit)} recording(s)", ""]
        lines += [str(self.refit), f"  process-noise scale: {self.refit.noise_scale:g}"]
        for name, value, published, sigmas in self.differences():
            lines.append(
                f"  {name}: {value:.5g}, published {published:.5g},"
                f" {100 * (value / published - 1):+.2f} %, {sigmas:+.1f} standard deviations"
            )
        lines += ["", "free run on held-out recordings, rms; refitted: with the parameters above"]
        lines.append(
            f"  {'recording':<28} {'output':<12} {'unit':<5} {'spread':>9} {'nominal':>9}"
            f" {'refitted':>9} {'limit':>9} {'noise':>9}"
        )
        for r in self.rows:
            lines.append(
                f"  {r.recording:<28} {r.output:<12} {r.unit:<5} {r.spread:>9.4g}"
                f" {r.nominal:>9.4g} {r.refitted:>9.4g} {r.limited:>9.4g} {_plain(r.noise):>9}"
                + _remark(r)
            )
        lines += [f"  {note}" for note in self.notes]
        return "\n".join(lines)


def run_refit(problem: Problem, *, progress: Callable[[str], None] | None = None) -> RefitReport:
    """Refit a model and judge it on recordings that it has not seen.

    Returns:
        Estimates, held-out errors of the nominal and the refitted model, and the errors that noise
        alone would leave.

    Raises:
        WorkbenchError: If there is no recording to fit on.
        NumericalError: If no start could be evaluated.
    """
    if not problem.fit:
        raise WorkbenchError(f"{problem.title} has no recording to fit on; give at least one")
    fit = [problem.observed(recording) for recording in problem.fit]
    judged = [(problem.model, recording) for recording in problem.hold_out]
    judged += problem.in_loop
    priors, how = default_priors(problem.model), problem.refit
    began, begun = time.perf_counter(), done()
    scale = MILD
    if how.stages:
        found = refit(
            problem.model,
            fit,
            priors=priors,
            stages=how.stages,
            starts=how.starts,
            progress=progress,
        )
    else:
        if progress:
            progress("refitting")
        fitted, _ = fit_with_likely_starts(problem.model, fit, priors)
        found, scale = fitted.refit, fitted.noise_scale
    seconds, work = time.perf_counter() - began, since(begun)
    if progress:
        progress("free runs on held-out recordings")
    nominal, refitted, rows = [], [], []
    for model, recording in judged:
        changed = model.with_parameters(found.values)
        own = ProcessNoiseFit(replace(found, model=changed), scale)
        # Where a run begins depends on the parameters between it and the first measurements.
        both = [problem.observed(recording, m) for m in (model, changed)]
        if not how.stages:
            both = [likely_start(changed, seen, seen, scale) for seen in both]
        as_nominal, observed = (growth_along(own, seen) for seen in both)
        if observed.diverges:
            before = windowed_run(model, model, as_nominal, scale)
            after = windowed_run(changed, model, observed, scale)
            floor = np.sqrt(floor_of(own, model, observed)).tolist()
            limited = dict(zip(observed.used, floor, strict=True))
        else:
            before = free_run(model, _started(how, model, as_nominal))
            started = _started(how, changed, observed)
            after = free_run(changed, started)
            limited = noise_limited(own.refit, started, how)
        nominal.append(before)
        refitted.append(after)
        for k, (name, row) in enumerate(zip(observed.used, observed.rows(model), strict=True)):
            unit = of_difference(model.outputs[row].display_unit)
            size = parse_unit(unit).factor
            rows.append(
                HeldOut(
                    observed.name,
                    name,
                    unit,
                    after.spread[name] / size,
                    before.rmse[name] / size,
                    after.rmse[name] / size,
                    limited[name] / size,
                    float("nan") if how.noise_is_model_error else observed.all_noise_rms[k] / size,
                )
            )
    return RefitReport(problem, found, tuple(nominal), tuple(refitted), tuple(rows), seconds, work)


def noise_limited(found: Refit, observed: Observed, how: RefitSettings) -> dict[str, float]:
    """Return the free-run error that noise alone would leave.

    The parameters are drawn from the distribution of their estimates, and the model is run with
    each from the start that it would have if the found ones were right; what these runs differ by
    adds to the noise of the measurements.

    Returns:
        Root mean square error by output, in its SI unit.
    """
    rng = np.random.default_rng(0)
    centre = free_run(found.model, observed)
    squares = []
    for _ in range(_DRAWS if centre.finite else 0):
        drawn = found.model.with_parameters(found.drawn(rng))
        read = centre.simulated + observed.noise(rng) + 0.0 * observed.outputs
        run = free_run(drawn, _started(how, drawn, replace(observed, outputs=read)))
        if run.finite:
            squares.append(np.mean((run.simulated - centre.simulated) ** 2, axis=0))
    spread = np.mean(squares, axis=0) if squares else np.zeros(len(observed.used))
    total = np.sqrt(spread + observed.all_noise_rms**2)
    return dict(zip(observed.used, total.tolist(), strict=True))


def _plain(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"


def _remark(row: HeldOut) -> str:
    if row.limited > row.spread:
        return "  parameters too uncertain to tell"
    if not math.isfinite(row.noise):
        return f"  {_short(row.refitted / row.limited)} times the limit"
    if row.times_noise < AT_NOISE:
        return "  at the noise"
    limit = row.limited / row.noise
    return f"  {_short(row.times_noise)} times the noise, the limit {_short(limit)} times"


def _short(value: float) -> str:
    return f"{float(f'{value:.2g}'):.10g}"


def _started(how: RefitSettings, model: Model, observed: Observed) -> Observed:
    if not how.start_samples:
        return settled(model, model, observed)
    samples = min(how.start_samples, len(observed.outputs))
    return fitted_start(model, observed, samples=samples)
