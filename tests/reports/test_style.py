"""One colour per controller, told apart from every other, on light and on dark ground."""

from __future__ import annotations

import math
from itertools import combinations, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from workbench.cli.main import run
from workbench.errors import WorkbenchError
from workbench.reports.figures.study_traces import parts
from workbench.reports.pictures import Picture
from workbench.reports.style import (
    FURTHER,
    INK,
    MEASURED,
    PAPER,
    SIMULATED,
    colours,
    controller_colours,
    decades,
    key,
    label,
    named_line,
    new_figure,
    palette,
    ramp,
    shades,
    told_apart,
)
from workbench.study.study import Report


def rgb(text: str) -> np.ndarray:
    return np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)


def luminance(text: str) -> float:
    linear = rgb(text) / 255
    linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def test_every_colour_of_the_palette_is_its_own() -> None:
    # The page replaces colours by their light value, so two of the same could not differ in dark.
    assert len({c.light for c in palette()}) == len({c.name for c in palette()}) == len(palette())


@pytest.mark.parametrize("ground", ["light", "dark"])
def test_controllers_are_told_apart(ground: str) -> None:
    shown = [*controller_colours().values(), SIMULATED, MEASURED]
    for a, b in combinations(shown, 2):
        # 60 of 441: about the distance of two neighbours of the ten-colour wheel of matplotlib.
        assert np.linalg.norm(rgb(getattr(a, ground)) - rgb(getattr(b, ground))) > 60


# What is left of red, green and blue without one kind of cone (Machado, Oliveira, Fernandes 2009).
SEEN = {
    "all": np.eye(3),
    "no red": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "no green": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "no blue": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
# From linear red, green and blue to cones and on to Oklab (B. Ottosson 2020).
CONES = [[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]]
OKLAB = [[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]]


def perceived(text: str, seen: str) -> np.ndarray:
    share = rgb(text) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    left = np.clip(np.asarray(SEEN[seen]) @ linear, 0.0, 1.0)
    return np.asarray(OKLAB) @ np.cbrt(np.asarray(CONES) @ left)


@pytest.mark.parametrize("seen", SEEN)
@pytest.mark.parametrize("ground", ["light", "dark"])
def test_curves_are_told_apart_by_everybody(ground: str, seen: str) -> None:
    shown = [getattr(c, ground) for c in (*controller_colours().values(), *FURTHER)]
    # From 0.02 on two patches side by side differ; thin lines need more. Few people see no blue.
    least = {"all": 0.12, "no blue": 0.04}.get(seen, 0.08)
    for a, b in combinations(shown, 2):
        assert np.linalg.norm(perceived(a, seen) - perceived(b, seen)) > least, (a, b)


@pytest.mark.parametrize("ground", ["light", "dark"])
def test_lines_stand_out_from_the_ground(ground: str) -> None:
    paper = getattr(PAPER, ground)
    assert contrast(getattr(INK, ground), paper) > 7.0
    for c in (*controller_colours().values(), *FURTHER, SIMULATED, MEASURED):
        # Web Content Accessibility Guidelines 2.1: 3 for graphics.
        assert contrast(getattr(c, ground), paper) > 3.0, c.name


def test_a_controller_keeps_its_colour_in_any_company() -> None:
    alone = colours(["linear MPC"])["linear MPC"]
    assert colours(["mine", "linear MPC", "yours"])["linear MPC"] == alone
    many = colours(["cascade PID", "a", "b", "sliding mode", "c"])
    assert len(set(many.values())) == 5


def test_a_name_without_a_colour_of_its_own_always_gets_the_same() -> None:
    assert colours(["mine"])["mine"] == colours(["cascade PID", "mine", "yours"])["mine"]


def test_designs_for_any_plant_keep_their_colours_in_any_company() -> None:
    names = [f"plain-{kind}" for kind in ("h-infinity", "mpc", "pid", "sliding-mode")] + ["lqi"]
    assert all(colours([name])[name] == colours(names)[name] for name in names)
    assert colours(names)["plain-mpc"] == colours(["linear MPC"])["linear MPC"]
    assert len(set(colours(["mpc", "plain-mpc", "linear MPC"]).values())) == 3


def test_families_with_a_colour() -> None:
    assert {"cascade PID", "sliding mode", "linear MPC"} <= set(controller_colours())


def test_curves_of_many_controllers_come_in_groups_that_are_told_apart() -> None:
    own = list(controller_colours())
    for count in (0, 1, 6, 7, 10, 13, 40):
        names = [*own, *(f"design {i}" for i in range(count))]
        given = shades(names)
        groups = told_apart(given)
        assert [name for group in groups for name in group] == list(given)
        assert sorted(given) == sorted(names) and len(groups) == max(1, math.ceil(count / 6))
        assert all(len({given[name] for name in group}) == len(group) for group in groups)


def test_too_many_curves_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="curves to tell apart"):
        colours([f"controller {i}" for i in range(7)])
    with pytest.raises(WorkbenchError, match="family"):
        ramp(8)


