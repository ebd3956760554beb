"""What verbs share while they run: the words typed, their folder, time limits, progress, JSON."""

from __future__ import annotations

import functools
import re
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from workbench.errors import WorkbenchError
from workbench.files import claimed, json_text, write_whole

if TYPE_CHECKING:
    from workbench.model import Model
    from workbench.study.designs import ControllerRecipe
    from workbench.study.result import StudyResult

_WORDS: ContextVar[tuple[str, ...]] = ContextVar("_WORDS", default=())

QUIET_S = 10.0
"""Time after which a reader is told that what was begun goes on, in s."""

_AGAIN_S = 5.0
"""Time after which the signal comes again, should a library have swallowed it, in s."""


@contextmanager
def typing(words: Sequence[str]) -> Iterator[None]:
    """Remember the words after the name of the program while a verb runs."""
    token = _WORDS.set(tuple(words))
    try:
        yield
    finally:
        _WORDS.reset(token)


def typed() -> str:
    """Return the command that is running, ready for a shell; empty if a verb was called as code."""
    words = _WORDS.get()
    return shlex.join(["workbench", *words]) if words else ""


def claiming(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Return a verb that keeps its folder ``out`` to itself, so that two runs never mix there."""

    @functools.wraps(verb)
    def claimed_verb(**options: Any) -> Any:
        with claimed(options["out"]):
            return verb(**options)

    return claimed_verb


class TimeUp(KeyboardInterrupt):
    """The time is up that the user gave."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """End what is done inside after a time in s, above 0; None sets no limit.

    Raises:
        TimeUp: When the time is up.
        WorkbenchError: If the platform has no timer that interrupts.
    """
    if seconds is None:
        yield
        return
    if not hasattr(signal, "setitimer"):
        raise WorkbenchError(
            "a time limit needs a timer that this platform does not have; leave the limit out and"
            " end with Ctrl-C, which keeps what was found too"
        )

    def end(*_: object) -> None:
        raise TimeUp

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds, _AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Let SIGTERM do inside what Ctrl-C does."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def tell(content: Mapping[str, Any], *, as_json: bool, file: Path | None = None) -> None:
    """Print a result as JSON if a script reads it, and write it to a file if one is named."""
    if as_json:
        typer.echo(json_text(content), nl=False)
    if file is not None:
        write_whole(file, json_text(content))
        typer.echo(f"written to {file}", err=as_json)


def note(sentence: str) -> None:
    """Tell a reader something beside the result, on the error stream."""
    typer.echo(sentence, err=True)


@contextmanager
def telling(begin: float, said: str = "starting") -> Iterator[Callable[[str], None]]:
    """Say on the error stream what begins and when, and while it goes on, say so every 10 s.

    Args:
        begin: Since when time is counted, in s of a running clock.
        said: What goes on until something is said.
    """
    heard, over = threading.Event(), False

    def line(text: str) -> None:
        typer.echo(f"{time.perf_counter() - begin:6.1f} s  {text}", err=True)

    def say(text: str) -> None:
        nonlocal said
        said = text
        heard.set()
        line(text)

    def watch() -> None:
        while not over:
            if heard.wait(QUIET_S):
                heard.clear()
            else:
                line(f"still {said}")

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield say
    finally:
        over = True
        heard.set()
        thread.join()


def tell_runs(outcome: StudyResult, plant: str, *, as_json: bool = False) -> None:
    """Print all metrics of a run; of several runs a table of each step to compare them by.

    Beside them stands how often controllers step, which a rig has to bear.
    """
    from workbench.model.units import in_time
    from workbench.study.summary import step_tables

    done = [record.metrics for record in outcome.records if record.metrics is not None]
    if done:
        text = step_tables(outcome, plant) if len(done) > 1 else str(replace(done[0], plant=plant))
        typer.echo(text, err=as_json)
        paces = sorted({s.sample_time for s in outcome.study.scenarios.values()})
        told = " or ".join(in_time(pace, 4) for pace in paces)
        typer.echo(f"controllers step every {told}", err=as_json)


def write_study(outcome: StudyResult, out: Path, *, more: str = "", as_json: bool = False) -> None:
    """Write what a study found into a folder, and say so before and after: pictures take seconds.

    Args:
        more: What else was written there.
    """
    from workbench.reports.study_page import write_study_files

    note("writing the report ...")
    files = write_study_files(outcome, out, command=typed())
    typer.echo(f"written to {out}: {', '.join(path.name for path in files)}{more}", err=as_json)


@contextmanager
def counting() -> Iterator[Callable[[str, int, int, str], None]]:
    """Count finished runs on the error stream: a bar on a screen, a line per tenth in a log."""
    from tqdm import tqdm

    from workbench.study.execution import FINISHED_BEFORE

    screen = sys.stderr.isatty()
    bar: Any = None
    told: dict[str, int] = {}

    def count(part: str, done: int, total: int, what: str) -> None:
        nonlocal bar
        if not screen:
            tenth = 10 * done // max(total, 1)
            if tenth > told.get(part, -1):
                note(f"{part}: {done} of {total}")
            told[part] = tenth
            return
        if bar is None or (part, total) != (bar.desc, bar.total):
            if bar is not None:
                bar.close()
            bar = tqdm(
                total=total,
                # What was finished before took no time of this run.
                initial=done if what == FINISHED_BEFORE else 0,
                desc=part,
                unit=part.removesuffix("s"),
                file=sys.stderr,
            )
        bar.set_postfix_str(what, refresh=False)
        bar.update(done - bar.n)
        if done == total:
            # What is said next has a line of its own.
            bar.close()

    try:
        yield count
    finally:
        if bar is not None:
            bar.close()


def write_in_c(recipes: Mapping[str, ControllerRecipe], folder: Path, model: Model) -> None:
    """Write controllers inside their guards as C, and say of each which files, or why none.

    Args:
        recipes: How they are designed, by their names in a study.
        folder: Where the files go.
        model: The plant, whose units the headers tell.
    """
    from controllers.c_export import export_c

    for title, recipe in recipes.items():
        name = re.sub("[^a-z0-9]+", "_", title.lower()).strip("_")
        try:
            typer.echo(export_c(recipe.build(), folder, name=name, units=model), err=True)
        except WorkbenchError as error:
            # What one cannot do costs no other its files.
            note(str(error))
