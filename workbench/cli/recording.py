"""The verb ``recording``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import typer

from workbench.cli.options import AsJson, taking
from workbench.cli.plant import CHANGES, Chosen, chosen_plant
from workbench.cli.running import tell, telling, typed
from workbench.errors import WorkbenchError

UNFIT = 1
"""Exit status if the recording is not fit to judge a model on."""


@taking("changes", chosen_plant, CHANGES, make=dict)
def _chosen(*, plant: str | None = None, changes: dict[str, Any]) -> Chosen | None:
    """Build the plant of a recording, if one is named.

    Args:
        plant (NAME): Plant that it is a recording of, a name of 'workbench plants' or
            module:object: its inputs and outputs are looked for, and its limits and signs are
            checked.
    """
    if plant is not None:
        return chosen_plant(plant, **changes)
    if any(changes.values()):
        raise WorkbenchError("options of a plant are given, but no plant; name it with --plant")
    return None


@taking("chosen", _chosen)
def recording(
    file: Path,
    *,
    mapping: Path | None = None,
    chosen: Chosen | None,
    out: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Read a recording, say how its columns were understood, and check whether it is fit.

    Examples: 'workbench recording run.csv --out run', 'workbench recording run.csv --plant
    my_plants:rig'.

    Args:
        file: Recording: text, Excel, MATLAB, Octave, HDF5, NumPy, LabVIEW, TDMS, MDF, Parquet or
            JSON.
        mapping (FILE): TOML file that says which column is which signal.
        out: Folder for the page and the pictures.
    """
    from workbench.recordings import check_recording, read_recording
    from workbench.recordings.column_matching import driven_by

    model = None if chosen is None else chosen.model
    wanted = None if model is None else driven_by(model)
    with telling(time.perf_counter(), f"reading {file}"):
        seen = read_recording(file, mapping=mapping, signals=wanted)
        required = None if wanted is None else [w.name for w in wanted if w.name in seen]
        report = check_recording(seen, model=model, required=required)
        if model is not None:
            from workbench.diagnosis.estimation.observe import recorded_outputs
            from workbench.diagnosis.misrecorded_columns import with_columns_tried

            report = with_columns_tried(model, report)
            try:
                recorded_outputs(model, seen)
            except WorkbenchError as error:
                # Fit as it may be, no model can be held against it.
                typer.echo(f"note: {error}", err=True)
    typer.echo(str(seen), err=as_json)
    if seen.mapping is not None:
        typer.echo(f"\n{seen.mapping}", err=as_json)
    typer.echo(f"\n{report}", err=as_json)
    content = {
        "result": report.result,
        "fit": report.fit,
        "doubtful": list(report.doubtful),
        **seen.as_data(),
        "checks": report.as_data(),
    }
    tell(content, as_json=as_json)
    if out is not None:
        from workbench.reports.page import write_page
        from workbench.reports.recording_page import recording_page

        page = recording_page(report, command=typed())
        typer.echo(f"open {write_page(page, out / 'report.html', pictures=out)}", err=as_json)
    return 0 if report.fit else UNFIT
