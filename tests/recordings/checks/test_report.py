import numpy as np
import pytest

from tests.machines import machine
from tests.recordings.example import example_recording
from workbench.errors import WorkbenchError
from workbench.recordings import check_recording
from workbench.recordings.checks import CHECKS, Check, Finding

TRIAL = example_recording(seconds=4.0)


def test_table_and_data() -> None:
    report = check_recording(TRIAL)
    assert str(report).startswith("example: pass, not checked: units, signs (see why")
    data = report.as_data()
    assert [d["check"] for d in data][:3] == ["time base", "gaps", "constant signals"]
    assert all(d["recording"] == "example" and d["note"] for d in data)
    assert len(data) == 16


def test_unfit_recording_cannot_be_used() -> None:
    report = check_recording(TRIAL[:10])
    assert not report.fit
    assert report.check("time base").note.startswith("10 samples")
    assert check_recording(TRIAL).fit


def test_required_signal_is_missing() -> None:
    with pytest.raises(WorkbenchError, match="no signal 'force'"):
        check_recording(TRIAL, required=["force"])


def test_model_gives_ranges_and_required_signals() -> None:
    model = machine(
        lambda m: {"angle": m.u.valve}, "angle rad", "valve V 0 10", "angle rad lower=0 upper=0.3"
    )
    report = check_recording(TRIAL, model=model)
    assert "outside the plausible" in report.check("units").note
    assert "valve saturates" not in report.check("clipping").note


def test_corrections_add_up() -> None:
    keep = np.ones(len(TRIAL), dtype=bool)
    keep[[400, 900]] = False
    rows = np.sort(np.concatenate([np.flatnonzero(keep), [50]]))
    report = check_recording(TRIAL.take(rows))
    assert report.result == "corrected"
    assert [n.split(":")[0] for n in report.recording.notes] == ["time base", "gaps"]
    # A corrected recording passes: nothing is corrected twice.
    again = check_recording(report.recording)
    assert again.result == "pass", str(again)


def test_a_check_of_the_users_own(monkeypatch: pytest.MonkeyPatch) -> None:
    first = Check("wiring", 5, lambda recording, expected: Finding("unfit", "no plug"), True)
    members = {**CHECKS.members(), "wiring": first}
    monkeypatch.setattr(CHECKS, "members", lambda: members)
    report = check_recording(example_recording(seconds=2.0))
    assert [(c.name, c.result) for c in report.checks] == [("wiring", "unfit")]
