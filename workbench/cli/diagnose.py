"""The verb ``diagnose``."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from workbench.cli.options import AsJson
from workbench.cli.plant import chosen_plant
from workbench.cli.problem import Loaded, with_problem
from workbench.cli.running import TimeUp, telling, typed
from workbench.cli.running import time_limit as until
from workbench.computing.counted import in_words
from workbench.errors import WorkbenchError, check_range
from workbench.files import whole_folder, write_whole
from workbench.registry import load_object, user_code

if TYPE_CHECKING:
    from workbench.diagnosis.experiment.menu import Experiment
    from workbench.diagnosis.experiment.run_on_machine import Machine
    from workbench.diagnosis.stages import Diagnosis
    from workbench.diagnosis.verdict import Verdict
    from workbench.physics.library import Hypothesis, Law


QUICK_S = 20.0
"""Time limit of a quick diagnosis, in s."""


@with_problem()
def diagnose(
    recorded: Callable[[], Loaded],
    *,
    effects: list[str] | None = None,
    jobs: int | None = None,
    time_limit: str | None = None,
    quick: bool = False,
    propose: Path | None = None,
    experiment: str | None = None,
    out: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Find out what physics a model leaves out, and prove it on held-out recordings.

    The model is refitted first; what parameters can explain is no missing physics. After Ctrl-C,
    SIGTERM or a time limit, verdict.json holds what was found until then, and the same command goes
    on from the last stage that was finished. --propose writes what to record next, --experiment
    records it on a machine and judges again. Examples: 'workbench diagnose practice-08 --out
    diagnosis', 'workbench diagnose --fit a.csv --fit b.csv --hold-out c.csv --load 3kg',
    'workbench diagnose --plant my_plants:rig --effects my_physics:law --fit a.csv --hold-out
    b.csv', 'workbench diagnose practice-08 --propose plan.csv --experiment my_rig:machine --out
    diagnosis'.

    Args:
        effects (NAME): Physics of your own that may be missing, beside the library: module:object,
            an effect or a function that returns one; may be given several times.
        jobs: Processes that work side by side; one per core by default, 8 at the most.
        time_limit (TIME): End after this time, such as 60s or 2min (1 to 1e6 s), with the best
            verdict until then, which says what was not tried; exit status 0.
        quick: The same as --time-limit 20.
        propose (FILE): CSV file for the next input: times and inputs in the plant's units, to be
            played on the machine.
        experiment (MACHINE): Play the next input on this machine and diagnose again with what it
            recorded; the new verdict is written into the folder 'experiment' beside the first. A
            plant that stands for it (a name, module:object or verdict.json), or a module:object of
            your own with a method play(experiment) that returns a Recording.
        out: Folder for verdict.json, report.html and the pictures.
    """
    from workbench.plants.plant import own_laws

    begin = time.perf_counter()
    limit = _limit(time_limit, quick=quick)
    if jobs is not None:
        check_range("number of processes", jobs, 1, 64)
    loaded = recorded()
    problem = loaded.problem
    if not problem.hold_out:
        raise WorkbenchError(
            f"case {problem.name} holds nothing out, so no claim could be proved; add a file"
            " validate_*.csv"
        )
    own = own_laws(problem.model, effects or (), folder=Path.cwd())
    machine = None if experiment is None else _machine(experiment, loaded)
    asked = _Asked(loaded, own, tuple(effects or ()), jobs, out, begin, limit, as_json)
    found = asked.diagnosed()
    if propose is not None:
        _propose(found, propose, as_json=as_json)
    if machine is not None:
        found = asked.after_experiment(found, machine)
    if as_json:
        typer.echo(asked.text(found.verdict))


