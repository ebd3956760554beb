"""Search: what is taken back, and why."""

from __future__ import annotations

from workbench.diagnosis.example_diagnosis import example_diagnosis
from workbench.diagnosis.selection.rules import LEAST_SHARE
from workbench.diagnosis.selection.search import _withdrawn


def test_effects_that_explain_too_little_are_taken_back_with_the_reason() -> None:
    given, _ = example_diagnosis()
    assert given.selected is not None
    gain = given.base.cost - given.selected.fits[1].cost
    left = _withdrawn(given.selected, gain / (0.5 * LEAST_SHARE.value))
    assert left.accepted == () and left.extended is given.base
    ((candidate, why),) = left.withdrawn
    assert candidate.entry.name == "coulomb_friction"
    assert why.startswith(f"explains too little: {50 * LEAST_SHARE.value:.0f} %")
    assert _withdrawn(given.selected, gain) is given.selected
