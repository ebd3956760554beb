"""The second simulators are independent of the product: they import nothing of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.meta.layers import imports
from workbench.evaluation import rig

ROOM = Path(rig.__file__).parent


@pytest.mark.parametrize("path", sorted(ROOM.glob("*.py")), ids=lambda path: path.stem)
def test_the_rig_imports_only_itself(path: Path) -> None:
    names = [name for _, name in imports(path.read_text(encoding="utf-8"))]
    own = "workbench.evaluation.rig"
    foreign = [n for n in names if n.startswith(("workbench", "controllers", "casadi", "tests"))]
    assert [n for n in foreign if not n.startswith(own)] == []
