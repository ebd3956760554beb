"""Options of verbs, from signatures and docstrings.

A parameter before the ``*`` is an argument of the command line, one behind it an option. Its entry
in ``Args`` is its help; in brackets stand its metavar and further switches, such as
``controller (-c NAME): Controller of the study.``
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterable
from functools import wraps
from typing import Annotated, Any, get_args, get_origin

import typer
from typer.core import TyperCommand

from workbench.errors import WorkbenchError

Verb = Callable[..., int | None]
"""A verb; what returns no exit status always ends well, with 0."""
AsJson = Annotated[
    bool,
    typer.Option(
        "--json", help="Print the result as JSON, in SI, and everything else to the error stream."
    ),
]
Jobs = Annotated[
    int | None, typer.Option(help="Number of processes; by default one per core.", metavar="N")
]
Short = Annotated[list[str] | None, typer.Option("--set", hidden=True)]
"""Words that are no options of the verb; `PlantCommand` collects them as ``NAME=VALUE``."""
Positive = Annotated[int, typer.Option(min=1)]

_ENTRY = re.compile(r"    (\w+)(?: \((.+?)\))?: (.+)")


class VerbCommand(TyperCommand):
    """A verb that refuses to be told twice what it takes once."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        takes = {
            name: p
            for p in self.params
            if p.param_type_name == "option" and not getattr(p, "is_flag", False)
            for name in p.opts
        }
        seen: dict[str, str] = {}
        words = iter(args)
        for word in words:
            if word == "--":
                break
            name, sign, value = word.partition("=")
            if (option := takes.get(name)) is None or not option.name:
                continue
            value = value if sign else next(words, "")
            if not getattr(option, "multiple", False) and option.name in seen:
                raise WorkbenchError(
                    f"{name} is given twice, {seen[option.name]!r} and {value!r}; it counts once"
                )
            seen[option.name] = value
        return super().parse_args(ctx, args)


def summary(function: Callable[..., Any]) -> str:
    """Return what a docstring says before its ``Args``, each paragraph in one line."""
    said = inspect.cleandoc(function.__doc__ or "").partition("\n\nArgs:\n")[0]
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in said.split("\n\n"))


def parameters_of(function: Callable[..., Any]) -> list[inspect.Parameter]:
    """Return the parameters of a function as Typer reads them."""
    said = _entries(inspect.cleandoc(function.__doc__ or "").partition("\n\nArgs:\n")[2])
    return [
        p.replace(kind=p.KEYWORD_ONLY, annotation=_annotated(p, *said.get(p.name, ("", ""))))
        for p in inspect.signature(function, eval_str=True).parameters.values()
    ]


def _entries(text: str) -> dict[str, tuple[str, str]]:
    """Return what stands in brackets, and the help, by parameter."""
    found: dict[str, tuple[str, str]] = {}
    name = ""
    for line in text.partition("\n\n")[0].splitlines():
        if match := _ENTRY.fullmatch(line):
            name = match[1]
            found[name] = match[2] or "", match[3]
        else:
            found[name] = found[name][0], f"{found[name][1]} {line.strip()}"
    return found


def _annotated(p: inspect.Parameter, words: str, text: str) -> Any:
    kind, given = p.annotation, None
    if get_origin(kind) is Annotated:
        kind, given = get_args(kind)
    if not text or getattr(given, "help", None):
        return p.annotation
    switches = [word for word in words.split() if word.startswith("-")]
    metavar = next((word for word in words.split() if not word.startswith("-")), None)
    if p.kind is not p.KEYWORD_ONLY and not switches:
        return Annotated[kind, typer.Argument(help=text, metavar=metavar)]
    # A flag that is off has no switch to turn it off; a letter stands beside the whole name.
    if not any(s.startswith("--") for s in switches) and (switches or p.default is False):
        switches.insert(0, f"--{p.name.replace('_', '-')}")
    least = getattr(given, "min", None)
    return Annotated[kind, typer.Option(*switches, help=text, metavar=metavar, min=least)]


def read_as(verb: Verb, parameters: Iterable[inspect.Parameter]) -> Verb:
    """Let Typer read a verb with other parameters."""
    listed = list(parameters)
    verb.__signature__ = inspect.Signature(listed)  # type: ignore[attr-defined]
    verb.__annotations__ = {p.name: p.annotation for p in listed}
    return verb


def taking(
    name: str,
    function: Callable[..., Any],
    only: Collection[str] | None = None,
    *,
    make: Callable[..., Any] | None = None,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a verb the parameters of a function in the place of one of its own.

    Args:
        name: The verb's own parameter, which gets what the function makes of them.
        only: Which of them it offers; all if None.
        make: Called in the place of the function.
    """
    offered = [p for p in parameters_of(function) if only is None or p.name in only]

    def decorate(verb: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(verb)
        def run(**given: Any) -> Any:
            taken = {p.name: given.pop(p.name, p.default) for p in offered}
            return verb(**{name: (make or function)(**taken)}, **given)

        own = parameters_of(verb)
        return read_as(run, (q for p in own for q in (offered if p.name == name else [p])))

    return decorate
