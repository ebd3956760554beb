"""A study: controllers, plants and their variations, scenarios and what is required, as data.

What an entry of a study file means stands in ``fields.toml``, once for the file's check, for the
page of fields and for the entries here that have its name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from workbench.errors import check_choice
from workbench.model.units import from_si, with_unit
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
        case: Name of the case; empty if the study has one plant.
        kind: Name without the case: ``"nominal"``, ``"1 kg"``.
        plan_duration: Duration of the planned moves relative to those of the design, a ratio.
        lead: What is added to the lead of the feedforward, in s.
        judged: Whether requirements apply; a variation that only shows what a part costs is
            evidence, and is not judged.
        differs: What differs of a machine that nobody modelled, each by one word.
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
    differs: tuple[str, ...] = ()

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
    """A plant that controllers are designed for and know."""

    name: str
    plant: PlantRecipe
    controllers: Mapping[str, ControllerRecipe]
    scenarios: Mapping[str, Scenario]


@dataclass(frozen=True)
class Selection:
    """Which runs a controller does, where it does not do all."""

    seeds: int | None = None
    scenarios: tuple[str, ...] = ()
    variations: tuple[str, ...] = ()
    judged: bool = True


@dataclass(frozen=True)
class Demand:
    """A requirement of a study.

    Args:
        weight: Weight in the mean score, dimensionless.
        variations: Names of the variations it applies to, with or without their case; all if empty.
        step: Size of the steps that are judged, in SI; all if None. For metrics of steps only.
        step_unit: Unit in which people read the step.
    """

    requirement: Requirement
    weight: float = 1.0
    controllers: tuple[str, ...] = ()
    variations: tuple[str, ...] = ()
    plants: tuple[str, ...] = ()
    step: float | None = None
    step_unit: str = "1"

    @property
    def metric(self) -> str:
        """The metric and the steps that it is of, in words."""
        if self.step is None:
            return self.requirement.metric
        size = with_unit(f"{from_si(self.step, self.step_unit):g}", self.step_unit)
        return f"{self.requirement.metric} of steps of {size}"

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
        required = self.requirement
        sign = "at most" if required.kind == "at_most" else "at least"
        return f"{self.metric} {sign} {with_unit(f'{required.limit:g}', required.unit)}"


@dataclass(frozen=True)
class Box:
    """Where the worst case is searched, and from which plants are drawn.

    Args:
        ranges: Lowest and highest value by parameter, in SI; draws are uniform.
    """

    ranges: Mapping[str, tuple[float, float]]
    scenarios: tuple[str, ...]
    controllers: tuple[str, ...] = ()
    draws: int = 20
    search: int = 12
    seed: int = 1
    hard: bool = True


@dataclass(frozen=True)
class Report:
    """What a study reports beside its runs.

    Args:
        limit_steps: Steps that are compared, as pairs of references in SI; all if empty.
        kin: Controllers, each with the name whose colour it has in pictures, if that is another's.
            Several of one name are its versions, which stand beside each other.
        said: Sentences about how the controllers were designed.
    """

    physical_limit: bool = False
    limit_steps: tuple[tuple[float, float], ...] = ()
    limit_variations: tuple[str, ...] = ()
    limitations: Limitations | None = None
    figures: tuple[str, ...] = ()
    traced: tuple[str, ...] = ()
    kin: tuple[tuple[str, str], ...] = ()
    said: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cause:
    """What keeps controllers from a goal."""

    name: str
    text: str = ""
    variation: str = ""


@dataclass(frozen=True)
class Limitations:
    """How the section on performance limitations reads the evidence.

    Args:
        ratio: Wanted settling over physical limit, a ratio.
        overshoot: Overshoot that a faster plan may have, a fraction of the step.
    """

    scenario: str
    unknown: Cause
    neglected: Cause
    loop: Cause
    design: Cause
    ladder: tuple[tuple[str, str], ...] = ()
    controllers: tuple[str, ...] = ()
    ratio: float = 2.0
    overshoot: float = 0.05
    notes: tuple[str, ...] = ()


def load_metrics(names: tuple[str, ...], folder: Path | None) -> tuple[Metric, ...]:
    """Return metrics of one's own by ``module:object``."""
    return tuple(METRICS.get(name, folder=folder) for name in names)


