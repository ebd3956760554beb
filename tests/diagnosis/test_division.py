"""What is held out where nobody says, and what stands for a plant in a diagnosis."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.division import with_some_held_out
from workbench.errors import WorkbenchError
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording, Signal

AXIS = servo_axis()


def run(name: str, samples: int) -> Recording:
    time = 0.01 * np.arange(samples)
    force = Signal("force", np.zeros(samples), "N", role="command")
    return Recording(name, time, (force, Signal("position", np.sin(time), "m")))


def test_the_last_of_several_is_held_out_and_of_one_its_last_part() -> None:
    a, b = run("a", 400), run("b", 400)
    assert with_some_held_out(AXIS, [a], [b]) == (((a,), (b,)), "")
    assert with_some_held_out(AXIS, [a, b], []) == (
        ((a,), (b,)),
        "no recording is held out (--hold-out), so b is",
    )
    ((fit,), (held,)), said = with_some_held_out(AXIS, [a], [])
    assert len(fit) + len(held) == 400 and fit.time[-1] < held.time[0]
    assert 0.3 < len(held) / 400 <= 0.5 and "of a are" in said
    with pytest.raises(WorkbenchError, match="short has 60 samples"):
        with_some_held_out(AXIS, [run("short", 60)], [])
    with pytest.raises(WorkbenchError, match="no recording to fit on"):
        with_some_held_out(AXIS, [], [a])


def test_each_piece_between_gaps_that_is_of_use_is_a_recording_of_its_own() -> None:
    whole, held = run("a", 900), run("b", 400)
    kept = np.ones(900, dtype=bool)
    # What is left between the last two of the gaps is too short.
    kept[300:320] = kept[700:710] = kept[715:725] = False
    (fits, _), said = with_some_held_out(AXIS, [whole.take(kept)], [held])
    assert [r.name for r in fits] == ["a (1 of 4)", "a (2 of 4)", "a (4 of 4)"]
    assert [len(r) for r in fits] == [300, 380, 175]
    assert (
        "a has 3 gap(s) too long to fill" in said
        and "300 rows from 0 s on and 380 rows from 3.2 s on" in said
    )
    again = with_some_held_out(AXIS, fits, [held])
    assert again == ((fits, (held,)), "")
    # So too where the clock counts otherwise, or rows are repeated.
    twice = np.sort([*np.flatnonzero(kept), 10])
    late = whole.at_times(1.7e12 + 1e3 * whole.time).take(twice)
    (others, _), told = with_some_held_out(AXIS, [late], [held])
    assert [len(r) for r in others] == [300, 380, 175] and "380 rows from 3.2 s on" in told
    assert with_some_held_out(AXIS, [whole.take(slice(0, 1))], [held])[1] == ""


@pytest.mark.long
def test_a_system_of_python_control_is_diagnosed_on_one_recording() -> None:
    time, rng = 0.02 * np.arange(1500), np.random.default_rng(1)
    drive = np.repeat(rng.uniform(-1.0, 1.0, 30), 50)
    # The machine is a fifth slower than is believed.
    slow = ct.ss(ct.tf([2.0], [0.6, 1.0]))
    _, read = ct.forced_response(ct.sample_system(slow, 0.02), time, drive)
    signals = Signal("u", drive, "1"), Signal("y", read + rng.normal(0.0, 0.01, 1500), "1")
    found = diagnose(ct.tf([2.0], [0.5, 1.0]), [Recording("lag", time, signals)], entries=())
    assert found.verdict.kind == "nothing_missing"
    values = {q.name: q.value for q in found.verdict.model.parameters}
    assert values["A_0_0"] == pytest.approx(-1.0 / 0.6, rel=0.02)
