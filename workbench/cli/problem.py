"""What `refit` and `diagnose` say about plant and recordings; both read it the same way."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.cli.options import Verb, parameters_of, taking
from workbench.cli.plant import CHANGES, Chosen, chosen_plant
from workbench.cli.running import note, telling
from workbench.errors import WorkbenchError, check_range
from workbench.plants import DEFAULT_PLANT

if TYPE_CHECKING:
    from workbench.diagnosis.problem import Problem
    from workbench.model import Model
    from workbench.recordings.case import RefitSettings

_SETTINGS = ("noise", "starts", "stages", "start_samples")


@dataclass(frozen=True)
class Loaded:
    """A problem and its plant."""

    problem: Problem
    chosen: Chosen


def with_problem(*, settings: bool = False) -> Callable[[Verb], Verb]:
    """Give a verb plant and recordings: its parameter ``recorded`` becomes options that name them.

    The verb calls ``recorded()``, which reads the recordings and returns a `Loaded`.

    Args:
        settings: Whether the settings of a refit may be chosen too.
    """
    offered = [p.name for p in parameters_of(_loaded) if settings or p.name not in _SETTINGS]
    return taking("recorded", _loaded, offered, make=partial(partial, _loaded))


@taking("changes", chosen_plant, CHANGES, make=dict)
def _loaded(
    cases: list[str] | None = None,
    *,
    fit: list[Path] | None = None,
    hold_out: list[Path] | None = None,
    plant: str | None = None,
    mapping: Path | None = None,
    data: Path | None = None,
    changes: dict[str, Any],
    noise: list[str] | None = None,
    starts: int | None = None,
    stages: str | None = None,
    start_samples: int | None = None,
) -> Loaded:
    """Read what options of a verb name.

    Args:
        cases ([CASE]): Folder of a case, or name of a shipped case such as practice-08 or of a
            machine such as emps; files are recordings to fit on.
        fit: Instead of a case: a recording to fit on; may be given several times.
        hold_out: A recording to judge on; may be given several times. By default the last of
            several, or the last part of the only one.
        plant (NAME): Plant: a name of 'workbench plants', or a function or model of your own as
            module:object; by default that of the case, or the arm.
        mapping (FILE): TOML file that maps their columns to signals.
        data: Folder with recordings of real machines; by default the environment variable
            WORKBENCH_DATA. What it does not hold is fetched from its publisher.
        noise (OUTPUT=VALUE): Standard deviation of the noise of an output, such as position=0.1mm,
            in place of the sensor's data.
        starts (N): Number of starts of the search.
        stages (SCALE,...): Process-noise scales, pass by pass, such as 1,0.1,0.01; by default the
            most likely.
        start_samples (N): Samples over which hidden states at the start of a free run are
            estimated.
    """
    from workbench.diagnosis.problem import problem_of_case, problem_of_files, sized_by_recordings
    from workbench.model.linear_system import with_free_coefficients
    from workbench.recordings.case import RefitSettings, read_case

    asked = list(cases or ())
    if len(asked) > 1 or (asked and Path(asked[0]).is_file()):
        missing = next((name for name in asked if not Path(name).is_file()), None)
        if missing is not None:
            raise WorkbenchError(f"there is no file {missing!r}; name one case, or recordings")
        fit, asked = [*map(Path, asked), *(fit or ())], []
    case = asked[0] if asked else None
    if case is None and not fit and not hold_out:
        raise WorkbenchError(
            "there is nothing to work on; name a case, or give recordings with --fit"
        )
    if case is not None and Path(case).suffix and not Path(case).is_dir():
        raise WorkbenchError(f"there is no file {case}")
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
            **(changes | _joined(read.changes if same else {}, changes)),
        )
        if same:
            read.check_options(dict(chosen.recipe.options))
        problem = problem_of_case(read, chosen.model)
        base = read.refit
    else:
        name = plant or DEFAULT_PLANT
        chosen = chosen_plant(name, **changes)
        base = RefitSettings(start_samples=chosen.plant.start_samples)
        try:
            with telling(time.perf_counter(), "reading the recordings"):
                problem = problem_of_files(chosen.model, fit or (), hold_out or (), mapping=mapping)
        except WorkbenchError as error:
            if plant is not None:
                raise
            raise WorkbenchError(
                f"{error}; no plant is named, so the {name} is taken: name yours with --plant"
                " ('workbench new-plant my_plants.py' writes one to start from)"
            ) from None
        for remark in problem.notes:
            note(f"note: {remark}")
    attached = {effect.name for effect in problem.model.effects}
    named = [n for n in chosen.recipe.effects if n in attached and n not in chosen.plant.effects]
    problem = sized_by_recordings(problem, named) if named else problem
    opened = with_free_coefficients(problem.model)
    if opened is not problem.model:
        names = [q.name for q in opened.parameters]
        note(f"note: coefficients of the system are refitted: {', '.join(names)}")
        problem = replace(problem, model=opened)
    elif not any(q.fitted for q in problem.model.parameters):
        about = f"no parameter of {problem.model.name!r} is declared fitted=True"
        note(f"note: {about}, so all keep their values")
    settings = _settings(problem.model, base, noise, starts, stages, start_samples)
    return Loaded(replace(problem, refit=settings), chosen)


def _joined(of_case: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    names = {"effect": "effects", "without": "without", "parameter": "parameters"}
    return {key: [*of_case.get(name, ()), *(given[key] or ())] for key, name in names.items()}


def _settings(
    model: Model,
    base: RefitSettings,
    noise: list[str] | None,
    starts: int | None,
    stages: str | None,
    start_samples: int | None,
) -> RefitSettings:
    from workbench.model.units import named_value, quantity
    from workbench.recordings.case import noise_of

    changed: dict[str, Any] = {}
    if noise:
        given = noise_of(model, dict(named_value("noise of an output", text) for text in noise))
        changed["noise"] = {**base.noise, **given}
    if starts is not None:
        changed["starts"] = round(check_range("number of starts", starts, 1, 100))
    if start_samples is not None:
        count = check_range("number of start samples", start_samples, 0, 1e6)
        changed["start_samples"] = round(count)
    if stages is not None:
        scales = (quantity("stage", text, "1") for text in stages.split(","))
        changed["stages"] = tuple(check_range("stage", scale, 1e-9, 1e9) for scale in scales)
    return replace(base, **changed)
