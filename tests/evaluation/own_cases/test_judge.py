"""An answer is judged by what was hidden: names, places, sizes."""

from __future__ import annotations

import math
from typing import Any

import pytest

from tests.evaluation.own_cases.made_up import found, row, verdict
from workbench.evaluation.own_cases.statistics import judge, true_size, verdict_of

TILT = found("tilt_gravity", "joint.torque")
OFFSET = found("valve_offset", "valve.command")


@pytest.mark.parametrize(
    ("effects", "findings", "points", "located", "regions", "named", "wrong"),
    [
        (("tilt",), [TILT], 6, (True,), (True,), (True,), False),
        (("tilt",), [found("ripple", "joint.torque", "tilt_gravity")], 3, (True,), (True,), (True,),
         False),
        (("tilt",), [found("ripple", "joint.torque")], -6, (True,), (True,), (False,), True),
        (("tilt",), [OFFSET], -6, (False,), (False,), (False,), True),
        (("tilt",), [found(None, "joint.torque")], 2, (True,), (True,), (False,), False),
        (("tilt",), [], 0, (False,), (False,), (False,), False),
        # Air went missing, though from the other chamber.
        (("leak_muscle_1",), [found(None, "chamber_2.flow")], 1, (False,), (True,), (False,),
         False),
        (("tilt", "valve_offset"), [OFFSET, TILT], 12, (True, True), (True, True), (True, True),
         False),
        (("tilt", "valve_offset"), [TILT], 6, (True, False), (True, False), (True, False), False),
        ((), [TILT], -6, (), (), (), True),
        ((), [], 6, (), (), (), False),
        ((), [found(None, "joint.torque")], -6, (), (), (), False),
        (("pressure_gain",), [found("sensor_gain_pressure_1", "pressure_1.reading")], -6, (False,),
         (False,), (False,), True),
        (("coulomb_drift",), [found("stribeck_friction", "joint.torque")], -6, (True,), (True,),
         (False,), True),
    ],
)  # fmt: skip
def test_names_and_places(
    effects: tuple[str, ...],
    findings: list[dict[str, Any]],
    points: int,
    located: tuple[bool, ...],
    regions: tuple[bool, ...],
    named: tuple[bool, ...],
    wrong: bool,
) -> None:
    judged = judge(row(1, effects, verdict(*findings)))
    assert judged is not None
    assert judged.line.points == points
    assert (judged.line.located, judged.regions, judged.line.named) == (located, regions, named)
    assert judged.wrong == wrong


def test_a_wrong_name_with_a_doubt_is_not_a_confident_one() -> None:
    for belief, sure in (("sure", True), ("likely", False)):
        judged = judge(row(1, ("tilt",), verdict(OFFSET | {"belief": belief})))
        assert judged.wrong and judged.sure == sure


def test_a_nonparametric_term_in_the_right_group_is_right_outside_the_library() -> None:
    said = verdict(found(None, "joint.torque"), kind="located_unnamed")
    judged = judge(row(1, ("pressure_torque",), said, kind="outside"))
    assert judged.line.points == 6


def test_sizes_are_compared_where_both_state_the_same() -> None:
    tilt = found("tilt_gravity", "joint.torque", tilt=(0.072, 0.005))
    judged = judge(row(1, ("tilt",), verdict(tilt)))
    assert judged is not None
    (size,) = judged.sizes
    assert size.true == 0.08 and size.error == pytest.approx(0.1) and size.covered
    # The rig states the centre of the valve, the library the offset of the command.
    offset = found("valve_offset", "valve.command", amount=(0.15, 0.001))
    judged = judge(row(1, ("valve_offset",), verdict(offset)))
    assert judged.sizes[0].error == pytest.approx(0.0, abs=1e-9)
    # Half the size, from a parameter that stands at another value.
    smaller = row(1, ("valve_offset",), verdict(offset), factor=0.4)
    assert true_size(smaller, "valve_offset") == pytest.approx(0.06)
    judged = judge(smaller)
    assert not judged.sizes[0].covered


def test_the_held_out_error_is_over_that_of_the_true_model() -> None:
    judged = judge(row(1, (), verdict(scale=1.25)))
    assert judged.over_limit == pytest.approx(1.25)
    assert verdict_of(row(1, (), verdict()), "greedy") is None
    said = verdict(TILT)
    said["fit"]["held_out"].pop("extended")
    judged = judge(row(1, (), verdict(), sindy=said), "sindy")
    assert math.isnan(judged.over_limit) and judged.wrong
