"""Objects show themselves: short in a list, as tables in a notebook, as a picture, as a frame."""

from __future__ import annotations

import html
import math
import re
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest

import workbench as wb
from tests.machines import machine
from workbench.display import Drawn, Rows, Shown, in_notebook
from workbench.errors import WorkbenchError


@pytest.fixture(scope="module")
def axis() -> dict[str, object]:
    """One object of each kind, of the servo axis and of a shipped case."""
    from controllers.plain.transfer_law import pid_by_hand

    model = wb.servo_axis()
    point = wb.operating_point(model, {"position": 0.0})
    linear = wb.linearise(point)
    controller = pid_by_hand(
        2e4, 0.0, 2e3, measured="position", actuator="force", lower=-350.0, upper=350.0
    )
    run = wb.verify(controller, model, wb.step_scenario("position", 0.0, 0.02, hold=0.5))
    case = wb.read_case(wb.shipped_data("practice-07"))
    return {
        "model": model,
        "point": point,
        "linear": linear,
        "controller": controller,
        "run": run,
        "trajectory": wb.simulate(model, np.full(100, 20.0), sample_time=0.01),
        "metrics": wb.metrics(run),
        "case": case,
        "recording": case.recordings["validate_open"],
    }


KINDS = (
    "model",
    "point",
    "linear",
    "controller",
    "run",
    "trajectory",
    "metrics",
    "case",
    "recording",
)


@pytest.mark.parametrize("kind", KINDS)
def test_an_object_is_short_in_a_list(axis: dict[str, Shown], kind: str) -> None:
    assert 10 < len(repr(axis[kind])) < 200
    assert "\n" not in repr(axis[kind])


@pytest.mark.parametrize("kind", KINDS)
def test_an_object_shows_its_tables(axis: dict[str, Shown], kind: str) -> None:
    page = axis[kind]._repr_html_()
    for table in axis[kind].tables():
        assert f"<summary>{html.escape(table.title)}</summary>" in page
        assert all(len(row) == len(table.headings) for row in table.rows)
    assert page.count("<tr>") == sum(1 + len(table.rows) for table in axis[kind].tables())


@pytest.mark.parametrize("name", ["pid", "sliding-mode", "mpc", "angle-pd"])
def test_a_controller_lists_its_numbers_and_the_sizes_of_its_matrices(name: str) -> None:
    from controllers.design import DESIGNS

    point = wb.operating_point(wb.arm(3).without("bearing_friction"), {"angle": math.radians(30)})
    design = DESIGNS.get(name)
    law = design.controller(wb.linearise(point, verdict=False), design.specified({}))
    assert repr(law).endswith("-> valve every 2 ms>") and len(repr(law)) < 100
    assert 200 < len(str(law)) < 2500
    assert ["valve.centre", 5.0] in [list(row) for row in law.tables()[0].rows]


def test_what_a_table_says_is_no_markup() -> None:
    page = Rows("a<b", ("x",), [("<script>",)])._repr_html_()
    assert "<script>" not in page
    assert "&lt;script&gt;" in page


def test_a_column_without_entries_is_not_shown() -> None:
    page = Rows("some", ("x", "why"), [(1.0, ""), (math.nan, "")])._repr_html_()
    assert "<th>x</th>" in page and "why" not in page


def test_a_long_table_is_folded() -> None:
    assert "<details open>" in Rows("few", ("x",), [(1,)])._repr_html_()
    assert "<details open>" not in Rows("many", ("x",), [(i,) for i in range(40)])._repr_html_()


@pytest.mark.parametrize(
    ("kind", "column", "rows"),
    [
        ("model", "value", 5),
        ("point", "value", 4),
        ("linear", "time constant in s", 2),
        ("run", "position reference", 500),
        ("recording", "angle", 8000),
    ],
)
def test_an_object_becomes_a_data_frame(
    axis: dict[str, Shown], kind: str, column: str, rows: int
) -> None:
    frame = axis[kind].to_dataframe()
    assert column in frame.columns
    assert len(frame) == rows


def test_without_pandas_the_extra_is_named(
    axis: dict[str, Shown], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(WorkbenchError, match=r"workbench\[notebooks\]"):
        axis["point"].to_dataframe()


@pytest.mark.parametrize(("kind", "panels"), [("linear", 2), ("run", 3), ("recording", 4)])
def test_an_object_draws_itself(axis: dict[str, Drawn], kind: str, panels: int) -> None:
    figure = axis[kind].plot()
    assert len(figure.axes) == panels
    assert all(re.search(r"\sin ", axes.get_ylabel()) for axes in figure.axes)
    assert all(axes.lines for axes in figure.axes)


def test_a_gain_over_a_speed_has_one_unit() -> None:
    plant = machine(lambda m: {"x": m.u.v}, "x m", "v m/s", "x m")
    figure = wb.plot(wb.linearise(wb.operating_point(plant, {"x": 0.0})))
    assert figure.axes[0].get_ylabel() == "magnitude in s"


def test_what_has_no_picture_says_which_have() -> None:
    with pytest.raises(WorkbenchError, match="no picture of a int; there is one of .*LinearModel"):
        wb.plot(3)


def test_bode_plot_of_python_control_takes_a_linear_model() -> None:
    import control as ct

    point = wb.operating_point(wb.arm(3).without("bearing_friction"), {"angle": math.radians(30)})
    linear = wb.linearise(point).select(outputs=["angle", "pressure_1"])
    curves = []
    for shown in (linear, linear.system):
        # Into a figure of its own: python-control adds to the one that is there.
        plt.figure()
        axes = ct.bode_plot(shown).axes.ravel()
        curves.append([panel.lines[0].get_ydata() for panel in axes])
        plt.close()
    assert len(curves[0]) == 4
    for own, expected in zip(*curves, strict=True):
        assert own.tolist() == expected.tolist()


def test_a_linear_model_has_no_other_attributes(axis: dict[str, object]) -> None:
    with pytest.raises(AttributeError, match="no attribute 'frequency'"):
        _ = axis["linear"].frequency  # type: ignore[attr-defined]


def test_a_program_that_imports_a_kernel_is_no_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    assert not in_notebook()
