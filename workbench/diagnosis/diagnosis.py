"""Everything that a diagnosis computes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.diagnosis.selection.candidates import Candidate
from workbench.diagnosis.selection.score import Scores
from workbench.diagnosis.verdict import Verdict
from workbench.model import Model


@dataclass
class Diagnosis:
    """Everything that a diagnosis computed, for the verdict and its proof.

    Args:
        nominal: The model as given.
        base: The refitted nominal model.
        extended: The refitted model with what was found.
        accepted: What was found, in the order of finding.
        rounds: Scores and candidates of each round of the search.
        before: Location of the mismatch in the refitted nominal model.
        after: The same in the extended model.
        runs: Free runs on held-out recordings, by model and recording.
        excess: Log likelihood that the refitted nominal model lacks, dimensionless.
        withdrawn: Effects that were taken back, each with the reason.
        free_form: Term without a name that was tried because nothing of the library explained the
            recordings; None if there was no need.
        verdict: The verdict.

    Example:
        >>> from workbench.diagnosis.example_diagnosis import example_diagnosis
        >>> example_diagnosis()[0].excess > 0.0
        True
    """

    nominal: Model
    base: ProcessNoiseFit
    extended: ProcessNoiseFit
    accepted: list[tuple[Candidate, tuple[str, ...]]] = field(default_factory=list)
    rounds: list[tuple[Scores, tuple[Candidate, ...]]] = field(default_factory=list)
    before: Location | None = None
    after: Location | None = None
    runs: dict[str, dict[str, FreeRun]] = field(default_factory=dict)
    excess: float = math.nan
    withdrawn: list[tuple[Candidate, str]] = field(default_factory=list)
    free_form: NonparametricTerm | None = None
    verdict: Verdict | None = None
