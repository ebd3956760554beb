"""A candidate: an effect refitted together with the free parameters, and how it was judged."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from workbench.arrays import Vector
from workbench.diagnosis.estimation.process_noise import PERFECT, ProcessNoiseFit
from workbench.diagnosis.estimation.refit_result import Estimate
from workbench.diagnosis.selection.held_out import RunErrors
from workbench.physics.library import Hypothesis


@dataclass(frozen=True)
class Candidate:
    """An effect refitted together with the free parameters.

    Args:
        fit: The refit; None if it failed.
        gain: Gain of log likelihood on the fitting recordings, dimensionless.
        held_out: Gain on the held-out recordings with its 99 % interval, dimensionless.
        refused: Why it was not accepted; empty if it was.
        followed: Whether it was refitted to the end; else fit and gain are those of a first refit
            on the beginning of the recordings.
        rule: Name of the rule that it breaks; empty if none.
        doubts: Rules that do not refuse it but lower the belief in it, in words.
        shift: Largest change of an output that the effect makes in a free run on held-out
            recordings, root mean square over the noise, dimensionless; NaN if unknown.
        blocks: Cost on the fitting and on the held-out recordings by block of time, shape (n,)
            each, dimensionless; empty if it was not followed.
        run: Errors of its runs on the held-out recordings; None if it was not followed.
        length: Samples of each recording on which it was refitted first, at the most; 0 if it was
            followed.
        common_gain: Gain of a first refit, as it ended, on beginnings that are as long for all,
            dimensionless; NaN if it was compared with none.
    """

    entry: Hypothesis
    fit: ProcessNoiseFit | None
    gain: float
    held_out: tuple[float, float, float] = (0.0, -math.inf, math.inf)
    refused: str = ""
    followed: bool = True
    rule: str = ""
    doubts: tuple[str, ...] = ()
    shift: float = math.nan
    blocks: tuple[Vector, ...] = field(default=(), compare=False)
    run: RunErrors | None = field(default=None, compare=False)
    length: int = 0
    common_gain: float = math.nan

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.entry.name

    @property
    def size(self) -> Estimate | None:
        """Estimate of the size parameter; None if the refit failed or the size was fixed."""
        if self.fit is None or self.entry.replaces:
            return None
        return self.fit.refit.estimate(self.entry.size_name)

    @property
    def _own(self) -> list[Estimate]:
        own = f"{self.entry.effect.name}."
        estimates = () if self.fit is None else self.fit.refit.estimates
        return [e for e in estimates if e.name.startswith(own)]

    @property
    def own_parameters(self) -> int:
        """How many parameters of its own were refitted."""
        return len(self._own)

    @property
    def degenerate(self) -> bool:
        """Whether its shape ended on a bound, where it is a simpler law: a jump at the start."""
        size = self.entry.size_name
        return any(e.on_bound and e.name != size for e in self._own)

    def __str__(self) -> str:
        size = self.size
        text = "" if size is None else f"{size.value:.4g} +- {size.std:.2g} {size.unit}"
        return (
            f"{self.entry.name:<34} gain {self.gain:>10.1f}  held out"
            f" {self.held_out[0]:>10.1f} [{self.held_out[1]:.0f}, {self.held_out[2]:.0f}]"
            f"  {text}  {self.refused or 'accepted'}"
        )


def is_sensor(candidate: Candidate) -> bool:
    """Whether an effect stands between process and measurement."""
    return candidate.entry.group == "sensor"


def colours_noise(candidate: Candidate) -> bool:
    """Whether something of what a sensor reads is left in it: a clock takes nothing."""
    effect = candidate.entry.effect
    remembers = not effect.about.level and any(q.unit != "s" for q in effect.states)
    return is_sensor(candidate) and remembers


def explains(candidate: Candidate) -> bool:
    """Whether the equations with an effect explain nearly all."""
    return candidate.fit is not None and candidate.fit.noise_scale <= PERFECT


def leaves_nothing(base: ProcessNoiseFit, candidate: Candidate) -> bool:
    """Whether the equations that left something out are complete with an effect."""
    return base.noise_scale > PERFECT and explains(candidate) and not colours_noise(candidate)


def trusts_less(candidate: Candidate, best: Candidate) -> bool:
    """Whether a refit trusts the equations less than another, so that the gains do not compare."""
    fit, other = candidate.fit, best.fit
    return fit is not None and other is not None and fit.noise_scale > other.noise_scale
