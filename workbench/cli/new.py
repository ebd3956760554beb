"""The verbs ``new-study``, ``new-controller`` and ``new-plant``, and ``study-fields``."""

from __future__ import annotations

import re
from pathlib import Path

import typer

from workbench.errors import WorkbenchError


def new_study(file: Path) -> int:
    """Write a commented study that runs: a plant, a controller, a scenario, requirements, a box.

    Example: 'workbench new-study my_study.toml'.

    Args:
        file: File to write; it must not exist.
    """
    return _write(file, "my_study.toml")


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


def _write(file: Path, template: str) -> int:
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
    text = text.replace(Path(template).stem, file.stem)
    write_whole(file, text)
    (line,) = re.findall(r"Run it: +(workbench .*)", text)
    where = "" if file.parent == Path() else f"cd {file.parent} && "
    typer.echo(f"written to {file}; run it: {where}{line}")
    return 0
