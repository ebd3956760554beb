"""Entry of the command line: verbs, and what becomes of errors."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from workbench.cli.controllers import controllers
from workbench.cli.demo import demo, force_map
from workbench.cli.diagnose import diagnose
from workbench.cli.evaluate import evaluate
from workbench.cli.linearise import linearise
from workbench.cli.new import new_controller, new_plant, new_study, notebook, study_fields
from workbench.cli.options import VerbCommand, parameters_of, read_as, summary
from workbench.cli.plant import PlantCommand
from workbench.cli.plants import plants
from workbench.cli.recording import recording
from workbench.cli.redesign import redesign
from workbench.cli.refit import refit
from workbench.cli.running import claiming, sigterm_interrupts, typing
from workbench.cli.simulate import simulate
from workbench.cli.study import bless, compare, report
from workbench.cli.verify import verify
from workbench.errors import WorkbenchError
from workbench.registry import own_place, told

WRONG_USE = 2
"""Exit status of wrong use."""

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it, and after SIGTERM."""

app = typer.Typer(
    name="workbench",
    help=(
        "Design controllers for a pneumatic-muscle arm or a machine of your own, prove them on the "
        "full nonlinear plant, and find out what physics a model leaves out.\n\n"
        "Start with 'workbench demo --out demo' and open demo/report.html. "
        "Values may carry their unit: 30deg, 0.5rad, 3bar, 300kPa. "
        "Exit status: 0 all is well, 1 a requirement is missed, 2 wrong use, 130 interrupted."
    ),
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
for _verb in (
    demo,
    plants,
    simulate,
    linearise,
    notebook,
    claiming(verify),
    recording,
    claiming(refit),
    force_map,
    claiming(diagnose),
    claiming(compare),
    claiming(controllers),
    claiming(redesign),
    bless,
    claiming(report),
    new_study,
    new_controller,
    new_plant,
    study_fields,
):
    _options = parameters_of(_verb)
    _kind = PlantCommand if any(p.name == "short" for p in _options) else VerbCommand
    app.command(help=summary(_verb), cls=_kind)(read_as(_verb, _options))


def _tell_version(asked: bool) -> None:
    if asked:
        from workbench.study.result import installed_version

        typer.echo(f"workbench {installed_version()}")
        raise typer.Exit


@app.callback()
def _about(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", is_eager=True, callback=_tell_version
        ),
    ] = False,
) -> None:
    """Take options that belong to no verb."""


app.add_typer(evaluate, name="evaluate", help="Tell how good the diagnosis is.")


def run(arguments: Sequence[str]) -> int:
    """Run the command line with the words after the program's name and return its exit status."""
    try:
        with typing(arguments):
            status = app(args=list(arguments), standalone_mode=False)
        # Typer turns Ctrl-C into this status without a word.
        if status == INTERRUPTED:
            raise KeyboardInterrupt
    except (typer.Abort, KeyboardInterrupt):
        _complain("interrupted; what was finished is kept")
        return INTERRUPTED
    except (typer.TyperException, WorkbenchError) as error:
        if str(error) == "" and isinstance(error, typer.TyperException):
            # Without any word, the help is shown.
            return WRONG_USE
        _complain(_sentence(error) if isinstance(error, typer.TyperException) else str(error))
        return WRONG_USE
    except BaseException as error:
        # A module of the user's own must neither show our insides nor leave with a good status.
        if not own_place(error):
            if isinstance(error, SystemExit):
                return error.code if isinstance(error.code, int) else WRONG_USE
            raise
        _complain(told(error))
        return WRONG_USE
    return status if isinstance(status, int) else 0


_usual_format = warnings.formatwarning


def _as_sentence(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    line: str | None = None,
) -> str:
    """Say a warning of ours without its place in the code."""
    if Path(filename).is_relative_to(Path(__file__).parents[1]):
        return f"workbench: {message}\n"
    return _usual_format(message, category, filename, lineno, line)


def main() -> None:
    """Run the command line and leave with its exit status."""
    warnings.formatwarning = _as_sentence
    with sigterm_interrupts():
        sys.exit(run(sys.argv[1:]))


def _complain(text: str) -> None:
    typer.echo(f"workbench: {' '.join(text.split())}", err=True)


def _sentence(error: typer.TyperException) -> str:
    text = getattr(error, "format_message", error.__str__)()
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "workbench"
    return f"{text.rstrip('.')}; see '{path.strip() or 'workbench'} --help'"