def test_a_label_longer_than_its_panel_is_broken_before_its_unit() -> None:
    _, (low, high) = new_figure([1.0, 3.0])
    for axes in (low, high):
        label(axes, y="pressure 1 in bar")
    assert low.get_ylabel() == "pressure 1\nin bar"
    assert high.get_ylabel() == "pressure 1 in bar"


@pytest.mark.usefixtures("undrawn")
def test_every_controller_of_a_study_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # One controller more than there are colours.
    monkeypatch.setattr("workbench.reports.style.FURTHER", FURTHER[:2])
    designs = [word for name in ("lqi", "plain-h-infinity", "plain-pid") for word in ("-c", name)]
    assert run(["verify", "--plant", "servo-axis", *designs, "--out", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Not drawn" not in page and "tracking-1-part-2" in page


@pytest.mark.usefixtures("undrawn")
def test_an_output_is_drawn_whatever_it_is_called(here: Path) -> None:
    Path("two_lags.py").write_text(
        "import control as ct\n"
        "G = ct.tf([[[1.0], [0.1]], [[0.1], [1.0]]], [[[1.0, 1.0]] * 2] * 2,\n"
        "          inputs=['P_1', 'P_2'], outputs=['T_top', 'T_Side'])\n"
    )
    step = ["--from", "T_top=0,T_Side=0", "--to", "T_top=1,T_Side=1"]
    assert run(["verify", "--plant", "two_lags:G", "-c", "plain-pid", *step, "--out", "o"]) == 0
    page = Path("o/report.html").read_text(encoding="utf-8")
    assert "Not drawn" not in page and "tracking-1-output-2" in page


def test_a_family_has_one_colour_whatever_it_was_designed_for() -> None:
    names = ("plain-pid", "lqi")
    kin = tuple((f"{n}, {word}", n) for word in ("nominal", "redesigned") for n in names)
    study = cast(Any, SimpleNamespace(controllers=dict(kin), report=Report(kin=kin)))
    first, second = parts(study, dict.fromkeys(dict(kin), cast(Any, None)))
    assert (first.tail, second.tail) == ("", "-part-2")
    for part in (first, second):
        assert list(part.shades.values()) == [colours(names)[name] for name in names]


def test_panels_keep_their_height_under_a_long_legend() -> None:
    def heights(names: list[str]) -> list[float]:
        figure, panels = new_figure([2.2, 1.1, 1.0])
        key(panels[0], handles=[named_line(name, shade) for name, shade in colours(names).items()])
        figure.draw_without_rendering()
        return [axes.get_window_extent().height / figure.dpi for axes in panels]

    short = heights([f"pid {i}" for i in range(6)])
    long = heights([f"plain-sliding-mode {i}, redesigned" for i in range(6)])
    assert long == pytest.approx(short, rel=0.05)


def test_numbers_at_an_axis_are_words_and_so_is_their_power_of_ten() -> None:
    figure, (axes,) = new_figure([2.0])
    axes.plot([0.0, 2e6], [0.0, 1.0])
    label(axes, x="stiffness in N/m", y="share in 1")
    drawn = Picture("numbers", figure, "").document
    assert ">1.25<" in drawn and ">×10⁶<" in drawn


def test_no_power_of_ten_stands_in_the_legend_above_an_axis() -> None:
    figure, (axes,) = new_figure([2.0])
    axes.plot([0.0, 1.0], [0.0, 6e7])
    label(axes, x="time in s", y="p in mm")
    figure.draw_without_rendering()
    assert axes.yaxis.get_offset_text().get_text() == ""
    assert "2e+07" in [text.get_text() for text in axes.get_yticklabels()]


def test_a_name_with_dollar_signs_is_no_formula_and_powers_of_ten_are_words() -> None:
    figure, (axes,) = new_figure([1.0])
    axes.plot([1.0, 1e6], [0.0, 1.0])
    axes.set_xscale("log")
    axes.set_yticks([0.0, 1.0], ["costs 2$ or 3$", "nothing"])
    drawn = Picture("dollars", figure, "").document
    assert ">costs 2$ or 3$<" in drawn
    assert ">10⁶<" in drawn


@pytest.mark.parametrize("span", [3.0, 12.0, 50.0, 90.0, 1e3, 1e5])
@pytest.mark.parametrize("low", [0.15, 0.4, 1.5, 8.0])
def test_numbers_of_a_logarithmic_axis_stand_apart(low: float, span: float) -> None:
    figure, (axes,) = new_figure([1.8])
    axes.semilogy([0.0, 1.0], [low, span * low])
    decades(axes)
    figure.draw_without_rendering()
    boxes = [t.get_window_extent() for t in axes.get_yticklabels(which="both") if t.get_text()]
    ends = sorted((box.y0, box.y1) for box in boxes if axes.bbox.y0 <= box.y0 <= axes.bbox.y1)
    assert len(ends) >= 2 or span < 5.0
    assert all(above[0] > below[1] for below, above in pairwise(ends))
