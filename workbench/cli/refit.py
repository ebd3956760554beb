"""The verb ``refit``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from workbench.cli.as_json import AsJson
from workbench.cli.plant import Effects, Options, Parameters, Short, Without
from workbench.cli.problem import (
    CaseName,
    CasePlant,
    Data,
    Fit,
    HoldOut,
    Mapped,
    Noise,
    Stages,
    Starts,
    StartSamples,
    load_problem,
)


def refit(
    case: CaseName = None,
    fit: Fit = None,
    hold_out: HoldOut = None,
    plant: CasePlant = None,
    mapping: Mapped = None,
    option: Options = None,
    parameter: Parameters = None,
    without: Without = None,
    effect: Effects = None,
    noise: Noise = None,
    starts: Starts = None,
    stages: Stages = None,
    start_samples: StartSamples = None,
    data: Data = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the page, the pictures and results.json.")
    ] = None,
    as_json: AsJson = False,
    short: Short = None,
) -> int:
    """Estimate a model's parameters from recordings and judge it on others.

    Examples: 'workbench refit practice-07 --out refit', 'workbench refit emps --data FOLDER',
    'workbench refit --plant my_plants:rig --fit a.csv --hold-out b.csv'.
    """
    from workbench.diagnosis.estimation.refit_report import run_refit
    from workbench.work.counted import in_words

    loaded = load_problem(
        case,
        fit=fit,
        hold_out=hold_out,
        plant=plant,
        mapping=mapping,
        data=data,
        settings={
            "noise": noise,
            "starts": starts,
            "stages": stages,
            "start_samples": start_samples,
        },
        changes={
            "options": option,
            "parameters": parameter,
            "without": without,
            "effects": effect,
            "short": short,
        },
    )
    report = run_refit(loaded.problem.task(), progress=lambda text: typer.echo(text, err=True))
    typer.echo(f"{report}\nwork: {in_words(report.work)}", err=as_json)
    if out is not None:
        _write(report, out)
        typer.echo(f"open {out / 'report.html'}", err=as_json)
    if as_json:
        typer.echo(_results_text(report), nl=False)
    return 0


def _write(report: Any, out: Path) -> None:
    from workbench.cli.typed import typed
    from workbench.files import write_whole
    from workbench.reports.page import write_page
    from workbench.reports.pictures import save
    from workbench.reports.refit_page import refit_page

    page = refit_page(report, command=typed())
    write_page(page, out / "report.html")
    for picture in page.pictures:
        save(picture, out)
    write_whole(out / "results.json", _results_text(report))


def _results_text(report: Any) -> str:
    from workbench.reports.results import json_text

    return json_text(_results(report))


def _results(report: Any) -> dict[str, Any]:
    import math

    def plain(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "schema": "workbench.refit/1",
        "name": report.task.name,
        "converged": report.refit.converged,
        "seconds": report.seconds,
        "work": dict(report.work),
        "process_noise_scale": report.refit.noise_scale,
        "reaches_noise_floor": report.reaches_floor,
        "parameters": {
            e.name: {
                "value": e.value,
                "unit": e.unit,
                "std": plain(e.std),
                "interval": [plain(end) for end in e.interval],
                "before": e.prior.mean,
                "on_bound": e.on_bound,
                "published": report.task.published.get(e.name),
            }
            for e in report.refit.estimates
        },
        "unidentifiable": list(report.refit.unidentifiable),
        "disagreements": list(report.refit.disagreements),
        "held_out": [
            {
                "recording": r.recording,
                "output": r.output,
                "unit": r.unit,
                "spread": plain(r.spread),
                "nominal": plain(r.nominal),
                "refitted": plain(r.refitted),
                "noise_limited": plain(r.limited),
                "noise": plain(r.noise),
            }
            for r in report.rows
        ],
    }
