"""The diagnosed case: what the shipped verdict says shows in the runs and in the controllers."""

from __future__ import annotations

from workbench.demo.diagnosed_case import diagnosed_case_part
from workbench.reports.pictures import Picture


def test_what_was_found_improves_the_model_and_the_controller() -> None:
    part = diagnosed_case_part()
    assert "hysteresis" in part.results["effect"]
    errors, tracking = part.results["held_out_angle_rms_deg"], part.results["tracking_rms_deg"]
    assert errors["extended"] < 0.2 * errors["refitted"]
    assert tracking["after"] < 0.5 * tracking["before"]
    drawn = part.results["drawn_angle_rms_deg"]
    # The models of the verdict run here as they ran there, though along one recording only.
    for model, error in drawn.items():
        assert 0.3 * errors[model] < error < 3 * errors[model]
    assert isinstance(part.first, Picture) and "shipped verdict" in part.first.caption
