"""The verb ``force-map``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def force_map(
    file: Annotated[
        Path,
        typer.Argument(
            help="Table of static forces with the columns pressure, length and force, each with "
            "its unit (pressure_Pa, length_m, force_N).",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the page, the pictures and results.json.")
    ] = None,
) -> int:
    """Fit every force law to a measured force map and judge it on points left out.

    Example: 'workbench force-map dmsp-20-300_static_force.csv --out map'.

    Args:
        file: Table with gauge pressure, length and force, in the units of its header.
        out: Folder to write to; None prints only.

    Returns:
        0.

    Example:
        >>> force_map(Path("nowhere.csv"))
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: ...
    """
    from workbench.demo.force_map_study import ForceMap, study_map
    from workbench.recordings import read_table

    table = read_table(file)
    points = ForceMap(table["pressure"], table["length"], table["force"])
    study = study_map(points, file.stem, progress=lambda text: typer.echo(text, err=True))
    typer.echo(str(study))
    if out is not None:
        import json

        from workbench.cli.typed import typed
        from workbench.demo.force_map_page import force_map_page
        from workbench.files import write_whole
        from workbench.reports.page import write_page
        from workbench.reports.pictures import save

        page = force_map_page(study, command=typed())
        write_page(page, out / "report.html")
        for picture in page.pictures:
            save(picture, out)
        results = {
            "schema": "workbench.force-map/1",
            "name": study.name,
            "largest_force_N": study.largest_force,
            "need_for_phi": study.need_for_phi,
            "laws": {
                law.name: {
                    "title": law.title,
                    "values": law.values.tolist(),
                    "std": law.std.tolist(),
                    "fitted_rms_N": law.fitted_rms,
                    "fitted_largest_N": law.largest,
                    "lengths_held_out_rms_N": law.length_rms,
                    "lengths_held_out_largest_N": law.length_largest,
                    "pressures_held_out_rms_N": law.pressure_rms,
                }
                for law in study.laws
            },
        }
        write_whole(out / "results.json", json.dumps(results, indent=2, ensure_ascii=False) + "\n")
        typer.echo(f"open {out / 'report.html'}")
    return 0