@dataclass(frozen=True)
class _Asked:
    """What is diagnosed, how, and since when, in s of a running clock.

    Args:
        references: Where the laws of the user's own come from, as ``module:object``.
    """

    loaded: Loaded
    own: tuple[Law | Hypothesis, ...]
    references: tuple[str, ...]
    jobs: int | None
    out: Path | None
    begin: float
    limit: float | None
    as_json: bool

    def diagnosed(self) -> Diagnosis:
        """Diagnose, print the verdict and write verdict and page."""
        found = self._until_limit()
        typer.echo(f"{found.verdict}\nwork: {in_words(found.work)}", err=self.as_json)
        if self.out is not None and not found.verdict.interrupted:
            self._write(found, self.out)
            typer.echo(f"open {self.out / 'report.html'}", err=self.as_json)
        return found

    def after_experiment(self, found: Diagnosis, machine: Machine) -> Diagnosis:
        """Play the next input, and diagnose again with its recording."""
        from workbench.diagnosis.experiment.run_on_machine import plan_csv, with_experiment
        from workbench.recordings.saving import write_recording

        plan, problem = _plan(found), self.loaded.problem
        if plan is None or found.verdict.interrupted:
            return found
        typer.echo(f"{time.perf_counter() - self.begin:6.1f} s  playing {plan.text}", err=True)
        with user_code("the machine"):
            recording, fit, hold_out = with_experiment(
                problem.model, plan, machine, problem.fit, problem.hold_out
            )
        folder = None if self.out is None else self.out / "experiment"
        if folder is not None:
            write_whole(folder / "plan.csv", plan_csv(found.nominal, plan))
            write_recording(recording, folder / "recording.csv")
        again = replace(self.loaded, problem=replace(problem, fit=fit, hold_out=hold_out))
        second = replace(self, loaded=again, out=folder).diagnosed()
        for when, verdict in (("before", found.verdict), ("after", second.verdict)):
            typer.echo(f"{when} the experiment: {verdict.brief}", err=self.as_json)
        return second

    def _until_limit(self) -> Diagnosis:
        from workbench.diagnosis.conclude import conclude_early
        from workbench.diagnosis.diagnose import stages

        problem = self.loaded.problem
        step = "starting"
        passed = time.perf_counter() - self.begin
        left = None if self.limit is None else max(self.limit - passed, 0.01)
        found: Diagnosis | None = None
        reached: Diagnosis

        def say(text: str) -> None:
            nonlocal step
            # What was said of the recordings when they were read is not said again.
            if text not in problem.notes:
                step = text
                tell(text)

        try:
            with telling(self.begin) as tell, until(left):
                for reached in stages(
                    problem.model,
                    problem.fit,
                    problem.hold_out,
                    extra=self.own,
                    jobs=self.jobs,
                    folder=self.out,
                    progress=say,
                ):
                    found = reached
        except KeyboardInterrupt as end:
            asked = self.limit if isinstance(end, TimeUp) else None
            if found is not None:
                early = conclude_early(found, step, after=asked)
                found = replace(found, concluded=early)
                if self.out is not None:
                    write_whole(self.out / "verdict.json", self.text(early))
            if asked is None:
                raise
            if found is None:
                raise WorkbenchError(
                    f"nothing was found within {asked:g} s, which ended while {step}; give more"
                    " time"
                ) from None
        assert found is not None
        return found

    def text(self, verdict: Verdict) -> str:
        """Return the verdict's JSON, with its model as a plant that every verb takes."""
        from workbench.plants.registry import saved_plant

        chosen = self.loaded.chosen
        recipe, nominal = chosen.recipe, chosen.nominal
        given = {
            chosen.plant.effect(nominal, name, folder=recipe.folder).name: name
            for name in recipe.effects
            if ":" in name
        }
        known = recipe.kind, dict(recipe.options), nominal, verdict.model
        return verdict.to_json(saved_plant(*known, given=given, own=self.references))

    def _write(self, found: Diagnosis, out: Path) -> None:
        from workbench.diagnosis.comparison import proof_of
        from workbench.diagnosis.nonparametric.law_file import law_file
        from workbench.reports.diagnosis_answers import accepted_term
        from workbench.reports.diagnosis_page import diagnosis_page
        from workbench.reports.page import write_page

        with whole_folder(out) as folder:
            write_whole(folder / "verdict.json", self.text(found.verdict))
            name, command = self.loaded.problem.name, typed()
            commands = (command,) if command else ()
            page = diagnosis_page(found, proof_of(found), name=name, commands=commands)
            if (term := accepted_term(found)) is not None:
                write_whole(folder / "law.py", law_file(term, found.nominal.name))
            write_page(page, folder / "report.html", pictures=folder / "figures")


def _machine(name: str, loaded: Loaded) -> Machine:
    """Return the machine that an option names, before anything takes time."""
    from workbench.diagnosis.experiment.run_on_machine import Machine, SimulatedMachine

    if ":" in name:
        found = load_object("machine", name, folder=Path.cwd())
        if isinstance(found, Machine):
            return found
    model = chosen_plant(name, defaults=_shared(name, loaded)).model
    wanted, offered = ([q.name for q in m.inputs] for m in (loaded.problem.model, model))
    if wanted != offered:
        raise WorkbenchError(
            f"machine {name!r} has the inputs {', '.join(offered)}; what is diagnosed has"
            f" {', '.join(wanted)}: give a machine with those"
        )
    return SimulatedMachine(model)


def _shared(name: str, loaded: Loaded) -> dict[str, object]:
    """Return options of the diagnosed plant that the machine has too, such as the load."""
    from workbench.plants.registry import PLANTS

    plant = PLANTS.get(name, folder=Path.cwd())
    known = {o.name for o in plant.options}
    return {name: value for name, value in loaded.chosen.recipe.options if name in known}


def _plan(found: Diagnosis) -> Experiment | None:
    plan = found.validated.plan if found.validated is not None else None
    if plan is None:
        said = found.verdict.next_experiment.get("sentence", "")
        typer.echo(f"no input is worth playing next{': ' if said else ''}{said}", err=True)
    return plan


def _propose(found: Diagnosis, path: Path, *, as_json: bool) -> None:
    from workbench.diagnosis.experiment.run_on_machine import plan_csv

    plan = _plan(found)
    if plan is not None:
        write_whole(path, plan_csv(found.nominal, plan))
        typer.echo(f"{plan.text}: written to {path}", err=as_json)


def _limit(given: str | None, *, quick: bool) -> float | None:
    from workbench.model.units import quantity

    seconds = None if given is None else quantity("time limit", given, "s")
    if quick and seconds is not None:
        raise WorkbenchError(
            f"--quick is a time limit of {QUICK_S:g} s, and --time-limit {seconds:g} is given too;"
            " keep one of them"
        )
    if quick:
        return QUICK_S
    return None if seconds is None else check_range("time limit", seconds, 1.0, 1e6, "s")
