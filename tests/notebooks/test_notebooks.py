"""Every notebook runs from a fresh kernel in an empty folder, asserts numbers, shows pictures."""

from __future__ import annotations

import ast
import importlib
import json
import os
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from workbench.data_folder import shipped_folder

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"
PATHS = sorted(FOLDER.glob("*.ipynb"))
# Three are diagnoses by the whole library, and two design MPCs or run a study; without its data one
# is run too.
LONG = re.compile("real_machine|does_not_match|own_plant|design_an_mpc|compare_and_decide")
RUN = [pytest.param(p, marks=pytest.mark.long) if LONG.search(p.stem) else p for p in PATHS]
PICTURES = {"image/png", "image/svg+xml"}


def executed(path: Path, place: Path, **environment: str) -> nbformat.NotebookNode:
    """Return a notebook with its outputs; its kernel works in an empty folder."""
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(place)}}
    )
    client.execute(env={**os.environ, **environment})
    return notebook


def outputs(notebook: nbformat.NotebookNode) -> list[Any]:
    return [out for cell in notebook.cells for out in cell.get("outputs", ())]


def pictures(notebook: nbformat.NotebookNode) -> int:
    return sum(bool(PICTURES & set(out.get("data", ()))) for out in outputs(notebook))


def made_up_round(folder: Path) -> None:
    """Write answers to the cases of the shipped round: everywhere the same, most of them wrong."""
    cases = [path.parent.name for path in shipped_folder().glob("blind/round-1/*/verdict.json")]
    (folder / "sealed").mkdir()
    key = {case: {"truth": [{"effect": "tilt"}]} for case in cases}
    (folder / "sealed" / "key.json").write_text(json.dumps(key))


@pytest.mark.system
@pytest.mark.parametrize("path", RUN, ids=lambda p: p.stem)
def test_notebook_runs_and_shows_its_pictures(path: Path, tmp_path: Path) -> None:
    place, data = tmp_path / "empty", tmp_path / "data"
    place.mkdir()
    data.mkdir()
    environment = {}
    if "concealed" in path.stem:
        made_up_round(data)
        environment = {"WORKBENCH_DATA": str(data)}
    if "real_machine" in path.stem and not os.environ.get("WORKBENCH_DATA"):
        pytest.skip("recordings of real machines are not there")
    notebook = executed(path, place, **environment)
    drawn = [c for c in notebook.cells if re.search(r"plot\(|subplots\(", c.get("source", ""))]
    assert pictures(notebook) >= max(2, len(drawn) // 2)
    printed = "".join(out.get("text", "") for out in outputs(notebook))
    assert not re.search(r"Not scored|Skipped", printed)
    assert not any(out.get("name") == "stderr" for out in outputs(notebook))


def test_a_notebook_without_its_data_says_so(tmp_path: Path) -> None:
    (path,) = [p for p in PATHS if "real_machine" in p.stem]
    # A folder that holds no recordings, and no way to their publisher.
    proxies = dict.fromkeys(("http_proxy", "https_proxy"), "http://127.0.0.1:9")
    elsewhere = {"WORKBENCH_DATA": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    notebook = executed(path, tmp_path, **elsewhere, **proxies)
    printed = "".join(out.get("text", "") for out in outputs(notebook))
    assert "Skipped: DATA_EMPS.mat could not be fetched" in printed
    assert pictures(notebook) == 0


@pytest.mark.parametrize("path", PATHS, ids=lambda p: p.stem)
def test_a_notebook_asserts_numbers_and_imports_what_there_is(path: Path) -> None:
    asserted = 0
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type != "code":
            continue
        tree = ast.parse(cell.source.replace("%matplotlib inline", ""))
        asserted += sum(isinstance(node, ast.Assert) for node in ast.walk(tree))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                module = importlib.import_module(node.module)
                missing = [a.name for a in node.names if not hasattr(module, a.name)]
                assert not missing, f"{path.name}: {node.module} has no {missing}"
    assert asserted >= 2


@pytest.mark.parametrize("path", PATHS, ids=lambda p: p.stem)
def test_a_notebook_is_stored_so_that_it_diffs_well(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        assert not cell.get("outputs"), f"{path.name} is stored with output; clear it"
        assert cell.get("execution_count") is None
        assert re.fullmatch(r"[a-z0-9-]+", cell.id), f"{path.name}: cell {cell.id} has no name"
    assert path.read_text(encoding="utf-8") == nbformat.writes(notebook) + "\n"


def test_the_notebooks_are_numbered_and_lead_from_one_to_the_next() -> None:
    assert [p.name[:2] for p in PATHS] == [f"{i:02}" for i in range(1, len(PATHS) + 1)]
    for i, path in enumerate(PATHS[:-1], start=2):
        assert f"Next: notebook {i}, " in path.read_text(encoding="utf-8")
