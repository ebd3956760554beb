"""Plants of a study, as recipes that another process or machine can cook again."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from workbench.model import Model
from workbench.plants import DEFAULT_PLANT
from workbench.plants.plant import Plant
from workbench.plants.registry import PLANTS
from workbench.study.dependencies import forgotten_with_its_code


@dataclass(frozen=True)
class PlantRecipe:
    """How to build a plant.

    Args:
        kind: Name of a plant, or ``module:object`` of one's own.
        options: Options of the plant by name, numbers in the option's unit.
        effects: Effects that are attached; those of the library at zero size until a parameter says
            more.
        parameters: Changed parameters by name, in SI.
        noise: Factor on the noise of every sensor, dimensionless.
        scaled: Parameters multiplied by a factor (dimensionless), whatever their bounds: evidence
            of what a part would do that does not exist.
    """

    kind: str = DEFAULT_PLANT
    options: tuple[tuple[str, Any], ...] = ()
    effects: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    parameters: tuple[tuple[str, float], ...] = ()
    noise: float = 1.0
    scaled: tuple[tuple[str, float], ...] = ()
    folder: Path | None = field(default=None, repr=False)

    def plant(self) -> Plant:
        """Return the plant of the registry that is built."""
        return PLANTS.get(self.kind, folder=self.folder)

    def build(self) -> Model:
        """Return the plant; the equations are written down once per process."""
        model = _structure(self.kind, self.options, self.effects, self.without, self.folder)
        model = model.with_parameters(dict(self.parameters))
        for name, factor in self.scaled:
            value = factor * model.parameter(name).value
            moved = replace(model.parameter(name), value=value, lower=value, upper=value)
            rows = tuple(moved if q.name == name else q for q in model.parameters)
            model = replace(model, parameters=rows)
        if self.noise == 1.0:
            return model
        noisy = copy.copy(model)
        outputs = tuple(replace(q, noise_rms=q.noise_rms * self.noise) for q in model.outputs)
        object.__setattr__(noisy, "outputs", outputs)
        return noisy

    def varied(
        self,
        *,
        options: Iterable[tuple[str, Any]] = (),
        parameters: Iterable[tuple[str, float]] = (),
        effects: Iterable[str] = (),
        without: Iterable[str] = (),
        noise: float = 1.0,
        scaled: Iterable[tuple[str, float]] = (),
    ) -> PlantRecipe:
        """Return the recipe with more changes; what is named again takes the new value.

        Numbers are in SI; ``noise`` is a factor.
        """
        without = tuple(without)
        # What an effect brought goes with it.
        gone = tuple(f"{name}." for name in without)
        kept = {k: v for k, v in self.parameters if not (gone and k.startswith(gone))}
        attached = tuple(e for e in (*self.effects, *effects) if e not in without)
        return replace(
            self,
            options=tuple({**dict(self.options), **dict(options)}.items()),
            effects=attached,
            without=(*self.without, *(w for w in without if w not in self.effects)),
            parameters=tuple({**kept, **dict(parameters)}.items()),
            noise=self.noise * noise,
            scaled=(*self.scaled, *scaled),
        )


def tolerated(plant: PlantRecipe) -> list[PlantRecipe]:
    """Return the plants at the ends of what a plant declares as tolerated, one change at a time."""
    model, found = plant.build(), []
    for name, ends in plant.plant().tolerated.items():
        known = model.parameter(name)
        for change in ends:
            value = min(max(known.value + change, known.lower), known.upper)
            if value != known.value:
                found.append(plant.varied(parameters=[(name, value)]))
    return found


@lru_cache(maxsize=64)
def _structure(
    kind: str,
    options: tuple[tuple[str, Any], ...],
    effects: tuple[str, ...],
    without: tuple[str, ...],
    folder: Path | None,
) -> Model:
    plant = PLANTS.get(kind, folder=folder)
    return plant.model(dict(options), effects=effects, without=without, folder=folder)


forgotten_with_its_code(_structure.cache_clear)
