"""The verbs that write a file to start from, ``new-...`` and ``notebook``; and ``study-fields``."""

from __future__ import annotations

import json
import re
import shlex
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from workbench.cli.plant import Chosen, chosen_plant, with_plant
from workbench.cli.running import note
from workbench.cli.verify import nominal_design
from workbench.errors import WorkbenchError
from workbench.files import write_whole

if TYPE_CHECKING:
    from workbench.model import Model
    from workbench.study.designs import ControllerRecipe
    from workbench.verification import Scenario


def new_study(file: Path, *, plant: str | None = None) -> None:
    """Write a commented study that runs: a plant, a controller, a scenario, requirements, a box.

    Examples: 'workbench new-study my_study.toml',
    'workbench new-study my_study.toml --plant my_plants:rig'.

    Args:
        file: File to write; it must not exist.
        plant (NAME): Plant of the study, with its own step and parameters: a name of 'workbench
            plants', module:object of your own, or verdict.json. By default a servo axis.
    """
    _write(file, "my_study.toml", plant)


def new_controller(file: Path) -> None:
    """Write a commented controller that runs: a design on a linear model, and its step.

    Example: 'workbench new-controller my_controller.py'.

    Args:
        file: File to write; it must not exist.
    """
    _write(file, "my_controller.py")


def new_plant(file: Path) -> None:
    """Write a commented plant that runs: states, inputs, outputs, parameters, a port.

    Example: 'workbench new-plant my_plant.py'.

    Args:
        file: File to write; it must not exist.
    """
    _write(file, "my_plant.py")


@with_plant("option", "effect", "at")
def notebook(chosen: Chosen, *, out: Path = Path("starter.ipynb")) -> None:
    """Write a starter notebook: a plant at an operating point, controllers, and their proof.

    Examples: 'workbench notebook --angle 30deg --load 3kg --out arm.ipynb',
    'workbench notebook --plant my_plants:circuit --at voltage=2V'.

    Args:
        out (FILE.ipynb): Notebook to write; it must not exist.
    """
    from workbench.notebook.starter import starter_notebook
    from workbench.study.step_trial import StepTrial

    _check_new(out, "starter.ipynb")
    base = replace(nominal_design(chosen), at=tuple(chosen.design_point.items()))
    write_whole(out, starter_notebook(StepTrial(chosen.recipe, base, say=note)))
    typer.echo(f"written to {out}; open it: {shlex.join(('jupyter', 'lab', str(out)))}")


def study_fields() -> None:
    """Print every field of a study file with its unit, range and example, as Markdown.

    Example: 'workbench study-fields > study-fields.md'.
    """
    from workbench.study.fields_page import study_fields as page

    typer.echo(page(), nl=False)


def _of_plant(plant: str) -> dict[str, Any]:
    """Return what a study of a plant says: the first design that meets it, steps and parameters."""
    from workbench.model.units import in_time
    from workbench.study.step_trial import StepTrial
    from workbench.verification import metrics, verify

    chosen = chosen_plant(plant)
    trial = StepTrial(chosen.recipe, nominal_design(chosen), say=note).exact()
    recipes, scenarios = trial.prepared()
    asked = [_asked(chosen.model, scenario) for scenario in scenarios]

    def missed(recipe: ControllerRecipe) -> list[str]:
        """Return the outputs that a design does not bring where they shall go."""
        left = [own["output"] for own in asked]
        with suppress(WorkbenchError):
            law = recipe.build()
            for scenario, own in zip(scenarios, asked, strict=True):
                found = metrics(verify(law, trial.model, scenario))
                late, error = (found[own["prefix"] + n] for n in (own["arrives"], "steady_error"))
                if late.value <= own["within"] and error.value <= own["near"]:
                    left.remove(own["output"])
        return left

    tried: list[tuple[list[str], ControllerRecipe]] = []
    while len(tried) < len(recipes) and all(left for left, _ in tried):
        design = recipes[len(tried)]
        tried.append((missed(design), design))
    left, design = min(tried, key=lambda pair: len(pair[0]))
    if left:
        within = in_time(max(own["within"] for own in asked))
        note(
            f"no design of the workbench brings {' and '.join(left)} there within {within}; the"
            " study asks for it all the same: step less far, or give a design of your own"
        )
    told = {
        "model": chosen.model.name,
        "name": plant,
        "plant": json.dumps(plant),
        "without": json.dumps(trial.machine.without) if trial.machine.without else "",
        "design": json.dumps(design.name),
        "at": ", ".join(f"{_key(name)} = {value:.10g}" for name, value in design.at),
        "told": ", ".join(f"{_key(n)} = {json.dumps(v)}" for n, v in design.specification),
        "scenarios": asked,
        "varied": "",
    }
    if varied := next((q for q in chosen.model.parameters if q.fitted and q.value), None):
        low, high = max(varied.lower, 0.9 * varied.value), min(varied.upper, 1.1 * varied.value)
        told |= {"varied": varied.name, "low": f"{low:.6g}", "high": f"{high:.6g}"}
    return told


