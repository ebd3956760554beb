"""The second simulators are independent of the product: they import no physics of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.meta.layers import imports
from workbench import evaluation

ROOM = Path(evaluation.__file__).parent
SIMULATORS = {
    "rig": sorted((ROOM / "rig").glob("*.py")),
    "foreign": [ROOM / "foreign" / f"{name}.py" for name in ("machine", "truths")],
}


@pytest.mark.parametrize(
    ("room", "path"),
    [(room, path) for room, paths in SIMULATORS.items() for path in paths],
    ids=lambda value: value if isinstance(value, str) else value.stem,
)
def test_a_simulator_imports_only_its_own(room: str, path: Path) -> None:
    names = [name for _, name in imports(path.read_text(encoding="utf-8"))]
    foreign = [n for n in names if n.startswith(("workbench", "controllers", "casadi", "tests"))]
    # How C is built and what an error is called say nothing of a machine.
    foreign = [n for n in foreign if not n.startswith(("workbench.errors", "workbench.computing"))]
    own = tuple(f"workbench.evaluation.{room}.{p.stem}" for p in SIMULATORS[room])
    # The rig's equations are its own; only what writes them as C, and calls it, is the product's.
    tools = (f"workbench.evaluation.{room}", "casadi", "workbench.simulation.equations")
    allowed = (*own, *tools) if room == "rig" else own
    assert [n for n in foreign if not n.startswith(allowed)] == []
