"""The option ``--json``: a verb prints its result for a script in place of a person."""

from __future__ import annotations

from typing import Annotated

import typer

AsJson = Annotated[
    bool,
    typer.Option(
        "--json", help="Print the result as JSON, in SI, and everything else to the error stream."
    ),
]
