"""The verb ``bless``."""

from __future__ import annotations

from pathlib import Path

import typer


def bless(results: Path, *, baseline: Path) -> int:
    """Accept the results of a study as the baseline, showing what changes by that.

    Requirements that are missed are still missed afterwards: a baseline accepts changes, not
    failures.

    Example: 'workbench bless comparison --baseline arm.baseline.json'.

    Args:
        results (DIR): Folder written by 'workbench compare'.
        baseline (FILE): File to write.
    """
    from workbench.study.baseline import bless as accept

    typer.echo(accept(results, baseline))
    return 0
