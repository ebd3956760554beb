"""The verb ``prove``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def prove(
    verdicts: Annotated[
        Path,
        typer.Argument(
            help="Folder with CASE/verdict.json or CASE.json for each case.", metavar="VERDICTS"
        ),
    ],
    key: Annotated[Path, typer.Option(help="JSON file with the answers.")],
    commitments: Annotated[
        Path | None,
        typer.Option(help="Text file with the SHA-256 of each answer, to check them."),
    ] = None,
    names: Annotated[
        Path | None,
        typer.Option(help="TOML file on how further words of the key are to be read."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="JSON file for the score.")] = None,
) -> int:
    """Score the verdicts of a blind round against the answers.

    Prints points per case, rates, and the p-value against random answers. Example:
    'workbench prove verdicts --key key.json --commitments commitments.txt'.

    Args:
        verdicts: Folder with verdicts.
        key: File with the answers.
        commitments: File with their digests, or None.
        names: Table of further names, or None.
        out: JSON file, or None.

    Returns:
        Exit status.

    Example:
        >>> prove(Path("nowhere"), Path("no key"))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: key 'no key' cannot be read: no such file or directory
    """
    from workbench.diagnosis.prove import prove as score

    found = score(verdicts, key, commitments=commitments, names=names)
    typer.echo(str(found))
    if out is not None:
        from workbench.files import write_whole
        from workbench.reports.results import json_text

        write_whole(out, json_text(found.as_data()))
        typer.echo(f"written to {out}")
    return 0
