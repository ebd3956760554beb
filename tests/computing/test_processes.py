"""Processes that are used again do not answer with code that was rewritten since."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from workbench.computing.processes import begin_anew, in_order


def test_a_module_that_is_reloaded_is_so_in_other_processes_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    own = tmp_path / "reloaded_in_this_test.py"
    own.write_text("def answer():\n    return 1\n")
    module = importlib.import_module(own.stem)
    # Processes that begin now find it where this one does.
    begin_anew()
    assert in_order([(module.answer, ())] * 2, jobs=2) == [1, 1]
    own.write_text("def answer():\n    return 1000\n")
    importlib.reload(module)
    assert in_order([(module.answer, ())] * 2, jobs=2) == [1000, 1000]
