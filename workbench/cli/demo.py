"""The verb ``demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.progress import Progress


def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for the page, the pictures and results.json.")
    ] = Path("demo"),
    data: Annotated[
        Path | None,
        typer.Option(
            help="Folder with recordings of real machines; adds measured force maps. "
            "By default the environment variable WORKBENCH_DATA, if set.",
        ),
    ] = None,
) -> int:
    """Show the whole workbench on one page: model, linear models, controllers, recording.

    Takes less than a minute on two cores and ends by saying what to open. Only the shipped
    recordings are needed.
    """
    from workbench.demo import PARTS, run_demo

    progress = Progress(len(PARTS) + 1)
    result = run_demo(out, data=data, progress=progress)
    progress.done()
    typer.echo(str(result))
    if result.interrupted:
        raise KeyboardInterrupt
    return 0 if result.complete else 1
