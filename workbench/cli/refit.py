"""The verb ``refit``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def refit(
    what: Annotated[
        str,
        typer.Argument(
            help="Folder of a case, name of a shipped case (practice-07), or a machine: emps, "
            "tanks, cylinder, pendulum.",
            metavar="CASE_OR_MACHINE",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the page, the pictures and results.json.")
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            help="Folder with recordings of real machines; by default the environment variable "
            "WORKBENCH_DATA. What it does not hold is fetched from its publisher.",
        ),
    ] = None,
) -> int:
    """Estimate a model's parameters from recordings and judge it on others.

    Examples: 'workbench refit practice-07 --out refit', 'workbench refit emps --data FOLDER'.

    Args:
        what: Folder of a case, name of a shipped case, or name of a machine.
        out: Folder to write to; None prints only.
        data: Folder with recordings of real machines.

    Returns:
        0.

    Example:
        >>> refit("nowhere")
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: 'nowhere' is neither a folder with a case nor one of ...
    """
    from workbench.diagnosis.estimation.refit_report import run_refit

    task = _task(what, data)
    report = run_refit(task, progress=lambda text: typer.echo(text, err=True))
    typer.echo(str(report))
    if out is not None:
        _write(report, out, f"workbench refit {what} --out {out.name}")
        typer.echo(f"open {out / 'report.html'}")
    return 0


def _task(what: str, data: Path | None) -> Any:
    from workbench.data_folder import shipped_cases, shipped_data
    from workbench.diagnosis.tasks import MACHINES, machine_task
    from workbench.diagnosis.tasks.arm_case import arm_case
    from workbench.errors import WorkbenchError
    from workbench.recordings import read_case

    if what in MACHINES:
        return machine_task(what, data=data)
    if what in shipped_cases():
        return arm_case(read_case(shipped_data(what)))
    if not Path(what).is_dir():
        raise WorkbenchError(
            f"{what!r} is neither a folder with a case nor one of"
            f" {', '.join((*shipped_cases(), *MACHINES))}"
        )
    return arm_case(read_case(what))


def _write(report: Any, out: Path, command: str) -> None:
    import json

    from workbench.files import write_whole
    from workbench.reports.page import write_page
    from workbench.reports.pictures import save
    from workbench.reports.refit_page import refit_page

    page = refit_page(report, command=command)
    write_page(page, out / "report.html")
    for picture in page.pictures:
        save(picture, out)
    text = json.dumps(_results(report), indent=2, allow_nan=False, ensure_ascii=False)
    write_whole(out / "results.json", text + "\n")


def _results(report: Any) -> dict[str, Any]:
    import math

    def plain(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "schema": "workbench.refit/1",
        "name": report.task.name,
        "converged": report.refit.converged,
        "seconds": report.seconds,
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
