"""What scoring and searching found, frozen after each round."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.held_out import Runs
from workbench.diagnosis.selection.rules import IMPERFECT, LEAST_GAIN, NEAR_NOISE, OFF_NOISE
from workbench.diagnosis.selection.score import Scores
from workbench.diagnosis.selection.weights import Compared, Weighted, set_weights


@dataclass(frozen=True)
class Scored:
    """The library, scored at the refitted nominal model.

    Args:
        perfect: Cost to be expected of a model that leaves nothing out, dimensionless.
        excess: Log likelihood that the refitted nominal model lacks, dimensionless.
        over_floor: Error of the runs of the refitted nominal model on held-out recordings over what
            noise and the uncertainty of its parameters would leave, by output, dimensionless.
    """

    scores: Scores
    perfect: float
    excess: float
    over_floor: Mapping[str, float] = field(default_factory=dict)

    @property
    def farthest(self) -> tuple[str, float]:
        """The output whose error is farthest beyond the noise, and how far, dimensionless."""
        far = {k: v if v == v else math.inf for k, v in self.over_floor.items()}
        name = max(far, key=far.__getitem__, default="")
        return name, far.get(name, 0.0)

    def near_noise(self, base: ProcessNoiseFit, within: float = NEAR_NOISE) -> bool:
        """Whether the refitted nominal model predicts nearly to the noise.

        Args:
            within: Held-out error over that of a perfect model up to which it does, dimensionless.
        """
        far = self.farthest[1]
        # Nothing can gain what is not left out, however little the filter trusts the equations.
        nothing_left = self.excess < LEAST_GAIN and far <= OFF_NOISE
        return (nothing_left or base.noise_scale <= IMPERFECT) and far <= within


class Round(NamedTuple):
    """One round of the search: the library scored on what was left, and what was refitted."""

    scores: Scores
    candidates: tuple[Candidate, ...]


class Accepted(NamedTuple):
    """An effect that was found, with those that explain the recordings as well, itself first."""

    candidate: Candidate
    alike: tuple[str, ...]


class Aside(NamedTuple):
    """What was withdrawn by a rule on how much it explains, with the model that it gave.

    Args:
        shown: Whether it takes most of the error of free runs, and so is told if no other search
            finds what explains more.
    """

    candidate: Candidate
    alike: tuple[str, ...]
    extended: ProcessNoiseFit
    reason: str
    shown: bool = False


class Withdrawn(NamedTuple):
    """An effect that was found and taken back, with the reason."""

    candidate: Candidate
    reason: str


@dataclass(frozen=True)
class Selected:
    """What the search found, after all its rounds or some of them.

    Args:
        extended: The refitted model with what was found; the refitted nominal one if nothing was.
        free: Priors of its parameters that are refitted.
        rounds: Scores and candidates of each round of the present search.
        accepted: What was found, in the order of finding.
        fits: The refitted nominal model and the model after each effect that was found.
        aside: The first effect of each search that was withdrawn as a whole.
        failed: Effects with which searches began that came to nothing.
        began: Effect with which the present search began; empty if none.
        penalty: Log likelihood that an effect of the last round had to gain, dimensionless.
        compared: Sets of effects that were refitted to the end and judged on all recordings.
        closest: The refitted nominal model (``refitted``) and the one with what was found
            (``extended``) as they were run on held-out recordings.
        runs: Their runs, by model and recording; empty where they were run over windows.
        nonparametric: Term without a name that was tried because nothing of the library explained
            the recordings; None if there was no need.
    """

    extended: ProcessNoiseFit
    free: tuple[Prior, ...]
    rounds: tuple[Round, ...] = ()
    accepted: tuple[Accepted, ...] = ()
    fits: tuple[ProcessNoiseFit, ...] = ()
    withdrawn: tuple[Withdrawn, ...] = ()
    aside: tuple[Aside, ...] = ()
    failed: tuple[str, ...] = ()
    began: str = ""
    penalty: float = 0.0
    compared: tuple[Compared, ...] = ()
    closest: Mapping[str, ProcessNoiseFit] = field(default_factory=dict)
    runs: Mapping[str, Runs] = field(default_factory=dict)
    nonparametric: NonparametricTerm | None = None
    finished: bool = False

    def __post_init__(self) -> None:
        """Free no parameter of an effect that was taken back."""
        own = {q.name for q in self.extended.model.parameters}
        object.__setattr__(self, "free", tuple(p for p in self.free if p.name in own))

    @cached_property
    def weights(self) -> tuple[Weighted, ...]:
        """Weights of the sets of effects that were compared, the likeliest first."""
        return set_weights(self.compared, self.penalty)
