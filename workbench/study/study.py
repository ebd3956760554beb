"""A study: controllers, variations of a plant, scenarios and what is required, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from workbench.study.designs import ControllerRecipe
from workbench.study.figures_of_merit import Rule, rule
from workbench.study.plants import PlantRecipe
from workbench.verification import Requirement, Scenario

NOMINAL = "nominal"
"""Name of the plant without variation, which every study runs."""


@dataclass(frozen=True)
class Demand:
    """A requirement of a study.

    Args:
        requirement: Metric, limit, hard or soft, scenario.
        weight: Weight in the mean score, dimensionless.
        controllers: Names of the controllers it applies to; all if empty.
        variations: Names of the variations it applies to; all if empty.

    Example:
        >>> Demand(Requirement("rmse", 1.0, "deg")).applies("pid", "nominal", "step")
        True
    """

    requirement: Requirement
    weight: float = 1.0
    controllers: tuple[str, ...] = ()
    variations: tuple[str, ...] = ()

    def applies(self, controller: str, variation: str, scenario: str) -> bool:
        """Tell whether a run is judged by this requirement.

        Args:
            controller: Name of the controller.
            variation: Name of the variation.
            scenario: Name of the scenario.

        Returns:
            Whether it is.
        """
        return (
            (not self.controllers or controller in self.controllers)
            and (not self.variations or variation in self.variations)
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
class Study:
    """What `workbench compare` runs.

    Args:
        name: Name of the study.
        path: File it was read from.
        plant: The nominal plant.
        variations: Plants by name, the nominal one first.
        controllers: Controllers by name.
        scenarios: Scenarios by name.
        demands: Requirements.
        seeds: Seeds of the sensors' noise.
        angles: Operating points of the linear analysis: given values by name, in SI.
        box: Parameter box, or None.
        tolerances: Rules of comparison that differ from the usual ones, by metric.
        description: What the study is about, in a sentence.
        physical_limit: Whether steps are compared with the fastest that the plant can do.

    Example:
        >>> from workbench.study.shipped import shipped_study
        >>> from workbench.study.schema import load_study
        >>> load_study(shipped_study("arm")).name
        'arm'
    """

    name: str
    path: Path
    plant: PlantRecipe
    variations: Mapping[str, PlantRecipe]
    controllers: Mapping[str, ControllerRecipe]
    scenarios: Mapping[str, Scenario]
    demands: tuple[Demand, ...]
    seeds: tuple[int, ...] = (1,)
    angles: tuple[tuple[tuple[str, float], ...], ...] = ()
    box: Box | None = None
    tolerances: Mapping[str, Rule] = field(default_factory=dict)
    description: str = ""
    physical_limit: bool = False

    def rule(self, metric: str) -> Rule:
        """Return how a metric is compared with a baseline.

        Args:
            metric: Name of the metric.

        Returns:
            The study's own rule, or the usual one.
        """
        return self.tolerances.get(metric) or rule(metric)

    def __str__(self) -> str:
        """Return what the study runs, in one line."""
        runs = len(self.controllers) * len(self.variations) * len(self.scenarios) * len(self.seeds)
        return (
            f"study {self.name}: {len(self.controllers)} controllers x {len(self.variations)}"
            f" variations x {len(self.scenarios)} scenarios x {len(self.seeds)} seeds = {runs} runs"
        )
