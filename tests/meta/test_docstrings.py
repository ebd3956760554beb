"""Everything public says what it is, and every number its unit."""

from __future__ import annotations

import importlib
from types import ModuleType

import pytest

from tests.meta.docstrings import check_module, names_unit
from tests.meta.sources import module_name, public_module_files

GOOD = '''
"""A module."""

def pressure(force: float, area: float | None = None, *, name: str = "p") -> float:
    """Return the pressure of a force on an area.

    Args:
        force: Force on the piston, N.
        area: Area of the piston in m^2; None takes the
            standard piston.
        name: What it is called.

    Returns:
        Gauge pressure, Pa.

    Example:
        >>> pressure(1.0, 1.0)
        1.0
    """
'''


def test_public_functions_are_documented() -> None:
    problems = [
        f"{name}, {problem}"
        for path in public_module_files()
        for name in (module_name(path),)
        for problem in check_module(path.read_text(encoding="utf-8"), importlib.import_module(name))
    ]
    assert not problems, "\n".join(problems)


def test_there_are_modules_to_check() -> None:
    assert "workbench.errors" in {module_name(path) for path in public_module_files()}


def test_complete_docstring_passes() -> None:
    assert check_module(GOOD) == []


@pytest.mark.parametrize(
    ("cut", "put", "problem"),
    [
        ('"""A module."""\n', "", "module: no docstring"),
        (
            ">>> pressure(1.0, 1.0)\n        1.0",
            ">>> pressure.__name__\n        'pressure'",
            "a name",
        ),
        ("        force: Force on the piston, N.\n", "", "Args gives no unit for force"),
        ("piston, N.", "piston.", "Args gives no unit for force"),
        ("piston, N.", "piston, shape (N, m).", "Args gives no unit for force"),
        ("piston, N.", "Newton's piston.", "Args gives no unit for force"),
        ("piston in m^2", "piston", "Args gives no unit for area"),
        ("name: What", "title: What", "Args names title, which is no parameter"),
        ("Gauge pressure, Pa.", "Gauge pressure.", "Returns gives no unit"),
        ("    Returns:\n        Gauge pressure, Pa.\n", "", "Returns gives no unit"),
    ],
)
def test_a_gap_is_found(cut: str, put: str, problem: str) -> None:
    assert cut in GOOD
    problems = check_module(GOOD.replace(cut, put))
    assert any(problem in found for found in problems), problems


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("@dataclass\nclass A:\n    '''A.'''\n    x: float", "A: Args gives no unit for x"),
        (
            "@dataclass()\nclass A:\n    '''A.\n\n    Args:\n        x: Way.'''\n    x: float",
            "A: Args gives no unit for x",
        ),
        ("class A:\n    '''A.'''\n    def f(self): pass", "A.f: no docstring"),
        ("class A: pass", "A: no docstring"),
        ("class A(NamedTuple):\n    '''A.'''\n    x: float", "A: Args gives no unit for x"),
        (
            "class A:\n    '''A.'''\n    def __init__(self, x: float): pass",
            "A: Args gives no unit for x",
        ),
        (
            "class A:\n    '''A.'''\n    @property\n    def p(self) -> float:\n        '''Way.'''",
            "A.p: Returns gives no unit",
        ),
        ("@app.command()\ndef f(x: float = 1):\n    '''Do.'''", "f: no help for the option x"),
    ],
)
def test_a_gap_in_a_class_or_verb_is_found(source: str, problem: str) -> None:
    problems = check_module(f"'''A module.'''\n{source}\n")
    assert any(problem in found for found in problems), problems


OVERRIDING = """
'''A module.'''
class Law:
    '''A law.'''
    def force(self, x: float) -> float:
        '''Return the force.

        Args:
            x: Way, m.

        Returns:
            Force, N.
        '''
class Spring(Law):
    '''A spring.'''
    def force(self, x: float) -> float:
        '''Return the force of a spring.'''
"""


def test_a_method_takes_over_what_its_base_says() -> None:
    module = ModuleType("sample")
    exec(OVERRIDING, vars(module))
    assert check_module(OVERRIDING, module) == []
    for cut, problem in [
        ("x: Way, m.", "Spring.force: Args gives no unit for x"),
        ("Force, N.", "Spring.force: Returns gives no unit"),
        ("(Law)", "Spring.force: Args gives no unit for x"),
    ]:
        source = OVERRIDING.replace(cut, "")
        exec(source, vars(module))
        assert any(problem in found for found in check_module(source, module)), cut


@pytest.mark.parametrize(
    "source",
    [
        "@dataclass\nclass A:\n    '''A.\n\n    Args:\n        x_deg: Way.'''\n    x_deg: float",
        "def _private(x: float): pass",
        "def f(name: str, deep: bool = False):\n    '''Do.'''",
        "def f(x_m: float) -> float:\n    '''Return the force, N.'''",
        "class A:\n    '''A.'''\n    def _private(self, x: float): pass",
        "class A:\n    '''A.'''\n    @property\n    def p(self) -> float:\n        '''Way, m.'''",
        "@dataclass\nclass A:\n    '''A.'''\n    _x: float\n    y: ClassVar[float] = 1.0",
        "@app.command()\ndef f(x: Annotated[float, Option(help='Load, kg.')] = 1):\n    '''Do.'''",
    ],
)
def test_what_needs_no_more_words_passes(source: str) -> None:
    assert check_module(f"'''A module.'''\n{source}\n") == []


@pytest.mark.parametrize(
    "text",
    [
        "Angle, rad.",
        "Angle in degrees.",
        "Gain in V per rad.",
        "Gain [V/rad].",
        "Rate, 1/s.",
        "Time step in s.",
        "N.",
        "Ratio of heat capacities.",
        "Limit, in the unit of ``x``.",
        "Opening, dimensionless.",
        "Values, shape (n,), Pa gauge.",
        "Temperature, 293 K.",
        "Tolerance, 1 %.",
    ],
)
def test_units_are_recognised(text: str) -> None:
    assert names_unit(text)


@pytest.mark.parametrize(
    "text",
    [
        "The angle.",
        "A value for each muscle.",
        "Matrix of shape (N, m).",
        "Vectors, shape ``(n, s)``.",
        "The arm's angle and what N stands for.",
        "Whether the minimum counts.",
    ],
)
def test_words_are_not_units(text: str) -> None:
    assert not names_unit(text)
