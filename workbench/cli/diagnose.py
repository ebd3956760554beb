"""The verb ``diagnose``."""

from __future__ import annotations

import time
from dataclasses import replace
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


QUICK_S = 20.0
"""Time limit of a quick diagnosis, in s."""


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
    time_limit: Annotated[
        float | None,
        typer.Option(
            "--time-limit",
            help="End after this time with the best verdict until then, which says what was not"
            " tried; exit status 0.",
            metavar="SECONDS",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help=f"The same as --time-limit {QUICK_S:g}.")
    ] = False,
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
    SIGTERM or a time limit, verdict.json holds what was found until then, and the same command goes
    on from the last stage that was finished. Examples: 'workbench diagnose practice-08 --out
    diagnosis', 'workbench diagnose --fit a.csv --fit b.csv --hold-out c.csv --load 3kg',
    'workbench diagnose --plant my_plants:rig --effects my_physics:law --fit a.csv --hold-out
    b.csv'.

    Args:
        time_limit: Time after which it ends, in s, 1 to 1e6.
    """
    from workbench.diagnosis.problem import own_hypotheses
    from workbench.work.counted import in_words

    begin = time.perf_counter()
    limit = _limit(time_limit, quick=quick)
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
    found = _run(loaded, own, workers, out, begin, limit)
    typer.echo(f"{found.verdict}\nwork: {in_words(found.work)}", err=as_json)
    if out is not None and not (found.verdict and found.verdict.interrupted):
        _write(found, loaded, out)
        typer.echo(f"open {out / 'report.html'}", err=as_json)
    if as_json:
        assert found.verdict is not None
        typer.echo(_text(found.verdict, loaded))
    return 0


def _limit(seconds: float | None, *, quick: bool) -> float | None:
    if quick and seconds is not None:
        raise WorkbenchError(
            f"--quick is a time limit of {QUICK_S:g} s, and --time-limit {seconds:g} is given too;"
            " keep one of them"
        )
    if quick:
        return QUICK_S
    return None if seconds is None else check_range("time limit", seconds, 1.0, 1e6, "s")


def _run(
    loaded: Loaded,
    own: tuple[Hypothesis, ...] | None,
    jobs: int,
    out: Path | None,
    begin: float,
    limit: float | None,
) -> Diagnosis:
    from workbench.cli.ending import TimeUp
    from workbench.cli.ending import time_limit as until
    from workbench.diagnosis.conclude import conclude_early
    from workbench.diagnosis.diagnose import stages
    from workbench.files import write_whole

    problem = loaded.problem
    step = "starting"
    left = None if limit is None else max(limit - (time.perf_counter() - begin), 0.01)
    found: Diagnosis | None = None
    reached: Diagnosis

    def say(text: str) -> None:
        nonlocal step
        step = text
        typer.echo(f"{time.perf_counter() - begin:6.1f} s  {text}", err=True)

    try:
        with until(left):
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
    except KeyboardInterrupt as end:
        asked = limit if isinstance(end, TimeUp) else None
        if found is not None:
            early = conclude_early(found, step, after=asked)
            found = replace(found, verdict=early)
            if out is not None:
                write_whole(out / "verdict.json", _text(early, loaded))
        if asked is None:
            raise
        if found is None:
            raise WorkbenchError(
                f"nothing was found within {asked:g} s, which ended while {step}; give more time"
            ) from None
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

    assert found.verdict is not None
    with whole_folder(out) as folder:
        write_whole(folder / "verdict.json", _text(found.verdict, loaded))
        page = diagnosis_page(
            found,
            proof_of(found),
            name=loaded.problem.name,
            commands=tuple(filter(None, (typed(),))),
        )
        write_page(page, folder / "report.html", pictures=folder / "figures")
