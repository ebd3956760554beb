"""The verb ``refit``."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from workbench.cli.options import AsJson
from workbench.cli.problem import Loaded, with_problem
from workbench.cli.running import tell, telling, typed
from workbench.computing.counted import in_words
from workbench.files import json_text, picked, write_whole


@with_problem(settings=True)
def refit(
    recorded: Callable[[], Loaded], *, out: Path | None = None, as_json: AsJson = False
) -> None:
    """Estimate a model's parameters from recordings and judge it on others.

    Examples: 'workbench refit practice-07 --out refit', 'workbench refit emps --data FOLDER',
    'workbench refit --plant my_plants:rig --fit a.csv --hold-out b.csv'.

    Args:
        out: Folder for the page, the pictures and results.json.
    """
    from workbench.diagnosis.refit_report import run_refit

    begin, problem = time.perf_counter(), recorded().problem
    with telling(begin) as say:
        report = run_refit(problem, progress=say)
    typer.echo(f"{report}\nwork: {in_words(report.work)}", err=as_json)
    if out is not None:
        from workbench.reports.page import write_page
        from workbench.reports.refit_page import refit_page

        page = refit_page(report, command=typed())
        path = write_page(page, out / "report.html", pictures=out)
        write_whole(out / "results.json", json_text(_results(report)))
        typer.echo(f"open {path}", err=as_json)
    tell(_results(report), as_json=as_json)


def _results(report: Any) -> dict[str, Any]:
    return {
        "schema": "workbench.refit/1",
        "name": report.problem.name,
        "converged": report.refit.converged,
        "seconds": report.seconds,
        "work": dict(report.work),
        "process_noise_scale": report.refit.noise_scale,
        "reaches_noise_floor": report.reaches_floor,
        "parameters": {
            e.name: picked(e, "value unit std interval before=prior.mean on_bound")
            | {"published": report.problem.published.get(e.name)}
            for e in report.refit.estimates
        },
        "unidentifiable": list(report.refit.unidentifiable),
        "disagreements": list(report.refit.disagreements),
        "held_out": [
            picked(r, "recording output unit spread nominal refitted noise_limited=limited noise")
            for r in report.rows
        ],
    }
