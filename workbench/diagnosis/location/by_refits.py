"""Locating what no law explains: the parameters are refitted beside an unknown input at each place.

An input that is allowed everywhere lets parameters stand in for what is missing, and then it is
missed elsewhere. N. Kristensen, H. Madsen and S. Jorgensen, Automatica 40 (2004) 225: the state
equation whose diffusion is significant, estimated together with the parameters, is the deficient
one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from workbench.diagnosis.estimation.prediction_error import Observed, disturbances
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.estimation.refit_result import Refit
from workbench.diagnosis.location.locate import TRUSTED, Location, groups_of
from workbench.errors import NumericalError

_LEVELS = (10.0, 30.0, 100.0, 300.0, 1000.0)
"""Process-noise scales that are tried at a place."""


def located_by_refits(
    base: ProcessNoiseFit, recordings: Sequence[Observed], priors: Sequence[Prior]
) -> tuple[Location, ProcessNoiseFit] | None:
    """Find the one group of ports at which an unknown input explains as much as one everywhere.

    Args:
        base: The nominal model, refitted with an unknown input everywhere.

    Returns:
        Where it is, and the model with the parameters beside it; None if no such group is.
    """
    sizes, fits = disturbances(base.model, 1.0), dict[str, Refit]()
    for group, ports in groups_of(base.model).items():
        values = base.refit.values
        for level in _LEVELS:
            pushed = {q: rms * (level if q in ports else TRUSTED[0]) for q, rms in sizes.items()}
            try:
                trial = refit(
                    base.model,
                    recordings,
                    priors=priors,
                    stages=(1.0,),
                    start=values,
                    pushed=pushed,
                )
            except NumericalError:
                continue
            if group in fits and trial.cost >= fits[group].cost:
                break
            fits[group], values = trial, trial.values
    best = min(fits.values(), key=lambda fit: fit.cost, default=base.refit)
    if len(fits) < 2 or best.cost >= base.cost:
        return None
    most = max(fit.cost for fit in fits.values())
    alone = {group: most - fit.cost for group, fit in fits.items()}
    return Location(alone), replace(base, refit=best, passed=None)