def _key(name: str) -> str:
    """Return a name as a key of TOML, which holds no letters of other tongues without quotes."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)


def _asked(model: Model, scenario: Scenario) -> dict[str, Any]:
    """Return what a study asks of a step of one output, the others staying where they are."""
    from workbench.linearisation.time_scales import noise_of
    from workbench.model.quantities import of_names
    from workbench.model.units import from_si, of_difference
    from workbench.verification import Steps

    references = {n: own for n, own in scenario.references.items() if isinstance(own, Steps)}
    name = next(name for name, own in references.items() if own.changes)
    about, far = of_names(model.outputs, [name])[0], references[name].values
    step = abs(far[1] - far[0])
    # Nobody sees a step settle within 2 % of less than fifty times the noise.
    shows, within = 0.02 * step >= noise_of(about), 0.4 * scenario.duration
    error = float(from_si(0.1 * step, of_difference(about.display_unit)))
    rows = [
        (
            _key(q.name),
            json.dumps(q.display_unit),
            list(references[q.name].times),
            [float(f"{float(from_si(v, q.display_unit)):.6g}") for v in references[q.name].values],
        )
        for q in of_names(model.outputs, references)
    ]
    return {
        "name": name if len(rows) > 1 else "step",
        "key": _key(name) if len(rows) > 1 else "step",
        "output": name,
        "references": rows,
        "duration": f"{scenario.duration:.6g}",
        "sample_time": f"{scenario.sample_time:.6g}",
        "late": scenario.late_samples,
        "prefix": f"{name}." if len(rows) > 1 else "",
        "arrives": "settling_time" if shows else "rise_time",
        "within": within,
        "limit": f"{within:.6g}",
        "near": 0.1 * step,
        "error": f"{error:.3g}",
        "difference": json.dumps(of_difference(about.display_unit)),
    }


def _write(file: Path, template: str, plant: str | None = None) -> None:
    from jinja2 import Template

    from workbench.data_folder import shipped_folder

    _check_new(file, template)
    text = (shipped_folder() / "templates" / template).read_text(encoding="utf-8")
    # In commands a name with blanks stands in quotes.
    stem = Path(template).stem
    text = re.sub(rf"{stem}(\.[\w.]+)", lambda m: shlex.quote(file.stem + m[1]), text)
    text = text.replace(stem, file.stem)
    if file.suffix == ".toml":
        own = None if plant is None else _of_plant(plant)
        text = Template(text, trim_blocks=True, keep_trailing_newline=True).render(own=own)
    write_whole(file, text)
    (line,) = re.findall(r"Run it: +(workbench .*)", text)
    where = "" if file.parent == Path() else f"cd {shlex.quote(str(file.parent))} && "
    typer.echo(f"written to {file}; run it: {where}{line}")


def _check_new(file: Path, example: str) -> None:
    """Check that a file to be written is named as it must be, and that there is none."""
    suffix = Path(example).suffix
    if file.suffix != suffix:
        raise WorkbenchError(f"file {str(file)!r} does not end in {suffix}; try {example}")
    if suffix == ".py" and not file.stem.isidentifier():
        raise WorkbenchError(
            f"{file.stem!r} is no name of a Python module; use letters, digits and _, such as"
            f" {example}"
        )
    if file.exists():
        raise WorkbenchError(f"file {str(file)!r} exists; give another name, nothing was changed")
