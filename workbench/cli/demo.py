"""The verb ``demo``."""

from __future__ import annotations

import time
from pathlib import Path

import typer

from workbench.cli.running import telling


def demo(*, out: Path = Path("demo"), data: Path | None = None) -> int:
    """Show the whole workbench on one page: model, linear models, controllers, recording.

    Takes less than a minute on two cores and ends by saying what to open. Only the shipped
    recordings are needed.

    Args:
        out: Folder for the page, the pictures and results.json.
        data: Folder with recordings of real machines; adds measured force maps. By default the
            environment variable WORKBENCH_DATA, if set.
    """
    from workbench.demo import run_demo

    with telling(time.perf_counter()) as say:
        result = run_demo(out, data=data, progress=say)
    typer.echo(str(result))
    if result.interrupted:
        raise KeyboardInterrupt
    return 0 if result.complete else 1
