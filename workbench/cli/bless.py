"""The verb ``bless``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def bless(
    results: Annotated[
        Path, typer.Argument(help="Folder written by 'workbench compare'.", metavar="DIR")
    ],
    baseline: Annotated[Path, typer.Option(help="File to write.", metavar="FILE")],
) -> int:
    """Accept the results of a study as the baseline, showing what changes by that.

    Requirements that are missed are still missed afterwards: a baseline accepts changes, not
    failures.

    Example: 'workbench bless comparison --baseline arm.baseline.json'.
    """
    from workbench.study.bless import bless as accept

    typer.echo(accept(results, baseline))
    return 0
