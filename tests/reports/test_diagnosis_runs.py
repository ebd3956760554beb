"""Free runs as pages draw them."""

import numpy as np
import pytest

from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.model import Model, Output, State
from workbench.reports.figures.diagnosis_runs import as_read, diagnosis_runs, sizes_as_read

MODEL = Model(
    "duct",
    lambda m: ({"flow": -m.x.flow}, {"flow": m.x.flow, "air": m.x.flow, "pressure": m.x.flow}),
    states=(State("flow", "m3/s", 1.0),),
    inputs=(),
    outputs=(
        Output("flow", "m3/s", 1.0, display_unit="m3/h"),
        Output("air", "K", 1.0, display_unit="degC"),
        Output("pressure", "Pa", 1.0),
    ),
)


def test_runs_are_drawn_in_the_units_that_the_outputs_declare() -> None:
    seen = np.tile([0.5, 293.15, 2e5], (20, 1))
    run = FreeRun(
        "a", ("flow", "air", "pressure"), ("m3/s", "K", "Pa"), np.arange(20.0), seen, seen - 0.1
    )
    shown = as_read(MODEL, run)
    assert shown.measured[0] == pytest.approx([1800.0, 20.0, 2e5])
    assert shown.error[0] == pytest.approx([360.0, 0.1, 0.1])
    assert sizes_as_read(MODEL, {"flow": 0.1, "air": 0.1, "pressure": 5.0}) == pytest.approx(
        {"flow": 360.0, "air": 0.1, "pressure": 5.0}
    )
    labels = [axes.get_ylabel() for axes in diagnosis_runs(shown).axes]
    assert labels == ["flow in m³/h", "air in °C", "pressure in bar", "flow in m³/h"]
