"""The verb ``notebook``."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import typer

from workbench.cli.plant import Chosen, with_plant
from workbench.errors import WorkbenchError


@with_plant("option", "effect", "at")
def notebook(chosen: Chosen, *, out: Path = Path("starter.ipynb")) -> int:
    """Write a starter notebook: a plant at an operating point, controllers, and their proof.

    Examples: 'workbench notebook --angle 30deg --load 3kg --out arm.ipynb',
    'workbench notebook --plant my_plants:circuit --at voltage=2V'.

    Args:
        out (FILE.ipynb): Notebook to write; it must not exist.
    """
    from workbench.cli.running import note
    from workbench.cli.verify import nominal_design
    from workbench.files import write_whole
    from workbench.notebook.starter import starter_notebook
    from workbench.study.step_trial import StepTrial

    if out.suffix != ".ipynb":
        raise WorkbenchError(f"file {str(out)!r} does not end in .ipynb; try starter.ipynb")
    if out.exists():
        raise WorkbenchError(f"file {str(out)!r} exists; give another name, nothing was changed")
    base = replace(nominal_design(chosen), at=tuple(chosen.design_point.items()))
    write_whole(out, starter_notebook(StepTrial(chosen.recipe, base, say=note)))
    typer.echo(f"written to {out}; open it: {shlex.join(('jupyter', 'lab', str(out)))}")
    return 0
