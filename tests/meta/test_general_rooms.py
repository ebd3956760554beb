"""General rooms know nothing of the arm: its words stand in its plant and in what is made for it.

Examples in docstrings may use it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.meta.graph import parsed
from tests.meta.sources import ROOT

ROOMS = (
    "errors.py", "files.py", "data_folder.py", "registry.py", "model", "simulation",
    "operating_point", "linearisation", "verification", "study", "recordings", "cli", "reports",
    "physics", "diagnosis",
)  # fmt: skip

STRINGS = {
    "arm", "angle", "valve", "load", "load_kg", "muscle", "muscle_1", "muscle_2", "pressure_1",
    "pressure_2", "mean_pressure", "supply_pressure", "supply_bar", "opening", "lower_stop",
    "upper_stop", "plane",
}  # fmt: skip
"""Words that no string is."""

NAMES = STRINGS - {"angle", "load", "opening", "plane"} | {"angle_deg", "from_deg", "to_deg"}
"""Words that nothing is called; the others have plain meanings too."""

ALLOWED = {
    "verification/joint_metrics.py": "metrics of joints, for plants with such signals",
    "recordings/column_matching.py": "what columns of files are called, in several languages",
    "recordings/headers.py": "angle is a quantity",
    "recordings/quantity_kinds.py": "angle is a quantity",
    "physics/motion.py": "angle is a quantity",
    "physics/survey.py": "load is what weighs on a bearing",
    "physics/supply.py": "supply_pressure is a role of ports",
}


def general_files() -> list[Path]:
    found: list[Path] = []
    for room in ROOMS:
        path = ROOT / "workbench" / room
        found += [path] if path.is_file() else sorted(path.rglob("*.py"))
    return found


def words_of_the_arm(path: Path) -> Iterator[str]:
    tree = parsed(path.read_text(encoding="utf-8"))
    texts = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in texts:
            if isinstance(node.value, str) and node.value in STRINGS:
                yield f"line {node.lineno}: {node.value!r}"
        elif isinstance(node, (ast.Name, ast.Attribute, ast.arg)):
            names = (getattr(node, key, None) for key in ("id", "attr", "arg"))
            yield from (f"line {node.lineno}: {name}" for name in names if name in NAMES)


def test_a_general_room_has_no_word_of_the_arm() -> None:
    found = {
        path.relative_to(ROOT / "workbench").as_posix(): list(words_of_the_arm(path))
        for path in general_files()
    }
    had = {name: words for name, words in found.items() if words}
    # What is allowed words of the arm has them still.
    assert had.keys() == ALLOWED.keys(), had
