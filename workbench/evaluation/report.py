"""Tables, figure and summary of a folder of kept answers, whichever verb kept them."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import WorkbenchError
from workbench.evaluation.foreign import foreign_case as foreign
from workbench.evaluation.kept import read_kept
from workbench.evaluation.own_cases import report as own_cases
from workbench.files import json_text, write_whole


def report(
    out: Path,
    *,
    figure_file: Path | None = None,
    summary_file: Path | None = None,
    each: bool = False,
) -> str:
    """Return the tables of a folder of answers; write figure and summary where wanted."""
    rows = read_kept(out)
    is_foreign = rows[0].get("schema") == foreign.SCHEMA
    if is_foreign:
        lines = "\n".join(foreign.line_of(row) for row in rows)
        tables, summary = foreign.tables(rows), foreign.summary(rows)
    else:
        lines, tables = own_cases.cases(rows), own_cases.tables(rows)
        summary = own_cases.summary(rows)
    if summary_file:
        write_whole(summary_file, json_text(summary))
    if figure_file:
        if is_foreign:
            raise WorkbenchError("foreign cases have no figure; leave --figure away")
        own_cases.figure(rows, figure_file)
    return "\n\n".join([*([lines] if each else []), tables])
