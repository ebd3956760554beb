"""Figures of a user's own stand on a page like those of the workbench."""

from pathlib import Path

import pytest

from workbench.errors import WorkbenchError
from workbench.reports.figure import FIGURES, Figure, own_figures, sections
from workbench.reports.page import Words
from workbench.reports.pictures import Picture

MODULE = '''
from workbench.reports.figure import Figure
from workbench.reports.style import new_figure

def fast(result):
    """Only the fast runs."""
    figure, _ = new_figure([result])
    return figure

def broken(result):
    return result["missing"]

def nothing(result):
    return None

two = Figure("two", lambda result: [fast(result), fast(result)], title="Two of them")
'''


def drawn(folder: Path, *names: str) -> list[tuple[str, list[object]]]:
    (folder / "my_figures.py").write_text(MODULE)
    own = own_figures([f"my_figures:{n}" for n in names], folder=folder)
    return [(s.title, list(s.blocks)) for s in sections(own, 2.0)]


def test_a_function_is_a_figure(tmp_path: Path) -> None:
    [(title, [picture])] = drawn(tmp_path, "fast")
    assert title == "Fast"
    assert isinstance(picture, Picture)
    assert (picture.name, picture.caption) == ("own-fast", "Only the fast runs.")
    [(title, pictures)] = drawn(tmp_path, "two")
    assert [p.name for p in pictures if isinstance(p, Picture)] == ["two", "two-2"]


def test_a_figure_without_anything_to_show_has_no_section(tmp_path: Path) -> None:
    assert drawn(tmp_path, "nothing") == []


def test_a_figure_that_fails_leaves_a_note(tmp_path: Path) -> None:
    [(_, [note])] = drawn(tmp_path, "broken")
    assert isinstance(note, Words)
    assert "my_figures.py, line 11" in note.text
    wrong = Figure("wrong", lambda result: 3.0)
    assert "returned a float" in str(wrong.blocks(1.0)[0])


def test_a_name_that_no_figure_has() -> None:
    with pytest.raises(WorkbenchError, match="write one of your own as module:object"):
        FIGURES.get("nowhere")
