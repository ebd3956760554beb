"""No public function, class or method swallows a keyword that it does not know."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

import pytest

from tests.meta.keywords import check_module
from tests.meta.sources import module_name, public_module_files


def test_unknown_keywords_are_refused() -> None:
    names = map(module_name, public_module_files())
    problems = [
        f"{name}.{problem}"
        for name in names
        for problem in check_module(importlib.import_module(name))
    ]
    assert not problems, "\n".join(problems)


def module_of(source: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    # A dataclass looks its module up in sys.modules.
    module = ModuleType("sample")
    monkeypatch.setitem(sys.modules, "sample", module)
    exec(source, vars(module))
    return module


HIDING_DECORATOR = """
import functools
def f(x): pass
def _swallow(inner):
    @functools.wraps(inner)
    def wrapper(*values, **options): return None
    return wrapper
f = _swallow(f)
"""


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("def f(x, **options): pass", "f takes **options"),
        ("class A:\n    def f(self, **options): pass", "A.f takes **options"),
        ("class A:\n    def __init__(self, **options): pass", "A takes **options"),
        ("class A:\n    @classmethod\n    def f(cls, **options): pass", "A.f takes **options"),
        # A decorator that hides the keywords of what it wraps behind the same signature.
        (
            HIDING_DECORATOR,
            "f accepts an unknown keyword",
        ),
    ],
)
def test_a_swallowed_keyword_is_found(
    source: str, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert check_module(module_of(source, monkeypatch)) == [problem]


@pytest.mark.parametrize(
    "source",
    [
        "def f(x, *, y=1): pass",
        "def _f(**options): pass",
        "from dataclasses import dataclass\n@dataclass\nclass A:\n    x: int",
        "import functools\n@functools.lru_cache\ndef f(x): pass",
        "from typing import Protocol\nclass P(Protocol):\n    def f(self, x): ...",
        "import enum\nclass E(enum.Enum):\n    a = 1",
        "class Mistake(Exception): pass",
    ],
)
def test_explicit_signatures_pass(source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert check_module(module_of(source, monkeypatch)) == []
