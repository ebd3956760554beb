"""Location: an unknown input gains where something is missing, and nowhere else."""

from __future__ import annotations

from tests.diagnosis.axis_case import diagnosed
from workbench.diagnosis.location.locate import Location, groups_of
from workbench.plants.arm import arm


def test_groups_are_those_ports_that_may_leave_something_out() -> None:
    groups = groups_of(arm(3))
    assert groups == {
        "chamber_1": ("chamber_1.flow",),
        "chamber_2": ("chamber_2.flow",),
        "joint": ("joint.torque",),
    }


def test_hidden_friction_is_located_and_gone_afterwards() -> None:
    found = diagnosed(True)
    assert found.before is not None and found.after is not None
    assert found.before.best == "axis"
    # Units of log likelihood: thousands against what another excitation would change by chance.
    assert found.before.alone["axis"] > 300
    assert found.after.alone["axis"] < 0.3 * found.before.alone["axis"]


def test_nothing_is_located_where_nothing_is_hidden() -> None:
    found = diagnosed(False)
    assert found.before is not None and found.before.alone["axis"] < 5


def test_location_prints_the_groups_by_gain() -> None:
    text = str(Location({"a": 1.0, "b": 50.0}, {"a": 0.0, "b": 40.0}, 55.0))
    assert text.index("b ") < text.index("a  ")
