"""The verb ``notebook``."""

from __future__ import annotations

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
    from workbench.files import write_whole
    from workbench.notebook.starter import Beginning, starter_notebook

    if out.suffix != ".ipynb":
        raise WorkbenchError(f"file {str(out)!r} does not end in .ipynb; try starter.ipynb")
    if out.exists():
        raise WorkbenchError(f"file {str(out)!r} exists; give another name, nothing was changed")
    begin = Beginning(chosen.plant, chosen.recipe, chosen.nominal, chosen.design_point)
    write_whole(out, starter_notebook(begin))
    typer.echo(f"written to {out}; open it: jupyter lab {out}")
    return 0
