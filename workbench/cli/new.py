"""The verbs ``new-study``, ``new-controller`` and ``new-plant``, and ``study-fields``."""

from __future__ import annotations

import json
import re
import shlex
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from workbench.errors import WorkbenchError

if TYPE_CHECKING:
    from workbench.study.designs import ControllerRecipe


def new_study(file: Path, *, plant: str | None = None) -> int:
    """Write a commented study that runs: a plant, a controller, a scenario, requirements, a box.

    Examples: 'workbench new-study my_study.toml',
    'workbench new-study my_study.toml --plant my_plants:rig'.

    Args:
        file: File to write; it must not exist.
        plant (NAME): Plant of the study, with its own step and parameters: a name of 'workbench
            plants', module:object of your own, or verdict.json. By default a servo axis.
    """
    return _write(file, "my_study.toml", plant)


def new_controller(file: Path) -> int:
    """Write a commented controller that runs: a design on a linear model, and its step.

    Example: 'workbench new-controller my_controller.py'.

    Args:
        file: File to write; it must not exist.
    """
    return _write(file, "my_controller.py")


def new_plant(file: Path) -> int:
    """Write a commented plant that runs: states, inputs, outputs, parameters, a port.

    Example: 'workbench new-plant my_plant.py'.

    Args:
        file: File to write; it must not exist.
    """
    return _write(file, "my_plant.py")


def study_fields() -> int:
    """Print every field of a study file with its unit, range and example, as Markdown.

    Example: 'workbench study-fields > study-fields.md'.
    """
    from workbench.study.fields_page import study_fields as page

    typer.echo(page(), nl=False)
    return 0


def _of_plant(plant: str) -> dict[str, Any]:
    """Return what a study of a plant says: the first design that meets it, step and parameters."""
    from workbench.cli.plant import chosen_plant
    from workbench.cli.running import note
    from workbench.cli.verify import nominal_design
    from workbench.linearisation.pace import noise_of
    from workbench.model.units import from_si, in_time, of_difference
    from workbench.study.step_trial import StepTrial
    from workbench.verification import Steps, metrics, verify

    chosen = chosen_plant(plant)
    trial = StepTrial(chosen.recipe, nominal_design(chosen), say=note)
    recipes, (scenario, *_) = trial.prepared()
    outputs = {q.name: q for q in chosen.model.outputs}
    stepped = next(name for name, own in scenario.references.items() if own.changes)
    about, reference = outputs[stepped], scenario.references[stepped]
    unit, held = about.display_unit, []
    for name, own in scenario.references.items():
        if name != stepped and isinstance(own, Steps):
            q = outputs[name]
            value = float(from_si(own.values[0], q.display_unit))
            held.append((name, json.dumps(q.display_unit), f"{value:.6g}"))
    assert isinstance(reference, Steps)
    levels = [float(f"{float(from_si(v, unit)):.6g}") for v in reference.values]
    prefix = f"{stepped}." if held else ""
    # Nobody sees a step settle within 2 % of less than fifty times the noise.
    shows = 0.02 * abs(reference.values[1] - reference.values[0]) >= noise_of(about)
    arrives, settling = "settling_time" if shows else "rise_time", 0.4 * scenario.duration
    error = 0.1 * abs(levels[1] - levels[0])

    def met(recipe: ControllerRecipe) -> bool:
        with suppress(WorkbenchError):
            found = metrics(verify(recipe.build(), chosen.model, scenario))
            late, left = (found[prefix + name] for name in (arrives, "steady_error"))
            return (
                late.value <= settling and float(from_si(left.value, of_difference(unit))) <= error
            )
        return False

    design = next(filter(met, recipes), None)
    if design is None:
        note(
            f"no design of the workbench brings {stepped} there within {in_time(settling)}; the"
            " study asks for it all the same: step less far, or give a design of your own"
        )
    design = design or recipes[0]
    told = {
        "model": chosen.model.name,
        "name": plant,
        "plant": json.dumps(plant),
        "design": json.dumps(design.name),
        "at": ", ".join(f"{name} = {value:.10g}" for name, value in design.at),
        "told": ", ".join(f"{n} = {json.dumps(v)}" for n, v in design.specification),
        "duration": f"{scenario.duration:.6g}",
        "sample_time": f"{scenario.sample_time:.6g}",
        "output": stepped,
        "held": held,
        "prefix": prefix,
        "unit": json.dumps(unit),
        "times": list(reference.times),
        "levels": levels,
        "arrives": arrives,
        "settling": f"{settling:.6g}",
        "error": f"{error:.3g}",
        "difference": json.dumps(of_difference(unit)),
        "varied": "",
    }
    if varied := next((q for q in chosen.model.parameters if q.fitted and q.value), None):
        low, high = max(varied.lower, 0.9 * varied.value), min(varied.upper, 1.1 * varied.value)
        told |= {"varied": varied.name, "low": f"{low:.6g}", "high": f"{high:.6g}"}
    return told


def _write(file: Path, template: str, plant: str | None = None) -> int:
    from jinja2 import Template

    from workbench.data_folder import shipped_folder
    from workbench.files import write_whole

    suffix = Path(template).suffix
    if file.suffix != suffix:
        raise WorkbenchError(f"file {str(file)!r} does not end in {suffix}; try {template}")
    if suffix == ".py" and not file.stem.isidentifier():
        raise WorkbenchError(
            f"{file.stem!r} is no name of a Python module; use letters, digits and _, such as"
            f" {template}"
        )
    if file.exists():
        raise WorkbenchError(f"file {str(file)!r} exists; give another name, nothing was changed")
    text = (shipped_folder() / "templates" / template).read_text(encoding="utf-8")
    # In commands a name with blanks stands in quotes.
    stem = Path(template).stem
    text = re.sub(rf"{stem}(\.[\w.]+)", lambda m: shlex.quote(file.stem + m[1]), text)
    text = text.replace(stem, file.stem)
    if suffix == ".toml":
        own = None if plant is None else _of_plant(plant)
        text = Template(text, trim_blocks=True, keep_trailing_newline=True).render(own=own)
    write_whole(file, text)
    (line,) = re.findall(r"Run it: +(workbench .*)", text)
    where = "" if file.parent == Path() else f"cd {shlex.quote(str(file.parent))} && "
    typer.echo(f"written to {file}; run it: {where}{line}")
    return 0
