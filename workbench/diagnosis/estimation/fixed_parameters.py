"""Intervals that count what a refit holds although it is not known exactly.

Some parameters scale with others, so that no recording tells them apart: the volume of the muscles
with every flow. One of them is fixed; its uncertainty then belongs to the intervals of the others,
after S. F. Schmidt's consider analysis (1966).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.estimation.refit_result import Outcome, summarise
from workbench.errors import NumericalError


def with_fixed_uncertainty(fit: ProcessNoiseFit, recordings: Sequence[Observed]) -> ProcessNoiseFit:
    """Widen the intervals of a refit by what the parameters that it left may be wrong.

    ``P = (J^T J + diag(prior variances)^-1)^-1`` over free and fixed parameters together, of which
    the block of the free ones is kept; the estimates stay.
    """
    model = fit.model
    estimates = {e.name: e.value for e in fit.refit.estimates}
    names = [q.name for q in model.parameters if q.fixed and q.name not in estimates]
    if not names:
        return fit
    own = [e.prior for e in fit.refit.estimates]
    # The nominal value is the best guess of what is fixed: only its uncertainty counts here.
    every = [*own, *default_priors(model, names)]
    fixed = {q.name: q.value for q in model.parameters if q.name in names}
    filter_ = filter_of(model, recordings[0], fit.noise_scale, [p.name for p in every])
    try:
        parts = filter_.along(recordings, model.values)
    except NumericalError:
        return fit
    outcome = Outcome(
        np.array([(estimates | fixed)[p.name] for p in every]),
        parts,
        fit.cost,
        fit.refit.converged,
        fit.refit.iterations,
        fit.refit.noise_scale,
    )
    wide = summarise(model, recordings, every, outcome)
    count = len(own)
    return replace(
        fit,
        refit=replace(
            fit.refit,
            estimates=wide.estimates[:count],
            covariance=wide.covariance[:count, :count],
            inflations=wide.inflations[:count],
        ),
    )
