"""Folders are layers: imports point only downward."""

from __future__ import annotations

import pytest

from tests.meta.layers import check_module
from tests.meta.sources import module_files, module_name


def test_imports_point_downward() -> None:
    problems = [
        f"{module_name(path)}: {problem}"
        for path in module_files()
        for problem in check_module(module_name(path), path.read_text(encoding="utf-8"))
    ]
    assert not problems, "\n".join(problems)


@pytest.mark.parametrize(
    ("module", "source", "problem"),
    [
        ("workbench.model.regularisation", "import workbench.physics.gas", "which is not below it"),
        (
            "workbench.model.regularisation",
            "from workbench.physics import gas",
            "which is not below it",
        ),
        (
            "workbench.model.regularisation",
            "from workbench import physics",
            "which is not below it",
        ),
        ("workbench.model.regularisation", "import workbench", "which is not below it"),
        (
            "workbench.model.regularisation",
            "def f():\n    import workbench.cli",
            "which is not below it",
        ),
        ("workbench.plants.arm", "import controllers.pid", "which is not below it"),
        ("controllers.pid", "from workbench.plants.arm import Arm", "must not know"),
        ("workbench.operating_point", "import workbench.linearisation", "which is not below it"),
        ("workbench.files", "import_module('workbench.study')", "which is not below it"),
        ("workbench.drawer", "", "is in no layer"),
        ("workbench.cli", "import workbench.drawer.thing", "is in no layer"),
    ],
)
def test_a_wrong_arrow_is_found(module: str, source: str, problem: str) -> None:
    problems = check_module(module, source)
    assert len(problems) == 1
    assert problem in problems[0]


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("workbench.physics.gas", "from workbench.model import regularisation\nimport numpy"),
        ("workbench.model.model", "from workbench.model.regularisation import EXACT"),
        ("controllers.mpc.whole_model", "from workbench.linearisation import LinearModel"),
        ("workbench.verification.loop", "import controllers.pid"),
        ("workbench", "from workbench.cli import main"),
    ],
)
def test_a_downward_arrow_passes(module: str, source: str) -> None:
    assert check_module(module, source) == []
