"""The verb ``recording``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

UNFIT = 1
"""Exit status if the recording is not fit to judge a model on."""


def recording(
    file: Annotated[Path, typer.Argument(help="Recording: CSV, MATLAB .mat, Parquet or JSON log.")],
    mapping: Annotated[
        Path | None,
        typer.Option(help="TOML file that says which column is which signal.", metavar="FILE"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the page and the pictures.")] = None,
) -> int:
    """Read a recording, say how its columns were understood, and check whether it is fit.

    Example: 'workbench recording run.csv --out run'.

    Args:
        mapping: Mapping of its columns; None maps by name and unit.
        out: Folder to write to; None prints only.

    Returns:
        0 if the recording is fit to judge a model on, 1 if not.

    Example:
        >>> recording(Path("nowhere.csv"))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: ...
    """
    from workbench.recordings import check_recording, read_recording

    seen = read_recording(file, mapping=mapping)
    report = check_recording(seen)
    typer.echo(str(seen))
    if seen.mapping is not None:
        typer.echo(f"\n{seen.mapping}")
    typer.echo(f"\n{report}")
    if out is not None:
        from workbench.reports.page import write_page
        from workbench.reports.pictures import save
        from workbench.reports.recording_page import recording_page

        page = recording_page(report, command=f"workbench recording {file.name} --out {out.name}")
        write_page(page, out / "report.html")
        for picture in page.pictures:
            save(picture, out)
        typer.echo(f"open {out / 'report.html'}")
    return 0 if report.fit else UNFIT
