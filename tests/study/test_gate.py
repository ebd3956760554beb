"""Attempts to fool the gate of a pull request: each ends red, or says what it leaves open."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.study.gate import Gate, finished_gate
from workbench.reports.study_page import study_page
from workbench.study.junit import junit
from workbench.study.result import StudyResult
from workbench.study.summary import plain_summary, summary

NARROW = ("limit = 0.6", "limit = 0.495")
"""A limit that holds on the plant and its variation, and not everywhere in the box."""

INFORMS = ("draws = 4", "hard = false\ndraws = 4")


@pytest.fixture(scope="module")
def gate(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gate]:
    """A finished study."""
    yield finished_gate(tmp_path_factory.mktemp("gate"))


def said(outcome: StudyResult) -> dict[str, str]:
    """Return the first line of everything that a reviewer reads."""
    return {
        "headline": outcome.headline(),
        "terminal": plain_summary(outcome).splitlines()[-1],
        "summary": summary(outcome).splitlines()[0],
    }


@pytest.mark.parametrize("place", ["headline", "terminal", "summary"])
def test_nominal_variations_box_and_soft_misses_are_in_the_first_line(
    gate: Gate, place: str
) -> None:
    line = said(gate.compared(NARROW, INFORMS))[place]
    assert "2 of 2 hard requirements met nominally" in line
    assert "2 of 2 on the variations" in line
    assert "box missed by 1 of 1" in line and "settling time" in line and "of 4 plants" in line
    assert "which only informs" in line and "4 of 4 soft ones missed" in line


def test_a_requirement_on_the_box_is_hard_unless_said_otherwise(gate: Gate) -> None:
    outcome = gate.compared(NARROW)
    assert not outcome.missed and not outcome.passed
    assert "failed, box missed" in outcome.verdict() and "### Missed in the box" in summary(outcome)
    assert "worst plant of the box" in junit(outcome) and "<failure" in junit(outcome)


def test_a_box_that_only_informs_is_named_in_title_table_and_junit(gate: Gate) -> None:
    outcome = gate.compared(NARROW, INFORMS)
    page = study_page(outcome)
    assert "passed, box missed, 4 soft missed" in page.title and "box missed" in page.lead
    assert "⚠️ pid" in summary(outcome) and "pid                  box" in plain_summary(outcome)
    assert "(only informs)" in junit(outcome)
    names = [picture.name for picture in page.pictures]
    # The trajectory on the worst plant stands beside the nominal one.
    assert names.index("worst-1") == names.index("tracking-1") + 1
