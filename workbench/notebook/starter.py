"""A starter notebook: a plant, its operating point, a linear model, controllers and their proof."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from workbench.errors import WorkbenchError
from workbench.linearisation import linearise
from workbench.model import Model
from workbench.model.quantities import shown_in
from workbench.model.units import from_si
from workbench.operating_point import operating_point
from workbench.plants.plant import Plant
from workbench.reports.page import template
from workbench.study.designs import ControllerRecipe, followed_by_default
from workbench.study.plants import PlantRecipe
from workbench.study.step_trial import StepTrial
from workbench.verification import Scenario, Steps


def starter_notebook(trial: StepTrial) -> str:
    """Return a notebook, as text, that runs as it stands beside the modules that it names.

    Its designs run through the first of the steps that are tried.
    """
    plant, recipe, model = trial.plant, trial.machine, trial.base.plant.build()
    at: dict[str, float] = dict(trial.base.at)
    linear = linearise(operating_point(model.without(*model.dry_effects), at))
    controlled = followed_by_default(plant, linear)
    recipes: list[ControllerRecipe] = []
    # Where no design fits, all else is there.
    with suppress(WorkbenchError):
        recipes, (scenario, *_) = trial.prepared()
        at = dict(recipes[0].at)
    text = template("workbench.notebook", "starter.j2").render(
        plant=plant,
        recipe=recipe,
        model=model,
        options={n: _with_unit(plant, n, value) for n, value in recipe.options},
        changes=_changes(recipe),
        at=", ".join(f"{name!r}: {_si(model, name, v)}" for name, v in at.items()),
        controlled=controlled[0],
        specified={own.name: _plainly(own.specification) for own in recipes},
        steps=_steps(model, scenario) if recipes else [],
        duration=scenario.duration if recipes else 0.0,
        sample_time=scenario.sample_time if recipes else 0.0,
    )
    _, *parts = re.split(r"^=== (.+)\n", text, flags=re.MULTILINE)
    content = {
        "cells": [_cell(*cell) for cell in zip(parts[::2], parts[1::2], strict=True)],
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _with_unit(plant: Plant, name: str, value: Any) -> Any:
    unit = plant.option(name).unit
    return f"{value:g} {unit}" if unit else value


def _changes(recipe: PlantRecipe) -> str:
    """Return effects and parameters as keywords of `Plant.model`."""
    units = {q.name: "" if q.unit == "1" else q.unit for q in recipe.build().parameters}
    parameters = [f"{n}={value:.10g} {units[n]}".rstrip() for n, value in recipe.parameters]
    changes = {"effects": recipe.effects, "without": recipe.without, "parameters": parameters}
    return ", ".join(f"{name}={list(words)!r}" for name, words in changes.items() if words)


def _plainly(specification: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    return {n: list(told) if isinstance(told, tuple) else told for n, told in specification}


def _steps(model: Model, scenario: Scenario) -> list[tuple[str, list[float], str]]:
    """Return times and levels of the references."""
    return [
        (name, list(asked.times), ", ".join(_si(model, name, v) for v in asked.values))
        for name, asked in scenario.references.items()
        if isinstance(asked, Steps)
    ]


def _si(model: Model, name: str, value: float) -> str:
    """Write an SI value as an expression in the unit in which people read it."""
    sums = {total.name: total.display_unit for total in model.traits.sums}
    others = {q.name: shown_in(q) for q in (*model.inputs, *model.states, *model.outputs)}
    unit = ({**sums, **others}).get(name, "1")
    shown = f"{from_si(value, unit):.10g}"
    return shown if unit in ("1", "") else f"to_si({shown}, {unit!r})"


def _cell(name: str, text: str) -> dict[str, Any]:
    lines = text.strip("\n").splitlines(keepends=True)
    cell: dict[str, Any] = {"cell_type": "markdown", "id": name, "metadata": {}, "source": lines}
    if not name.endswith("-text"):
        cell |= {"cell_type": "code", "execution_count": None, "outputs": []}
    # In the order in which a notebook is saved again.
    return dict(sorted(cell.items()))
