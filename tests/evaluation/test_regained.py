"""Speed lost to what was not known of a machine, and regained from what was found."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.evaluation.regained import WHICH, DesignRun, flow_share, nominal_recipe, regained
from workbench.evaluation.tolerance import tolerant_study
from workbench.plants.arm.arm import ARM
from workbench.reports.page import write_page
from workbench.reports.regained_page import regained_page, regained_table
from workbench.study.plants import PlantRecipe

LINES = (("lines.share", 1.0), ("lines.conductance", 1e-8), ("lines.volume", 15e-6))


def late() -> PlantRecipe:
    """Return a machine that is 8 ms late, with lines of a third of the valve."""
    found = ("valve_delay.time", 0.008)
    plant = tolerant_study().plant
    return plant.varied(effects=["valve_delay", "lines"], parameters=[found, *LINES])


def test_a_line_of_a_third_of_the_valve_leaves_a_third_of_the_flow() -> None:
    nominal = tolerant_study().plant.build()
    assert flow_share(late().build(), nominal, ARM) == pytest.approx(1.0 / 3.0, abs=0.08)
    assert flow_share(nominal, nominal, ARM) == pytest.approx(1.0)


def test_the_rules_of_a_redesign_are_those_of_the_nominal_designs() -> None:
    recipe = nominal_recipe("cascade PID", late())
    assert recipe.fastest is not None and recipe.fastest.maximum_sensitivity == 2.0
    assert not recipe.plant.build().dry_effects
    with pytest.raises(WorkbenchError, match="controller"):
        nominal_recipe("fuzzy", late())


def test_the_page_sets_the_three_designs_side_by_side(tmp_path: Path) -> None:
    time = np.arange(0.0, 2.0, 0.01)
    told = {"settling": [0.2, 0.4], "overshoot": 0.02, "oscillation": math.radians(0.1)}
    runs = [
        DesignRun("state feedback", w, 20.0, "", None, told, time, 0.3 + 0 * time) for w in WHICH
    ]
    table = regained_table(runs)
    assert [row[1] for row in table.rows] == list(WHICH) and table.rows[0][3] == "0.300"
    page = write_page(regained_page(runs, "verdict.json"), tmp_path / "redesign.html")
    text = page.read_text()
    assert "redesigned, on the machine" in text
    # An axis says its quantity, a panel its controller.
    assert "angle in °" in text and "state feedback (" not in text


@pytest.mark.long
def test_what_was_found_gives_the_speed_back() -> None:
    nominal, tolerant, own = (
        max(run.told["settling"]) for run in regained(late(), ["state feedback"])
    )
    # A third of the flow costs a factor 3^(1/3), the latency 8 ms.
    assert own <= nominal * 3.0 ** (1.0 / 3.0) + 0.008
    assert own <= 0.5 * tolerant
