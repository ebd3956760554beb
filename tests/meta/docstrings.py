"""A checker of docstrings: one sentence for everything public, a unit for every number.

What needs no words gets none: a flag or a name is described where its author found something to
say, an example stands where it teaches.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator, Sequence
from types import ModuleType

from tests.meta.graph import parsed

TYPE = re.compile(r"\b(float|floating|float64|ndarray|Expression|SX|MX|DM|\w*Array\w*)\b")
"""Annotations that stand for numbers with a unit; counts (int), flags and words have none."""

UNIT = re.compile(
    # Words that are or stand for a unit.
    r"(?i:\b(?:units?|dimensionless|fractions?|ratios?|factors?|normali[sz]ed|scaled|relative|"
    r"probabilit(?:y|ies)|seconds?|minutes?|samples?|metres?|newtons?|volts?|kelvins?|pascals?|"
    r"degrees?|radians?|octaves?|decades?|SI)\b(?!['’]))"
    # Symbols that are no word of the language.
    r"|(?<![\w.])(?:rad|deg|kg|Pa|kPa|MPa|hPa|bar|mbar|Nm|Hz|kHz|mm|cm|km|ms|us|µs|min|dB|rpm|kJ|"
    r"mV|mA|MB|l)(?![\w'’])"
    r"|[°%‰Ω]"
    # One letter is a unit only where a unit stands: after "in", a comma, a bracket, a number.
    r"|(?:\bin |\bper |\band |\bor |, |\(|\[|\d |\d|/ ?|[·*⋅] ?|``)(?:m|s|K|N|V|J|W|A|g)"
    r"(?![\w'’])"
    # Or where it is all that is said.
    r"|^(?:m|s|K|N|V|J|W|A|g)(?=[.,;]|$)"
)
SHAPE = re.compile(r"`*[(\[]\s*(?:[\w+*\- ]+\s*,\s*)+[\w+*\- ]*[)\]]`*")
"""A shape such as ``(n, m)``: its letters are counts, not units."""

NAMED_UNIT = re.compile(
    r"_(?:deg|rad|kg|g|Pa|bar|N|Nm|Hz|kHz|m|mm|cm|s|ms|us|V|mV|K|J|W|dB|percent)$"
)
"""A name that carries its own unit: angle_deg, pressure_bar."""

SECTION = re.compile(r"^([A-Z][A-Za-z ]*):\s*$")
ENTRY = re.compile(r"^(\*{0,2}\w+(?:\s*,\s*\*{0,2}\w+)*)\s*(?:\([^)]*\))?\s*:(?:\s|$)")

Definition = ast.FunctionDef | ast.AsyncFunctionDef


def names_unit(text: str) -> bool:
    """Tell whether a description names a unit.

    Example:
        >>> names_unit("Joint angle, rad."), names_unit("Joint angle of the arm, shape (m, s).")
        (True, False)
    """
    return UNIT.search(SHAPE.sub("()", text)) is not None


def is_numerical(annotation: ast.expr | None) -> bool:
    """Tell whether an annotation stands for numbers that have a unit.

    Example:
        >>> [is_numerical(ast.parse(a, mode="eval").body) for a in ("float | None", "str")]
        [True, False]
    """
    if annotation is None:
        return False
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        annotation = ast.parse(annotation.value, mode="eval").body
    text = ast.unparse(annotation)
    if re.search(r"\bCallable\b", text) or re.search(r"Array\[np\.(int|bool|str|uint)", text):
        return False
    return TYPE.search(text) is not None


def sections(docstring: str) -> dict[str, str]:
    """Split a docstring into its description (under "") and its named sections."""
    found: dict[str, list[str]] = {"": []}
    current = ""
    for line in docstring.splitlines():
        header = SECTION.match(line)
        if header:
            current = header[1]
            found.setdefault(current, [])
        else:
            if line.strip() and not line.startswith(" "):
                current = ""
            found[current].append(line)
    return {name: textwrap.dedent("\n".join(lines)).strip() for name, lines in found.items()}


def entries(section: str) -> dict[str, str]:
    """Split the text of an Args section into the description of each name."""
    found: dict[str, str] = {}
    current: list[str] = []
    for line in section.splitlines():
        match = ENTRY.match(line)
        if match:
            current = [name.strip().lstrip("*") for name in match[1].split(",")]
            found.update(dict.fromkeys(current, line[match.end() :].strip()))
        else:
            for name in current:
                found[name] += " " + line.strip()
    return found


def decorators(node: Definition | ast.ClassDef) -> set[str]:
    """Return the dotted names of the decorators, without their arguments."""
    return {
        ast.unparse(item.func if isinstance(item, ast.Call) else item)
        for item in node.decorator_list
    }


def parameters(node: Definition, *, method: bool) -> dict[str, ast.expr | None]:
    """Return the parameters that a caller passes, with their annotations."""
    arguments = node.args
    positional = [*arguments.posonlyargs, *arguments.args]
    if method and "staticmethod" not in decorators(node):
        positional = positional[1:]
    every = [*positional, arguments.vararg, *arguments.kwonlyargs, arguments.kwarg]
    return {item.arg: item.annotation for item in every if item and not item.arg.startswith("_")}


def fields(node: ast.ClassDef) -> dict[str, ast.expr | None]:
    """Return the public fields that the constructor of a dataclass or named tuple takes."""
    return {
        item.target.id: item.annotation
        for item in node.body
        if isinstance(item, ast.AnnAssign)
        and isinstance(item.target, ast.Name)
        and not item.target.id.startswith("_")
        and "ClassVar" not in ast.unparse(item.annotation)
        and "init=False" not in (ast.unparse(item.value) if item.value else "")
    }


def check_entries(described: dict[str, str], wanted: dict[str, ast.expr | None]) -> Iterator[str]:
    """Yield the numbers among the wanted parameters whose unit is said nowhere."""
    for name, annotation in wanted.items():
        if (
            is_numerical(annotation)
            and not NAMED_UNIT.search(name)
            and not names_unit(described.get(name, ""))
        ):
            yield f"Args gives no unit for {name}: {described.get(name, '')!r}"


def check_function(
    node: Definition, *, method: bool, inherited: Sequence[str] = ()
) -> Iterator[str]:
    """Yield what is missing in the docstring of a function or method.

    A method need not repeat what the docstrings of the methods say that it overrides.
    """
    marks = decorators(node)
    if any(mark.endswith(("overload", ".setter", ".deleter")) for mark in marks):
        return
    docstring = ast.get_docstring(node) or ""
    if not docstring and not inherited:
        yield "no docstring"
        return
    if shows_a_name(docstring):
        yield "an example that shows a name teaches nothing"
    wanted = parameters(node, method=method)
    if any(mark.endswith((".command", ".callback")) for mark in marks):
        # The help of each option is the documentation of a verb of the command line.
        for name, annotation in wanted.items():
            text = ast.unparse(annotation) if annotation else ""
            if "help=" not in text and "Context" not in text:
                yield f"no help for the option {name}"
        return
    parts = sections(docstring)
    described = entries(parts.get("Args", ""))
    bases = [sections(text) for text in inherited]
    taken_over = {
        name: text for base in bases for name, text in entries(base.get("Args", "")).items()
    }
    # What is said of one number in the sentence itself need not stand in a list of one.
    said = {} if described else dict.fromkeys(wanted, parts[""])
    yield from check_entries(said | taken_over | described, wanted)
    for name in described.keys() - wanted.keys():
        yield f"Args names {name}, which is no parameter"
    results = [part.get("Returns") or part.get("Yields") or part[""] for part in [parts, *bases]]
    named = NAMED_UNIT.search(node.name)
    if is_numerical(node.returns) and not named and not any(map(names_unit, results)):
        yield f"Returns gives no unit: {results[0]!r}"


def shows_a_name(docstring: str) -> bool:
    """Tell whether an example only repeats what the thing or its fields are called."""
    return bool(
        re.search(r">>> (\S*\.__name__|.*__dataclass_fields__.*)$", docstring, re.MULTILINE)
    )


def inherited_docstrings(owner: type | None, method: str) -> list[str]:
    """Return the docstrings that the bases of a class give to a method."""
    bases = owner.__mro__[1:] if owner else ()
    found = [inspect.getattr_static(base, method, None) for base in bases]
    return [inspect.cleandoc(item.__doc__) for item in found if item and item.__doc__]


def check_class(node: ast.ClassDef, owner: type | None = None) -> Iterator[tuple[str, str]]:
    """Yield the name and what is missing for a class and its public methods."""
    docstring = ast.get_docstring(node) or ""
    if not docstring:
        yield node.name, "no docstring"
    if shows_a_name(docstring):
        yield node.name, "an example that shows a name teaches nothing"
    parts = sections(docstring)
    described = entries(parts.get("Args", "")) | entries(parts.get("Attributes", ""))
    bases = {ast.unparse(base).split(".")[-1] for base in node.bases}
    if "NamedTuple" in bases or any(mark.endswith("dataclass") for mark in decorators(node)):
        for problem in check_entries(described, fields(node)):
            yield node.name, problem
    for item in node.body:
        if isinstance(item, Definition) and item.name == "__init__":
            own = entries(sections(ast.get_docstring(item) or "").get("Args", ""))
            for problem in check_entries(described | own, parameters(item, method=True)):
                yield node.name, problem
        elif isinstance(item, Definition) and not item.name.startswith("_"):
            bases_say = inherited_docstrings(owner, item.name)
            for problem in check_function(item, method=True, inherited=bases_say):
                yield f"{node.name}.{item.name}", problem
        elif isinstance(item, ast.ClassDef) and not item.name.startswith("_"):
            for name, problem in check_class(item, getattr(owner, item.name, None)):
                yield f"{node.name}.{name}", problem


def check_module(source: str, module: ModuleType | None = None) -> list[str]:
    """Return what is missing in the docstrings of a module's public functions and classes.

    Given the imported module too, a method takes over what its base classes say.

    Example:
        >>> check_module("'''A module.'''\\ndef f(): pass")
        ['line 2: f: no docstring']
    """
    tree = parsed(source)
    undescribed = tree.body and not ast.get_docstring(tree)
    problems = ["line 1: module: no docstring"] if undescribed else []
    # A module of numerics may state the units of all its numbers once.
    units_said = re.search(r"(?m)^Units: ", ast.get_docstring(tree) or "")
    for item in tree.body:
        if not isinstance(item, Definition | ast.ClassDef) or item.name.startswith("_"):
            continue
        if isinstance(item, ast.ClassDef):
            found = list(check_class(item, getattr(module, item.name, None)))
        else:
            found = [(item.name, problem) for problem in check_function(item, method=False)]
        problems += [
            f"line {item.lineno}: {name}: {problem}"
            for name, problem in found
            if not (units_said and "gives no unit" in problem)
        ]
    return problems
