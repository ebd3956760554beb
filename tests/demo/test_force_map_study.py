"""Force laws on measured and on made-up force maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.demo.made_up_map import made_up_map
from workbench.demo.force_map_study import ForceMap, study_map
from workbench.errors import WorkbenchError
from workbench.physics.force_laws import PaperLaw
from workbench.recordings import read_table
from workbench.recordings.public_data import public_file


def test_the_law_that_made_a_map_is_the_best_on_it() -> None:
    rng = np.random.default_rng(0)
    points = made_up_map()
    truth = PaperLaw((280.0, -2.2, 0.033), (-10.0, -12.0, -0.3, 0.005), 0.0, phi_switch=-1.0)
    force = np.asarray(truth.force(points.contraction, points.pressure))
    noisy = ForceMap(points.pressure, points.length, force + rng.normal(0, 1.0, 70))
    study = study_map(noisy, "made up")
    assert study.best.name.startswith("paper")
    assert study.need_for_phi > 3.0
    law = study.law("paper_3")
    # Noise of 1 N: the fit leaves it, a length held out is extrapolated a little.
    assert 0.7 < law.fitted_rms_N < 1.3
    numbers = (*truth.gain_bar_mm, *truth.phi_mm)
    for value, std, true in zip(law.values, law.std, numbers, strict=True):
        assert abs(value - true) < 4 * std


@pytest.mark.parametrize(
    ("muscle", "published_percent"), [("dmsp-20-300", 2.35), ("dmsp-10-250", 4.4)]
)
def test_measured_maps_need_phi(
    external_folder: Path, muscle: str, published_percent: float
) -> None:
    name = f"martens2017-festo-force-maps/{muscle}_static_force.csv"
    table = read_table(public_file(name, data=external_folder))
    study = study_map(ForceMap(table["pressure"], table["length"], table["force"]), muscle)
    percent = 100 / study.largest_force
    for best in (study.law("paper_3"), study.law("sarosi")):
        # The best published model of these muscles stays below this at its worst point.
        assert percent * best.fitted_largest_N < published_percent
        assert percent * best.lengths_held_out_largest_N < 3.0
    assert study.need_for_phi > 5.0
    orders = [study.law(f"paper_{n}").pressures_held_out_rms_N for n in range(4)]
    assert orders == sorted(orders, reverse=True)


def test_too_few_lengths_are_refused() -> None:
    points = made_up_map()
    with pytest.raises(WorkbenchError, match="needs 4 or more"):
        study_map(points.take(points.contraction < 0.011), "short")


@pytest.mark.parametrize(
    ("of", "factor"),
    [("pressure", 100.0), ("pressure", 0.01), ("pressure", 1e5), ("pressure", 1e-5),
     ("length", 1e3), ("length", 1e-3), ("force", 1e3), ("force", 1e-3)],
)  # fmt: skip
def test_a_map_in_a_wrong_unit_is_refused(of: str, factor: float) -> None:
    points = made_up_map()
    wrong = {
        name: getattr(points, name) * (factor if name == of else 1.0)
        for name in ("pressure", "length", "force")
    }
    with pytest.raises(WorkbenchError, match="check the units of pressure, length and force"):
        study_map(ForceMap(**wrong), "wrong")
