"""Every design states itself once, and a user's function is a design too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from controllers.design import DESIGNS
from controllers.pid import PIDSpecification, ScheduledPIDSpecification, design_pid
from workbench.errors import WorkbenchError


def test_every_design_says_what_may_be_specified() -> None:
    for name, design in DESIGNS.members().items():
        assert design.name == name
        assert design.keys
        silent = [key.name for key in design.keys if not key.meaning]
        assert not silent, f"{name} says nothing about {silent}"


def test_families_have_one_colour_each() -> None:
    colours: dict[str, set[Any]] = {}
    for design in DESIGNS.members().values():
        colours.setdefault(design.family, set()).add(design.colour)
    assert all(len(found) == 1 for found in colours.values())
    known = [colour for (colour,) in map(tuple, colours.values()) if colour]
    assert len(known) == len(set(known)) >= 3


def test_a_specification_is_checked() -> None:
    pid = DESIGNS.get("pid")
    assert pid.specified({"bandwidth": 20.0}) == PIDSpecification(bandwidth=20.0)
    assert DESIGNS.get("scheduled_pid").specified({"frequency": 20.0}) == ScheduledPIDSpecification(
        frequency=20.0
    )
    with pytest.raises(WorkbenchError, match="key of the pid specification"):
        pid.specified({"bandwith": 20.0})
    with pytest.raises(WorkbenchError, match="damping ratio"):
        pid.specified({"damping": 0.0})


def test_a_design_names_its_controller(linear: Any) -> None:
    pid = DESIGNS.get("pid")
    assert pid.controller(linear, pid.specified({}), name="mine").name == "mine"


OWN = """
from controllers.pid import design_pid, PIDSpecification

def gentle(linear, specification):
    "A gentle PID."
    return design_pid(linear, PIDSpecification(**specification))

def broken(linear, specification):
    return 1 / 0

def nothing(linear, specification):
    return None
"""


def test_a_users_function_is_a_design(linear: Any, tmp_path: Path) -> None:
    (tmp_path / "own_designs.py").write_text(OWN)
    own = DESIGNS.get("own_designs:gentle", folder=tmp_path)
    assert (own.summary, own.needs, own.own) == ("A gentle PID.", "linear", True)
    law = own.controller(linear, own.specified({"bandwidth": 20.0}))
    assert law.gains == design_pid(linear, PIDSpecification(bandwidth=20.0)).gains
    for name, told in (("broken", "ZeroDivisionError.*own_designs.py"), ("nothing", "NoneType")):
        design = DESIGNS.get(f"own_designs:{name}", folder=tmp_path)
        with pytest.raises(WorkbenchError, match=told):
            design.controller(linear, {})