@dataclass(frozen=True)
class Study:
    """What `workbench compare` runs.

    Args:
        cases: Plants that are known to the designs, by name, the first of which leads.
        variations: Plants that run, by name, the nominal one of each case first.
        controllers: Controllers by name, as designed for the first case that has them.
        selections: Which runs controllers and scenarios have that do not have all, by name.
        points: Operating points of the linear analysis: given values by name, in SI.
        sizes: What is typical of each metric, in its SI unit.
    """

    name: str
    path: Path
    cases: Mapping[str, Case]
    variations: Mapping[str, Variation]
    controllers: Mapping[str, ControllerRecipe]
    scenarios: Mapping[str, Scenario]
    demands: tuple[Demand, ...]
    seeds: tuple[int, ...] = (1,)
    selections: Mapping[str, Selection] = field(default_factory=dict)
    points: tuple[tuple[tuple[str, float], ...], ...] = ()
    box: Box | None = None
    tolerances: Mapping[str, Tolerance] = field(default_factory=dict)
    sizes: Mapping[str, float] = field(default_factory=dict)
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

    def with_limit(self, asked: bool) -> Study:
        """Return the study with or without the comparison with the physical limit."""
        return replace(self, report=replace(self.report, physical_limit=asked))

    def nominal(self, case: str = "") -> Variation:
        """Return the nominal variation of a case, of the first one by default."""
        return next(
            v for v in self.variations.values() if v.nominal and (not case or v.case == case)
        )

    def tolerance(self, metric: str) -> Tolerance:
        """Return how a metric is compared with a baseline: the study's own rule, or the usual."""
        found = self.tolerances.get(metric) or tolerance_of(metric, self.metrics)
        return found.sized(self.sizes.get(metric, 0.0))

    def selection(self, name: str) -> Selection:
        """Return which runs a controller or a scenario has."""
        return self.selections.get(name, Selection())

    def runs(self) -> Iterator[tuple[Variation, str, str, int]]:
        """Yield variation, controller, scenario and seed of every run without the box.

        Plant by plant, so that a process that took one run has what the next needs.
        """
        for variation in self.variations.values():
            case = self.cases[variation.case]
            for controller in case.controllers:
                own = self.selection(controller)
                for scenario in case.scenarios:
                    asked = self.selection(scenario)
                    if (
                        variation.runs(controller, scenario)
                        and scenario in (own.scenarios or (scenario,))
                        and all(
                            variation.kind in (s.variations or (variation.kind,))
                            for s in (own, asked)
                        )
                    ):
                        counts = [s.seeds for s in (own, asked) if s.seeds is not None]
                        for seed in self.seeds[: min(counts, default=len(self.seeds))]:
                            yield variation, controller, scenario, seed

    def judges(self, demand: Demand, controller: str, variation: str, scenario: str) -> bool:
        """Tell whether a run is judged by a requirement."""
        return self.selection(controller).judged and demand.applies(
            controller, self.variations[variation], scenario
        )

    def only(self, controllers: Sequence[str]) -> Study:
        """Return the study with some of its controllers."""
        for name in controllers:
            check_choice("controller", name, self.controllers)

        def chosen(every: Mapping[str, ControllerRecipe]) -> dict[str, ControllerRecipe]:
            return {n: c for n, c in every.items() if n in controllers}

        cases = {n: replace(c, controllers=chosen(c.controllers)) for n, c in self.cases.items()}
        return replace(self, cases=cases, controllers=chosen(self.controllers))

    def __str__(self) -> str:
        plants = len(self.cases)
        said = f"{plants} plants x " if plants > 1 else ""
        return (
            f"study {self.name}: {said}{len(self.controllers)} controllers x"
            f" {len(self.variations) // plants} variations x {len(self.scenarios)} scenarios x"
            f" {len(self.seeds)} seeds = {sum(1 for _ in self.runs())} runs"
        )
