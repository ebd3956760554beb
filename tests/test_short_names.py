"""`import workbench as wb` offers the names that a notebook needs, each when it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import workbench as wb
from workbench import _OFFERED


@pytest.mark.parametrize("name", sorted(_OFFERED))
def test_every_name_is_there(name: str) -> None:
    assert name in dir(wb)
    assert callable(getattr(wb, name))


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'linearize'"):
        _ = wb.linearize


@pytest.mark.parametrize("first", ["wb.operating_point", "import workbench.operating_point.trim"])
def test_the_function_stands_before_the_room_of_its_name(first: str) -> None:
    code = f"import workbench as wb\n{first}\nassert wb.operating_point.__name__, wb\n"
    code += "assert not hasattr(wb.operating_point, '__path__')"
    subprocess.run([sys.executable, "-c", code], check=True)
