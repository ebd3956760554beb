"""What `refit` and `diagnose` say about plant and recordings; both read it the same way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.cli.plant import CHANGES, Chosen, Short, chosen_plant, options_of
from workbench.errors import WorkbenchError, check_range
from workbench.plants import DEFAULT_PLANT

if TYPE_CHECKING:
    from workbench.diagnosis.problem import Problem
    from workbench.model import Model
    from workbench.recordings.case import RefitSettings

CaseName = Annotated[
    str | None,
    typer.Argument(
        help="Folder of a case, or name of a shipped case such as practice-08 or of a machine such"
        " as emps.",
        metavar="[CASE]",
    ),
]
Fit = Annotated[
    list[Path] | None,
    typer.Option(help="Instead of a case: a recording to fit on; may be given several times."),
]
HoldOut = Annotated[
    list[Path] | None,
    typer.Option(help="A recording to judge on; may be given several times."),
]
Mapped = Annotated[
    Path | None, typer.Option(help="TOML file that maps their columns to signals.", metavar="FILE")
]
CasePlant = Annotated[
    str | None,
    typer.Option(
        "--plant",
        help="Plant: a name of 'workbench plants', or a function or model of your own as"
        " module:object; by default that of the case, or the arm.",
        metavar="NAME",
    ),
]
Noise = Annotated[
    list[str] | None,
    typer.Option(
        help="Standard deviation of the noise of an output, such as position=0.1mm, in place of"
        " the sensor's data.",
        metavar="OUTPUT=VALUE",
    ),
]
Starts = Annotated[int | None, typer.Option(help="Number of starts of the search.", metavar="N")]
Stages = Annotated[
    str | None,
    typer.Option(
        help="Process-noise scales, pass by pass, such as 1,0.1,0.01; by default the most likely.",
        metavar="SCALE,...",
    ),
]
StartSamples = Annotated[
    int | None,
    typer.Option(
        help="Samples over which hidden states at the start of a free run are estimated.",
        metavar="N",
    ),
]
Data = Annotated[
    Path | None,
    typer.Option(
        help="Folder with recordings of real machines; by default the environment variable"
        " WORKBENCH_DATA. What it does not hold is fetched from its publisher.",
    ),
]


@dataclass(frozen=True)
class Loaded:
    """A problem and its plant."""

    problem: Problem
    chosen: Chosen


_RECORDED: dict[str, tuple[Any, Any]] = {
    "case": (CaseName, None),
    "fit": (Fit, None),
    "hold_out": (HoldOut, None),
    "plant": (CasePlant, None),
    "mapping": (Mapped, None),
    "data": (Data, None),
    **CHANGES,
    "short": (Short, None),
}
_SETTINGS: dict[str, tuple[Any, Any]] = {
    "noise": (Noise, None),
    "starts": (Starts, None),
    "stages": (Stages, None),
    "start_samples": (StartSamples, None),
}


def with_problem(*, settings: bool = False) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Give a verb plant and recordings: its parameter ``recorded`` becomes options that name them.

    The verb calls ``recorded()``, which reads the recordings and returns a `Loaded`.

    Args:
        settings: Whether the settings of a refit may be chosen too.
    """

    def make(**given: Any) -> Callable[[], Loaded]:
        return partial(_loaded, **given)

    return options_of("recorded", {**_RECORDED, **(_SETTINGS if settings else {})}, make)


def _loaded(
    case: str | None,
    fit: Sequence[Path] | None,
    hold_out: Sequence[Path] | None,
    plant: str | None,
    mapping: Path | None,
    data: Path | None,
    **given: Any,
) -> Loaded:
    """Read what options of a verb name."""
    changes = {name: given.pop(name) for name in (*CHANGES, "short")}
    from workbench.diagnosis.problem import problem_of_case, problem_of_files
    from workbench.recordings.case import RefitSettings, read_case

    if case is None and not fit and not hold_out:
        raise WorkbenchError(
            "there is nothing to work on; name a case, or give recordings with --fit and --hold-out"
        )
    if case is not None and (fit or hold_out):
        raise WorkbenchError(f"both the case {case!r} and recordings are given; keep one of them")
    if case is not None:
        read = read_case(case, mapping=mapping, data=data)
        name = plant or read.plant.name
        same = plant is None or name == read.plant.name
        folder = Path.cwd() if plant is not None else read.changes.get("folder")
        chosen = chosen_plant(
            name,
            defaults=read.options if same else {},
            folder=folder,
            **{**changes, **_joined(read.changes if same else {}, changes)},
        )
        if same:
            read.check_options(dict(chosen.recipe.options))
        problem = problem_of_case(read, chosen.model)
        base = read.refit
    else:
        name = plant or DEFAULT_PLANT
        chosen = chosen_plant(name, **changes)
        base = RefitSettings(start_samples=chosen.plant.start_samples)
        problem = problem_of_files(chosen.model, fit or (), hold_out or (), mapping=mapping)
        for note in problem.notes:
            typer.echo(f"note: {note}", err=True)
    if not any(q.fitted for q in problem.model.parameters):
        typer.echo(
            f"note: no parameter of {problem.model.name!r} is declared fitted=True, so all keep"
            " their values",
            err=True,
        )
    return Loaded(replace(problem, refit=_settings(problem.model, base, given)), chosen)


def _joined(of_case: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    names = {"effect": "effects", "without": "without", "parameter": "parameters"}
    return {key: [*of_case.get(name, ()), *(given[key] or ())] for key, name in names.items()}


def _settings(model: Model, base: RefitSettings, given: Mapping[str, Any]) -> RefitSettings:
    from workbench.recordings.case import noise_of

    changed: dict[str, Any] = {}
    if given.get("noise"):
        pairs = [text.partition("=") for text in given["noise"]]
        for name, sign, _ in pairs:
            if not sign:
                raise WorkbenchError(f"noise {name!r} has no value; write it as OUTPUT=VALUE")
        changed["noise"] = {
            **base.noise,
            **noise_of(model, {name.strip(): value for name, _, value in pairs}),
        }
    if given.get("starts") is not None:
        changed["starts"] = round(check_range("number of starts", given["starts"], 1, 100))
    if given.get("start_samples") is not None:
        changed["start_samples"] = round(
            check_range("number of start samples", given["start_samples"], 0, 1e6)
        )
    if given.get("stages") is not None:
        from workbench.model.units import quantity

        changed["stages"] = tuple(
            check_range("stage", quantity("stage", text, "1"), 1e-9, 1e9)
            for text in given["stages"].split(",")
        )
    return replace(base, **changed)
