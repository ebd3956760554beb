"""Every figure names its quantities and units, and draws what it was given."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from tests.demo.made_up_map import made_up_map
from workbench.demo.diagnosed_case import diagnosed
from workbench.demo.force_map_study import study_map
from workbench.demo.force_maps import force_map_page
from workbench.demo.identification import DRAWN, force_lines
from workbench.demo.open_loop import open_loop
from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.experiments import IsometricRecord
from workbench.physics.force_laws import PaperLaw
from workbench.reports.figures.bode_nyquist import bode
from workbench.reports.figures.tracking import Trajectory, tracking
from workbench.reports.style import controller_colours

T = np.linspace(0.0, 2.0, 41)
WAVE = 0.5 + 0.3 * np.sin(T)
RUN = FreeRun("run", ("angle",), ("rad",), T, WAVE[:, None], WAVE[:, None])
RAMPS = IsometricRecord(
    np.repeat(DRAWN, len(T)),
    np.tile(1e5 * T, len(DRAWN)),
    np.repeat(0.002 * np.arange(len(DRAWN)), len(T)),
    np.tile(WAVE, len(DRAWN)),
    "made up",
)


def steps() -> Figure:
    runs = [
        Trajectory(name, T, WAVE + 0.01 * i, 5.0 + WAVE, WAVE)
        for i, name in enumerate(controller_colours())
    ]
    return tracked(T, np.full_like(T, 0.5), runs)


def tracked(time: np.ndarray, reference: np.ndarray, runs: list[Trajectory]) -> Figure:
    words = {"quantity": "angle", "unit": "°", "command": "valve in V"}
    return tracking(time, reference, runs, error_limit=0.3, **words)


@cache
def map_pictures() -> list[Figure]:
    study = study_map(made_up_map(), "made up")
    return [picture.figure for picture in force_map_page(study, command="").pictures]


FIGURES: dict[str, Callable[[], Figure]] = {
    "force lines": lambda: force_lines(RAMPS, PaperLaw()),
    "open loop": lambda: open_loop(T, WAVE, dict.fromkeys(("linear valve", "full"), (WAVE, WAVE))),
    "bode": lambda: bode(T + 0.1, {"30°": np.exp(1j * WAVE)}, unit="° per V"),
    "steps": steps,
    "diagnosed": lambda: diagnosed(RUN, RUN, T, {"before": WAVE, "after": WAVE}),
    "force map": lambda: map_pictures()[0],
    "law errors": lambda: map_pictures()[1],
}

UNIT = re.compile(r"\sin (s|V|N|°|°/s|bar|mm|Hz|° per V)$")


@pytest.mark.parametrize("name", FIGURES)
def test_axes_carry_units(name: str) -> None:
    figure = FIGURES[name]()
    panels = figure.axes
    assert UNIT.search(panels[-1].get_xlabel()), panels[-1].get_xlabel()
    for axes in panels:
        words = [tick.get_text() for tick in axes.get_yticklabels()]
        # Bars of named laws have names instead of a quantity on their vertical axis.
        assert UNIT.search(axes.get_ylabel()) or "Sárosi" in words, axes.get_ylabel()


@pytest.mark.parametrize("name", FIGURES)
def test_nothing_is_drawn_outside_the_figure(name: str) -> None:
    figure = FIGURES[name]()
    figure.draw_without_rendering()
    whole = figure.bbox
    for axes in figure.axes:
        box = axes.get_tightbbox()
        assert box is not None
        # Two pixels: rounding of the layout.
        assert box.x0 >= -2 and box.y0 >= -2 and box.x1 <= whole.x1 + 2 and box.y1 <= whole.y1 + 2


@pytest.mark.parametrize("name", FIGURES)
def test_labels_of_neighbouring_panels_do_not_overlap(name: str) -> None:
    figure = FIGURES[name]()
    figure.draw_without_rendering()
    labels = [axes.yaxis.label.get_window_extent() for axes in figure.axes]
    for above, below in pairwise(labels):
        assert below.y1 <= above.y0 + 1


def test_a_controller_has_its_colour_and_the_linear_run_is_dashed() -> None:
    position = steps().axes[0]
    for name, colour in controller_colours().items():
        own = [line for line in position.lines if to_hex(str(line.get_color())) == colour.light]
        assert {line.get_linestyle() for line in own} == {"-", "--"}, name


def test_the_error_is_the_reference_held_at_each_sample_less_the_angle() -> None:
    fine = np.linspace(0.0, 1.0, 11)
    run = Trajectory("cascade PID", fine, np.full(11, 0.2), np.full(11, 5.0))
    figure = tracked(np.array([0.0, 0.5]), np.array([0.2, 0.4]), [run])
    drawn = np.asarray(figure.axes[1].lines[0].get_ydata())
    np.testing.assert_allclose(drawn, np.where(fine < 0.5, 0.0, 0.2), atol=1e-12)


def test_phases_start_within_one_turn() -> None:
    response = np.exp(1j * np.radians(170.0)) * np.ones_like(T)
    figure = bode(T + 0.1, {"a": response}, unit="V")
    assert np.asarray(figure.axes[1].lines[0].get_ydata())[0] == pytest.approx(-190.0)
