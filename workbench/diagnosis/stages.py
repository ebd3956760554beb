"""The stages of a diagnosis: what each one found, frozen.

Prepared -> Fitted -> Location -> Scored -> Selected -> Validated. Each is made by one function of
those before it (`workbench.diagnosis.diagnose`), written when it is reached and read again by a
later call (`workbench.diagnosis.stage_files`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from workbench.computing.counted import Work
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.experiment.menu import Experiment
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.location.missing_signal import MissingSignal, Occurrence
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.diagnosis.selection.held_out import Runs
from workbench.diagnosis.selection.rules import AT_NOISE, IMPERFECT, lacks_little
from workbench.diagnosis.selection.selected import Accepted, Round, Scored, Selected, Withdrawn
from workbench.diagnosis.selection.weights import Weighted
from workbench.diagnosis.verdict import Verdict
from workbench.display import Drawn, Rows
from workbench.errors import WorkbenchError
from workbench.model import Model


@dataclass(frozen=True)
class Prepared:
    """Recordings, checked and observed once, with what is known of the parameters.

    Args:
        fitting: Recordings to fit on; empty if a recording is unfit.
        judging: Recordings to judge on; empty if a recording is unfit.
        data: One row per check of a recording, as `verdict.json` lists them.
        unfit: Which recording cannot be judged and why; empty if all can.
    """

    fitting: tuple[Observed, ...]
    judging: tuple[Observed, ...]
    priors: tuple[Prior, ...]
    data: tuple[Mapping[str, str], ...] = ()
    unfit: str = ""


@dataclass(frozen=True)
class Fitted:
    """The refitted nominal model, against which every claim is made.

    Args:
        prepared: The recordings, with the starts that the refitted model finds likely.
    """

    base: ProcessNoiseFit
    prepared: Prepared


@dataclass(frozen=True)
class Validated:
    """What was found, on recordings that were not fitted on.

    Args:
        refitted: The refitted nominal model, with the values that run closest to the recordings.
        extended: The extended model, likewise; its intervals count the parameters that a refit
            fixes.
        runs: Free runs by model (``nominal``, ``refitted``, ``extended``) and recording.
        location: Where the extended model lacks something; None if nothing was found.
        plan: The input to play next on the machine as it is set; None if no input is worth it.
        missing: What is missing, by finding; of the located group where nothing was found.
        left: What is missing beside all that was found, where the equations still leave something
            out.
        not_shown: Why there is no such signal; empty if there is one.
        wrong: Parameters on a bound of a model that lacks nothing else, whose usual values the
            held-out recordings refuse.
    """

    refitted: ProcessNoiseFit
    extended: ProcessNoiseFit
    runs: Mapping[str, Runs]
    location: Location | None = None
    advice: Mapping[str, Any] = field(default_factory=dict)
    plan: Experiment | None = None
    missing: tuple[tuple[MissingSignal, ...], ...] = ()
    left: tuple[MissingSignal, ...] = ()
    not_shown: str = ""
    wrong: tuple[str, ...] = ()

    def occurrence(self, index: int = 0) -> Occurrence | None:
        """Return when and where a finding acts most; None if that is not known."""
        return _strongest(self.missing[index] if index < len(self.missing) else ())

    @property
    def rest(self) -> Occurrence | None:
        """When and where acts most what is left beside all that was found; None if unknown."""
        return _strongest(self.left)


def _strongest(signals: tuple[MissingSignal, ...]) -> Occurrence | None:
    known = [signal.occurrence for signal in signals if signal.occurrence is not None]
    return max(known, key=lambda found: found.rms, default=None)


@dataclass(frozen=True, repr=False)
class Diagnosis(Drawn):
    """A diagnosis as far as it came.

    Args:
        seconds: Time of the stages that are there, in s, those read from a folder included.

    Raises:
        WorkbenchError: From a property whose stage was not reached.
    """

    nominal: Model
    prepared: Prepared
    fitted: Fitted | None = None
    located: Location | None = None
    scored: Scored | None = None
    selected: Selected | None = None
    validated: Validated | None = None
    concluded: Verdict | None = None
    seconds: float = 0.0
    work: Work = field(default_factory=dict)

    def tables(self) -> tuple[Rows, ...]:
        """Return the tables of the verdict; none before it."""
        return self.concluded.tables() if self.concluded is not None else ()

    def __str__(self) -> str:
        """Return the verdict, or how far the diagnosis came."""
        if self.concluded is not None:
            return str(self.concluded)
        return f"diagnosis of {self.nominal.name} without a verdict, {self.seconds:.0f} s"

    @property
    def verdict(self) -> Verdict:
        """What the diagnosis says in the end."""
        if self.concluded is None:
            raise WorkbenchError("the diagnosis did not get as far as a verdict")
        return self.concluded

    @property
    def base(self) -> ProcessNoiseFit:
        """The refitted nominal model."""
        if self.fitted is None:
            raise WorkbenchError("the diagnosis did not get as far as the refit")
        return self.fitted.base

    @property
    def refitted(self) -> ProcessNoiseFit:
        """The refitted nominal model as it is shown, with the values that run closest."""
        return self.validated.refitted if self.validated is not None else self.base

    @property
    def extended(self) -> ProcessNoiseFit:
        """The refitted model with what was found; the refitted nominal one if nothing was."""
        if self.validated is not None:
            return self.validated.extended
        return self.selected.extended if self.selected is not None else self.base

    @property
    def improved(self) -> bool:
        """Whether something was found, with or without a name."""
        term = self.nonparametric
        return bool(self.accepted) or (term is not None and term.accepted)

    @property
    def complete(self) -> bool:
        """Whether the refitted nominal model predicts nearly to the noise: nothing is missing.

        So it does where nothing was found, it runs as close to unseen recordings as noise lets it,
        and next to nothing of what a sample tells is lacking: the noise of a meter that an input
        was read by.
        """
        if self.scored is None:
            return self.base.noise_scale <= IMPERFECT
        if self.scored.near_noise(self.base):
            return True
        if self.selected is None or not self.selected.finished or self.improved:
            return False
        little = lacks_little(self.scored.excess, self.prepared.fitting)
        return little and self.scored.farthest[1] <= AT_NOISE

    @property
    def accepted(self) -> tuple[Accepted, ...]:
        """What was found, in the order of finding."""
        return self.selected.accepted if self.selected is not None else ()

    @property
    def withdrawn(self) -> tuple[Withdrawn, ...]:
        """What was found and taken back."""
        return self.selected.withdrawn if self.selected is not None else ()

    @property
    def rounds(self) -> tuple[Round, ...]:
        """Scores and candidates of each round of the search."""
        return self.selected.rounds if self.selected is not None else ()

    @property
    def weights(self) -> tuple[Weighted, ...]:
        """Weights of the sets of effects that were compared, the likeliest first."""
        return self.selected.weights if self.selected is not None else ()

    @property
    def nonparametric(self) -> NonparametricTerm | None:
        """Term without a name; None if there was no need of one."""
        return self.selected.nonparametric if self.selected is not None else None

    @property
    def before(self) -> Location | None:
        """Where the refitted nominal model lacks something; None if that cannot be told."""
        return self.located if self.located is not None and self.located.alone else None

    @property
    def after(self) -> Location | None:
        """Where the extended model lacks something."""
        return self.validated.location if self.validated is not None else None

    @property
    def runs(self) -> Mapping[str, Runs]:
        """Free runs on held-out recordings, by model and recording; empty if not reached."""
        return self.validated.runs if self.validated is not None else {}
