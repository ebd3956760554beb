"""A starter notebook: a plant, its operating point, a linear model, controllers and their proof."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from controllers.design import designs_for
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel, linearise
from workbench.linearisation.pace import step_time
from workbench.model import Model
from workbench.model.units import from_si, shown_unit
from workbench.operating_point import operating_point
from workbench.plants.plant import Plant
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
    smooth = begin.model.without(*begin.model.dry_effects)
    linear = linearise(operating_point(smooth, begin.at))
    cells = [*_plant(begin), *_linear(begin), *_control(begin, linear), *_further(begin)]
    content = {
        "cells": [_cell(name, text.strip("\n")) for name, text in cells],
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _plant(begin: Beginning) -> list[tuple[str, str]]:
    plant, recipe = begin.plant, begin.recipe
    options = {}
    for name, value in recipe.options:
        unit = plant.option(name).unit
        options[name] = f"{value:g} {unit}" if unit else value
    units = {q.name: "" if q.unit == "1" else q.unit for q in recipe.build().parameters}
    parameters = [
        f"{name}={value:.10g} {units[name]}".rstrip() for name, value in recipe.parameters
    ]
    changes = {"effects": recipe.effects, "without": recipe.without, "parameters": parameters}
    given = [f"{name}={list(words)!r}" for name, words in changes.items() if words]
    own = "\n\nIts module must stand beside this notebook." if ":" in recipe.kind else ""
    told = f"`workbench plants {recipe.kind}` tells what may be chosen about it."
    summary = f"{plant.summary[:1].upper()}{plant.summary[1:]}. " if plant.summary else ""
    return [
        ("title-text", f"# {plant.name}\n\n{summary}{told}{own}"),
        (
            "plant",
            f"""
%matplotlib inline
from pathlib import Path

import workbench as wb
from controllers.design import DESIGNS
from workbench.model.units import to_si
from workbench.plants.registry import PLANTS
from workbench.verification import Scenario, Steps

plant = PLANTS.get({recipe.kind!r}, folder=Path.cwd())
options = {options!r}
nominal = plant.model(options)
full = {f"plant.model(options, {', '.join(given)})" if given else "nominal"}
full
""",
        ),
    ]


def _linear(begin: Beginning) -> list[tuple[str, str]]:
    at = ", ".join(f"{name!r}: {_si(begin.model, name, v)}" for name, v in begin.at.items())
    return [
        (
            "point-text",
            "## Operating point and linear model\n\nFriction without a slope at rest is left out"
            " for the design, not for the proof.",
        ),
        (
            "point",
            f"""
smooth = nominal.without(*nominal.dry_effects)
point = wb.operating_point(smooth, {{{at}}})
point
""",
        ),
        ("linear", "linear = wb.linearise(point)\nlinear"),
        ("bode", f"linear.plot({begin.plant.controlled_outputs(begin.model)[0]!r})"),
    ]


def _control(begin: Beginning, linear: LinearModel) -> list[tuple[str, str]]:
    controlled = begin.plant.controlled_outputs(begin.model)
    time = step_time(linear)
    told = {"measured": controlled[0], "sample_time": time / 1000}
    specified = {}
    for design in designs_for(linear):
        values = {} if design.sensors else told
        try:
            controller = design.controller(linear, design.specified(values))
        except WorkbenchError:
            continue
        if {q.name for q in begin.model.inputs} <= set(controller.actuators):
            specified[design.name] = values
    if not specified:
        return [("control-text", "No design of the workbench fits this plant as it stands.")]
    rest = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    scale = {q.name: q.scale for q in begin.model.outputs}[controlled[0]]
    first, last = begin.plant.step or (rest[controlled[0]], rest[controlled[0]] + scale)
    steps: dict[str, tuple[tuple[float, ...], tuple[float, ...]]]
    steps = {controlled[0]: ((0.0, time / 4), (first, last))}
    steps |= {name: ((0.0,), (rest[name],)) for name in controlled[1:]}
    levels = {n: ", ".join(_si(begin.model, n, v) for v in steps[n][1]) for n in steps}
    references = "\n".join(
        f"    {name!r}: Steps({list(steps[name][0])}, [{levels[name]}])," for name in steps
    )
    designs = "\n".join(f"    {name!r}: {values!r}," for name, values in specified.items())
    return [
        (
            "control-text",
            "## Controllers and their proof\n\nEach is designed on the linear model and runs on"
            " the full plant, with saturation, converters and noise. Write into the braces what"
            " you want to be different; `DESIGNS.get(NAME).keys` lists what may be specified.",
        ),
        (
            "controllers",
            f"""
specifications = {{
{designs}
}}
controllers = []
for name, values in specifications.items():
    design = DESIGNS.get(name)
    controllers.append(design.controller(linear, design.specified(values)))
""",
        ),
        (
            "proof",
            f"""
references = {{
{references}
}}
step = Scenario("step", references, duration={1.25 * time:g}, sample_time={time / 1000:g})
runs = [wb.verify(controller, full, step) for controller in controllers]
runs[0].plot(*runs[1:5])
""",
        ),
        ("metrics", 'for run in runs:\n    print(wb.metrics(run), end="\\n\\n")'),
    ]


def _further(begin: Beginning) -> list[tuple[str, str]]:
    inputs = ", ".join(q.name for q in begin.model.inputs)
    outputs = ", ".join(q.name for q in begin.model.outputs)
    text = f"""
## When the machine says otherwise

A recording is a table with the time, the inputs ({inputs}) and at least one of the outputs
({outputs}), with units in its headers.

```python
fit_on = [wb.read_recording("first.csv")]
hold_out = [wb.read_recording("second.csv")]
diagnosis = wb.diagnose(nominal, fit_on, hold_out)
diagnosis.plot()
```
"""
    return [("further-text", text)]


def _si(model: Model, name: str, value: float) -> str:
    """Write an SI value as an expression in the unit in which people read it."""
    outputs = {q.name: q.display_unit for q in model.outputs}
    sums = {total.name: total.display_unit for total in model.traits.sums}
    others = {q.name: shown_unit(q.unit) for q in (*model.inputs, *model.states)}
    unit = ({**others, **sums, **outputs}).get(name, "1")
    shown = f"{from_si(value, unit):.10g}"
    return shown if unit in ("1", "") else f"to_si({shown}, {unit!r})"


def _cell(name: str, text: str) -> dict[str, Any]:
    lines = re.findall(r".*\n|.+$", text)
    if name.endswith("-text"):
        return {"cell_type": "markdown", "id": name, "metadata": {}, "source": lines}
    return {
        "cell_type": "code",
        "execution_count": None,
        "id": name,
        "metadata": {},
        "outputs": [],
        "source": lines,
    }
