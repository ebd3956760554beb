"""Search: what is taken back, and why."""

from __future__ import annotations

from dataclasses import replace

from workbench.diagnosis.example_diagnosis import example_diagnosis
from workbench.diagnosis.selection.search import LEAST_SHARE, _withdraw


def test_effects_that_explain_too_little_are_taken_back_with_the_reason() -> None:
    given, _ = example_diagnosis()
    passed = [given.base, given.extended]
    gain = given.base.cost - given.extended.cost
    found = replace(
        given, accepted=list(given.accepted), withdrawn=[], excess=gain / (0.5 * LEAST_SHARE)
    )
    _withdraw(found, passed)
    assert found.accepted == [] and found.extended is given.base
    ((candidate, why),) = found.withdrawn
    assert candidate.entry.name == "coulomb_friction"
    assert why.startswith(f"explains too little: {50 * LEAST_SHARE:.0f} %")
    kept = replace(given, accepted=list(given.accepted), withdrawn=[], excess=gain)
    _withdraw(kept, passed)
    assert kept.withdrawn == [] and kept.accepted == given.accepted
