"""The first screen of a diagnosis: each finding with its place and time."""

from __future__ import annotations

from dataclasses import replace

from workbench.diagnosis.comparison import Proof
from workbench.diagnosis.location.missing_signal import Occurrence, Place, Span
from workbench.diagnosis.stages import Diagnosis, Prepared
from workbench.diagnosis.verdict import Finding, Verdict
from workbench.plants.servo_axis import servo_axis
from workbench.reports.diagnosis_answers import diagnosis_answers

AXIS = servo_axis()
SEEN = Occurrence(
    "axis.force", "N", 1.0, 2.0, (Span("run", 1.0, 2.0, 0.9),), 0.1,
    (Place("speed", "m/s", 0.9, ((0.1, 0.2),), 0.1),),
)  # fmt: skip
WITH = "with speed (90 % of its variance), most at 100 to 200 mm/s"
ONE = Finding(("axis.force",), "creep", ("creep",), "Missing: creep.", occurrence=SEEN)


def _said(verdict: Verdict) -> dict[str, str]:
    empty = Diagnosis(AXIS, Prepared((), (), ()))
    return dict(diagnosis_answers(empty, Proof((), ()), verdict).entries)


def test_a_single_finding_needs_no_name_before_its_place() -> None:
    said = _said(Verdict("named", "Missing: creep.", AXIS, findings=(ONE,)))
    assert said["where"] == f"axis.force, {WITH}"
    assert said["when"] == "from 1 to 2 s of run, up to 2 N rms"


def test_each_of_several_findings_has_its_place_and_time() -> None:
    other = replace(ONE, effect="ripple", where=("axis.other",), occurrence=None)
    said = _said(Verdict("named", "Missing: creep.", AXIS, findings=(ONE, other)))
    assert said["where"] == f"creep: axis.force, {WITH}; ripple: axis.other"
    assert said["when"] == "creep: from 1 to 2 s of run, up to 2 N rms"


def test_times_of_hours_and_of_milliseconds_are_told_in_these() -> None:
    hours = Span("run", 1.8e4, 5.4e4, 0.9), Span("run", 0.0, 3600.0, 0.8)
    short = (Span("run", 2e-4, 0.021, 0.9),)
    for spans, told in ((hours, "from 0 to 1 and 5 to 15 h"), (short, "from 0.2 to 21 ms")):
        seen = replace(SEEN, spans=spans, period=9e4)
        said = _said(Verdict("unexplained", "Something is left out.", AXIS, occurrence=seen))
        assert said["when"] == f"{told} of run, up to 2 N rms, every 25 h"


def test_what_could_not_be_located_has_a_time_and_a_signal() -> None:
    said = _said(Verdict("unexplained", "Something is left out.", AXIS, occurrence=SEEN))
    assert said["where"] == WITH
    assert said["when"].startswith("from 1 to 2 s")
    assert "where" not in _said(Verdict("nothing_missing", "Nothing is missing.", AXIS))
