"""Figures of a user's own stand on a page like those of the workbench."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.machines import machine
from workbench.errors import WorkbenchError
from workbench.reports.figure import FIGURES, Figure, own_figures, sections
from workbench.reports.figures.tracking import Trajectory, tracked, tracking
from workbench.reports.page import Words
from workbench.reports.pictures import Picture
from workbench.study.study import Report

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


def test_each_followed_output_stands_beside_a_command_that_moves() -> None:
    tank = machine(
        lambda m: {"level": m.u.pump - m.x.level, "warmth": m.u.heater - m.x.warmth},
        "level m scale=1, warmth K scale=1",
        "valve 1, pump m/s, heater K/s",
        "level m scale=1, warmth K scale=1",
    )
    moving = ("time", "input.pump", "input.heater", "output.level", "output.warmth")
    still = {"input.valve": 0.0, "reference.level": 1.0, "reference.warmth": 1.0}
    traces = {name: np.arange(3.0) for name in moving}
    traces |= {name: np.full(3, value) for name, value in still.items()}
    plant = SimpleNamespace(build=lambda: tank)
    study = SimpleNamespace(plant=plant, controllers=("mine",), report=Report(), demands=())
    runs = cast(Any, {"mine": SimpleNamespace(traces=traces)})
    for output, command in (("level", "pump in m/s"), ("warmth", "heater in K/s")):
        *_, below = tracked(cast(Any, study), "step", runs, output).axes
        assert below.get_ylabel().replace("\n", " ") == command


def test_what_only_rounds_is_drawn_as_a_line() -> None:
    time, held = np.arange(9.0), np.zeros(9)
    one = Trajectory("mine", time, held + 1e-16 * (-1.0) ** time, held, held)
    words = {"quantity": "speed", "unit": "m/s", "command": "drive in N"}
    whole, error, _ = tracking(time, held, [one], size=20.0, **words).axes
    assert min(np.ptp(whole.get_ylim()), np.ptp(error.get_ylim())) > 1e-5
