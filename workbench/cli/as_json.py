"""Results for scripts: the option ``--json``, and files that hold the same."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

AsJson = Annotated[
    bool,
    typer.Option(
        "--json", help="Print the result as JSON, in SI, and everything else to the error stream."
    ),
]


def tell(content: Mapping[str, Any], *, as_json: bool, file: Path | None = None) -> None:
    """Print a result as JSON if a script reads it, and write it to a file if one is named."""
    from workbench.files import json_text, write_whole

    if as_json:
        typer.echo(json_text(content), nl=False)
    if file is not None:
        write_whole(file, json_text(content))
        typer.echo(f"written to {file}", err=as_json)
