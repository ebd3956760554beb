"""Isolability: against small systems with known answers, random ranks and the groups of the arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.machines import machine
from workbench.diagnosis.location.isolability import Transfers, isolability
from workbench.diagnosis.location.structure import Structure, cut, structure_of
from workbench.errors import WorkbenchError
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.plants.arm import arm
from workbench.plants.cascaded_tanks import cascaded_tanks
from workbench.plants.servo_axis import servo_axis

READ = ("angle", "pressure_1", "pressure_2")


def two_tanks() -> Model:
    """x1' = inflow - between, x2' = between - outflow, both levels read."""

    def equations(m: Scope) -> Equations:
        x, p = m.x, m.p
        inflow = m.port("upper.inflow", m.u.pump, unit="1")
        between = m.port("upper.outflow", p.drain * x.upper, unit="1")
        outflow = m.port("lower.outflow", p.drain * x.lower, unit="1")
        measurements = {n: m.port(f"{n}.reading", x[n], unit="1") for n in ("upper", "lower")}
        return {"upper": inflow - between, "lower": between - outflow}, measurements

    return machine(equations, "upper 1, lower 1", "pump 1", "upper 1, lower 1", "drain 1/s 0.5")


def test_two_tanks_by_hand() -> None:
    # Residuals y1' - u + q1(y1) and y2' - q1(y1) + q2(y2): the outflow and the lower measurement
    # move the second alone, the inflow the first alone, the others both in different ways.
    found = isolability(two_tanks())
    assert set(found.groups) == {
        ("upper.inflow",),
        ("upper.outflow",),
        ("lower.outflow", "lower.reading"),
        ("upper.reading",),
    }
    assert found.unseen == ()
    # With the lower level alone there is one residual, which tells nothing apart.
    assert len(isolability(two_tanks(), outputs=("lower",)).groups) == 1
    # With the upper level alone nothing that happens below is seen.
    upper = isolability(two_tanks(), outputs=("upper",))
    assert upper.groups == (("upper.inflow", "upper.outflow", "upper.reading"),)
    assert set(upper.unseen) == {"lower.outflow", "lower.reading"}


def test_a_meter_splits_what_a_level_cannot() -> None:
    (sensor, *_) = isolability(two_tanks()).sensors_that_split(["lower.outflow"])
    assert sensor.splits == ((("lower.outflow",), ("lower.reading",)),)
    single = isolability(two_tanks(), outputs=("lower",))
    first = single.sensors_that_split()[0]
    # The second level makes the four groups of the test above.
    assert first.gained == 3 or "upper" in {s.signal for s in single.sensors_that_split()}
    upper = next(s for s in single.sensors_that_split() if s.signal == "upper")
    assert len(upper.splits[0]) == 3


def test_equal_directions_are_joined_although_the_structure_differs() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        one = m.port("a.one", m.u.push, unit="1")
        two = m.port("b.two", 0.0 * m.u.push, unit="1")
        return {"x": one + two - m.x.x, "y": 2 * one + 2 * two - m.x.y}

    model = machine(equations, "x 1, y 1", "push 1", "x 1, y 1")
    structure, _ = structure_of(cut(model), ("x", "y"))
    # Every output is read at a port of its own.
    assert {("a.one",), ("b.two",)} < set(structure.groups()[0])
    assert ("a.one", "b.two") in isolability(model).groups


def test_checkable_equations_are_those_a_random_matrix_can_lose() -> None:
    # An independent route: a row belongs to the overdetermined part if the generic rank is the
    # same without it, and the rank of random numbers is generic.
    rng = np.random.default_rng(1)
    for _ in range(50):
        holds = rng.random((9, 7)) < 0.25
        numbers = np.where(holds, rng.normal(size=holds.shape), 0.0)
        rank = np.linalg.matrix_rank(numbers)
        without = [np.linalg.matrix_rank(np.delete(numbers, i, axis=0)) == rank for i in range(9)]
        structure = Structure(holds, tuple("1234567"))
        assert structure.checkable().tolist() == without


def test_the_groups_of_the_arm() -> None:
    found = isolability(arm(load_kg=3), outputs=READ)
    assert {"joint.torque", "muscle_1.force", "muscle_2.force"} <= set(
        found.group_of("joint.torque")
    )
    for i in (1, 2):
        chamber = set(found.group_of(f"chamber_{i}.flow"))
        assert {f"valve.supply_{i}", f"valve.exhaust_{i}", f"muscle_{i}.volume"} <= chamber
        assert "joint.torque" not in chamber and f"chamber_{3 - i}.flow" not in chamber
        assert "valve.spool" not in chamber
        assert found.group_of(f"pressure_{i}.reading") == (f"pressure_{i}.reading",)
    assert found.group_of("angle.reading") == ("angle.reading",)
    assert "load_cell.reading" in found.unseen
    assert "joint.torque" in str(found)


@pytest.mark.long
def test_sensors_that_split_the_groups_of_the_arm() -> None:
    found = isolability(arm(load_kg=3), outputs=READ)
    by_force = {s.text: s for s in found.sensors_that_split(["joint.torque"])}
    parts = by_force["muscle_1.force"].splits[0]
    assert ("muscle_1.tension", "muscle_1.force") in parts
    by_flow = {s.text: s for s in found.sensors_that_split(["chamber_1.flow"])}
    meter = by_flow["chamber_1.flow (as it enters)"].splits[0]
    where = {port: i for i, part in enumerate(meter) for port in part}
    assert where["valve.supply_1"] == where["valve.exhaust_1"] != where["chamber_1.flow"]


def test_a_recorded_load_cell_sees_the_lower_stop() -> None:
    found = isolability(arm(load_kg=3))
    assert found.group_of("lower_stop.torque") == ("lower_stop.torque",)
    assert found.group_of("load_cell.reading") == ("load_cell.reading",)


@pytest.mark.parametrize("plant", [servo_axis, cascaded_tanks])
def test_a_single_sensor_tells_nothing_apart(plant: type) -> None:
    assert len(isolability(plant()).groups) == 1


def test_unknown_names_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="did you mean 'position'"):
        isolability(servo_axis(), outputs=("positon",))
    with pytest.raises(WorkbenchError, match=r"axis\.force"):
        isolability(servo_axis()).group_of("axis.fork")


def test_where_no_point_can_be_linearised_no_ports_are_alike() -> None:
    # A ratio of the equations is infinite for the values that parameters have.
    nowhere = Transfers(("a.rate", "b.rate"), np.zeros((0, 1, 2), dtype=np.complex128), {})
    assert np.isnan(nowhere.sines()).all()
