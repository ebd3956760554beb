"""A study: controllers, plants and their variations, scenarios and what is required, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from workbench.study.designs import ControllerRecipe
from workbench.study.plants import PlantRecipe
from workbench.verification import METRICS, Disturbance, Metric, Requirement, Scenario, Tolerance
from workbench.verification.metrics import tolerance_of

NOMINAL = "nominal"
"""Name of the plant without variation, which every study runs."""


@dataclass(frozen=True)
class Variation:
    """What differs from the nominal plant of a case in some runs.

    Args:
        name: Name in results; with several cases it begins with the case.
        plant: The plant.
        case: Name of the case; empty if the study has one plant.
        kind: Name without the case: ``"nominal"``, ``"1 kg"``.
        scenarios: Names of the scenarios that it runs; all if empty.
        controllers: Names of the controllers that it runs; all if empty.
        disturbances: Disturbances that every scenario has with it.
        ideal: Whether sensors and converters are ideal.
        late_samples: Samples by which every command is late.
        plan_duration: Duration of the planned moves relative to those of the design, a ratio.
        lead: What is added to the lead of the feedforward, in s.
        judged: Whether requirements apply; a variation that only shows what a part costs is
            evidence, and is not judged.

    Example:
        >>> Variation("3 kg, 5 bar", PlantRecipe(), "3 kg", "5 bar").nominal
        False
    """

    name: str
    plant: PlantRecipe
    case: str = ""
    kind: str = NOMINAL
    scenarios: tuple[str, ...] = ()
    controllers: tuple[str, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    ideal: bool = False
    late_samples: int = 0
    plan_duration: float = 1.0
    lead: float = 0.0
    judged: bool = True

    @property
    def nominal(self) -> bool:
        """Whether it is the nominal plant of its case."""
        return self.kind == NOMINAL

    def runs(self, controller: str, scenario: str) -> bool:
        """Tell whether a controller runs a scenario with it."""
        return (not self.controllers or controller in self.controllers) and (
            not self.scenarios or scenario in self.scenarios
        )

    def of(self, scenario: Scenario) -> Scenario:
        """Return a scenario with what differs."""
        found = replace(
            scenario,
            disturbances=(*scenario.disturbances, *self.disturbances),
            late_samples=scenario.late_samples + self.late_samples,
        )
        return found.without_imperfections() if self.ideal else found


@dataclass(frozen=True)
class Case:
    """A plant that controllers are designed for and know.

    Args:
        name: Name; empty if the study has one plant.
        plant: The plant that runs when nothing varies.
        controllers: Controllers by name, as designed for it.
    """

    name: str
    plant: PlantRecipe
    controllers: Mapping[str, ControllerRecipe]


@dataclass(frozen=True)
class Demand:
    """A requirement of a study.

    Args:
        requirement: Metric, limit, hard or soft, scenario.
        weight: Weight in the mean score, dimensionless.
        controllers: Names of the controllers it applies to; all if empty.
        variations: Names of the variations it applies to, with or without their case; all if empty.
        plants: Names of the cases it applies to; all if empty.

    Example:
        >>> nominal = Variation("nominal", PlantRecipe())
        >>> Demand(Requirement("rmse", 1.0, "deg")).applies("pid", nominal, "step")
        True
    """

    requirement: Requirement
    weight: float = 1.0
    controllers: tuple[str, ...] = ()
    variations: tuple[str, ...] = ()
    plants: tuple[str, ...] = ()

    def applies(self, controller: str, variation: Variation, scenario: str) -> bool:
        """Tell whether a run is judged by this requirement."""
        return (
            variation.judged
            and (not self.controllers or controller in self.controllers)
            and (not self.variations or bool({variation.name, variation.kind} & {*self.variations}))
            and (not self.plants or variation.case in self.plants)
            and self.requirement.scenario in ("", scenario)
        )

    def __str__(self) -> str:
        """Return the demand in words."""
        wanted = self.requirement
        sign = "at most" if wanted.kind == "at_most" else "at least"
        unit = f" {wanted.unit}".replace(" deg", "°") if wanted.unit not in ("", "1") else ""
        return f"{wanted.metric} {sign} {wanted.limit:g}{unit}"


@dataclass(frozen=True)
class Box:
    """Where the worst case is searched, and from which plants are drawn.

    Args:
        ranges: Lowest and highest value by parameter, in SI; draws are uniform.
        scenarios: Names of the scenarios that every draw runs.
        controllers: Names of the controllers; all if empty.
        draws: Number of drawn plants.
        search: Number of further plants that the local search may try.
        seed: Seed of the draws.
        hard: Whether a hard requirement missed at the worst point fails the study.

    Example:
        >>> Box({"load": (2.0, 4.0)}, ("step",)).draws
        20
    """

    ranges: Mapping[str, tuple[float, float]]
    scenarios: tuple[str, ...]
    controllers: tuple[str, ...] = ()
    draws: int = 20
    search: int = 12
    seed: int = 1
    hard: bool = False


@dataclass(frozen=True)
class Report:
    """What a study reports beside its runs.

    Args:
        physical_limit: Whether steps are compared with the fastest that the plant can do.
        limit_steps: Steps that are compared, as pairs of references in SI; all if empty.
        limit_variations: Variations whose physical limit is found too.
        limitations: How the section on performance limitations reads the evidence.
        figures: Figures of one's own on the page, each as ``module:object``.
    """

    physical_limit: bool = False
    limit_steps: tuple[tuple[float, float], ...] = ()
    limit_variations: tuple[str, ...] = ()
    limitations: Limitations | None = None
    figures: tuple[str, ...] = ()


@dataclass(frozen=True)
class Limitations:
    """How the section on performance limitations reads the evidence.

    Args:
        scenario: Scenario whose steps are compared.
        controllers: Controllers whose steps are shown with one limitation less at a time.
        ladder: Variations from the nominal one on, each with one limitation less, by name, and what
            the plant has less.
        causes: Name of the limitation that each rung shows.
        unknown: Variation that no design knows, whose cost a faster plan shows.
        ratio: Wanted settling over physical limit, a ratio.
        overshoot: Overshoot that a faster plan may have, a fraction of the step.
    """

    scenario: str
    controllers: tuple[str, ...]
    ladder: tuple[tuple[str, str], ...]
    causes: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    ratio: float = 2.0
    overshoot: float = 0.05


def load_metrics(names: tuple[str, ...], folder: Path | None) -> tuple[Metric, ...]:
    """Return metrics of one's own by ``module:object``."""
    return tuple(METRICS.get(name, folder=folder) for name in names)


