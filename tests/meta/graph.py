"""Checkers of the import graph: cycles between modules, and public names that nothing uses."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path


@cache
def parsed(source: str) -> ast.Module:
    """Return the tree of a source, parsed once for every question."""
    return ast.parse(source)


def statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield a module and its statements, however deep, without the expressions in them.

    Example:
        >>> [type(node).__name__ for node in statements(ast.parse("if a:\\n def f(): b"))]
        ['Module', 'If', 'FunctionDef', 'Expr']
    """
    found: list[ast.AST] = [tree]
    for node in found:
        yield node
        for part in ("body", "orelse", "handlers", "finalbody", "cases"):
            found += getattr(node, part, ())


def imported_modules(source: str, known: set[str]) -> set[str]:
    """Return the modules among the known ones that a source imports, anywhere in it.

    Example:
        >>> sorted(imported_modules("from a import b, c\\nimport d.e", {"a", "a.b", "d.e"}))
        ['a', 'a.b', 'd.e']
    """
    found: set[str] = set()
    for node in statements(parsed(source)):
        if isinstance(node, ast.Import):
            found |= {item.name for item in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            whole = {f"{node.module}.{item.name}" for item in node.names}
            found |= whole & known
            if whole - known:
                found.add(node.module)
    return found & known


def cycle(arrows: Mapping[str, set[str]]) -> list[str]:
    """Return modules each of which imports the next one, round to the first; empty if none do.

    Example:
        >>> cycle({"a": {"b"}, "b": {"a"}, "c": {"a"}}), cycle({"a": {"b"}})
        (['a', 'b', 'a'], [])
    """
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as found:
        return list(found.args[1])
    return []


def public_names(source: str) -> set[str]:
    """Return the public functions, classes and constants that a module defines.

    Example:
        >>> sorted(public_names("LIMIT = 3\\ndef f(): pass\\nclass _Own: pass"))
        ['LIMIT', 'f']
    """
    found: set[str] = set()
    for node in parsed(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign):
            found |= {t.id for t in node.targets if isinstance(t, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
    return {name for name in found if not name.startswith("_")}


def public_members(source: str) -> set[str]:
    """Return the public methods and properties of the public classes of a module.

    Example:
        >>> sorted(public_members("class A:\\n def b(self): pass\\n def _c(self): pass"))
        ['b']
    """
    found: set[str] = set()
    for node in parsed(source).body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            found |= {part.name for part in node.body if isinstance(part, ast.FunctionDef)}
    return {name for name in found if not name.startswith("_")}


def without_docstrings(source: str) -> str:
    """Return a source without its docstrings, whose examples use what nothing else may.

    Example:
        >>> without_docstrings('def f():\\n    "Return x()."\\n    return 1').splitlines()[1]
        ''
    """
    lines = source.splitlines()
    for node in statements(parsed(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                for number in range(first.lineno, (first.end_lineno or first.lineno) + 1):
                    lines[number - 1] = ""
    return "\n".join(lines)


def unused_members(pages: Iterable[str], modules: Mapping[Path, str]) -> Iterator[str]:
    """Yield public methods and properties that stand nowhere but where they are defined."""
    count: Counter[str] = Counter()
    defined: Counter[str] = Counter()
    members: dict[Path, set[str]] = {}
    for text in pages:
        count.update(re.findall(r"[A-Za-z_]\w*", text))
    for path, source in modules.items():
        count.update(re.findall(r"[A-Za-z_]\w*", without_docstrings(source)))
        defined.update(
            part.name
            for node in statements(parsed(source))
            if isinstance(node, ast.ClassDef)
            for part in node.body
            if isinstance(part, ast.FunctionDef)
        )
        members[path] = public_members(source)
    for path, names in members.items():
        yield from (f"{path}: {name}" for name in sorted(names) if count[name] <= defined[name])


def words(source: str) -> set[str]:
    """Return every word of a source: what a name must be among to be used there."""
    return set(re.findall(r"[A-Za-z_]\w*", source))


def _makes_a_member(decorator: ast.Call) -> bool:
    """Tell whether what a decorator makes of a function may be a member of a registry."""
    return ast.unparse(decorator.func).rpartition(".")[2] not in ("lru_cache", "wraps")


def unused_names(texts: Mapping[Path, str], modules: Mapping[Path, str]) -> Iterator[str]:
    """Yield public names of modules that no other text names.

    Args:
        texts: Every text in which a use may stand, by path.
        modules: The sources whose public names are looked for, by path.
    """
    where: dict[str, set[Path]] = {}
    for path, text in texts.items():
        # A package that only offers a name does not use it.
        if path.name != "__init__.py":
            for word in words(text):
                where.setdefault(word, set()).add(path)
    for path, source in modules.items():
        body = parsed(source)
        own = [
            n.id for n in ast.walk(body) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)
        ]
        # What a call makes may be a member of a registry, which finds it without its name.
        own += [
            name.id
            for node in body.body
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
            for target in node.targets
            for name in ast.walk(target)
            if isinstance(name, ast.Name)
        ]
        own += [
            node.name
            for node in body.body
            if isinstance(node, ast.FunctionDef)
            and any(isinstance(d, ast.Call) and _makes_a_member(d) for d in node.decorator_list)
        ]
        for name in sorted(public_names(source)):
            if not where.get(name, set()) - {path} and own.count(name) == 0:
                yield f"{path}: {name}"
