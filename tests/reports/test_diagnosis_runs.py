"""Free runs as pages draw them."""

import numpy as np
import pytest

from tests.machines import machine
from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.model import Model, Output, State
from workbench.reports.figures.diagnosis import (
    as_read,
    diagnosis_residuals,
    diagnosis_runs,
    sizes_as_read,
)

MODEL = machine(
    lambda m: ({"flow": -m.x.flow}, {"flow": m.x.flow, "air": m.x.flow, "pressure": m.x.flow}),
    "flow m3/s scale=1",
    "",
    "flow m3/s scale=1 display_unit=m3/h, air K scale=1 display_unit=degC, pressure Pa scale=1",
)


def test_runs_are_drawn_in_the_units_that_the_outputs_declare() -> None:
    seen = np.tile([0.5, 293.15, 2e5], (20, 1))
    names, units = ("flow", "air", "pressure"), ("m3/s", "K", "Pa")
    run = FreeRun("a", names, units, np.arange(20.0), seen, seen - 0.1)
    shown = as_read(MODEL, run)
    assert shown.measured[0] == pytest.approx([1800.0, 20.0, 2e5])
    assert shown.error[0] == pytest.approx([360.0, 0.1, 0.1])
    sizes = sizes_as_read(MODEL, {"flow": 0.1, "air": 0.1, "pressure": 5.0})
    assert sizes == pytest.approx({"flow": 360.0, "air": 0.1, "pressure": 5.0})
    labels = [axes.get_ylabel() for axes in diagnosis_runs({"refitted": shown}).axes]
    assert labels == ["flow in m³/h", "air in °C", "pressure in Pa", "flow in m³/h"]


@pytest.mark.parametrize(("step", "unit"), [(1.0, "s"), (360.0, "h"), (36000.0, "d")])
def test_long_runs_are_drawn_over_hours_or_days(step: float, unit: str) -> None:
    time, seen = step * np.arange(100.0), np.sin(np.arange(100.0))[:, None]
    run = FreeRun("a", ("flow",), ("m3/s",), time, seen, 0.8 * seen)
    runs = {"refitted": run}
    size = {"s": 1.0, "h": 3600.0, "d": 86400.0}[unit]
    for drawn in (diagnosis_runs(runs), diagnosis_residuals(runs, {"flow": 0.1})):
        drawn.draw_without_rendering()
        axes = drawn.axes[0]
        ticks = dict(zip(axes.get_xticks(), axes.get_xticklabels(), strict=True))
        low, high = axes.get_xlim()
        told = {at / size: text.get_text() for at, text in ticks.items() if low <= at <= high}
        assert len(told) > 3
        shown = {at: float(text) for at, text in told.items() if text and unit != "s"}
        assert list(shown) == pytest.approx(list(shown.values()), rel=1e-5)
        assert drawn.axes[-1].get_xlabel().startswith(f"time in {unit}")


def test_what_a_slow_sensor_read_is_drawn_wherever_it_did() -> None:
    time = np.arange(3000.0)
    seen = np.where(time % 10.0 == 3.0, np.sin(0.01 * time), np.nan)[:, None]
    # With every other sample for a page, none of those was among them.
    run = FreeRun("a", ("flow",), ("1",), time, seen, np.sin(0.01 * time)[:, None])
    drawn = diagnosis_runs({"refitted": run})
    measured = np.asarray(drawn.axes[0].lines[0].get_ydata(), dtype=float)
    assert len(measured) == 300 and np.isfinite(measured).all()


def test_the_zero_of_a_scale_has_no_part_in_an_error() -> None:
    outputs = (Output("air", "K", 1.0, display_unit="degF"),)
    model = Model(
        "room",
        lambda m: ({"air": -m.x.air}, {"air": m.x.air}),
        states=(State("air", "K", 1.0),),
        inputs=(),
        outputs=outputs,
    )
    seen = np.full((20, 1), 293.15)
    run = FreeRun("a", ("air",), ("K",), np.arange(20.0), seen, seen - 5.0)
    assert as_read(model, run).measured[0] == pytest.approx([68.0])
    error = as_read(model, run, errors=True)
    assert error.rmse["air"] == pytest.approx(9.0)
    (axes,) = diagnosis_residuals({"refitted": error}, sizes_as_read(model, {"air": 0.05})).axes
    assert axes.get_ylabel() == "error of air in Δ°F"


def test_errors_beside_a_sensor_whose_noise_nobody_knows_have_no_band() -> None:
    seen = np.sin(0.1 * np.arange(100.0))[:, None]
    run = FreeRun("a", ("flow",), ("1",), np.arange(100.0), seen, 0.9 * seen)
    (axes,) = diagnosis_residuals({"refitted": run}, {}).axes
    low, high = axes.get_ylim()
    assert not axes.patches and 1e-3 < low < high < 1.0
