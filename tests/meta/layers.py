"""A checker of imports: a module imports only from the layers below its own."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.meta.graph import parsed
from tests.meta.sources import ROOT

PAGE = ROOT / "data" / "docs" / "architecture.md"
MEND = "give it a place in data/docs/architecture.md"


def layers(page: str) -> tuple[tuple[str, ...], ...]:
    """Return the rooms of each layer from the table of the architecture page, lowest first.

    Example:
        >>> layers("| errors | `a.b` |\\n| files | `c`, `d` |")
        (('a.b',), ('c', 'd'))
    """
    rows = re.findall(r"^\|[^|`]+\|((?: `[\w.]+`,?)+) \|$", page, re.MULTILINE)
    return tuple(tuple(re.findall(r"`([\w.]+)`", row)) for row in rows)


LAYERS = layers(PAGE.read_text(encoding="utf-8"))
"""Lowest layer first; the package's own `__init__` offers everything and stands on top."""

BLIND: dict[str, tuple[str, ...]] = {
    "controllers": ("workbench.physics", "workbench.plants", "workbench.simulation"),
}
"""What a layer must not know although it lies below: a controller knows linear models only."""


UPWARD = {("workbench.display", "workbench.notebook")}
"""What is loaded by name from above: the page on architecture says why."""


def room(module: str) -> str | None:
    """Return the room of the list that a module is in, or None.

    Example:
        >>> room("workbench.plants.arm.muscle"), room("workbench"), room("numpy")
        ('workbench.plants', 'workbench', None)
    """
    for rooms in LAYERS:
        for name in rooms:
            if module == name or (name != "workbench" and module.startswith(name + ".")):
                return name
    return None


def imports(source: str) -> Iterator[tuple[int, str]]:
    """Yield the line and name of every module that a source imports, anywhere in it."""
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.Import):
            for item in node.names:
                yield node.lineno, item.name
        elif isinstance(node, ast.ImportFrom) and node.module:
            # `from workbench import errors` names the room in its second half.
            for item in node.names:
                whole = f"{node.module}.{item.name}"
                yield node.lineno, whole if room(whole) else node.module
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            for name in node.args[:1]:
                if isinstance(name, ast.Constant):
                    yield node.lineno, str(name.value)


def check_module(module: str, source: str) -> list[str]:
    """Return the imports of a module that point upward or that its layer must not know."""
    level = {name: number for number, rooms in enumerate(LAYERS) for name in rooms}
    home = room(module)
    if home is None:
        return [f"{module} is in no layer; {MEND}"]
    problems = []
    for line, name in imports(source):
        if name.split(".")[0] not in ("workbench", "controllers"):
            continue
        target = room(name)
        if (home, target) in UPWARD:
            continue
        if target is None:
            problems.append(f"line {line}: {name} is in no layer; {MEND}")
        elif target in BLIND.get(home, ()):
            problems.append(f"line {line}: {home} must not know {name}")
        elif level[target] > level[home] or (level[target] == level[home] and target != home):
            problems.append(f"line {line}: {home} imports {name}, which is not below it")
    return problems
