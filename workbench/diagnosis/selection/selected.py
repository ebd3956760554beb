"""What scoring and searching found, frozen after each round."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.held_out import Runs
from workbench.diagnosis.selection.score import Scores


@dataclass(frozen=True)
class Scored:
    """The library, scored at the refitted nominal model.

    Args:
        scores: Scores of the effects.
        perfect: Cost to be expected of a model that leaves nothing out, dimensionless.
        excess: Log likelihood that the refitted nominal model lacks, dimensionless.
    """

    scores: Scores
    perfect: float
    excess: float


class Round(NamedTuple):
    """One round of the search: the library scored on what was left, and what was refitted."""

    scores: Scores
    candidates: tuple[Candidate, ...]


class Accepted(NamedTuple):
    """An effect that was found, with those that explain the recordings as well, itself first."""

    candidate: Candidate
    alike: tuple[str, ...]


class Withdrawn(NamedTuple):
    """An effect that was found and taken back, with the reason."""

    candidate: Candidate
    reason: str


@dataclass(frozen=True)
class Selected:
    """What the search found, after all its rounds or some of them.

    Args:
        extended: The refitted model with what was found; the refitted nominal one if nothing was.
        free: Its free parameters.
        rounds: Scores and candidates of each round of the present search.
        accepted: What was found, in the order of finding.
        fits: The refitted nominal model and the model after each effect that was found.
        withdrawn: What was found and taken back.
        failed: Effects with which searches began that came to nothing.
        began: Effect with which the present search began; empty if none.
        penalty: Log likelihood that an effect of the last round had to gain, dimensionless.
        runs: Free runs on held-out recordings that were done on the way, by model and recording.
        nonparametric: Term without a name that was tried because nothing of the library explained
            the recordings; None if there was no need.
        finished: Whether the search has ended.
    """

    extended: ProcessNoiseFit
    free: tuple[Prior, ...]
    rounds: tuple[Round, ...] = ()
    accepted: tuple[Accepted, ...] = ()
    fits: tuple[ProcessNoiseFit, ...] = ()
    withdrawn: tuple[Withdrawn, ...] = ()
    failed: tuple[str, ...] = ()
    began: str = ""
    penalty: float = 0.0
    runs: Mapping[str, Runs] = field(default_factory=dict)
    nonparametric: NonparametricTerm | None = None
    finished: bool = False