@dataclass(frozen=True)
class Study:
    """What `workbench compare` runs.

    Args:
        name: Name of the study.
        path: File it was read from.
        cases: Plants that are known to the designs, by name, the first of which leads.
        variations: Plants that run, by name, the nominal one of each case first.
        controllers: Controllers by name, as designed for the first case that has them.
        scenarios: Scenarios by name.
        demands: Requirements.
        seeds: Seeds of the sensors' noise.
        few_seeds: Number of seeds of controllers and scenarios that have fewer, by name.
        points: Operating points of the linear analysis: given values by name, in SI.
        box: Parameter box, or None.
        tolerances: Rules of comparison that differ from the usual ones, by metric.
        description: What the study is about, in a sentence.
        report: What is reported beside the runs.
        own_metrics: Metrics of the study's own, as ``module:object``.

    Example:
        >>> from workbench.study.shipped import shipped_study
        >>> from workbench.study.schema import load_study
        >>> load_study(shipped_study("arm")).name
        'arm'
    """

    name: str
    path: Path
    cases: Mapping[str, Case]
    variations: Mapping[str, Variation]
    controllers: Mapping[str, ControllerRecipe]
    scenarios: Mapping[str, Scenario]
    demands: tuple[Demand, ...]
    seeds: tuple[int, ...] = (1,)
    few_seeds: Mapping[str, int] = field(default_factory=dict)
    points: tuple[tuple[tuple[str, float], ...], ...] = ()
    box: Box | None = None
    tolerances: Mapping[str, Tolerance] = field(default_factory=dict)
    description: str = ""
    report: Report = Report()
    own_metrics: tuple[str, ...] = ()

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """Metrics of the study's own."""
        return load_metrics(self.own_metrics, self.path.resolve().parent)

    @property
    def plant(self) -> PlantRecipe:
        """The nominal plant of the first case."""
        return next(iter(self.cases.values())).plant

    @property
    def has_own_code(self) -> bool:
        """Whether a plant, effect, design, metric or reference is a module of the user's own."""
        recipes = [c for case in self.cases.values() for c in case.controllers.values()]
        plants = [*(v.plant for v in self.variations.values()), *(c.plant for c in recipes)]
        names = [*(p.kind for p in plants), *(e for p in plants for e in p.effects)]
        kinds = {
            type(r).__module__.partition(".")[0]
            for s in self.scenarios.values()
            for r in s.references.values()
        }
        return (
            bool(self.own_metrics)
            or any(":" in name for name in (*names, *(c.design for c in recipes)))
            or not kinds <= {"workbench"}
        )

    def with_limit(self, wanted: bool) -> Study:
        """Return the study with or without the comparison with the physical limit."""
        return replace(self, report=replace(self.report, physical_limit=wanted))

    def nominal(self, case: str = "") -> Variation:
        """Return the nominal variation of a case, of the first one by default."""
        return next(
            v for v in self.variations.values() if v.nominal and (not case or v.case == case)
        )

    def tolerance(self, metric: str) -> Tolerance:
        """Return how a metric is compared with a baseline: the study's own rule, or the usual."""
        return self.tolerances.get(metric) or tolerance_of(metric, self.metrics)

    def seeds_of(self, controller: str, scenario: str) -> tuple[int, ...]:
        """Return the seeds of the runs of a controller in a scenario."""
        few = [self.few_seeds[n] for n in (controller, scenario) if n in self.few_seeds]
        return self.seeds[: min(few)] if few else self.seeds

    def __str__(self) -> str:
        """Return what the study runs, in one line."""
        runs = sum(
            len(self.seeds_of(c, s))
            for v in self.variations.values()
            for c in self.cases[v.case].controllers
            for s in self.scenarios
            if v.runs(c, s)
        )
        return (
            f"study {self.name}: {len(self.controllers)} controllers x {len(self.variations)}"
            f" variations x {len(self.scenarios)} scenarios x {len(self.seeds)} seeds = {runs} runs"
        )
