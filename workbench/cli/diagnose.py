"""The verb ``diagnose``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.as_json import AsJson
from workbench.cli.plant import Effects, Options, Parameters, Short, Without
from workbench.cli.problem import (
    CaseName,
    CasePlant,
    Data,
    Fit,
    HoldOut,
    Loaded,
    Mapped,
    load_problem,
)
from workbench.errors import WorkbenchError, check_range

if TYPE_CHECKING:
    from workbench.diagnosis.stages import Diagnosis
    from workbench.diagnosis.verdict import Verdict
    from workbench.physics.hypothesis import Hypothesis


def diagnose(
    case: CaseName = None,
    fit: Fit = None,
    hold_out: HoldOut = None,
    plant: CasePlant = None,
    mapping: Mapped = None,
    effects: Annotated[
        list[str] | None,
        typer.Option(
            "--effects",
            help="Physics of your own that may be missing, beside the library: module:object, an"
            " effect or a function that returns one; may be given several times.",
            metavar="NAME",
        ),
    ] = None,
    option: Options = None,
    parameter: Parameters = None,
    without: Without = None,
    effect: Effects = None,
    jobs: Annotated[int, typer.Option(help="Processes that work side by side.")] = 2,
    data: Data = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for verdict.json, report.html and the pictures."),
    ] = None,
    as_json: AsJson = False,
    short: Short = None,
) -> int:
    """Find out what physics a model leaves out, and prove it on held-out recordings.

    The model is refitted first; what parameters can explain is no missing physics. After Ctrl-C,
    verdict.json holds what was found until then. Examples: 'workbench diagnose practice-08 --out
    diagnosis', 'workbench diagnose --fit a.csv --fit b.csv --hold-out c.csv --load 3kg',
    'workbench diagnose --plant my_plants:rig --effects my_physics:law --fit a.csv --hold-out
    b.csv'.
    """
    from workbench.diagnosis.problem import own_hypotheses

    workers = round(check_range("number of processes", jobs, 1, 64))
    if out is not None and out.exists() and not out.is_dir():
        raise WorkbenchError(f"folder {str(out)!r} is a file; give the name of a folder")
    loaded = load_problem(
        case,
        fit=fit,
        hold_out=hold_out,
        plant=plant,
        mapping=mapping,
        data=data,
        settings={},
        changes={
            "options": option,
            "parameters": parameter,
            "without": without,
            "effects": effect,
            "short": short,
        },
    )
    problem = loaded.problem
    if not problem.hold_out:
        raise WorkbenchError(
            f"case {problem.name} holds nothing out, so no claim could be proved; add a file"
            " validate_*.csv"
        )
    own = own_hypotheses(problem.model, effects or (), folder=Path.cwd())
    found = _run(loaded, own, workers, out)
    typer.echo(str(found.verdict), err=as_json)
    if out is not None:
        _write(found, loaded, out)
        typer.echo(f"open {out / 'report.html'}", err=as_json)
    if as_json:
        assert found.verdict is not None
        typer.echo(_text(found.verdict, loaded))
    return 0


def _run(
    loaded: Loaded, own: tuple[Hypothesis, ...] | None, jobs: int, out: Path | None
) -> Diagnosis:
    from workbench.diagnosis.conclude import conclude_early
    from workbench.diagnosis.diagnose import stages
    from workbench.files import write_whole

    problem = loaded.problem
    begin = time.perf_counter()
    step = "starting"
    found: Diagnosis | None = None
    reached: Diagnosis

    def say(text: str) -> None:
        nonlocal step
        step = text
        typer.echo(f"{time.perf_counter() - begin:6.1f} s  {text}", err=True)

    try:
        for reached in stages(
            problem.model,
            problem.fit,
            problem.hold_out,
            entries=own,
            jobs=jobs,
            folder=out,
            progress=say,
        ):
            found = reached
    except KeyboardInterrupt:
        if out is not None and found is not None:
            write_whole(out / "verdict.json", _text(conclude_early(found, step), loaded))
        raise
    assert found is not None
    return found


def _text(verdict: Verdict, loaded: Loaded) -> str:
    """Return the verdict's JSON, with its model as a plant that every verb takes."""
    from workbench.plants.saved import saved_plant

    own = loaded.chosen
    return verdict.to_json(saved_plant(own.reference, own.options, own.nominal, verdict.model))


def _write(found: Diagnosis, loaded: Loaded, out: Path) -> None:
    from workbench.cli.typed import typed
    from workbench.diagnosis.comparison import proof_of
    from workbench.files import whole_folder, write_whole
    from workbench.reports.diagnosis_page import diagnosis_page
    from workbench.reports.page import write_page
    from workbench.reports.pictures import save

    assert found.verdict is not None
    with whole_folder(out) as folder:
        write_whole(folder / "verdict.json", _text(found.verdict, loaded))
        page = diagnosis_page(
            found,
            proof_of(found),
            name=loaded.problem.name,
            commands=tuple(filter(None, (typed(),))),
        )
        write_page(page, folder / "report.html")
        for picture in page.pictures:
            save(picture, folder / "figures")
