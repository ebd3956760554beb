"""No module imports itself by a detour, and no public name stands there for nothing."""

from __future__ import annotations

from pathlib import Path

from tests.meta.graph import cycle, imported_modules, unused_members, unused_names
from tests.meta.sources import ROOT, module_files, module_name, texts

SOURCES = {path: path.read_text(encoding="utf-8") for path in module_files()}


def test_no_cycle_of_imports() -> None:
    known = {module_name(path) for path in SOURCES}
    arrows = {
        module_name(path): imported_modules(source, known) - {module_name(path)}
        for path, source in SOURCES.items()
    }
    assert not cycle(arrows)


def test_public_names_and_members_are_used() -> None:
    kinds = {".md", ".toml", ".ipynb", ".html"}
    pages = {path: path.read_text(encoding="utf-8") for path in texts(kinds)}
    unused = [*unused_names(SOURCES | pages, SOURCES), *unused_members(pages.values(), SOURCES)]
    assert not unused, "\n".join(text.replace(f"{ROOT}/", "") for text in unused)


def test_a_cycle_and_an_unused_name_are_found() -> None:
    assert set(cycle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}
    sources = {Path("a.py"): "def used(): pass\nUNUSED = 3", Path("b.py"): "used()"}
    assert list(unused_names(sources, {Path("a.py"): sources[Path("a.py")]})) == ["a.py: UNUSED"]
    room = 'class Room:\n def open(self):\n  "Try shut()."\n def shut(self): self.open()\n'
    assert list(unused_members(["a text"], {Path("a.py"): room})) == ["a.py: shut"]
