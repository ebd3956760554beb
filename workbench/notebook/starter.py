"""A starter notebook: a plant, its operating point, a linear model, controllers and their proof."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from controllers.design import designs_for
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel, linearise
from workbench.linearisation.pace import step_time, usual_sample_time
from workbench.model import Model
from workbench.model.quantities import shown_in
from workbench.model.units import from_si
from workbench.operating_point import operating_point
from workbench.plants.plant import Plant
from workbench.reports.page import template
from workbench.study.designs import followed_by_default
from workbench.study.plants import PlantRecipe


@dataclass(frozen=True)
class Beginning:
    """What a starter notebook begins with.

    Args:
        recipe: What is chosen of it; no design knows its effects and changed parameters.
        model: The plant's model with the options alone, for which designs are made.
        at: Values at rest by name, in SI; empty for the nominal inputs.
    """

    plant: Plant
    recipe: PlantRecipe
    model: Model
    at: Mapping[str, float] = field(default_factory=dict)


def starter_notebook(begin: Beginning) -> str:
    """Return a notebook, as text, that runs as it stands beside the modules that it names."""
    plant, recipe, model = begin.plant, begin.recipe, begin.model
    linear = linearise(operating_point(model.without(*model.dry_effects), begin.at))
    controlled, time = followed_by_default(plant, linear), step_time(linear)
    text = template("workbench.notebook", "starter.j2").render(
        plant=plant,
        recipe=recipe,
        model=model,
        options={n: _with_unit(plant, n, value) for n, value in recipe.options},
        changes=_changes(recipe),
        at=", ".join(f"{name!r}: {_si(model, name, v)}" for name, v in begin.at.items()),
        controlled=controlled[0],
        specified=_specified(model, linear, controlled, usual_sample_time(linear, controlled)),
        steps=_steps(begin, linear, controlled, time / 4),
        time=time,
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


def _specified(
    model: Model, linear: LinearModel, controlled: Sequence[str], sample_time: float
) -> dict[str, dict[str, Any]]:
    """Return the designs that command every input, with what each must be told."""
    found = {}
    measured = controlled[0] if len(controlled) == 1 else list(controlled)
    for design in designs_for(linear):
        told = {} if design.sensors else {"measured": measured, "sample_time": sample_time}
        try:
            controller = design.controller(linear, design.specified(told))
        except WorkbenchError:
            continue
        if {q.name for q in model.inputs} <= set(controller.actuators):
            found[design.name] = told
    return found


def _steps(
    begin: Beginning, linear: LinearModel, controlled: Sequence[str], at: float
) -> list[tuple[str, list[float], str]]:
    """Return times and levels of the references: a step of the first, the others at rest."""
    rest = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    name = controlled[0]
    scale = {q.name: q.scale for q in begin.model.outputs}[name]
    levels: dict[str, tuple[float, ...]] = {n: (rest[n],) for n in controlled}
    levels[name] = begin.plant.step or (rest[name], rest[name] + scale)
    return [
        (n, [0.0, at][: len(values)], ", ".join(_si(begin.model, n, v) for v in values))
        for n, values in levels.items()
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
