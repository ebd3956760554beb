"""Every notebook runs from a fresh kernel and asserts its headline number."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"


@pytest.mark.system
@pytest.mark.parametrize(
    "path",
    [
        # A notebook that diagnoses takes minutes.
        pytest.param(p, id=p.stem, marks=pytest.mark.long if "recording" in p.stem else ())
        for p in sorted(FOLDER.glob("*.ipynb"))
    ],
)
def test_notebook_runs(path: Path, tmp_path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    assert any("assert " in source for source in code), "the notebook asserts no number"
    # The kernel works in an empty folder, so a notebook cannot lean on files beside it.
    client = NotebookClient(
        notebook,
        timeout=300,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    )
    client.execute()


def test_notebooks_import_what_there_is() -> None:
    for path in sorted(FOLDER.glob("*.ipynb")):
        for cell in nbformat.read(path, as_version=4).cells:
            tree = ast.parse(cell.source) if cell.cell_type == "code" else ast.Module([])
            for node in ast.walk(tree):
                if isinstance(node, ast.ImportFrom) and node.module:
                    module = importlib.import_module(node.module)
                    missing = [a.name for a in node.names if not hasattr(module, a.name)]
                    assert not missing, f"{path.name}: {node.module} has no {missing}"


def test_notebooks_are_stored_without_output() -> None:
    for path in sorted(FOLDER.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        for cell in notebook.cells:
            assert not cell.get("outputs"), f"{path.name} is stored with output; clear it"
