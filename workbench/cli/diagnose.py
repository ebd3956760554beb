"""The verb ``diagnose``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.plant import Parameters, Without, plant_from_options
from workbench.errors import WorkbenchError, check_choice, check_range

if TYPE_CHECKING:
    from workbench.diagnosis.stages import Diagnosis
    from workbench.model import Model
    from workbench.recordings.recording import Recording

PLANTS = ("arm", "servo-axis", "emps", "cylinder", "tanks", "pendulum")
"""Plants that recordings without a case may belong to."""


def diagnose(
    case: Annotated[
        str | None,
        typer.Argument(
            help="Folder of a case, or name of a shipped case such as practice-08.",
            metavar="[CASE]",
        ),
    ] = None,
    fit: Annotated[
        list[Path] | None,
        typer.Option(help="Instead of a case: a recording to fit on; may be given several times."),
    ] = None,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(help="A recording to judge on; may be given several times."),
    ] = None,
    plant: Annotated[
        str, typer.Option(help=f"Plant of those recordings: {', '.join(PLANTS)}.")
    ] = "arm",
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file that maps their columns to signals.")
    ] = None,
    load: Annotated[
        str | None,
        typer.Option(
            help="Mass of the plates on the arm; by default that of the case.", metavar="MASS"
        ),
    ] = None,
    plane: Annotated[
        str | None, typer.Option(help="Plane of the motion; by default that of the case.")
    ] = None,
    supply: Annotated[
        str | None,
        typer.Option(
            help="Supply pressure, gauge; by default that of the case.", metavar="PRESSURE"
        ),
    ] = None,
    parameter: Parameters = None,
    without: Without = None,
    jobs: Annotated[int, typer.Option(help="Processes that work side by side.")] = 2,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for verdict.json, report.html and the pictures."),
    ] = None,
) -> int:
    """Find out what physics a model leaves out, and prove it on held-out recordings.

    The model is refitted first; what parameters can explain is no missing physics. After Ctrl-C,
    verdict.json holds what was found until then. Examples: 'workbench diagnose practice-08 --out
    diagnosis', 'workbench diagnose --fit a.csv --fit b.csv --hold-out c.csv --load 3kg'.

    Args:
        case: Folder or name of a case; None if recordings are given.
        fit: Recordings to fit on.
        hold_out: Recordings to judge on.
        plant: Plant of those recordings.
        mapping: Mapping of their columns, or None.
        load: Mass of the plates, or None for that of the case.
        plane: Plane of the motion, or None for that of the case.
        supply: Supply pressure, gauge, or None for that of the case.
        parameter: Changed parameters as NAME=VALUE.
        without: Effects to leave out.
        jobs: Number of processes.
        out: Folder to write to; None prints only.

    Returns:
        Exit status.

    Example:
        >>> diagnose()
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: there is nothing to diagnose; name a case, or give ...
    """
    workers = round(check_range("number of processes", jobs, 1, 64))
    if out is not None and out.exists() and not out.is_dir():
        raise WorkbenchError(f"folder {str(out)!r} is a file; give the name of a folder")
    task = _task(case, fit or (), hold_out or (), plant, mapping, (load, plane, supply))
    changed = tuple(without or ()), tuple(parameter or ())
    model = _changed(task.model, *changed) if any(changed) else task.model
    found = _run(model, task, workers, out)
    typer.echo(str(found.verdict))
    if out is not None:
        _write(found, task, out)
        typer.echo(f"open {out / 'report.html'}")
    return 0


@dataclass(frozen=True)
class _Task:
    """A model with recordings to fit on and to judge on."""

    name: str
    model: Model
    fit: tuple[Recording, ...]
    hold_out: tuple[Recording, ...]
    command: str


def _task(
    case: str | None,
    fit: Sequence[Path],
    hold_out: Sequence[Path],
    plant: str,
    mapping: Path | None,
    settings: tuple[str | None, str | None, str | None],
) -> _Task:
    if case is None and not fit and not hold_out:
        raise WorkbenchError(
            "there is nothing to diagnose; name a case, or give recordings with --fit and"
            " --hold-out"
        )
    if case is not None and (fit or hold_out):
        raise WorkbenchError(f"both the case {case!r} and recordings are given; keep one of them")
    if case is not None:
        return _of_case(case, mapping, settings)
    if not fit or not hold_out:
        raise WorkbenchError(
            f"recordings to fit on ({len(fit)}) and others to judge on ({len(hold_out)}) are both"
            " needed; give --fit and --hold-out"
        )
    return _of_recordings(fit, hold_out, plant, mapping, settings)


def _of_case(
    name: str, mapping: Path | None, settings: tuple[str | None, str | None, str | None]
) -> _Task:
    from workbench.data_folder import shipped_cases, shipped_data
    from workbench.recordings.case import read_case

    shipped = name in shipped_cases() and not Path(name).is_dir()
    case = read_case(shipped_data(name) if shipped else name, mapping=mapping)
    if not case.hold_out:
        raise WorkbenchError(
            f"case {case.name} holds nothing out, so no claim could be proved; add a file"
            " validate_*.csv"
        )
    load, plane, supply = settings
    model = plant_from_options(
        load or f"{case.load_kg}kg", plane or case.plane, supply or f"{case.supply_bar}bar"
    )
    return _Task(
        case.name,
        model,
        tuple(case.fit.values()),
        tuple(case.hold_out.values()),
        f"workbench diagnose {name}",
    )


def _of_recordings(
    fit: Sequence[Path],
    hold_out: Sequence[Path],
    plant: str,
    mapping: Path | None,
    settings: tuple[str | None, str | None, str | None],
) -> _Task:
    from workbench.recordings import read_recording

    load, plane, supply = settings
    check_choice("plant", plant, PLANTS)
    if plant == "arm":
        model = plant_from_options(load or "3kg", plane or "horizontal", supply or "6bar")
    elif any(settings):
        raise WorkbenchError(f"load, plane and supply belong to the arm, not to plant {plant!r}")
    else:
        model = _plant(plant)
    names = dict(zip((*fit, *hold_out), _titles((*fit, *hold_out)), strict=True))
    if len(names) < len(fit) + len(hold_out):
        raise WorkbenchError(
            "a recording is given twice; what a model is judged on must not be fitted on"
        )
    read = {
        path: _commanded(read_recording(path, mapping=mapping, name=title), model)
        for path, title in names.items()
    }
    files = " ".join(
        [*(f"--fit {path}" for path in fit), *(f"--hold-out {path}" for path in hold_out)]
    )
    return _Task(
        ", ".join(names[path] for path in fit),
        model,
        tuple(read[path] for path in fit),
        tuple(read[path] for path in hold_out),
        f"workbench diagnose {files} --plant {plant}",
    )


def _commanded(recording: Recording, model: Model) -> Recording:
    """Mark inputs of the model as commands, which may stand still without being stuck."""
    inputs = [q.name for q in model.inputs if q.name in recording]
    return recording.with_roles(dict.fromkeys(inputs, "command"))


def _titles(paths: Sequence[Path]) -> list[str]:
    """Name recordings by their files, with the folder where two files share a name."""
    stems = [path.name.split(".")[0] for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{path.parent.name}/{stem}"
        for path, stem in zip(paths, stems, strict=True)
    ]


def _plant(name: str) -> Model:
    from workbench.plants.cascaded_tanks import cascaded_tanks
    from workbench.plants.cylinder import cylinder
    from workbench.plants.emps import emps
    from workbench.plants.servo_axis import servo_axis
    from workbench.plants.servo_pendulum import servo_pendulum

    return {
        "servo-axis": servo_axis,
        "emps": emps,
        "cylinder": cylinder,
        "tanks": cascaded_tanks,
        "pendulum": servo_pendulum,
    }[name]()


def _changed(model: Model, without: Sequence[str], parameters: Sequence[str]) -> Model:
    from workbench.cli.plant import _parameter

    model = model.without(*without)
    return model.with_parameters(dict(_parameter(model, text) for text in parameters))


def _run(model: Model, task: _Task, jobs: int, out: Path | None) -> Diagnosis:
    from workbench.diagnosis.conclude import conclude_early
    from workbench.diagnosis.diagnose import stages
    from workbench.files import write_whole

    begin = time.perf_counter()
    step = "starting"
    found: Diagnosis | None = None
    reached: Diagnosis

    def say(text: str) -> None:
        nonlocal step
        step = text
        typer.echo(f"{time.perf_counter() - begin:6.1f} s  {text}", err=True)

    try:
        for reached in stages(model, task.fit, task.hold_out, jobs=jobs, folder=out, progress=say):
            found = reached
    except KeyboardInterrupt:
        if out is not None and found is not None:
            write_whole(out / "verdict.json", conclude_early(found, step).to_json())
        raise
    assert found is not None
    return found


def _write(found: Diagnosis, task: _Task, out: Path) -> None:
    from workbench.diagnosis.comparison import proof_of
    from workbench.files import whole_folder, write_whole
    from workbench.reports.diagnosis_page import diagnosis_page
    from workbench.reports.page import write_page
    from workbench.reports.pictures import save

    assert found.verdict is not None
    with whole_folder(out) as folder:
        write_whole(folder / "verdict.json", found.verdict.to_json())
        page = diagnosis_page(
            found,
            proof_of(found),
            name=task.name,
            commands=(f"{task.command} --out {out.name}",),
        )
        write_page(page, folder / "report.html")
        for picture in page.pictures:
            save(picture, folder / "figures")
